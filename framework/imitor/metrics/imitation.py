"""How well the robot's limbs follow the human's."""

from __future__ import annotations

from typing import Final

import numpy as np

from imitor.metrics.figure import Outcome, Sample, Unmeasured, figure
from imitor.metrics.run import Run, unit
from imitor.types import SEGMENTS, SIDES, Array

ENDS: Final = tuple(f"{side}_{end}" for end in ("hand", "foot") for side in SIDES)


def angle(a: Array, b: Array) -> Array:
    """Return the angles between unit vectors, shape (T,) [rad]; exact where the arc cosine is not."""
    return np.asarray(2.0 * np.arctan2(np.linalg.norm(a - b, axis=1), np.linalg.norm(a + b, axis=1)))


def _direction_errors(run: Run) -> dict[str, Array | Unmeasured]:
    """Return per segment the error of each frame, shape (T,) [deg], NaN where the human is not known."""
    out: dict[str, Array | Unmeasured] = {}
    for segment, ends in SEGMENTS.items():
        lacking = run.robot_lacks(*ends)
        if lacking:
            out[segment] = Unmeasured(f"the robot has no {' and no '.join(lacking)}")
            continue
        error = np.degrees(angle(run.human_direction[segment], unit(run.robot_vector(*ends))))
        known = ~np.isnan(error)
        out[segment] = (
            error if known.any() else Unmeasured(f"the human's {' and '.join(ends)} are never known together")
        )
    return out


@figure(
    "direction_error_{segment}_deg",
    unit="deg",
    formula="angle between the line of the robot's two role points and the human's, in world; valid frames",
    better="lower",
    about="Similarity of pose, whatever the body sizes.",
    members=tuple(SEGMENTS),
)
def direction_error(run: Run) -> dict[str, Outcome]:
    """Take the direction error of each main segment."""
    return {
        segment: error if isinstance(error, Unmeasured) else Sample.over(error, reason="no frame is known")
        for segment, error in _direction_errors(run).items()
    }


@figure(
    "direction_error_deg",
    unit="deg",
    formula="mean over the segments of their means over frames; worst_segment_mean the largest of those",
    better="lower",
    about="One number for the similarity of pose.",
)
def mean_direction_error(run: Run) -> Outcome:
    """Take the mean direction error over frames, then segments."""
    errors = {s: e for s, e in _direction_errors(run).items() if not isinstance(e, Unmeasured)}
    if not errors:
        return Unmeasured("no segment is known of both human and robot")
    means = {s: float(np.nanmean(e)) for s, e in errors.items()}
    worst = max(means, key=lambda s: means[s])
    frames = int((~np.isnan(np.array(list(errors.values())))).any(axis=0).sum())
    return Sample(
        {
            "mean": sum(means.values()) / len(means),
            "worst_segment_mean": means[worst],
            "worst_segment": worst,
            "segments": len(means),
        },
        frames,
    )


@figure(
    "end_effector_error_{end}_m",
    unit="m",
    formula="|r − (L_robot / L_human) h|: r, h the vectors shoulder → wrist (hand, where a body has no "
    "wrist) or hip → ankle of robot and human in world, L the median limb length over frames",
    better="lower",
    about="Reach of hands and feet after scaling the limb.",
    members=ENDS,
)
def end_effector_error(run: Run) -> dict[str, Outcome]:
    """Take the error of hands and feet relative to their limb's root."""
    return {end: _limb_error(run, end) for end in ENDS}


def _limb_error(run: Run, end: str) -> Outcome:
    side, part = end.split("_")
    chains = (
        [("shoulder", "elbow", "wrist"), ("shoulder", "elbow", "hand")]
        if part == "hand"
        else [("hip", "knee", "ankle")]
    )
    reason = ""
    for chain in chains:
        root, middle, tip = (f"{side}_{joint}" for joint in chain)
        lacking = run.robot_lacks(root, middle, tip)
        if lacking:
            reason = reason or f"the robot has no {' and no '.join(lacking)}"
            continue
        human = run.human_vector(root, tip)
        length = _length(run.human_vector(root, middle), run.human_vector(middle, tip))
        if not length > 0:
            reason = reason or f"the human's {root}, {middle} and {tip} are never known together"
            continue
        scale = _length(run.robot_vector(root, middle), run.robot_vector(middle, tip)) / length
        error = np.linalg.norm(run.robot_vector(root, tip) - scale * human, axis=1)
        return Sample.over(error, reason="no frame is known", scale=scale)
    return Unmeasured(reason)


def _length(upper: Array, lower: Array) -> float:
    """Return the median limb length over the frames in which it is known [m]; NaN where it never is."""
    lengths = np.linalg.norm(upper, axis=1) + np.linalg.norm(lower, axis=1)
    known = lengths[~np.isnan(lengths)]
    return float(np.median(known)) if known.size else float("nan")


@figure(
    "support_agreement_frames",
    unit="frames",
    formula="frames in which the robot's declared contact of both feet equals the human's support",
    better="higher",
    about="Whether the robot steps when the human does.",
)
def support_agreement(run: Run) -> Outcome:
    """Count the frames in which robot and human stand on the same feet."""
    same = (run.motion.contact == run.reference.human_support).all(axis=1)
    return Sample.count(same, run.reference.human_support_known, reason="the human's support was not marked")
