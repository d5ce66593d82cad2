"""Every figure against an answer computed by hand, on the small humanoid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from imitor import metrics
from imitor.errors import SourceError
from imitor.metrics.balance import GRAVITY, cart_table_zmp
from imitor.metrics.catalogue import FIGURES
from imitor.record import Motion, Reference
from imitor.robot.model import RobotModel
from imitor.types import ROLE_INDEX, SEGMENTS
from small_humanoid import FOREARM, RATE_HZ, SOLE, SmallHumanoid, moving, still

T = 20
HIP_Y, BACK, FRONT, SIDE = 0.08, SOLE[1][0], SOLE[0][0], SOLE[0][1]


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    """The small humanoid, standing with straight legs."""
    return RobotModel.load(str(SmallHumanoid().write(tmp_path_factory.mktemp("robot"))))


@dataclass
class Case:
    """A run that a test changes in one place before it measures."""

    robot: RobotModel
    motion: Motion
    reference: Reference

    def column(self, joint: str) -> int:
        return self.robot.joint_index(joint)

    def set(self, joint: str, values: Any, frames: Any = slice(None)) -> None:
        self.motion.joint_position_rad[frames, self.column(joint)] = values

    def report(self, **options: Any) -> dict[str, Any]:
        return metrics.evaluate(self.motion, self.reference, self.robot, **{"collision_every": 0, **options})

    def figures(self, **options: Any) -> dict[str, Any]:
        figures: dict[str, Any] = self.report(**options)["figures"]
        return figures

    def follow_human(self) -> None:
        """Let the human do what the robot does."""
        self.reference = moving(self.robot, self.motion.configurations())[1]


@pytest.fixture
def case(robot: RobotModel) -> Case:
    """A robot that stands for 20 frames, and a human whose points are the robot's."""
    return Case(robot, *still(robot, T))


def near(value: Any, tolerance: float = 1e-9) -> Any:
    return pytest.approx(value, abs=tolerance)


# ---------------------------------------------------------------------- imitation


def test_a_human_that_is_the_robot_has_no_error(case: Case) -> None:
    figures = case.figures()
    for segment in SEGMENTS:
        assert figures[f"direction_error_{segment}_deg"] == {"mean": near(0), "max": near(0), "frames": T}
    for end in ("left_hand", "right_hand", "left_foot", "right_foot"):
        assert figures[f"end_effector_error_{end}_m"]["max"] == near(0)
    assert figures["direction_error_deg"]["segments"] == 9
    assert figures["support_agreement_frames"] == {"count": T, "share": 1.0, "frames": T}


def test_a_forearm_turned_by_ten_degrees(case: Case) -> None:
    case.set("left_elbow", np.radians(-10.0))
    figures = case.figures()
    assert figures["direction_error_left_forearm_deg"] == {"mean": near(10), "max": near(10), "frames": T}
    assert figures["direction_error_right_forearm_deg"]["max"] == near(0)
    assert figures["direction_error_left_upper_arm_deg"]["max"] == near(0)
    overall = figures["direction_error_deg"]
    assert (overall["mean"], overall["worst_segment_mean"], overall["worst_segment"]) == (
        near(10 / 9),
        near(10),
        "left_forearm",
    )
    assert figures["end_effector_error_left_hand_m"]["mean"] == near(2 * FOREARM * np.sin(np.radians(5.0)))


def test_only_frames_in_which_the_human_is_known_count(case: Case) -> None:
    case.set("left_elbow", np.radians(-10.0), slice(0, 5))
    case.reference.role_valid[5:, ROLE_INDEX["left_wrist"]] = False
    case.reference.role_position_m[4, ROLE_INDEX["left_elbow"]] = np.nan
    figures = case.figures()
    assert figures["direction_error_left_forearm_deg"] == {"mean": near(10), "max": near(10), "frames": 4}
    assert figures["direction_error_left_upper_arm_deg"]["frames"] == T - 1
    assert figures["end_effector_error_left_hand_m"]["frames"] == 5  # shoulder and wrist are enough


def test_a_larger_human_of_the_same_form_has_no_error(case: Case) -> None:
    case.reference.role_position_m *= 1.7
    figures = case.figures()
    assert figures["direction_error_deg"]["worst_segment_mean"] == near(0)
    hand = figures["end_effector_error_left_hand_m"]
    assert hand["max"] == near(0)
    assert hand["scale"] == near(1 / 1.7)


