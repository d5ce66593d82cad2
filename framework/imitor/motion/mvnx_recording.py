"""From an MVNX file to the human in our world."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from imitor.errors import SourceError
from imitor.motion.clip import Clip, window
from imitor.motion.mvnx_body import LEG_ROLES, find_axes, motion_of, rest_pose, stature
from imitor.motion.mvnx_file import REST_TYPES, Mvnx
from imitor.motion.normalise import FLOOR_TOLERANCE_M, handedness, role
from imitor.types import ROLE_INDEX, ROLES, SIDES, Array, BoolArray, Skeleton

_NO_LEGS: Final = frozenset({"upperbody", "upperbodynohands"})


@dataclass(frozen=True)
class MvnxOptions:
    """What the user may say; see the options of the source."""

    floor: str | float = "auto"
    legs: str = "auto"
    height_m: float | None = None
    start_s: float = 0.0
    stop_s: float | None = None
    mass_kg: float = 70.0
    sex: str = "male"


def make_mvnx_recording(path: str | Path, mvnx: Mvnx, options: MvnxOptions) -> Clip:
    """Bring a recording into our world.

    Raises:
        SourceError: The sides are swapped, or no frame is left.
    """
    kind = next(t for t in REST_TYPES if t in mvnx.rest)
    notes = [
        f"skeleton: Xsens MVN, MVNX version {mvnx.version}, {mvnx.configuration or 'no configuration named'}"
    ]
    notes.append(f"rest pose: the file's {kind}")
    axes = find_axes(mvnx, kind)
    rest, ankle_m, toe_m = rest_pose(mvnx, kind, axes)
    position, orientation = motion_of(mvnx, axes)
    if handedness(rest) < 0.3:
        raise SourceError(path, f"left and right of its {kind} are swapped: the feet point backwards")
    height_m = options.height_m or stature(rest)
    notes.append(f"stature {height_m:.2f} m" + (" as given" if options.height_m else ""))

    com: Array | None = None if mvnx.com is None else mvnx.com.copy()
    support: BoolArray | None = (
        None if mvnx.contact is None else np.asarray(mvnx.contact.reshape(-1, 2, 2).any(axis=2))
    )
    if _legs_unknown(mvnx, options):
        position[:, [ROLE_INDEX[r] for r in LEG_ROLES]] = np.nan
        legs = [ROLE_INDEX[f"{s}_{r}"] for s in SIDES for r in ("hip", "knee", "ankle", "toe")]
        orientation[:, legs] = np.nan
        com, support = None, None
        floor = _pelvis_floor(position, rest)
        notes.append(
            "the legs were not captured: knees and feet, contacts and the file's CoM are left out (legs)"
        )
        notes.append("floor: under a person who stands as in the rest pose")
    else:
        floor = _floor(position, support, ankle_m, toe_m, options, notes)
    position[..., 2] -= floor
    if com is not None:
        com[:, 2] -= floor

    position, orientation, com, support = _without_gaps(mvnx, position, orientation, com, support, notes)
    notes.append(f"rate: {mvnx.rate_hz:g} Hz")
    first, last = window(path, len(position), mvnx.rate_hz, options.start_s, options.stop_s)
    valid: BoolArray = np.asarray(np.isfinite(position).all(axis=-1))
    known = np.asarray(np.isfinite(rest).all(axis=-1))
    skeleton = Skeleton(
        name="xsens",
        roles=frozenset(name for name in ROLES if known[ROLE_INDEX[name]]),
        rest_position=rest,
        height_m=height_m,
        ankle_height_m=ankle_m,
        toe_height_m=toe_m,
        mass_kg=options.mass_kg,
        sex=options.sex,
        notes=tuple(notes),
    )
    facts: dict[str, str | float] = {
        "version": mvnx.version, "rest": kind, "height_m": height_m, "floor_m": floor, "rate_hz": mvnx.rate_hz,
    }  # fmt: skip
    clip = Clip(
        skeleton, mvnx.rate_hz, position, valid, facts, orientation=orientation, com=com, support=support
    )
    return clip.part(first, last)


def _legs_unknown(mvnx: Mvnx, options: MvnxOptions) -> bool:
    if options.legs == "auto":
        return mvnx.configuration.lower() in _NO_LEGS
    return options.legs == "unknown"


def _pelvis_floor(position: Array, rest: Array) -> float:
    return float(np.median(position[:, ROLE_INDEX["pelvis"], 2]) - rest[ROLE_INDEX["pelvis"], 2])


def _floor(
    position: Array,
    support: BoolArray | None,
    ankle_m: float,
    toe_m: float,
    options: MvnxOptions,
    notes: list[str],
) -> float:
    """Return the floor's height in the recording [m]: under the feet in contact, or else under the lower foot."""
    sole = np.stack(
        [
            np.nanmin(
                [
                    role(position, f"{s}_ankle")[:, 2] - ankle_m,
                    role(position, f"{s}_toe")[:, 2] - toe_m,
                    role(position, f"{s}_heel")[:, 2],
                    role(position, f"{s}_toe_tip")[:, 2],
                ],
                axis=0,
            )
            for s in SIDES
        ],
        axis=1,
    )
    if support is not None and support.any():
        found = float(np.median(sole[support]))
    else:
        low = sole.min(axis=1)
        found = float(np.median(low[low <= np.quantile(low, 0.5)]))
    if isinstance(options.floor, int | float):
        notes.append(f"floor: at {options.floor:g} m of the recording, as given")
        return float(options.floor)
    if options.floor == "file" or abs(found) <= FLOOR_TOLERANCE_M:
        notes.append(f"floor: the file's zero (the feet stand {found:+.3f} m from it)")
        return 0.0
    notes.append(f"floor: {found:+.3f} m in the recording, from the standing feet")
    return found


def _without_gaps(
    mvnx: Mvnx,
    position: Array,
    orientation: Array,
    com: Array | None,
    support: BoolArray | None,
    notes: list[str],
) -> tuple[Array, Array, Array | None, BoolArray | None]:
    """Return every frame by its number: those that the recorder dropped are lost, their contact that before."""
    row = mvnx.index.astype(int)
    count = int(row[-1]) + 1
    if count == len(row):
        return position, orientation, com, support
    notes.append(f"{count - len(row)} of {count} frames are missing in the file: lost")

    def spread(array: Array) -> Array:
        out = np.full((count, *array.shape[1:]), np.nan)
        out[row] = array
        return out

    before = np.searchsorted(row, np.arange(count), side="right") - 1
    return (
        spread(position),
        spread(orientation),
        None if com is None else spread(com),
        None if support is None else support[before],
    )
