"""How the robot's support follows the human's: what it carries out, and how much later."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np

from imitor.metrics.figure import Outcome, Sample, Unmeasured, figure
from imitor.metrics.run import Run
from imitor.types import BoolArray

LONG_S: Final = 1.0
"""Single-support phases of the human at least this long are asked of the robot [s]."""
LATE_S: Final = 1.0
"""How long after a phase of the human the robot may still carry it out [s]."""
_SLACK_S: Final = 1e-9
_UNMARKED: Final = "the human's support was not marked"


def phases(support: BoolArray, known: BoolArray) -> list[tuple[int, int]]:
    """Return first frame and end of every stretch without a change of support, shape (T, 2); unknown ones left out.

    Args:
        support: The feet in contact, shape (T, 2).
        known: Where it is known, shape (T,).
    """
    state = np.where(known, support @ np.array([1, 2]), -1)
    edges = [0, *(np.flatnonzero(np.diff(state)) + 1).tolist(), len(state)]
    return [(a, b) for a, b in pairwise(edges) if known[a]]


def _executed(run: Run, first: int, end: int) -> int | None:
    """Return the frame in which the robot first stands as the human in a phase, or late after it; ``None``: never."""
    until = run.motion.time_s[end - 1] + LATE_S + _SLACK_S
    late = int(np.searchsorted(run.motion.time_s, until, side="right"))
    same = (run.motion.contact[first:late] == run.reference.human_support[first]).all(axis=1)
    return first + int(same.argmax()) if same.any() else None


def _human_phases(run: Run) -> list[tuple[int, int]]:
    return phases(run.reference.human_support, run.reference.human_support_known)


@figure(
    "support_delay_s",
    unit="s",
    formula="for each change of the human's support to one or two feet, the time until the robot's declared contact "
    f"is the same; until {LATE_S:g} s after the human has changed again, else it counts in missed",
    better="lower",
    about="How much later the robot changes support than the human.",
)
def support_delay(run: Run) -> Outcome:
    """Take the delay of every change of support that the robot follows."""
    if not run.reference.human_support_known.any():
        return Unmeasured(_UNMARKED)
    changes = [(a, b) for a, b in _human_phases(run)[1:] if run.reference.human_support[a].any()]
    if not changes:
        return Unmeasured("the human never changed its support")
    found = [(a, _executed(run, a, b)) for a, b in changes]
    delays = [float(run.motion.time_s[at] - run.motion.time_s[a]) for a, at in found if at is not None]
    if not delays:
        return Unmeasured(f"the robot followed none of {len(changes)} changes")
    return Sample(
        {
            "mean": sum(delays) / len(delays),
            "max": max(delays),
            "changes": len(changes),
            "missed": len(changes) - len(delays),
        },
        len(run),
    )


@figure(
    "single_support_executed_phases",
    unit="phases",
    formula=f"the human's phases on one foot of at least {LONG_S:g} s in which, or up to {LATE_S:g} s after which, the "
    "robot stands on that foot alone by its declared contact",
    better="higher",
    about="Whether the robot really balances on one leg where the human does.",
)
def single_support_executed(run: Run) -> Outcome:
    """Count the long phases on one foot that the robot carries out."""
    if not run.reference.human_support_known.any():
        return Unmeasured(_UNMARKED)
    time_s = run.motion.time_s
    asked = [
        (a, b)
        for a, b in _human_phases(run)
        if run.reference.human_support[a].sum() == 1
        and time_s[min(b, len(time_s) - 1)] - time_s[a] >= LONG_S - _SLACK_S
    ]
    if not asked:
        return Unmeasured(f"the human never stood on one foot for {LONG_S:g} s")
    done = sum(_executed(run, a, b) is not None for a, b in asked)
    return Sample({"count": done, "share": done / len(asked), "phases": len(asked)}, len(run))


@figure(
    "human_unseen_frames",
    unit="frames",
    formula="frames in which an ankle or the CoM of the human is not known",
    better="lower",
    about="How often balance had to go on with what it saw last.",
)
def human_unseen(run: Run) -> Outcome:
    """Count the frames without what balance looks at."""
    known = run.human_has("left_ankle") & run.human_has("right_ankle")
    known &= np.isfinite(run.reference.human_com_m).all(axis=1)
    return Sample.count(~known, np.ones(len(run)), reason="no frame")


@figure(
    "human_flight_frames",
    unit="frames",
    formula="frames in which neither foot of the human is marked as in contact",
    better="neither",
    about="Jumps, lying and sitting without the feet: what a balanced robot does not follow.",
)
def human_flight(run: Run) -> Outcome:
    """Count the frames in which the human stands on nothing."""
    return Sample.count(
        ~run.reference.human_support.any(axis=1), run.reference.human_support_known, reason=_UNMARKED
    )
