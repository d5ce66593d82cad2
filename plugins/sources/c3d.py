"""The source of C3D files."""

from __future__ import annotations

from imitor import hookimpl
from imitor.motion.c3d_file import EXTRA, read_c3d
from imitor.motion.marker_file import MarkerFile
from imitor.motion.marker_source import MarkerConfig, MarkerSource


class C3dConfig(MarkerConfig):
    """Options of the C3D source."""


class C3d(MarkerSource[C3dConfig]):
    """Reads optical markers from C3D files, with joint centres by published regressions."""

    name = "c3d"
    extensions = (".c3d",)
    extra = EXTRA
    gives = frozenset({"markers"})

    def read_file(self, path: str) -> MarkerFile:
        """Read the points."""
        return read_c3d(path)


@hookimpl
def imitor_components() -> list[type[C3d]]:
    """Return the components of this module."""
    return [C3d]
