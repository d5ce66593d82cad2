"""The window of ``--view``: the simulation at the pace of real time."""

from __future__ import annotations

import time
from typing import Any, Final

from imitor.errors import SinkError
from imitor.visual.offscreen import headless

_REFRESH_S: Final = 1.0 / 60.0


def check_display() -> None:
    """Make sure that there is a display.

    Raises:
        SinkError: There is none.
    """
    if headless():
        raise SinkError(
            "no window can be opened: there is no display (DISPLAY and WAYLAND_DISPLAY are not set); "
            "take --view away, or set the option `video: true` for a video"
        )


class Window:
    """MuJoCo's viewer, fed after every step; once a person closes it the simulation runs on at full speed.

    Args:
        paced: Whether it waits for real time to catch up; where somebody else keeps time it need not.
    """

    def __init__(self, *, paced: bool = True) -> None:
        self._paced = paced
        self._viewer: Any = None
        self._begin_s = self._shown_s = 0.0

    def __call__(self, model: Any, data: Any) -> None:
        """Show the state when the next picture is due."""
        if self._viewer is None:
            self._viewer = _launch(model, data)
            self._begin_s = time.perf_counter() - data.time
        elif not self._viewer.is_running() or data.time - self._shown_s < _REFRESH_S:
            return
        self._shown_s = data.time
        self._viewer.sync()
        if self._paced:
            time.sleep(max(0.0, data.time - (time.perf_counter() - self._begin_s)))

    def close(self) -> None:
        """Close the window; safe to call again."""
        if self._viewer is not None:
            self._viewer.close()


def _launch(model: Any, data: Any) -> Any:
    import mujoco.viewer

    try:
        return mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False)
    except Exception as error:  # windowing systems fail in their own ways
        raise SinkError(
            f"no window can be opened: {error}; take --view away, or set `video: true`"
        ) from error
