"""What a recording must have to be sent as a body of turning segments."""

from __future__ import annotations

from typing import Any

from imitor.errors import ImitorError
from imitor.kinds import Source
from imitor.live.sender import lacking
from imitor.motion.skeletons import MAIN_ROLES


def check_sendable(protocol: str, source: Source[Any]) -> None:
    """Refuse a started source that has no orientations, or lacks parts of the body.

    Raises:
        ImitorError: Says what is missing.
    """
    if "orientation" not in source.gives:
        raise lacking(
            protocol, source, "orientations of segments", "those of skeletons do, e.g. mvnx and bvh"
        )
    missing = [r for r in (*MAIN_ROLES, "chest") if not source.skeleton.has(r)]
    if missing:
        raise ImitorError(
            f"'{protocol}' sends a whole body, and this recording ({source.name}) has no {', '.join(missing)}"
        )


__all__ = ["check_sendable"]
