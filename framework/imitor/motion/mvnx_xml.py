"""The XML of MVNX files: `read_elements` walks through a file and collects what a motion needs.

The file is read as a stream, so that its size costs memory for the numbers alone. Nothing outside the file is ever
loaded, and entity declarations are refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from xml.parsers import expat

import numpy as np

from imitor.errors import SourceError
from imitor.types import Array

VERSIONS: Final = ("3", "4")
MAX_SEGMENTS: Final = 1000
_FRAME_DATA: Final = frozenset({"orientation", "position", "centerOfMass", "footContacts"})
_POINT_DATA: Final = frozenset({"pos_b", "pos_s"})
_CUT: Final = tuple(
    expat.errors.codes[message]
    for message in (expat.errors.XML_ERROR_NO_ELEMENTS, expat.errors.XML_ERROR_UNCLOSED_TOKEN)
)
"""Errors of expat that mean that the file ends too early."""


@dataclass
class Frame:
    """A frame as written.

    Attributes:
        line: Where it begins.
        kind: Its type; ``normal`` when none is given.
        index: Its number.
        data: Tag -> line and numbers.
    """

    line: int
    kind: str
    index: str
    data: dict[str, tuple[int, Array]] = field(default_factory=dict)


class Elements:
    """What is needed of a file, collected while expat walks through it.

    Attributes:
        version, configuration, rate: As written; empty when the file does not say.
        subject_line: Where the subject begins.
        segments: Labels in order.
        points: (segment, point) -> coordinates, shape (3,) [m].
        contacts: Labels of the foot contacts in order.
        frames: All frames, calibration poses, too.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = path
        self.version, self.configuration, self.rate = "", "", ""
        self.subject_line = 0
        self.segments: list[str] = []
        self.points: dict[tuple[str, str], Array] = {}
        self.contacts: list[str] = []
        self.frames: list[Frame] = []
        self.open: list[str] = []  # the tags around the place at hand
        self._text: list[str] | None = None
        self._text_line = 0
        self._point = ""
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._characters
        self.parser.EntityDeclHandler = self._refuse_entity

    @property
    def line(self) -> int:
        """Line of the element at hand."""
        return self.parser.CurrentLineNumber

    def _refuse_entity(self, name: str, *_: object) -> None:
        raise SourceError(self.path, f"declares the entity '{name}'; MVNX has none: refused", self.line)

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        tag = tag.rpartition(":")[2]
        if not self.open:
            self._root(tag, attributes)
        self.open.append(tag)
        if tag == "subject":
            if self.subject_line:
                raise SourceError(self.path, "a second subject; write one file a person", self.line)
            self.subject_line = self.line
            self.rate, self.configuration = (
                attributes.get("frameRate", ""),
                attributes.get("configuration", ""),
            )
        elif tag == "segment" and self.open[-2:-1] == ["segments"]:
            self.segments.append(attributes.get("label", ""))
            if len(self.segments) > MAX_SEGMENTS:
                raise SourceError(self.path, f"more than {MAX_SEGMENTS} segments", self.line)
        elif tag == "point":
            self._point = attributes.get("label", "")
        elif tag == "contactDefinition":
            self.contacts.append(attributes.get("label", ""))
        elif tag == "frame":
            self.frames.append(
                Frame(self.line, attributes.get("type", "normal"), attributes.get("index", ""))
            )
        if (tag in _FRAME_DATA and self.frames) or tag in _POINT_DATA:
            self._text, self._text_line = [], self.line

    def _root(self, tag: str, attributes: dict[str, str]) -> None:
        if tag != "mvnx":
            raise SourceError(self.path, f"an MVNX file begins with <mvnx>, this one with <{tag}>", self.line)
        self.version = attributes.get("version", "")
        if self.version.split(".")[0] not in VERSIONS:
            raise SourceError(
                self.path,
                f"MVNX version '{self.version}' is unknown; known are {' and '.join(VERSIONS)}. "
                "Export the recording again with a current MVN",
                self.line,
            )

    def _characters(self, text: str) -> None:
        if self._text is not None:
            self._text.append(text)

    def _end(self, tag: str) -> None:
        tag = self.open.pop()
        if self._text is None or tag not in _FRAME_DATA | _POINT_DATA:
            return
        values = self._numbers(tag, "".join(self._text).split())
        self._text = None
        if tag in _POINT_DATA:
            if len(values) != 3:
                raise SourceError(
                    self.path, f"point '{self._point}' has {len(values)} coordinates", self._text_line
                )
            self.points[self.segments[-1] if self.segments else "", self._point] = values
        else:
            self.frames[-1].data[tag] = self._text_line, values

    def _numbers(self, tag: str, words: Sequence[str]) -> Array:
        try:
            values = np.array(words, dtype=np.float64)
            bad = np.flatnonzero(~np.isfinite(values))
        except ValueError:
            bad = np.array([i for i, w in enumerate(words) if not is_number(w)])
        if len(bad):
            k = int(bad[0])
            raise SourceError(
                self.path, f"value {k + 1} of <{tag}> is '{words[k]}', not a finite number", self._text_line
            )
        return values


def is_number(word: str) -> bool:
    """Tell whether a word is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def read_elements(path: str | Path) -> Elements:
    """Read the elements of an MVNX file.

    Raises:
        SourceError: The file cannot be read or is no well-formed MVNX; says where and why.
    """
    file = Path(path)
    if file.is_dir():
        raise SourceError(path, "is a folder; give an MVNX file")
    reader = Elements(path)
    try:
        with file.open("rb") as stream:
            head = stream.read(4096)
            if not head.strip():
                raise SourceError(path, "the file is empty")
            if b"\0" in head and not head.startswith((b"\xff\xfe", b"\xfe\xff")):
                hint = (
                    "; an .mvn file must be exported as MVNX from MVN"
                    if file.suffix.lower() == ".mvn"
                    else ""
                )
                raise SourceError(path, f"is not a text file, so not MVNX{hint}")
            stream.seek(0)
            reader.parser.ParseFile(stream)
    except FileNotFoundError:
        raise SourceError(path, "there is no such file") from None
    except OSError as error:
        raise SourceError(path, f"cannot be read: {error.strerror or error}") from error
    except expat.ExpatError as error:
        if error.code in _CUT and reader.open:
            message = f"the file ends inside <{reader.open[-1]}>: it is cut off; export or copy it again"
        else:
            message = f"is no well-formed XML: {expat.ErrorString(error.code)}"
        raise SourceError(path, message, error.lineno) from None
    return reader
