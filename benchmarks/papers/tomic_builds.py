"""People and tasks of the experiment of [tomic2018] section 5: 19 builds, 7 dual-arm tasks, hand errors of two fits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import imitor  # noqa: F401  (sets one BLAS thread before numpy is used)
from imitor.human.body import FRACTIONS
from imitor.kinds import Context, Mapper, Source
from imitor.mapping.marker_mapper import MarkerMapper
from imitor.registry import Registry
from imitor.robot.model import RobotModel
from imitor.tasks import TaskStack
from imitor.types import Array

TASKS = (
    "turn_valve",
    "paddle_canoe",
    "pump_mattress",
    "open_close_drawer",
    "turn_steering_wheel",
    "cut_with_knife",
    "grate_food",
)
ALGORITHMS = ("virtual_marker_fit", "marker_fit")
N_BUILDS, SEED = 19, 2018
STATURE_M = {"male": (1.76, 0.07), "female": (1.63, 0.065)}
"""Mean and standard deviation of stature."""
RATIO_SPREAD = 0.04
"""Standard deviation of single lengths, in parts of the length."""
CAPTURE: Mapping[str, Any] = {
    "targets": True,
    "noise_std_m": 0.0005,
    "orientation_noise_rad": 0.005,
    "skin_motion_m": 0.010,
    "joint_motion_m": 0.002,
    "arms_forward_s": 1.0,
    "rate_hz": 50.0,
}
"""How well the people are captured; joint centres are the suit software's estimates."""


def builds() -> list[dict[str, Any]]:
    """Return options of the performer for 19 people, drawn once from the anthropometric spread."""
    rng = np.random.default_rng(SEED)
    people = []
    for i in range(N_BUILDS):
        sex = "male" if rng.random() < 0.5 else "female"
        mean, spread = STATURE_M[sex]
        height = float(np.clip(rng.normal(mean, spread), mean - 2 * spread, mean + 2 * spread))
        ratios = np.clip(rng.normal(1.0, RATIO_SPREAD, len(FRACTIONS)), 0.9, 1.1)
        people.append(
            {
                "sex": sex,
                "height_m": round(height, 3),
                "segment_ratios": {
                    name: round(float(r), 3) for name, r in zip(FRACTIONS, ratios, strict=True)
                },
                "seed": i,
            }
        )
    return people


@dataclass(frozen=True)
class Fitted:
    """Errors of a fit over a motion, each (T, ...) from the end of the calibration pose on.

    Attributes:
        hand_m, joint_m: Distances of recorded hand joints (T, 2), and of shoulders and elbows (T, 4), from the robot's.
        marker_m: Distances of virtual and real markers (T, 6).
        turn: Norms of the orientation error of the hands' markers, eq. 9, (T, 2).
        true_hand_m: Distances of the hand joints from where they really are (T, 2).
    """

    time_s: Array
    hand_m: Array
    joint_m: Array
    marker_m: Array
    turn: Array
    true_hand_m: Array


def fit(robot: RobotModel, algorithm: str, task: str, person: Mapping[str, Any], **capture: Any) -> Fitted:
    """Perform a task as a person and fit the scaled robot to it."""
    registry = Registry(entry_points=False)
    kind: type[Source[Any]] = registry.get("source", "performer")  # type: ignore[assignment]
    source = kind(kind.config_type(scenario=task, **person, **{**CAPTURE, **capture}))
    source.start()
    mapper_kind: type[Mapper[Any]] = registry.get("mapper", algorithm)  # type: ignore[assignment]
    context = Context(robot, source.skeleton, 1.0 / source.rate_hz)
    mapper = mapper_kind(mapper_kind.config_type(pose={}), context)  # type: ignore[call-arg]
    assert isinstance(mapper, MarkerMapper)
    stack = TaskStack(robot.n)
    mapper.declare(stack)
    stack.compile()
    mapper.start()
    frames = list(source.frames())
    mapper.calibrate([f for f in frames if f.time_s <= mapper.calibration_s])
    mapper.reset()
    return Fitted(*(np.array(v) for v in zip(*_errors(mapper, stack, frames, source), strict=True)))


def _errors(mapper: MarkerMapper[Any], stack: TaskStack, frames: Any, source: Any) -> Iterator[Any]:
    from imitor.mapping.virtual_markers import Weights
    from imitor.types import ROLE_INDEX

    criterion = mapper.imitation.criterion
    arms = criterion.arms
    n_m, n_j = len(arms.markers), len(arms.joints)
    hands = [ROLE_INDEX[r] for r in arms.hands]
    for i, frame in enumerate(frames):
        mapper.step(frame, stack)
        if frame.time_s < mapper.calibration_s:
            continue
        criterion.model.update()
        goal, real = criterion.targets(frame)
        at = criterion.model.points()
        distance = np.linalg.norm(goal - at, axis=1)
        weights, criterion.weights = criterion.weights, Weights(gamma=1.0)
        turn = criterion.rows(goal, real)[0][3 * len(goal) :].reshape(-1, 3)
        criterion.weights = weights
        true = np.linalg.norm(source.truth.position[i, hands] - at[n_m + n_j :], axis=1)
        yield (
            frame.time_s, distance[n_m + n_j :], distance[n_m : n_m + n_j], distance[:n_m],
            np.linalg.norm(turn, axis=1), true,
        )  # fmt: skip


def survey(robot: RobotModel, tasks: Sequence[str] = TASKS) -> dict[str, Any]:
    """Return mean and largest hand errors, shape (builds, tasks) [m], and largest joint errors, of both algorithms."""
    out: dict[str, Any] = {}
    for algorithm in ALGORITHMS:
        found = [[fit(robot, algorithm, task, p) for task in tasks] for p in builds()]
        out[algorithm] = {
            "hand_mean_m": np.array([[f.hand_m.mean() for f in row] for row in found]),
            "hand_max_m": np.array([[f.hand_m.max() for f in row] for row in found]),
            "true_hand_mean_m": np.array([[f.true_hand_m.mean() for f in row] for row in found]),
            "joint_max_m": np.array([[f.joint_m.max() for f in row] for row in found]),
            "marker_mean_m": np.array([[f.marker_m.mean() for f in row] for row in found]),
            "turn_max": np.array([[f.turn.max() for f in row] for row in found]),
        }
    return out
