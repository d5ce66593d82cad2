"""The one state machine of tracking: loss, hold, stop, resume; the same for files and live captures.

| state | from | when |
|---|---|---|
| waiting | | nobody was seen yet |
| tracking | waiting, returning | the person is seen; the blend is over |
| predicting | tracking, returning | lost for at most ``predict_s``: the person goes on, slowing down |
| holding | predicting | lost for longer: the person stands still |
| stopped | holding, any | lost for longer than ``stop_s``, or the operator's stop: the last safe command stays |
| paused | any but stopped | the operator's pause: the person slows down and stands still; stopped waits for them too |
| returning | predicting, holding, stopped, paused | seen again: from where the person was left to where they are |

From *predicting* the person returns at once. From *holding* and *stopped* they must be seen for ``stable_s`` first,
and what was stopped goes on by itself only with ``resume: automatic``; an operator's stop and pause wait for the
operator. *Lost* is what the mapper says of a filtered frame (`Mapper.missing`).
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Final, Literal

from pydantic import Field

from imitor.kinds import Config


class State(StrEnum):
    """Where the tracking of the person stands."""

    WAITING = "waiting"
    TRACKING = "tracking"
    PREDICTING = "predicting"
    HOLDING = "holding"
    STOPPED = "stopped"
    PAUSED = "paused"
    RETURNING = "returning"


class Request(StrEnum):
    """What the operator may ask for."""

    NONE = ""
    PAUSE = "pause"
    RESUME = "resume"
    STOP = "stop"


OPERATOR: Final = "the operator asked for it"
AWAY: Final = frozenset({State.PREDICTING, State.HOLDING, State.STOPPED, State.PAUSED})
"""States in which the robot does not follow what is seen."""
_SLACK_S: Final = 1e-9


class TrackingOptions(Config):
    """What happens when the person is lost, and how they come back."""

    predict_s: float = Field(
        0.1,
        ge=0,
        le=1,
        description="So long a loss is bridged by going on as the person moved, slowing down [s].",
    )
    stop_s: float = Field(
        1.0,
        ge=0,
        le=3600,
        description="A longer loss is an emergency stop; the person stands still before [s].",
    )
    stable_s: float = Field(
        0.2,
        ge=0,
        le=60,
        description="How long a person who was lost is seen before the robot follows again [s].",
    )
    resume: Literal["automatic", "request"] = Field(
        "automatic", description="Whether the robot goes on by itself after an emergency stop [-]."
    )
    blend_m_s: float = Field(
        0.5,
        gt=0,
        le=10,
        description="How fast points move beside their own motion while the person returns [m/s].",
    )
    blend_rad_s: float = Field(1.5, gt=0, le=50, description="The same of orientations [rad/s].")
    human_m_s: float = Field(
        20.0,
        gt=0,
        le=1000,
        description="No human moves faster: a point that does is taken for lost [m/s].",
    )


@dataclass
class TrackingReport:
    """What happened [times], and how long states lasted [frames]."""

    losses: int = 0
    stops: int = 0
    predicted_frames: int = 0
    held_frames: int = 0
    stopped_frames: int = 0
    returning_frames: int = 0
    longest_loss_s: float = 0.0

    def figures(self) -> dict[str, float]:
        """Return the figures by name."""
        return asdict(self)


class Tracking:
    """Says in every frame where the tracking stands.

    Args:
        options: Times and how to resume.

    Attributes:
        state: Where it stands.
        report: What happened so far.
        why: The reason of the first stop; empty when there was none.
        stopped_at_s: When the first stop was [s]; NaN when there was none.
    """

    def __init__(self, options: TrackingOptions) -> None:
        self.options = options
        self.reset()

    def reset(self) -> None:
        """Forget the person."""
        self.state = State.WAITING
        self.report = TrackingReport()
        self.why = ""
        self.stopped_at_s = math.nan
        self._seen_at: float | None = None  # when the person was last seen
        self._back_at: float | None = None  # since when they are seen again
        self._asks = False  # the operator stopped it, and the operator must let it go on
        self._allowed = False  # a resume that was asked for while it could not be granted yet

    def step(self, time_s: float, seen: bool, request: Request = Request.NONE, why: str = "") -> State:
        """Return the state of a frame.

        Args:
            time_s: Time of the frame [s]; increases.
            seen: Whether all that is needed of the person is seen.
            request: What the operator asks for.
            why: What is not seen, for the report.
        """
        self._note(time_s, seen)
        before = self.state
        state = self._asked(before, request)
        if state is State.WAITING:
            state = State.TRACKING if seen else state
        elif state in (State.TRACKING, State.RETURNING, State.PREDICTING):
            state = self._seen(state, seen, time_s)
        elif state is State.HOLDING:
            state = State.RETURNING if self._stable(time_s) else state if seen else self._lost(time_s)
        elif state is State.STOPPED and self._may_resume() and self._stable(time_s):
            state, self._asks, self._allowed = State.RETURNING, False, False
        elif state is State.PAUSED and self._allowed:
            state = State.RETURNING if self._stable(time_s) else state
            self._allowed = state is State.PAUSED
        if state is State.STOPPED and before is not State.STOPPED:
            self._stop(time_s, request, why)
        self.state = state
        self._count(before)
        return state

    def returned(self) -> None:
        """Say that the way back is over."""
        if self.state is State.RETURNING:
            self.state = State.TRACKING

    def lost_s(self, time_s: float) -> float:
        """Return for how long the person has not been seen [s]."""
        return 0.0 if self._seen_at is None else time_s - self._seen_at

    # ------------------------------------------------------------------ the table, row by row

    def _asked(self, state: State, request: Request) -> State:
        if request is Request.STOP:
            self._asks, self._allowed = True, False
            return State.STOPPED
        if request is Request.PAUSE:
            self._allowed = False
            self._asks = self._asks or state is State.STOPPED
            return state if state is State.STOPPED else State.PAUSED
        if request is Request.RESUME and state in (State.STOPPED, State.PAUSED):
            self._allowed = True
        return state

    def _seen(self, state: State, seen: bool, time_s: float) -> State:
        if seen:
            return State.RETURNING if state is State.PREDICTING else state
        return self._lost(time_s)

    def _lost(self, time_s: float) -> State:
        lost = self.lost_s(time_s)
        if lost > self.options.stop_s + _SLACK_S:
            return State.STOPPED
        return State.PREDICTING if lost <= self.options.predict_s + _SLACK_S else State.HOLDING

    def _stable(self, time_s: float) -> bool:
        return self._back_at is not None and time_s - self._back_at >= self.options.stable_s - _SLACK_S

    def _may_resume(self) -> bool:
        return self._allowed or (self.options.resume == "automatic" and not self._asks)

    # ------------------------------------------------------------------ what happened

    def _note(self, time_s: float, seen: bool) -> None:
        if seen:
            self._back_at = time_s if self._back_at is None else self._back_at
            self._seen_at = time_s
        else:
            self._back_at = None
            self.report.longest_loss_s = max(self.report.longest_loss_s, self.lost_s(time_s))

    def _stop(self, time_s: float, request: Request, why: str) -> None:
        self.report.stops += 1
        if self.report.stops == 1:
            self.why = OPERATOR if request is Request.STOP else f"{why} lost for longer than allowed"
            self.stopped_at_s = time_s

    def _count(self, before: State) -> None:
        r, state = self.report, self.state
        lost = (State.PREDICTING, State.HOLDING, State.STOPPED)
        r.losses += (
            state in lost and before not in (*lost, State.PAUSED, State.WAITING) and self._back_at is None
        )
        r.predicted_frames += state is State.PREDICTING
        r.held_frames += state in (State.HOLDING, State.PAUSED)
        r.stopped_frames += state is State.STOPPED
        r.returning_frames += state is State.RETURNING


__all__ = ["AWAY", "Request", "State", "Tracking", "TrackingOptions", "TrackingReport"]