def test_a_hand_stands_for_a_wrist_that_the_human_lacks(case: Case) -> None:
    case.reference.role_valid[:, ROLE_INDEX["left_wrist"]] = False
    report = case.report()
    assert "direction_error_left_forearm_deg" not in report["figures"]
    assert report["not_measured"]["direction_error_left_forearm_deg"] == (
        "the human's left_elbow and left_wrist are never known together"
    )
    assert report["figures"]["end_effector_error_left_hand_m"]["max"] == near(0)


def test_support_agreement_counts_known_frames(case: Case) -> None:
    case.reference.human_support_known[:8] = False
    case.reference.human_support[10:13, 1] = False
    assert case.figures()["support_agreement_frames"] == {"count": 9, "share": near(9 / 12), "frames": 12}


def stand_on_left(case: Case, first: int, end: int, robot_first: int, robot_end: int) -> None:
    """Let the human and the robot stand on the left foot for a while, five frames a second."""
    case.motion.time_s[:] = case.reference.time_s[:] = 0.2 * np.arange(T)
    case.reference.human_support[first:end, 1] = False
    case.motion.contact[robot_first:robot_end, 1] = False


def test_the_delay_of_support_is_the_time_until_the_robot_stands_alike(case: Case) -> None:
    stand_on_left(case, 3, 10, 5, 11)
    figures = case.figures()
    assert figures["support_delay_s"] == {
        "mean": near(0.3),
        "max": near(0.4),
        "changes": 2,
        "missed": 0,
        "frames": T,
    }
    assert figures["single_support_executed_phases"] == {"count": 1, "share": 1.0, "phases": 1, "frames": T}


def test_a_support_that_the_robot_never_takes_is_missed(case: Case) -> None:
    stand_on_left(case, 3, 10, 0, 0)
    figures = case.figures()
    assert figures["support_delay_s"]["missed"] == 1
    assert figures["single_support_executed_phases"] == {"count": 0, "share": 0.0, "phases": 1, "frames": T}


@pytest.mark.parametrize(("late", "executed"), [(14, 1), (15, 0)])
def test_a_phase_may_be_carried_out_a_second_late(case: Case, late: int, executed: int) -> None:
    stand_on_left(case, 3, 10, late, late + 1)  # the human's phase ends with frame 9
    assert case.figures()["single_support_executed_phases"]["count"] == executed


def test_phases_on_one_foot_that_are_short_are_not_asked_for(case: Case) -> None:
    stand_on_left(case, 3, 7, 3, 7)
    reasons = case.report()["not_measured"]
    assert reasons["single_support_executed_phases"] == "the human never stood on one foot for 1 s"


# ---------------------------------------------------------------------- feet


def test_slip_is_the_speed_of_a_foot_in_contact(case: Case) -> None:
    case.motion.root_position_m[:, 0] += 0.3 * case.motion.time_s
    case.motion.root_position_m[:, 1] -= 0.4 * case.motion.time_s
    case.reference.human_support[5:, :] = False
    case.reference.human_support[:, 1] = False
    figures = case.figures()
    declared = {"mean": near(0.5), "max": near(0.5), "foot_frames": 2 * (T - 1), "frames": T - 1}
    assert figures["foot_slip_declared_contact_m_s"] == declared
    assert figures["foot_slip_human_contact_m_s"] == {**declared, "foot_frames": 4, "frames": 4}


def test_slip_leaves_out_the_vertical(case: Case) -> None:
    case.motion.root_position_m[:, 2] += 0.3 * case.motion.time_s
    assert case.figures()["foot_slip_declared_contact_m_s"]["max"] == near(0)


def test_a_lifted_robot_floats_and_flies(case: Case) -> None:
    case.motion.root_position_m[:, 2] += 0.02
    case.motion.contact[:5, 0] = False
    report = case.report()
    figures = report["figures"]
    assert figures["float_m"] == {
        "mean": near(0.02), "max": near(0.02), "foot_frames": 2 * T - 5, "frames": T
    }  # fmt: skip
    assert figures["penetration_m"]["max"] == 0.0
    assert figures["flight_frames"] == {"count": T, "share": 1.0, "frames": T}
    assert figures["contact_disagreement_frames"] == {
        "count": T, "share": 1.0, "declared_not_touching_foot_frames": 2 * T - 5,
        "touching_not_declared_foot_frames": 0, "frames": T,
    }  # fmt: skip
    assert report["not_measured"]["com_margin_double_support_m"] == "no frame in double support"


