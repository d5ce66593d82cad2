"""A motion executed in physics: the servos are told the commands, everything else is gravity and contact."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from imitor.record import Motion, Reference
from imitor.robot.model import BASE_NQ, BASE_NV
from imitor.simulation.body import FLOOR, LEFT, OTHER, Body
from imitor.simulation.verdict import Fall, FallRule, tilt
from imitor.types import Array, BoolArray, IntArray
from imitor.visual.offscreen import import_mujoco

_ASKED_TO_TOUCH_M: Final = 0.02
"""A part that the motion itself brings so near the floor may touch it [m]."""

Observer = Callable[[Any, Any], None]
"""Called after every step with MuJoCo's model and data."""


@dataclass(frozen=True)
class Trace:
    """What the simulated robot did, at the times of the T commands.

    Attributes:
        time_s: Times of the commands, shape (T,) [s].
        q: Pinocchio configurations, shape (T, 7 + n).
        v: Pinocchio velocities, the base's in its own axes, shape (T, 6 + n) [m/s, rad/s].
        q_asked: The commands, base set down on the floor unless it is held, shape (T, 7 + n).
        torque: Of the servos, shape (T, n) [N m].
        peak_torque: Largest since the frame before, absolute, shape (T, n) [N m].
        saturated: Share of the steps since the frame before with some servo at its limit, shape (T,) [-].
        force: Vertical force of the floor on left foot, right foot, other parts; mean since the frame before,
            shape (T, 3) [N].
        zmp: Centre of pressure on the floor, mean since the frame before weighted by force, shape (T, 2) [m]; NaN
            in the air.
        sole: Sole corners, shape (T, 2, K, 3) [m].
        object_shift: How far each object is from where it was, shape (T, K, 3) [m], and where it was to be,
            `object_shift_asked`.
        held: Number of the object that each hand holds, -1 for none, shape (T, 2), and was to hold, `held_asked`.
        fall: When and how it fell, or ``None``.
        step_s: Time step [s].
        real_time_factor: Simulated time by computing time [-].
    """

    time_s: Array
    q: Array
    v: Array
    q_asked: Array
    torque: Array
    peak_torque: Array
    saturated: Array
    force: Array
    zmp: Array
    sole: Array
    object_shift: Array
    object_shift_asked: Array
    held: IntArray
    held_asked: IntArray
    fall: Fall | None
    step_s: float
    real_time_factor: float


def play(
    body: Body,
    motion: Motion,
    *,
    settle_s: float = 1.0,
    rule: FallRule | None = None,
    velocity_reference: bool = True,
    observer: Observer | None = None,
    reference: Reference | None = None,
    reach_m: float = 0.0,
) -> Trace:
    """Execute a motion, from its first command with the soles on the floor to its last.

    Args:
        body: The robot.
        motion: Commands of the same joints; between two of them the targets move evenly.
        settle_s: How long the first command is held before time starts [s].
        rule: What counts as a fall.
        velocity_reference: Whether the servos damp the deviation from the commanded speed, or all speed.
        observer: Called after every step.
        reference: Says which hand is to hold which object, and where objects are to go; none: hands hold nothing.
        reach_m: How near its surface a hand takes an object that it is to hold; 0 takes none [m].
    """
    with silent(import_mujoco()):
        run = _Run(body, motion, rule or FallRule(), velocity_reference, observer)
        run.grasp(reference, reach_m)
        return run.execute(settle_s)


def fitting_step(time_s: Array, step_s: float) -> float:
    """Return the longest time step that fits a whole number of times between even frames [s]; else ``step_s``."""
    periods = np.diff(time_s)
    if not len(periods):
        return step_s
    period = float(periods.mean())
    if np.abs(periods - period).max() > 1e-6:
        return step_s
    return period / max(1, math.ceil(period / step_s - 1e-6))


