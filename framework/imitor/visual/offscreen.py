"""Off-screen pictures with MuJoCo's renderer: with EGL where there is no display."""

from __future__ import annotations

import os
import platform
import sys
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imitor.errors import SinkError

_OFF: Final = ("disable", "disabled", "off", "false", "0")
_MAX_GEOMS: Final = 2000
_REMEDY: Final = (
    "install EGL (Debian, Ubuntu: apt install libegl1 libgl1-mesa-dri) and set MUJOCO_GL=egl, "
    "or take `use: video` out of the pipeline's sinks"
)


def import_mujoco() -> Any:
    """Import MuJoCo; without a display it is told first to draw with EGL."""
    if "mujoco" not in sys.modules and headless():
        os.environ.setdefault("MUJOCO_GL", "egl")
    import mujoco

    return mujoco


def headless() -> bool:
    """Tell whether there is no display to draw on."""
    return platform.system() == "Linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )


def _context(width: int, height: int) -> Any:
    """Return a current OpenGL context, whatever MuJoCo was told when it was imported."""
    mujoco = import_mujoco()
    wanted = os.environ.get("MUJOCO_GL", "").lower().strip()
    if wanted in _OFF:
        raise SinkError(
            f"no off-screen rendering here: MUJOCO_GL={wanted} switches it off; unset it, or {_REMEDY}"
        )
    try:
        if wanted == "egl" or (not wanted and headless()):
            from mujoco.egl import GLContext
        else:
            GLContext = mujoco.GLContext
        context = GLContext(width, height)
        context.make_current()
    except Exception as error:  # drivers and loaders fail in their own ways
        reason = str(error).strip().split("\n", 1)[0] or type(error).__name__
        raise SinkError(f"no off-screen rendering here: {reason}; {_REMEDY}") from error
    return context


def check_rendering() -> None:
    """Make sure that pictures can be rendered.

    Raises:
        SinkError: They cannot; says what to install.
    """
    _context(16, 16).free()


class Offscreen:
    """Renders MuJoCo scenes of one model into arrays.

    Args:
        model: The MuJoCo model; its off-screen buffer must be as large as the pictures.
        size: Width and height [px].
        shadows: Whether shadows are cast; they take more than half of the time.

    Attributes:
        scene: The abstract scene; geoms may be added between `look` and `picture`.
        camera: A free camera.
    """

    def __init__(self, model: Any, size: tuple[int, int], *, shadows: bool = True) -> None:
        self._mujoco = mujoco = import_mujoco()
        self._model = model
        self._gl = _context(*size)
        self.scene = mujoco.MjvScene(model, maxgeom=_MAX_GEOMS)
        self.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        self.camera = mujoco.MjvCamera()
        self._option = mujoco.MjvOption()
        self._rect = mujoco.MjrRect(0, 0, *size)
        self._buffer = np.empty((size[1], size[0], 3), dtype=np.uint8)
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)

    def look(self, data: Any) -> None:
        """Fill the scene with the model's geoms as they stand in ``data``."""
        m = self._mujoco
        m.mjv_updateScene(
            self._model, data, self._option, None, self.camera, m.mjtCatBit.mjCAT_ALL.value, self.scene
        )

    def picture(self) -> NDArray[np.uint8]:
        """Render the scene, shape (height, width, 3)."""
        self._mujoco.mjr_render(self._rect, self.scene, self._context)
        self._mujoco.mjr_readPixels(self._buffer, None, self._rect, self._context)
        return self._buffer[::-1].copy()  # OpenGL counts rows from the bottom

    def close(self) -> None:
        """Free the graphics memory; safe to call again."""
        if self._gl is not None:
            self._gl.make_current()
            self._context.free()
            self._gl.free()
            self._gl = None