def test_a_lowered_robot_penetrates_the_floor(case: Case) -> None:
    case.motion.root_position_m[:10, 2] -= 0.01
    figures = case.figures()
    assert figures["penetration_m"] == {"mean": near(0.005), "max": near(0.01), "frames": T}
    assert figures["penetration_frames"] == {"count": 10, "share": 0.5, "frames": T}
    assert figures["float_m"]["max"] == near(0)


def test_a_foot_that_stands_without_saying_so(case: Case) -> None:
    case.motion.contact[:6, 1] = False
    figures = case.figures()
    disagreement = figures["contact_disagreement_frames"]
    assert (disagreement["count"], disagreement["touching_not_declared_foot_frames"]) == (6, 6)


# ---------------------------------------------------------------------- joints


def test_joints_outside_their_limits(case: Case) -> None:
    i, k = case.column("left_knee"), case.column("waist_yaw")
    case.set("left_knee", case.robot.lower[i] - 0.1, [3, 4])
    case.set("waist_yaw", case.robot.upper[k] + 0.2, [4])
    case.set("right_knee", case.robot.lower[i] - 1e-10, [8])
    assert case.figures()["joint_limit_violation_frames"] == {
        "count": 2, "share": 0.1, "joint_frames": 3, "excess_rad": near(0.2), "frames": T
    }  # fmt: skip


def test_a_step_is_a_jump_unless_the_human_turns(case: Case) -> None:
    case.set("left_shoulder_pitch", 0.6, slice(10, None))
    still_human = case.figures()
    assert still_human["joint_jump_frames"] == {
        "count": 1, "share": near(1 / (T - 1)), "largest_step_rad": near(0.6), "frames": T - 1
    }  # fmt: skip
    speed = still_human["joint_speed_rad_s"]
    assert (speed["max"], speed["joint"]) == (near(0.6 * RATE_HZ), "left_shoulder_pitch")
    assert speed["mean"] == near(0.6 * RATE_HZ / (T - 1))
    assert still_human["joint_speed_to_limit_ratio"]["max"] == near(0.6 * RATE_HZ / 8.0)
    assert still_human["joint_overspeed_frames"] == {"count": 1, "share": near(1 / (T - 1)), "frames": T - 1}
    case.follow_human()
    assert case.figures()["joint_jump_frames"]["count"] == 0


def test_a_human_that_is_lost_counts_as_still(case: Case) -> None:
    case.set("left_shoulder_pitch", 0.6, slice(10, None))
    case.follow_human()
    case.reference.role_valid[10] = False
    assert case.figures()["joint_jump_frames"]["count"] == 1


def test_speed_at_its_limit_is_not_above_it(case: Case) -> None:
    case.set("waist_yaw", np.arange(T) * 8.0 / RATE_HZ - 1.5)
    figures = case.figures()
    assert figures["joint_speed_to_limit_ratio"]["max"] == near(1.0)
    assert figures["joint_overspeed_frames"]["count"] == 0


def test_acceleration_and_jerk_of_polynomials(case: Case) -> None:
    t = case.motion.time_s
    case.set("waist_yaw", 0.5 * 20.0 * t**2)
    assert case.figures()["joint_acceleration_to_limit_ratio"]["max"] == near(20.0 / 100.0)
    assert case.figures()["joint_acceleration_to_limit_ratio"]["joint"] == "waist_yaw"
    case.set("waist_yaw", t**3)
    jerk = case.figures()["joint_jerk_rad_s3"]
    assert jerk == {"rms": near(6.0 / np.sqrt(case.robot.n), 1e-6), "max": near(6.0, 1e-6), "frames": T - 3}


# ---------------------------------------------------------------------- balance


def test_com_in_the_polygon_of_both_feet(case: Case) -> None:
    """Only the feet, 0.5 kg each at x 0.04, move the CoM of 24.8 kg forward; they span x -0.05 to 0.13."""
    x = 2 * 0.5 * 0.04 / 24.8
    margin = {"mean": near(x - BACK), "min": near(x - BACK), "inside": T, "inside_share": 1.0, "frames": T}
    assert case.figures()["com_margin_double_support_m"] == margin
    assert case.figures()["zmp_margin_double_support_m"] == {**margin, "inside": T - 4, "frames": T - 4}
    case.motion.root_position_m[:, 0] += 1.0  # the feet go along
    assert case.figures()["com_margin_double_support_m"] == margin


