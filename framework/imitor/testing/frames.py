"""Rules of a skeleton and a human frame: shapes, types, flags that agree with NaN, rotations that are rotations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imitor.testing.expect import AnyComponent, Snapshot, expect, fail, is_rotation, short
from imitor.types import N_ROLES, ROLES, HumanFrame, Skeleton, Support

ARRAYS = ("position", "valid", "orientation", "marker", "marker_valid", "target", "target_valid", "com")


def snapshot(frame: HumanFrame) -> Snapshot:
    """Return copies of what a frame holds."""
    out: Snapshot = {"time_s": np.array(frame.time_s)}
    for name in ARRAYS:
        value = getattr(frame, name)
        if value is not None:
            out[name] = np.array(value)
    if frame.support is not None:
        out["support"] = np.array([frame.support.left, frame.support.right])
    return out


def given_words(frame: HumanFrame) -> frozenset[str]:
    """Return what a frame holds, in the words of `Component.gives`."""
    words = {
        "support": frame.support, "com": frame.com, "orientation": frame.orientation,
        "markers": frame.marker, "targets": frame.target,
    }  # fmt: skip
    return frozenset(word for word, value in words.items() if value is not None)


def check_frame(cls: AnyComponent, frame: HumanFrame, skeleton: Skeleton, which: str) -> None:
    """Check one human frame."""
    expect(isinstance(frame, HumanFrame), cls, f"{which} is a {type(frame).__name__}, not a HumanFrame")
    expect(np.isfinite(frame.time_s), cls, f"{which} has the time {frame.time_s}")
    _points(cls, which, "position", "valid", frame.position, frame.valid, N_ROLES)
    unknown = [ROLES[i] for i in np.flatnonzero(frame.valid) if ROLES[i] not in skeleton.roles]
    expect(not unknown, cls, f"{which} has {', '.join(unknown)}, which the skeleton's roles do not name")
    if frame.orientation is not None:
        shape = (N_ROLES, 3, 3)
        expect(
            frame.orientation.shape == shape,
            cls,
            f"{which}: orientation is {frame.orientation.shape}, not {shape}",
        )
        known = np.isfinite(frame.orientation).all(axis=(1, 2))
        expect(
            np.isnan(frame.orientation[~known]).all() and is_rotation(frame.orientation[known]),
            cls,
            f"{which}: an orientation is no rotation; it is one, or NaN where not known",
        )
    if frame.marker is not None:
        _points(
            cls, which, "marker", "marker_valid", frame.marker, frame.marker_valid, len(skeleton.marker_names)
        )
    if frame.target is not None:
        n = len(skeleton.target_names)
        expect(
            frame.target.shape == (n, 4, 4), cls, f"{which}: target is {frame.target.shape}, not {(n, 4, 4)}"
        )
        valid = frame.target_valid
        expect(valid is not None and valid.shape == (n,), cls, f"{which}: target_valid does not fit target")
        if valid is not None:
            expect(is_rotation(frame.target[valid][:, :3, :3]), cls, f"{which}: a valid target is no pose")
    if frame.com is not None and not (frame.com.shape == (3,) and np.isfinite(frame.com).all()):
        fail(cls, f"{which}: com is {short(np.asarray(frame.com))}, not three finite numbers")
    if frame.support is not None:
        expect(isinstance(frame.support, Support), cls, f"{which}: support is no Support")


def check_skeleton(cls: AnyComponent, skeleton: Skeleton) -> None:
    """Check the constant facts about the human."""
    expect(isinstance(skeleton, Skeleton), cls, "start() sets no skeleton")
    unknown = skeleton.roles - set(ROLES)
    expect(not unknown, cls, f"the skeleton's roles {', '.join(sorted(unknown))} are none of imitor.ROLES")
    rest = skeleton.rest_position
    expect(rest.shape == (N_ROLES, 3), cls, f"rest_position has shape {rest.shape}, not {(N_ROLES, 3)}")
    known = {r for r, p in zip(ROLES, rest, strict=True) if np.isfinite(p).all()}
    wrong = known ^ skeleton.roles
    expect(not wrong, cls, f"rest_position and roles disagree about {', '.join(sorted(wrong))}")
    for name in ("height_m", "ankle_height_m", "toe_height_m", "mass_kg"):
        value = getattr(skeleton, name)
        expect(np.isfinite(value) and value > 0, cls, f"the skeleton's {name} is {value}")


def _points(
    cls: AnyComponent, which: str, name: str, flag: str, points: np.ndarray, valid: np.ndarray | None, n: int
) -> None:
    """Check points and their flags, shapes (n, 3) and (n,)."""
    expect(points.shape == (n, 3), cls, f"{which}: {name} has shape {points.shape}, not {(n, 3)}")
    expect(points.dtype == np.float64, cls, f"{which}: {name} is of type {points.dtype}, not float64")
    if valid is None:
        fail(cls, f"{which}: {name} without {flag}")
    fits = valid.shape == (n,) and valid.dtype == np.bool_
    expect(fits, cls, f"{which}: {flag} is {valid.dtype} of shape {valid.shape}, not bool of {(n,)}")
    expect(
        np.isfinite(points[valid]).all(),
        cls,
        f"{which}: a point of {name} is not finite though {flag} says so",
    )
    expect(
        np.isnan(points[~valid]).all(), cls, f"{which}: a point of {name} has a place though {flag} denies it"
    )


def check_untouched(cls: AnyComponent, frame: HumanFrame, before: Snapshot, which: str) -> None:
    """Refuse changed input arrays: a stage binds new ones."""
    for name in ARRAYS:
        value = getattr(frame, name)
        if value is not None and name in before:
            same = np.array_equal(value, before[name], equal_nan=before[name].dtype.kind == "f")
            expect(same, cls, f"{which}: it wrote into {name} of the frame it was given; bind a new array")


def lost_points(frames: Sequence[HumanFrame]) -> list[HumanFrame]:
    """Return frames in which an arm is lost for a while, then a leg, then everything for three frames."""
    out = []
    n = len(frames)
    arm = np.array([r.startswith("left_") and r[5:] in ("shoulder", "elbow", "wrist", "hand") for r in ROLES])
    leg = np.array(
        [r.startswith("right_") and r[6:] in ("hip", "knee", "ankle", "heel", "toe") for r in ROLES]
    )
    for i, frame in enumerate(frames):
        lost = np.zeros(N_ROLES, dtype=bool)
        lost |= arm & (n // 5 <= i < 2 * n // 5)
        lost |= leg & (3 * n // 10 <= i < 3 * n // 5)
        lost |= 7 * n // 10 <= i < 7 * n // 10 + 3
        valid = frame.valid & ~lost
        position = np.where(valid[:, None], frame.position, np.nan)
        orientation = None
        if frame.orientation is not None:
            orientation = np.where(valid[:, None, None], frame.orientation, np.nan)
            orientation.flags.writeable = False
        valid.flags.writeable = position.flags.writeable = False
        out.append(
            HumanFrame(frame.time_s, position, valid, orientation, frame.marker, frame.marker_valid, frame.target,
                       frame.target_valid, frame.com, frame.support)
        )  # fmt: skip
    return out