class _Run:
    def __init__(
        self, body: Body, motion: Motion, rule: FallRule, velocity_reference: bool, observer: Observer | None
    ) -> None:
        self._mujoco = mujoco = import_mujoco()
        self._body, self._rule, self._observer = body, rule, observer
        self._model, self._data = body.model, mujoco.MjData(body.model)
        self._time = motion.time_s
        self._asked = motion.configurations()
        self._set_down()
        self._may_touch = self._asked_to_touch()
        self._step_s = self._model.opt.timestep = fitting_step(self._time, body.around.step_s)
        self._steps = np.rint((self._time - self._time[0]) / self._step_s).astype(int)
        self._targets = self._servo_targets(velocity_reference)
        frames, n = len(motion), body.n
        self._q, self._v = np.empty_like(self._asked), np.zeros((frames, BASE_NV + n))
        self._torque, self._peak = np.zeros((frames, n)), np.zeros((frames, n))
        self._saturated, self._force = np.zeros(frames), np.zeros((frames, 3))
        self._zmp = np.full((frames, 2), np.nan)
        self._sole = np.empty((frames, *body.robot.sole.shape))
        self._fall: Fall | None = None

    def grasp(self, reference: Reference | None, reach_m: float) -> None:
        """Tell which hand is to hold what, and from how near."""
        frames, names = len(self._time), self._body.things.names
        self._reach_m = reach_m
        self._shift = np.zeros((frames, len(names), 3))
        self._shift_asked, self._held_asked = np.zeros_like(self._shift), np.full((frames, 2), -1)
        self._held = self._held_asked.copy()
        if reference is not None and list(reference.object_names) == names:
            self._shift_asked, self._held_asked = reference.object_shift_m, reference.held_object

    def _set_down(self) -> None:
        """Put the lowest sole corner of the first command on the floor; the whole motion moves along.

        A base that is held stays where it is asked for.
        """
        if self._body.held:
            return
        data = self._data
        data.qpos[:] = self._body.qpos(self._asked[0])
        self._mujoco.mj_kinematics(self._model, data)
        self._asked = self._asked.copy()
        self._asked[:, 2] -= self._body.sole_corners(data)[..., 2].min()

    def _asked_to_touch(self) -> BoolArray:
        """Return which geoms the motion itself brings to the floor, shape (T, ngeom)."""
        mujoco, data = self._mujoco, self._mujoco.MjData(self._model)
        out = np.zeros((len(self._asked), self._model.ngeom), dtype=bool)
        lowered = self._body.qpos(self._asked)
        lowered[:, 2] -= _ASKED_TO_TOUCH_M
        for i, qpos in enumerate(lowered):
            data.qpos[:] = qpos
            mujoco.mj_kinematics(self._model, data)
            mujoco.mj_comPos(self._model, data)
            mujoco.mj_collision(self._model, data)
            out[i, data.contact.geom.ravel()] = True
        return out

    def _servo_targets(self, velocity_reference: bool) -> Array:
        """Return the target of every servo at every step, shape (S, n)."""
        joints, at = self._asked[:, BASE_NQ:], self._time - self._time[0]
        targets = joints
        if velocity_reference and len(at) > 1:
            lead = self._body.drives.kv / self._body.drives.kp
            targets = joints + lead * np.gradient(joints, at, axis=0)
        steps = np.arange(self._steps[-1]) * self._step_s
        return np.column_stack([np.interp(steps, at, column) for column in targets.T])

    def execute(self, settle_s: float) -> Trace:
        model, data, body = self._model, self._data, self._body
        self._mujoco.mj_resetData(model, data)
        data.qpos[:] = body.qpos(self._asked[0])
        hold = np.tile(self._asked[0, BASE_NQ:], (max(1, round(settle_s / self._step_s)), 1))
        begin = time.perf_counter()
        with np.errstate(all="ignore"):  # what diverges is found by `_look`
            self._advance(hold, 0)
            for i in range(1, len(self._time)):
                self._advance(self._targets[self._steps[i - 1] : self._steps[i]], i)
        taken = time.perf_counter() - begin
        simulated = (len(hold) + self._steps[-1]) * self._step_s
        return Trace(
            self._time, self._q, self._v, self._asked, self._torque, self._peak, self._saturated, self._force,
            self._zmp, self._sole, self._shift, self._shift_asked, self._held, self._held_asked, self._fall,
            self._step_s, float(simulated / taken),
        )  # fmt: skip

    def _advance(self, targets: Array, frame: int) -> None:
        """Step through the targets up to a frame and keep what was measured on the way."""
        if self._fall is not None and self._fall.diverged:
            self._keep_still(frame)
            return
        mujoco, model, data, kind = self._mujoco, self._model, self._data, self._body.kind
        limit = self._body.drives.limit * (1.0 - 1e-9)
        force, moment = np.zeros(3), np.zeros(2)
        touching = np.zeros(model.ngeom, dtype=bool)
        peak, saturated = self._peak[frame], 0
        if self._body.held:
            data.mocap_pos[0], data.mocap_quat[0] = self._asked[frame, :3], self._asked[frame, [6, 3, 4, 5]]
        if self._reach_m:
            self._body.things.hold(model, data, self._held_asked[frame], self._reach_m)
        for target in targets:
            data.ctrl[:] = target
            mujoco.mj_step(model, data)
            torque = np.abs(data.actuator_force)
            np.maximum(peak, torque, out=peak)
            saturated += bool((torque >= limit).any())
            if data.ncon:
                contact = data.contact
                normal = data.efc_force[contact.efc_address]
                first, second = contact.geom.T
                mine = kind[first] >= LEFT
                geom, other = np.where(mine, first, second), np.where(mine, second, first)
                # a sole may stand on an object; what else touches one neither carries the robot nor is a fall
                counts = (kind[other] == FLOOR) | (kind[geom] != OTHER)
                geom, normal = geom[counts], normal[counts]
                force += np.bincount(kind[geom], normal, 3)
                moment += normal @ contact.pos[counts, :2]
                touching[geom] = True
            if self._observer is not None:
                self._observer(model, data)
        steps = max(len(targets), 1)
        self._saturated[frame] = saturated / steps
        self._force[frame] = force / steps
        if force.sum() > 0.0:
            self._zmp[frame] = moment / force.sum()
        self._look(frame, touching)

    def _look(self, frame: int, touching: BoolArray) -> None:
        """Keep the state of a frame and tell whether the robot has fallen."""
        data, asked = self._data, self._asked[frame]
        if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
            if self._fall is None:
                self._fall = Fall(frame, self._at(frame), "the simulation diverged", diverged=True)
            else:
                self._fall = Fall(self._fall.frame, self._fall.time_s, self._fall.reason, diverged=True)
            self._keep_still(frame)
            return
        self._q[frame] = self._body.configuration(data.qpos)
        self._v[frame] = self._body.velocity(data.qpos, data.qvel)
        self._torque[frame] = data.actuator_force
        self._sole[frame] = self._body.sole_corners(data)
        self._shift[frame] = self._body.things.shift(data.qpos)
        self._held[frame] = self._body.things.holding(data)
        if self._fall is not None:
            return
        strange = touching & (self._body.kind == OTHER) & ~self._may_touch[frame]
        reason = self._rule.reason(
            height=float(data.qpos[2]), asked_height=float(asked[2]),
            standing_height=float(self._body.robot.standing[2]),
            tilt=tilt(self._q[frame, 3:7]), asked_tilt=tilt(asked[3:7]),
            part=self._body.geom_names[int(strange.argmax())] if strange.any() else "",
        )  # fmt: skip
        if reason and frame == 0:
            reason = f"before the motion began, {reason}"
        if reason:
            self._fall = Fall(frame, self._at(frame), reason)

    def _keep_still(self, frame: int) -> None:
        """Repeat the last state that was finite."""
        before = max(frame - 1, 0)
        self._q[frame] = self._q[before] if frame else self._asked[0]
        self._sole[frame] = self._sole[before] if frame else 0.0
        self._shift[frame], self._held[frame] = self._shift[before], self._held[before]
        self._torque[frame] = self._peak[frame] = self._force[frame] = 0.0
        self._zmp[frame] = np.nan

    def _at(self, frame: int) -> float:
        return float(self._time[frame] - self._time[0])


@contextlib.contextmanager
def silent(mujoco: Any) -> Iterator[None]:
    """Keep MuJoCo from writing its warnings into a file of the current folder."""
    mujoco.set_mju_user_warning(lambda _message: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(None)


__all__ = ["Observer", "Trace", "fitting_step", "play", "silent"]