def test_com_beside_the_only_foot(case: Case) -> None:
    case.set("right_hip_pitch", -0.5)
    case.set("right_knee", 1.0)
    case.set("right_ankle_pitch", -0.5)
    report = case.report()
    single = report["figures"]["com_margin_single_support_m"]
    case.robot.update(case.motion.configurations()[0])
    y = float(case.robot.com[1])
    assert single == {
        "mean": near(y - (HIP_Y - SIDE)), "min": near(y - (HIP_Y - SIDE)), "inside": 0, "inside_share": 0.0,
        "frames": T,
    }  # fmt: skip
    assert single["min"] < -0.02
    assert report["not_measured"]["com_margin_double_support_m"] == "no frame in double support"
    case.robot.update(case.robot.standing)


def test_a_tilted_sole_stands_on_its_edge(case: Case) -> None:
    """On its heels the robot has a line to stand on: the margin is minus the distance to it."""
    for side in ("left", "right"):
        case.set(f"{side}_ankle_pitch", -0.2)
    lowest = 0.05 * np.cos(0.2) + 0.05 * np.sin(0.2)
    case.motion.root_position_m[:, 2] += lowest - 0.05
    figures = case.figures()
    assert figures["penetration_m"]["max"] == near(0)
    assert figures["com_margin_double_support_m"]["inside"] == 0
    heel_x = BACK * np.cos(0.2) + 0.05 * np.sin(0.2)
    case.robot.update(case.motion.configurations()[0])
    expected = -abs(float(case.robot.com[0]) - heel_x)
    case.robot.update(case.robot.standing)
    assert figures["com_margin_double_support_m"]["min"] == near(expected)


def test_zmp_of_a_sway_is_that_of_the_cart_table() -> None:
    """c = A sin(wt) has p = c (1 + z w^2 / g); the central difference lowers w^2 by sinc^2(w h / 2)."""
    period, height, amplitude, w = 0.01, 0.8, 0.03, 2 * np.pi * 0.8
    t = np.arange(300) * period
    com = np.stack([np.zeros_like(t), amplitude * np.sin(w * t), np.full_like(t, height)], axis=1)
    zmp, known = cart_table_zmp(com, period)
    assert known.sum() == 300 - 2 * 5  # five frames of 10 ms to each side
    damped = w**2 * np.sinc(w * 0.05 / 2 / np.pi) ** 2
    exact = com[:, 1] * (1 + height * damped / GRAVITY)
    np.testing.assert_allclose(zmp[known, 1], exact[known], atol=1e-12)
    analytic = com[:, 1] * (1 + height * w**2 / GRAVITY)
    np.testing.assert_allclose(zmp[known, 1], analytic[known], atol=0.01 * 0.06)
    assert np.isnan(zmp[~known]).all()


def test_a_push_forward_moves_the_zmp_but_not_the_com(case: Case) -> None:
    """The whole robot accelerates at 1 m/s^2: CoM and feet together, the ZMP stays behind by z / g."""
    case.motion.root_position_m[:, 0] += 0.5 * 1.0 * case.motion.time_s**2
    figures = case.figures()
    shift = figures["com_margin_double_support_m"]["min"] - figures["zmp_margin_double_support_m"]["min"]
    case.robot.update(case.robot.standing)
    assert shift == near(float(case.robot.com[2]) / GRAVITY)


# ---------------------------------------------------------------------- time and status


def test_time_per_frame(case: Case) -> None:
    times = np.linspace(0.001, 0.020, T)
    case.reference.compute_s = times
    figures = case.figures()
    assert figures["compute_time_s"] == {
        "mean": near(0.0105), "median": near(0.0105), "p99": near(np.percentile(times, 99)),
        "p99_9": near(np.percentile(times, 99.9)), "max": near(0.020), "frames": T,
    }  # fmt: skip
    assert figures["compute_time_to_period_ratio"]["mean"] == near(0.0105 * RATE_HZ)
    case.reference.compute_s = np.zeros(T)
    assert case.report()["not_measured"]["compute_time_s"] == "the time per frame was not recorded"


