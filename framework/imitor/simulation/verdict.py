"""Whether the robot fell, and how well it executed the motion until then."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from imitor.metrics.polygon import Point, convex_hull, margins
from imitor.robot.model import BASE_NQ
from imitor.types import Array, BoolArray

if TYPE_CHECKING:
    from imitor.simulation.body import Body
    from imitor.simulation.playback import Trace

EDGE_M: Final = 1e-3
"""Nearer to the edge of the polygon the robot tips: the centre of pressure cannot leave it [m]."""
_STANDS: Final = 0.01
"""Share of the weight from which a foot counts as standing [-]."""


@dataclass(frozen=True)
class Fall:
    """When and how the robot fell.

    Attributes:
        frame: Frame at which it was seen.
        time_s: Its time from the first command [s].
        reason: In words.
        diverged: Whether the simulation itself broke down; what follows it is no motion.
    """

    frame: int
    time_s: float
    reason: str
    diverged: bool = False


@dataclass(frozen=True)
class FallRule:
    """What counts as a fall: always by comparison with what the motion asks for.

    Attributes:
        tilt_rad: So much more tilt of the base [rad].
        drop_share: So much less height of the base, by its standing height [-].
    """

    tilt_rad: float = math.radians(45.0)
    drop_share: float = 0.3

    def reason(
        self, *, height: float, asked_height: float, standing_height: float, tilt: float, asked_tilt: float,
        part: str = "",
    ) -> str:  # fmt: skip
        """Return why this is a fall, or an empty string.

        Args:
            height, asked_height, standing_height: Of the base over the floor [m].
            tilt, asked_tilt: Angle of the base's z axis to the vertical [rad].
            part: Name of a part on the floor that should not be there.
        """
        if tilt - asked_tilt > self.tilt_rad:
            more = math.degrees(tilt - asked_tilt)
            return f"the trunk leans {more:.0f} degrees more than the motion asks for"
        if asked_height - height > self.drop_share * standing_height:
            return f"the base is {asked_height - height:.2f} m lower than the motion asks for"
        return f"{part.removeprefix('part/').replace('_', ' ')} touches the floor" if part else ""


def tilt(quaternion: Array) -> float:
    """Return the angle between the z axis of a frame and the vertical [rad], from its quaternion x y z w."""
    x, y = float(quaternion[0]), float(quaternion[1])
    return math.acos(min(1.0, max(-1.0, 1.0 - 2.0 * (x * x + y * y))))


def standing_feet(trace: Trace, weight: float) -> BoolArray:
    """Return the feet that carry at least a hundredth of the weight [N], shape (T, 2)."""
    return np.asarray(trace.force[:, :2] > _STANDS * weight)


def polygons(trace: Trace, feet: BoolArray) -> list[list[Point]]:
    """Return the support polygon of each frame: the hull of the soles that stand, on the floor [m]."""
    return [
        convex_hull([(float(x), float(y)) for x, y, _ in sole[stands].reshape(-1, 3)])
        for sole, stands in zip(trace.sole, feet, strict=True)
    ]


def figures(trace: Trace, body: Body) -> dict[str, Any]:
    """Return the verdict for ``metrics.json``; errors, ZMP and torques are taken over the frames before the fall."""
    fall, frames = trace.fall, len(trace.time_s)
    end = max(fall.frame, 1) if fall is not None else frames
    rows = slice(0, end)
    duration = float(trace.time_s[-1] - trace.time_s[0])
    joint_error = np.abs(trace.q - trace.q_asked)[rows, BASE_NQ:]
    base_error = np.linalg.norm((trace.q - trace.q_asked)[rows, :3], axis=1)
    ratio = trace.peak_torque[rows] / body.drives.limit
    out: dict[str, Any] = {
        "fell": fall is not None,
        "fall_time_s": None if fall is None else fall.time_s,
        "fall_reason": "" if fall is None else fall.reason,
        "survived_s": duration if fall is None else fall.time_s,
        "frames": end,
        "joint_error_rad": {**_errors(joint_error), "joint": _where(joint_error, body.robot.joint_names)},
        "base_error_m": _errors(base_error),
        "torque_nm": {
            "max": float(trace.peak_torque[rows].max()),
            "joint": _where(trace.peak_torque[rows], body.robot.joint_names),
        },
        "torque_to_limit": {
            "max": float(ratio.max()),
            "joint": body.robot.joint_names[_most_loaded(ratio)],
            "saturated_share": float(trace.saturated[rows].mean()),
        },
        "real_time_factor": trace.real_time_factor,
        "step_s": trace.step_s,
        "notes": list(body.drives.notes),
        "base_held": body.held,
        "zmp_inside_share": None,
    }
    if not body.held:
        out |= _balance(trace, body, rows)
    moved = _objects(trace, body, rows)
    return out | ({"objects": moved} if moved else {})


def _objects(trace: Trace, body: Body, rows: slice) -> dict[str, Any]:
    """Return of each object that slides how far it was opened, of what was asked for, and for how long it was held."""
    out = {}
    for k, name in enumerate(body.things.names):
        if body.things.carrier[k] != k:
            continue
        asked, opened = (
            np.linalg.norm(s[rows, k], axis=1) for s in (trace.object_shift_asked, trace.object_shift)
        )
        parts = [i for i, c in enumerate(body.things.carrier) if c == k]
        wanted, held = (np.isin(h[rows], parts) for h in (trace.held_asked, trace.held))
        out[name] = {
            "asked_m": float(asked.max()),
            "opened_m": float(opened.max()),
            "opened_share": float(opened.max() / asked.max()) if asked.any() else None,
            "error_m": _errors(np.abs(opened - asked)),
            "left_open_m": float(opened[-1]),
            "asked_held_hand_frames": int(wanted.sum()),
            "held_hand_frames": int((held & wanted).sum()),
        }
    return out


def _balance(trace: Trace, body: Body, rows: slice) -> dict[str, Any]:
    feet = standing_feet(trace, body.weight_n)
    margin = np.array(margins(np.nan_to_num(trace.zmp), polygons(trace, feet)))[rows]
    number = feet.sum(axis=1)[rows]
    out: dict[str, Any] = {"airborne_frames": int((number == 0).sum())}
    known = np.isfinite(margin)
    inside = margin[known] >= EDGE_M
    out["zmp_inside_share"] = float(inside.mean()) if inside.size else None
    for support, count in (("single", 1), ("double", 2)):
        taken = margin[known & (number == count)]
        if taken.size:
            out[f"zmp_margin_{support}_support_m"] = {
                "min": float(taken.min()),
                "mean": float(taken.mean()),
                "inside_share": float((taken >= EDGE_M).mean()),
                "frames": int(taken.size),
            }
    return out


def _errors(error: Array) -> dict[str, float]:
    return {"rms": float(np.sqrt(np.mean(error**2))), "max": float(error.max())}


def _most_loaded(ratio: Array) -> int:
    """Return the joint with the largest load; of several at the limit the one that is there in most frames."""
    return int((ratio >= ratio.max() - 1e-6).sum(axis=0).argmax())


def _where(values: Array, names: Sequence[str]) -> str:
    """Return the joint with the largest value."""
    return names[int(values.max(axis=0).argmax())]
