"""What the robot's feet do on the floor, which is the plane z = 0."""

from __future__ import annotations

import numpy as np

from imitor.metrics.figure import Outcome, Sample, Unmeasured, figure
from imitor.metrics.run import TOUCH_M, Run
from imitor.types import BoolArray

_TOO_SHORT = "it takes two frames"


def _slip(run: Run, contact: BoolArray, reason: str) -> Outcome:
    """Return the slip of the feet in contact (T, 2) at both ends of a step from frame to frame."""
    if len(run) < 2:
        return Unmeasured(_TOO_SHORT)
    standing = contact[1:] & contact[:-1]
    speed = np.linalg.norm(np.diff(run.path.sole_centre[..., :2], axis=0), axis=2) / run.period_s
    slips = speed[standing]
    if not slips.size:
        return Unmeasured(reason)
    values = {"mean": slips.mean(), "max": slips.max(), "foot_frames": slips.size}
    return Sample(values, int(standing.any(axis=1).sum()))


@figure(
    "foot_slip_human_contact_m_s",
    unit="m/s",
    formula="horizontal speed of the sole's centre from frame to frame while the human's same foot is in "
    "contact in both; mean and max over feet and frames",
    better="lower",
    about="Whether the robot's feet stay where the human's stand.",
)
def slip_in_human_contact(run: Run) -> Outcome:
    """Take the slip while the human's foot stands."""
    contact = run.reference.human_support & run.reference.human_support_known[:, None]
    return _slip(run, contact, "the human's support was not marked, or no foot stood for two frames")


@figure(
    "foot_slip_declared_contact_m_s",
    unit="m/s",
    formula="the same while the robot's own contact is declared",
    better="lower",
    about="Whether a foot that carries the robot slides.",
)
def slip_in_declared_contact(run: Run) -> Outcome:
    """Take the slip while the robot says that the foot stands."""
    return _slip(run, run.motion.contact, "no foot was declared in contact for two frames")


@figure(
    "penetration_m",
    unit="m",
    formula="max(0, −z) of the lowest sole corner of both feet",
    better="lower",
    about="Feet sunk into the floor; read it together with the float.",
)
def penetration(run: Run) -> Outcome:
    """Take the depth of the deepest sole corner."""
    return Sample.over(np.maximum(0.0, -run.path.sole[..., 2].min(axis=(1, 2))), reason="no frame")


@figure(
    "penetration_frames",
    unit="frames",
    formula=f"frames with a sole corner deeper than {1000 * TOUCH_M:.0f} mm",
    better="lower",
    about="How often feet are sunk.",
)
def penetration_frames(run: Run) -> Outcome:
    """Count the frames with a sunk foot."""
    sunk = run.path.sole[..., 2].min(axis=(1, 2)) < -TOUCH_M
    return Sample.count(sunk, np.ones(len(run)), reason="no frame")


@figure(
    "float_m",
    unit="m",
    formula="max(0, z) of the lowest corner of a foot declared in contact; mean and max over feet and frames",
    better="lower",
    about="Feet that are to stand but hang in the air; a shift in height trades it for penetration.",
)
def float_height(run: Run) -> Outcome:
    """Take the height of feet that are to stand."""
    contact = np.asarray(run.motion.contact, dtype=bool)
    heights = np.maximum(0.0, run.path.sole[..., 2].min(axis=2))[contact]
    if not heights.size:
        return Unmeasured("no foot was declared in contact")
    values = {"mean": heights.mean(), "max": heights.max(), "foot_frames": heights.size}
    return Sample(values, int(contact.any(axis=1).sum()))


@figure(
    "flight_frames",
    unit="frames",
    formula=f"frames without any sole corner at or under z = {1000 * TOUCH_M:.0f} mm",
    better="neither",
    about="Frames with no support at all; the balance figures leave them out.",
)
def flight(run: Run) -> Outcome:
    """Count the frames in which no corner touches."""
    return Sample.count(~run.foot_touching.any(axis=1), np.ones(len(run)), reason="no frame")


@figure(
    "contact_disagreement_frames",
    unit="frames",
    formula=f"frames in which a foot touches (a corner at or under {1000 * TOUCH_M:.0f} mm) and is not "
    "declared in contact, or the reverse; foot_frames of each kind beside it",
    better="lower",
    about="Whether the declared contact is what the geometry says.",
)
def contact_disagreement(run: Run) -> Outcome:
    """Count the frames in which declared and geometric contact differ."""
    declared, touching = np.asarray(run.motion.contact, dtype=bool), run.foot_touching
    return Sample.count(
        (declared != touching).any(axis=1),
        np.ones(len(run)),
        reason="no frame",
        declared_not_touching_foot_frames=int((declared & ~touching).sum()),
        touching_not_declared_foot_frames=int((touching & ~declared).sum()),
    )