def test_held_and_stopped_frames(case: Case) -> None:
    case.motion.status = ["ok"] * 15 + ["held"] * 3 + ["stopped"] * 2
    assert case.figures()["held_frames"] == {"count": 5, "share": 0.25, "stopped": 2, "frames": T}


# ---------------------------------------------------------------------- every figure


def bend(case: Case, segment: str) -> None:
    side, _, part = segment.rpartition("_") if segment == "torso" else segment.partition("_")
    joint = {"upper_arm": "shoulder_pitch", "forearm": "elbow", "thigh": "hip_pitch", "shank": "knee"}
    if segment == "torso":
        case.reference.role_position_m[:, ROLE_INDEX["left_shoulder"], 0] += 0.1
    else:
        case.set(f"{side}_{joint[part]}", 0.15)


def one_foot_up(case: Case) -> None:
    case.set("right_hip_pitch", -0.5)
    case.set("right_knee", 1.0)
    case.set("right_ankle_pitch", -0.5)


def sway(case: Case, *, lift: bool) -> None:
    case.motion.root_position_m[:, 1] += 0.02 * np.sin(10 * case.motion.time_s)
    if lift:
        one_foot_up(case)


def shift(height: float) -> Callable[[Case], None]:
    def apply(case: Case) -> None:
        case.motion.root_position_m[:, 2] += height

    return apply


def accelerate(case: Case) -> None:
    case.set("waist_yaw", 5 * case.motion.time_s**3)


def cross_arms(case: Case) -> None:
    case.set("left_shoulder_roll", -0.6)


def change(**values: Any) -> Callable[[Case], None]:
    def apply(case: Case) -> None:
        for name, value in values.items():
            setattr(case.reference, name, value)

    return apply


def move_base(case: Case) -> None:
    case.motion.root_position_m[:, 0] += np.arange(T) * 0.01


CAUSES: dict[str, Callable[[Case], None]] = {
    "direction_error_deg": lambda c: bend(c, "left_thigh"),
    **{f"direction_error_{s}_deg": lambda c, s=s: bend(c, s) for s in SEGMENTS},  # type: ignore[misc]
    **{f"end_effector_error_{s}_hand_m": lambda c, s=s: bend(c, f"{s}_forearm") for s in ("left", "right")},  # type: ignore[misc]
    **{f"end_effector_error_{s}_foot_m": lambda c, s=s: bend(c, f"{s}_shank") for s in ("left", "right")},  # type: ignore[misc]
    "support_agreement_frames": change(human_support=np.zeros((T, 2), dtype=bool)),
    "support_delay_s": lambda c: stand_on_left(c, 3, 10, 5, 11),
    "human_unseen_frames": change(human_com_m=np.zeros((T, 3))),
    "human_flight_frames": change(human_support=np.zeros((T, 2), dtype=bool)),
    "single_support_executed_phases": lambda c: stand_on_left(c, 2, T, 2, T),
    "foot_slip_human_contact_m_s": lambda c: sway(c, lift=False),
    "foot_slip_declared_contact_m_s": lambda c: sway(c, lift=False),
    "penetration_m": shift(-0.01),
    "penetration_frames": shift(-0.01),
    "float_m": shift(0.01),
    "flight_frames": shift(0.01),
    "contact_disagreement_frames": one_foot_up,
    "com_margin_single_support_m": one_foot_up,
    "com_margin_double_support_m": lambda c: c.set("left_shoulder_pitch", 1.0),
    "zmp_margin_single_support_m": lambda c: sway(c, lift=True),
    "zmp_margin_double_support_m": lambda c: sway(c, lift=False),
    "joint_limit_violation_frames": lambda c: c.set("left_knee", -0.1, [2]),
    "joint_speed_rad_s": accelerate,
    "joint_speed_to_limit_ratio": accelerate,
    "joint_overspeed_frames": lambda c: c.set("waist_yaw", 0.6, slice(9, None)),
    "joint_saturated_frames": lambda c: c.set("waist_yaw", 0.6, slice(9, None)),
    "base_speed_m_s": move_base,
    "joint_acceleration_to_limit_ratio": accelerate,
    "joint_jump_frames": lambda c: c.set("waist_yaw", 0.6, slice(9, None)),
    "joint_jerk_rad_s3": accelerate,
    "self_collision_frames": cross_arms,
    "compute_time_s": change(compute_s=np.full(T, 0.003)),
    "compute_time_to_period_ratio": change(compute_s=np.full(T, 0.003)),
    "held_frames": lambda c: setattr(c.motion, "status", ["held"] * T),
}


