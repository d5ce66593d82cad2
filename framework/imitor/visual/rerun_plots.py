"""Curves and states of a run beside the picture in the Rerun viewer, and how all is laid out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from imitor.record import Motion, Reference
from imitor.robot.model import BASE_NV, RobotModel
from imitor.types import SIDES, Array
from imitor.visual.rerun_log import TIMELINE, RerunLog

WINDOW_S: Final = 10.0
"""How far back the curves of a live view reach [s]."""
_COLOUR: Final = {
    "ok": (46, 158, 120), "held": (242, 143, 33), "stopped": (214, 60, 90), "stands": (97, 150, 201)
}  # fmt: skip
_REPEAT_S: Final = 5.0
"""A state is told again after so long, for those who look later [s]."""


class RerunPlots:
    """Joint positions and speeds, balance, times and states.

    Args:
        robot: The robot of the motion.
    """

    def __init__(self, robot: RobotModel) -> None:
        self._groups = joint_groups(robot)
        self._names = robot.joint_names
        self._before: tuple[float, Array] | None = None
        self._state: dict[str, tuple[str, float]] = {}

    def begin(self, log: RerunLog) -> None:
        """Send the colours of the states."""
        rr = log.rr
        values = ["", *_COLOUR]
        colours = [(0, 0, 0, 0), *_COLOUR.values()]
        for path in ("robot", *(f"{side}_foot" for side in SIDES)):
            log.fixed(f"state/{path}", rr.StateConfiguration(values=values, colors=colours))

    def add(
        self, log: RerunLog, motion: Motion, reference: Reference, latency_s: Array | None = None
    ) -> None:
        """Send frames.

        Args:
            log: Where to.
            motion, reference: The frames, next to those sent before.
            latency_s: From arrival to solution, shape (T,) [s]; NaN where nothing had arrived.
        """
        time_s, q = motion.time_s, motion.joint_position_rad
        since, speed = self._speeds(time_s, q)
        for group, joints in self._groups:
            names = [self._names[j] for j in joints]
            log.series(f"plots/position_rad/{group}", time_s, q[:, joints], names)
            log.series(f"plots/speed_rad_s/{group}", since, speed[:, joints], names)
        compute_ms = 1e3 * reference.compute_s[:, None]
        log.series("plots/times_ms/frame", time_s, compute_ms, ["time per frame [ms]"])
        if latency_s is not None:
            self._finite(log, "plots/times_ms/latency", time_s, 1e3 * latency_s, "arrival to solution [ms]")
        self._add_states(log, "robot", time_s, motion.status)
        for side, stands in zip(SIDES, motion.contact.T, strict=True):
            self._add_states(log, f"{side}_foot", time_s, np.where(stands, "stands", "").tolist())

    def add_margin(self, log: RerunLog, time_s: Array, margin_m: Array) -> None:
        """Send how far inside the support polygon the CoM is, shape (T,) [m]; NaN where there is none."""
        self._finite(log, "plots/com_margin_m", time_s, margin_m, "CoM margin [m]")

    def _speeds(self, time_s: Array, q: Array) -> tuple[Array, Array]:
        """Return speeds since the frame before, and at which times there are some."""
        if self._before is not None:
            time_s, q = np.append(self._before[0], time_s), np.vstack([self._before[1], q])
        self._before = float(time_s[-1]), q[-1].copy()
        return time_s[1:], np.diff(q, axis=0) / np.diff(time_s)[:, None]

    @staticmethod
    def _finite(log: RerunLog, path: str, time_s: Array, values: Array, name: str) -> None:
        known = np.isfinite(values)
        if known.any():
            log.series(path, time_s[known], values[known, None], [name])

    def _add_states(self, log: RerunLog, path: str, time_s: Array, states: Sequence[str]) -> None:
        """Send a state where it changes, and now and then again."""
        told: list[int] = []
        state, at = self._state.get(path, ("", -math.inf))
        for i, (t, s) in enumerate(zip(time_s.tolist(), states, strict=True)):
            if s != state or t - at >= _REPEAT_S:
                state, at = s, t
                told.append(i)
        self._state[path] = state, at
        if told:
            columns = log.rr.StateChange.columns(state=[states[i] for i in told])
            log.columns(f"state/{path}", time_s[told], columns)

    def blueprint(self, *, live: bool) -> Any:
        """Return the layout: the picture left, curves and states right.

        Args:
            live: Follow the newest frame and show the last seconds of the curves.
        """
        import rerun.blueprint as rrb

        recent = None
        if live:
            cursor = rrb.TimeRangeBoundary.cursor_relative
            recent = rrb.VisibleTimeRange(TIMELINE, start=cursor(seconds=-WINDOW_S), end=cursor())

        def view(origin: str, name: str) -> Any:
            return rrb.TimeSeriesView(origin=f"plots/{origin}", name=name, time_ranges=recent)

        def plots(quantity: str, name: str) -> Any:
            views = [view(f"{quantity}/{group}", group.replace("_", " ")) for group, _ in self._groups]
            return rrb.Tabs(*views, name=name)

        panels = [rrb.TimePanel(timeline=TIMELINE, play_state="following", state="collapsed")] if live else []
        return rrb.Blueprint(
            rrb.Horizontal(
                rrb.Spatial3DView(origin="world", name="human and robot"),
                rrb.Vertical(
                    plots("position_rad", "joint positions [rad]"),
                    plots("speed_rad_s", "joint speeds [rad/s]"),
                    view("com_margin_m", "CoM margin [m]"),
                    view("times_ms", "times [ms]"),
                    rrb.StateTimelineView(origin="state", name="states"),
                ),
                column_shares=[3, 2],
            ),
            *panels,
            collapse_panels=True,
        )


def joint_groups(robot: RobotModel) -> list[tuple[str, list[int]]]:
    """Return the joints of each limb, and those of trunk and head, as (name, joint numbers)."""
    below = {}
    for role in ("left_hand", "right_hand", "left_foot", "right_foot"):
        if robot.has(role):
            below[role] = robot.ancestors(role)[BASE_NV:] > 0
    shared = np.sum(list(below.values()), axis=0) > 1 if below else np.zeros(robot.n, dtype=bool)
    groups: list[tuple[str, list[int]]] = []
    rest = np.ones(robot.n, dtype=bool)
    for role, mask in below.items():
        own = mask & ~shared
        rest &= ~own
        groups.append((role.replace("hand", "arm").replace("foot", "leg"), np.flatnonzero(own).tolist()))
    groups.append(("trunk_and_head", np.flatnonzero(rest).tolist()))
    return [(name, joints) for name, joints in groups if joints]


__all__ = ["RerunPlots", "joint_groups"]
