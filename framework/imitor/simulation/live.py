"""A simulated robot that goes along with commands as they come: one period of physics a command."""

from __future__ import annotations

import contextlib
import math
import time
from typing import Any, Final

import numpy as np

from imitor.robot.model import BASE_NQ
from imitor.simulation.body import FLOOR, OTHER, Body
from imitor.simulation.playback import Observer, silent
from imitor.simulation.verdict import Fall, FallRule, tilt
from imitor.types import Array
from imitor.visual.offscreen import import_mujoco

_REACH_M: Final = 0.02
"""A part that the command itself brings so near the floor may touch it [m]."""


class LiveRun:
    """Executes commands one by one, and measures what came of each; nothing grows with the length of the run.

    Args:
        body: The robot.
        period_s: Time between commands [s].
        rule: What counts as a fall.
        velocity_reference: Whether the servos damp the deviation from the commanded speed, or all speed.
        observer: Called after every step.

    Attributes:
        fall: When and how it fell, or ``None``.
    """

    def __init__(
        self,
        body: Body,
        period_s: float,
        rule: FallRule,
        *,
        velocity_reference: bool,
        observer: Observer | None,
    ) -> None:
        self._mujoco = mujoco = import_mujoco()
        self._body, self._rule, self._observer, self._period_s = body, rule, observer, period_s
        self._model, self._data, self._other = (
            body.model,
            mujoco.MjData(body.model),
            mujoco.MjData(body.model),
        )
        self._steps = max(1, math.ceil(period_s / body.around.step_s - 1e-6))
        self._model.opt.timestep = period_s / self._steps
        drives = body.drives
        self._lead = drives.kv / drives.kp if velocity_reference else np.zeros(body.n)
        self._limit = drives.limit * (1.0 - 1e-9)
        self._target: Array = np.zeros(body.n)
        self._shift: Array | None = None
        self.fall: Fall | None = None
        self._commands = self._measured = self._saturated = 0
        self._square, self._base_square, self._base_max = 0.0, 0.0, 0.0
        self._worst, self._load = np.zeros(body.n), np.zeros(body.n)
        self._busy_s = 0.0
        self._quiet = contextlib.ExitStack()
        self._quiet.enter_context(silent(mujoco))

    def place(self, q: Array, settle_s: float) -> None:
        """Put the robot down with its lowest sole corner on the floor, and hold it for a while.

        Args:
            q: Configuration, shape (nq,); its height is of no matter.
            settle_s: How long, in the time of the simulation [s].
        """
        data = self._data
        data.qpos[:] = self._body.qpos(q)
        self._mujoco.mj_kinematics(self._model, data)
        data.qpos[2] -= self._body.sole_corners(data)[..., 2].min()
        self._target = q[BASE_NQ:].copy()
        data.ctrl[:] = self._target
        for _ in range(round(settle_s / self._model.opt.timestep)):
            self._mujoco.mj_step(self._model, data)

    def joints(self) -> Array:
        """Return where the joints are, shape (n,) [rad]."""
        return self._body.configuration(self._data.qpos)[BASE_NQ:]

    def step(self, q: Array, *, measured: bool = True) -> None:
        """Let one period pass, in which the servos are told to go evenly to a command.

        Args:
            q: The command, shape (nq,).
            measured: Whether errors are counted; not while the robot is on its way to the first command.
        """
        self._commands += 1
        if self.fall is not None and self.fall.diverged:
            return
        begin = time.perf_counter()
        data, model, step = self._data, self._model, self._mujoco.mj_step
        joints = q[BASE_NQ:]
        slope = (joints - self._target) / self._steps
        lead = self._lead * (joints - self._target) / self._period_s
        saturated = 0
        with np.errstate(all="ignore"):  # what diverges is found below
            for k in range(self._steps):
                data.ctrl[:] = self._target + (k + 1) * slope + lead
                step(model, data)
                torque = np.abs(data.actuator_force)
                saturated += bool((torque >= self._limit).any())
                np.maximum(self._load, torque, out=self._load)
                if self._observer is not None:
                    self._observer(model, data)
        self._target = joints.copy()
        self._look(q, measured, saturated)
        self._busy_s += time.perf_counter() - begin

    def _look(self, q: Array, measured: bool, saturated: int) -> None:
        data = self._data
        if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
            self.fall = Fall(self._commands - 1, self._now_s, "the simulation diverged", diverged=True)
            return
        if self.fall is not None:
            return
        done = self._body.configuration(data.qpos)
        part = self._part_on_floor(q)
        reason = self._rule.reason(
            height=float(done[2]), asked_height=float(q[2]),
            standing_height=float(self._body.robot.standing[2]), tilt=tilt(done[3:7]),
            asked_tilt=tilt(q[3:7]), part=part,
        )  # fmt: skip
        if reason:
            self.fall = Fall(self._commands - 1, self._now_s, reason)
        elif measured:
            self._measure(q, done, saturated)

    def _measure(self, q: Array, done: Array, saturated: int) -> None:
        error = np.abs(done[BASE_NQ:] - q[BASE_NQ:])
        if self._shift is None:  # drift is counted from the first command on
            self._shift = done[:3] - q[:3]
        base = float(np.linalg.norm(done[:3] - q[:3] - self._shift))
        self._measured += 1
        self._saturated += saturated
        self._square += float(error @ error) / self._body.n
        np.maximum(self._worst, error, out=self._worst)
        self._base_square += base * base
        self._base_max = max(self._base_max, base)

    def _part_on_floor(self, q: Array) -> str:
        """Return the name of a part on the floor that the command does not bring there, or an empty text."""
        touching = self._touching(self._data)
        if not touching.any():
            return ""
        other = self._other
        other.qpos[:] = self._body.qpos(q)
        other.qpos[2] -= _REACH_M
        for update in (self._mujoco.mj_kinematics, self._mujoco.mj_comPos, self._mujoco.mj_collision):
            update(self._model, other)
        strange = touching & ~self._touching(other)
        return self._body.geom_names[int(strange.argmax())] if strange.any() else ""

    def _touching(self, data: Any) -> Any:
        """Return which parts beside the soles touch the floor, shape (ngeom,)."""
        out, kind = np.zeros(self._model.ngeom, dtype=bool), self._body.kind
        if data.ncon:
            geom = data.contact.geom
            first, second = geom.min(axis=1), geom.max(axis=1)
            out[second[(kind[first] == FLOOR) & (kind[second] == OTHER)]] = True
        return out

    @property
    def _now_s(self) -> float:
        return self._commands * self._period_s

    def figures(self) -> dict[str, Any]:
        """Return the verdict; errors are taken over the commands before the fall."""
        n, names, fall = max(self._measured, 1), self._body.robot.joint_names, self.fall
        ratio = self._load / self._body.drives.limit
        return {
            "fell": fall is not None,
            "fall_time_s": None if fall is None else fall.time_s,
            "fall_reason": "" if fall is None else fall.reason,
            "survived_s": self._now_s if fall is None else fall.time_s,
            "frames": self._measured,
            "joint_error_rad": {
                "rms": math.sqrt(self._square / n), "max": float(self._worst.max()),
                "joint": names[int(self._worst.argmax())],
            },
            "base_error_m": {"rms": math.sqrt(self._base_square / n), "max": self._base_max},
            "torque_to_limit": {
                "max": float(ratio.max()), "joint": names[int(ratio.argmax())],
                "saturated_share": self._saturated / (n * self._steps),
            },
            "zmp_inside_share": None,
            "real_time_factor": self._now_s / self._busy_s if self._busy_s else 0.0,
            "step_s": self._model.opt.timestep,
            "notes": list(self._body.drives.notes),
        }  # fmt: skip

    def close(self) -> None:
        """Let MuJoCo write its warnings again; safe to call twice."""
        self._quiet.close()


__all__ = ["LiveRun"]
