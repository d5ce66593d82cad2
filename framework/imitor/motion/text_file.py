"""Text files of motions: read whole, whatever their code page and line ends."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from imitor.errors import SourceError

MAX_BYTES: Final = 1_000_000_000
"""Bound on the size of a file, so that a broken or hostile one cannot take all memory [bytes]."""
_HEAD: Final = 4096


def read_text(path: str | Path, wanted: str) -> str:
    """Return the text of a file, with plain line ends.

    Args:
        path: The file.
        wanted: What it should be, for messages, e.g. ``a BVH file``.

    Raises:
        SourceError: It cannot be read, is empty, too large, or no text.
    """
    file = Path(path)
    if file.is_dir():
        raise SourceError(path, f"is a folder; give {wanted}")
    try:
        size = file.stat().st_size
        if size > MAX_BYTES:
            raise SourceError(path, f"has {size} bytes; files up to {MAX_BYTES} are read: cut it into parts")
        data = file.read_bytes()
    except FileNotFoundError:
        raise SourceError(path, "there is no such file") from None
    except OSError as error:
        raise SourceError(path, f"cannot be read: {error.strerror or error}") from error
    if not data.strip():
        raise SourceError(path, "the file is empty")
    if b"\0" in data[:_HEAD]:
        raise SourceError(path, f"is not a text file, so not {wanted}")
    return decode(data)


def read_lines(path: str | Path, wanted: str) -> list[str]:
    """Return the lines of a file; see `read_text`.

    Raises:
        SourceError: It cannot be read, is empty, too large, or no text.
    """
    return read_text(path, wanted).split("\n")


def decode(data: bytes) -> str:
    """Return bytes as text with plain line ends; old files hold names in the code page of their writer."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")


__all__ = ["MAX_BYTES", "decode", "read_lines", "read_text"]
