"""Arrays that take long to compute, kept on disk under a digest of what they were computed from."""

from __future__ import annotations

import hashlib
import logging
import zipfile
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

import numpy as np

from imitor.atomic import atomic
from imitor.cache import cache_folder

_LOG: Final = logging.getLogger("imitor")


def digest(parts: Iterable[Any]) -> str:
    """Return a name for a sequence of arrays, numbers and texts."""
    out = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else np.ascontiguousarray(part).tobytes()
        out.update(len(data).to_bytes(8, "little") + data)
    return out.hexdigest()[:20]


def kept(name: str, make: Callable[[], Mapping[str, Any]], *, about: str) -> dict[str, Any]:
    """Return arrays kept under a name in ``$IMITOR_CACHE``, else ``~/.cache/imitor``, or make and keep them.

    Args:
        name: Their name, with a digest of what they are made from.
        make: Makes them.
        about: What is said when they have to be made.
    """
    path = cache_folder() / "collision" / f"{name}.npz"
    try:
        with np.load(path, allow_pickle=False) as found:
            return {key: found[key] for key in found.files}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile):
        pass  # not there, or damaged
    _LOG.info("%s (once)", about)
    made = {key: np.asarray(value) for key, value in make().items()}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **made)
    except OSError as error:
        _LOG.warning("%s is not kept: %s", path, error)
    return made
