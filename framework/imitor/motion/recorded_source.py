"""The base of sources that read a whole file before the first frame."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

from imitor.kinds import Config, Source
from imitor.motion.clip import Clip
from imitor.types import HumanFrame

C = TypeVar("C", bound=Config)


class RecordedSource(Source[C]):
    """Reads a file as a clip and plays it.

    Attributes:
        recording: The clip; set by `start`.
    """

    recording: Clip

    def read(self) -> Clip:
        """Read the whole file and bring it into our world.

        Raises:
            SourceError: The file cannot be used; says where and why.
            SpecError: A card that it needs is wrong.
        """
        raise NotImplementedError

    def start(self) -> None:
        """Read the file."""
        self.recording = self.read()
        self.skeleton = self.recording.skeleton
        self.rate_hz = self.recording.rate_hz
        self.n_frames = len(self.recording)

    def frames(self) -> Iterator[HumanFrame]:
        """Yield the frames; their arrays cannot be written."""
        return self.recording.frames()
