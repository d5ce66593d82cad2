"""The source of recordings of live runs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from pydantic import Field

from imitor import Config, HumanFrame, Source, hookimpl
from imitor.kinds import Tick
from imitor.live.received import RECEIVED_FILE, Received


class ReceivedConfig(Config):
    """Which recording."""

    path: Path = Field(description="Path of a received.npz that a live run has written.")


class ReceivedSource(Source[ReceivedConfig]):
    """Plays what a live run received, step by step: the same pipeline gives the same configurations."""

    name = "received"
    extensions = (".npz",)
    gives = frozenset({"orientation", "markers", "targets", "com", "support"})

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell whether this source can read the file, by its name."""
        return path.name == RECEIVED_FILE or path.name.endswith(f"-{RECEIVED_FILE}")

    def start(self) -> None:
        """Read the file."""
        self._received = Received(self.config.path)
        self.skeleton, self.rate_hz = self._received.skeleton, self._received.rate_hz
        self.n_frames = len(self._received)

    def ticks(self) -> Iterator[Tick]:
        """Yield the steps of the live run."""
        return self._received.ticks()

    def frames(self) -> Iterator[HumanFrame]:
        """Yield the frames that had arrived."""
        return (tick.frame for tick in self._received.ticks() if tick.frame is not None)

    def first_frames(self) -> Iterator[HumanFrame]:
        """Yield the frames that stages were calibrated with; of a run without any, those that had arrived."""
        first = list(self._received.calibrated_with)
        return iter(first) if first else self.frames()


@hookimpl
def imitor_components() -> list[type[ReceivedSource]]:
    """Register the source."""
    return [ReceivedSource]
