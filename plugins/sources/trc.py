"""The source of TRC files."""

from __future__ import annotations

from imitor import hookimpl
from imitor.motion.marker_file import MarkerFile
from imitor.motion.marker_source import MarkerConfig, MarkerSource
from imitor.motion.trc_file import read_trc


class TrcConfig(MarkerConfig):
    """Options of the TRC source."""


class Trc(MarkerSource[TrcConfig]):
    """Reads optical markers from TRC files, with joint centres by published regressions."""

    name = "trc"
    extensions = (".trc",)
    gives = frozenset({"markers"})

    def read_file(self, path: str) -> MarkerFile:
        """Read the points."""
        return read_trc(path)


@hookimpl
def imitor_components() -> list[type[Trc]]:
    """Return the components of this module."""
    return [Trc]
