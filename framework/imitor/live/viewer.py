"""Viewers get the newest frame when they are ready for one; a slow one delays nobody."""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from imitor.errors import told
from imitor.kinds import Sink
from imitor.live.mailbox import Mailbox
from imitor.live.solved import Mirror, Solved
from imitor.tasks import TaskStack

log = logging.getLogger("imitor")


class Viewers(threading.Thread):
    """Writes the newest frame to sinks that may miss some; one that fails is left out from then on.

    Args:
        stack: The tasks; copied.
        sinks: The viewers, with their names for messages.
    """

    def __init__(self, stack: TaskStack, sinks: Sequence[tuple[str, Sink[Any]]]) -> None:
        super().__init__(name="imitor-viewers", daemon=True)
        self.box: Mailbox[Solved] = Mailbox()
        self.shown = 0
        self._stack, self._sinks = stack.twin(), list(sinks)
        self._closing = threading.Event()

    def close(self) -> None:
        """Stop after the frame that is being shown."""
        self._closing.set()
        self.box.close()
        if self.is_alive():
            self.join(5.0)

    def run(self) -> None:
        """Show until closed."""
        mirror: Mirror | None = None
        while not self._closing.is_set() and self._sinks:
            solved = self.box.take(0.5)
            if solved is None:
                continue
            mirror = mirror or Mirror(self._stack, solved)
            np.copyto(mirror.state.q, solved.q)
            mirror.take(solved)
            self._show(mirror)

    def _show(self, mirror: Mirror) -> None:
        for item in list(self._sinks):
            where, sink = item
            try:
                sink.write(mirror.record)
            except Exception as error:  # a viewer that was closed is no reason to stop a robot
                log.warning("%s: %s; it is left out from now on", where, told(error))
                self._sinks.remove(item)
        self.shown += 1

    def figures(self) -> dict[str, Any]:
        """Return what is told of it in the report."""
        return {"shown": self.shown, "replaced": self.box.replaced}


__all__ = ["Viewers"]