@pytest.mark.parametrize("name", [name for figure in FIGURES for name in figure.full_names])
def test_a_figure_changes_with_its_cause(case: Case, name: str) -> None:
    before = case.report(collision_every=None)
    CAUSES[name](case)
    after = case.report(collision_every=None)
    assert after["figures"][name] != before["figures"].get(name)


def test_every_figure_is_measured_or_has_a_reason(case: Case) -> None:
    report = case.report()
    names = [name for figure in FIGURES for name in figure.full_names]
    assert sorted(report["figures"].keys() | report["not_measured"].keys()) == sorted(names)
    assert not report["figures"].keys() & report["not_measured"].keys()
    assert all(f["frames"] > 0 for f in report["figures"].values())
    single = Case(case.robot, *still(case.robot, 1)).report()
    assert single["not_measured"]["joint_speed_rad_s"] == "it takes two frames"
    assert sorted(single["figures"].keys() | single["not_measured"].keys()) == sorted(names)


def test_a_robot_without_arms_says_what_is_missing(tmp_path: Path) -> None:
    human = SmallHumanoid()
    for role in ("elbow", "wrist", "hand"):
        del human.card["roles"][role]
    robot = RobotModel.load(str(human.write(tmp_path)))
    report = Case(robot, *still(robot)).report()
    assert (
        report["not_measured"]["direction_error_left_forearm_deg"]
        == "the robot has no left_elbow and no left_wrist"
    )
    assert (
        report["not_measured"]["end_effector_error_left_hand_m"]
        == "the robot has no left_elbow and no left_wrist"
    )
    assert report["figures"]["direction_error_deg"]["segments"] == 5


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(turn=st.floats(-np.pi, np.pi), x=st.floats(-5, 5), y=st.floats(-5, 5))
def test_figures_do_not_depend_on_where_the_world_begins(
    robot: RobotModel, turn: float, x: float, y: float
) -> None:
    rng = np.random.default_rng(3)
    q = np.tile(robot.standing, (T, 1))
    q[:, 7:] = np.clip(np.cumsum(rng.normal(0, 0.02, (T, robot.n)), axis=0), robot.lower, robot.upper)
    case = Case(robot, *moving(robot, q))
    case.set("left_elbow", -0.3)
    before = case.figures()
    c, s = np.cos(turn), np.sin(turn)
    R, shift = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), np.array([x, y, 0.0])
    w, k = np.cos(turn / 2), np.sin(turn / 2)
    quaternion = case.motion.root_quaternion_wxyz
    turned = np.stack(
        [
            w * quaternion[:, 0] - k * quaternion[:, 3],
            w * quaternion[:, 1] - k * quaternion[:, 2],
            w * quaternion[:, 2] + k * quaternion[:, 1],
            w * quaternion[:, 3] + k * quaternion[:, 0],
        ],
        axis=1,
    )
    moved = replace(
        case.motion, root_position_m=case.motion.root_position_m @ R.T + shift, root_quaternion_wxyz=turned
    )
    reference = replace(case.reference, role_position_m=case.reference.role_position_m @ R.T + shift)
    after = Case(robot, moved, reference).figures()
    for name, values in before.items():
        for key, value in values.items():
            assert after[name][key] == (
                value if isinstance(value, str) else pytest.approx(value, abs=1e-6)
            ), name


# ---------------------------------------------------------------------- wrong input


def test_files_that_do_not_fit_are_refused(case: Case) -> None:
    other = still(case.robot, T - 1)[1]
    with pytest.raises(
        SourceError, match=r"reference.npz: 19 frames, but motion.npz has 20; both are of one run"
    ):
        metrics.evaluate(case.motion, other, case.robot)
    case.motion.joint_position_rad[[7, 9], 0] = np.nan
    with pytest.raises(
        SourceError, match=r"motion.npz: frame 7 holds a number that is not finite \(2 such frames\)"
    ):
        case.report()
    case.motion.joint_position_rad[[7, 9], 0] = 0.0
    case.motion.time_s[3] = case.motion.time_s[2]
    with pytest.raises(SourceError, match=r"time does not increase from frame 2 to frame 3"):
        case.report()
    with pytest.raises(SourceError, match=r"there is no frame in it"):
        Case(case.robot, *moving(case.robot, np.zeros((0, case.robot.nq)))).report()
