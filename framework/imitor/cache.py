"""Results that are dear to find and belong to a robot: computed once, kept in the user's cache folder."""

from __future__ import annotations

import hashlib
import logging
import os
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from imitor.atomic import atomic
from imitor.types import Array

_LOG: Final = logging.getLogger("imitor")


def cache_folder() -> Path:
    """Return the folder of what is computed once: ``IMITOR_CACHE``, or the platform's cache folder."""
    chosen = os.environ.get("IMITOR_CACHE")
    if chosen:
        return Path(chosen).expanduser()
    if platform.system() == "Darwin":
        return Path.home() / "Library" / "Caches" / "imitor"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "imitor"


def fingerprint(*parts: str | bytes) -> str:
    """Return a name for everything that a result depends on."""
    total = hashlib.sha256()
    for part in parts:
        total.update(part.encode() if isinstance(part, str) else part)
        total.update(b"\0")
    return total.hexdigest()[:16]


def kept(path: Path, compute: Callable[[], Array]) -> Array:
    """Return the array kept at a path, else compute and keep it; without a usable cache it is only computed."""
    try:
        return np.asarray(np.load(path, allow_pickle=False))
    except (OSError, ValueError, EOFError):
        value = compute()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic(path) as temporary, temporary.open("wb") as stream:
            np.save(stream, value)
    except OSError as error:
        _LOG.warning("the cache folder %s cannot be written: %s", path.parent, error.strerror)
    return value
