"""Every registered plugin keeps the contract of its kind; and the kit sees each way of breaking one."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from pydantic import Field

from captured_people import small_acclaim, small_c3d, small_targets, small_trc
from imitor import (
    Config,
    Configuration,
    Filter,
    HumanFrame,
    Mapper,
    Postprocessor,
    Record,
    RunInfo,
    Sink,
    SinkReport,
    Skeleton,
    Solver,
    Source,
    Stabilizer,
    Strictness,
    Support,
    TaskKind,
    TaskStack,
    testing,
)
from imitor.kinds import Tick
from imitor.live.received import ReceivedRecorder
from imitor.motion.bvh_file import write_bvh
from imitor.motion.bvh_hierarchy import Node
from imitor.registry import Registered, Registry
from imitor.types import ROLE_INDEX, read_only
from test_kinect_source import small_kinect
from test_mvnx_source import small_mvnx_options

COMPONENTS = list(Registry(entry_points=False))


def small_bvh(folder: Path) -> dict[str, Any]:
    """Write a person of 1.75 m who raises an arm; return the options that read it."""
    places = {
        "Hips": ("", (0.0, 0.0, 0.95)),
        "Spine": ("Hips", (0.0, 0.0, 1.1)),
        "Neck": ("Spine", (0.0, 0.0, 1.48)),
        "Head": ("Neck", (0.0, 0.0, 1.58)),
    }
    for side, s in (("Left", 1.0), ("Right", -1.0)):
        for name, parent, place in (
            ("Arm", "Spine", (0.0, 0.18, 1.43)), ("ForeArm", "Arm", (0.0, 0.46, 1.43)),
            ("Hand", "ForeArm", (0.0, 0.71, 1.43)), ("UpLeg", "Hips", (0.0, 0.09, 0.92)),
            ("Leg", "UpLeg", (0.0, 0.09, 0.5)), ("Foot", "Leg", (0.0, 0.09, 0.08)),
            ("ToeBase", "Foot", (0.13, 0.09, 0.02)),
        ):  # fmt: skip
            above = parent if parent in ("Hips", "Spine") else side + parent
            places[side + name] = above, (place[0], s * place[1], place[2])
    index = {name: i for i, name in enumerate(places)}
    turn = ("Zrotation", "Yrotation", "Xrotation")
    nodes, columns = [], []
    for name, (parent, place) in places.items():
        offset = np.array(place) - (np.array(places[parent][1]) if parent else 0.0)
        channels = turn if parent else ("Xposition", "Yposition", "Zposition", *turn)
        nodes.append(Node(name, index[parent] if parent else -1, offset, channels, False))
        columns += [(name, channel) for channel in channels]
    motion = np.zeros((40, len(columns)))
    motion[:, columns.index(("Hips", "Zposition"))] = 0.95
    motion[:, columns.index(("LeftForeArm", "Zrotation"))] = np.linspace(0.0, 60.0, 40)
    write_bvh(folder / "person.bvh", nodes, motion, 1 / 30)
    return {"path": str(folder / "person.bvh")}


def small_received(folder: Path) -> dict[str, Any]:
    frames = testing.make_frames("walk", 60)
    recorder = ReceivedRecorder(testing.make_skeleton(), 30.0, frames[:10], folder)
    for frame in frames:
        recorder.add(Tick(frame.time_s, frame))
    recorder.save(folder / "received.npz")
    recorder.close()
    return {"path": str(folder / "received.npz")}


OPTIONS: Mapping[str, Callable[[Path], dict[str, Any]]] = {
    "art_targets": small_targets,
    "asf_amc": small_acclaim,
    "bvh": small_bvh,
    "c3d": small_c3d,
    "kinect": small_kinect,
    "mvnx": small_mvnx_options,
    "received": small_received,
    "rerun_live": lambda _: {"port": 0},
    "trc": small_trc,
    "video": lambda _: {"size_px": (64, 64), "fps": 5.0, "sheet_width_px": 200, "columns": 1, "rows": 1},
}
"""What a plugin needs to be checked: options without a default, and what makes a check quick."""


PACKAGES = {"c3d": "ezc3d", "osc": "pythonosc", "trackers": "redis", "nao": "qi", "unitree": "cyclonedds"}
"""What an extra brings: a plugin is checked where it is there."""


@pytest.fixture(autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMITOR_CACHE", str(tmp_path_factory.getbasetemp() / "cache"))


@pytest.mark.parametrize("registered", COMPONENTS, ids=[f"{r.kind}-{r.name}" for r in COMPONENTS])
def test_it_keeps_the_contract_of_its_kind(registered: Registered, tmp_path: Path) -> None:
    if registered.component.extra:
        pytest.importorskip(PACKAGES[registered.component.extra])
    options = OPTIONS[registered.name](tmp_path) if registered.name in OPTIONS else None
    testing.check_component(registered.component, options)


def test_the_performer_gives_markers_and_targets_when_asked() -> None:
    registry = Registry(entry_points=False)
    options = {"markers": "41", "targets": True, "loss": 0.1, "noise_std_m": 0.01, "scenario": "walk"}
    testing.check_source(registry.get("source", "performer"), options)  # type: ignore[arg-type]


@pytest.mark.parametrize("robot", ["romeo", "talos"])
@pytest.mark.parametrize("solver", Registry(entry_points=False).names("solver"))
def test_solvers_on_other_robots(solver: str, robot: str) -> None:
    registry = Registry(entry_points=False)
    testing.check_solver(registry.get("solver", solver), robot=testing.make_robot(robot))  # type: ignore[arg-type]


@pytest.mark.parametrize("solver", Registry(entry_points=False).names("solver"))
def test_solvers_with_acceleration_limits(solver: str) -> None:
    card = testing.make_robot().card
    limits = card.limits.model_copy(update={"acceleration_rad_s2": {"*": 60.0}})
    registry = Registry(entry_points=False)
    testing.check_solver(registry.get("solver", solver), robot=testing.make_robot(limits=limits))  # type: ignore[arg-type]


@pytest.mark.parametrize("robot", ["romeo", "talos"])
@pytest.mark.parametrize("mapper", Registry(entry_points=False).names("mapper"))
def test_mappers_on_other_robots(mapper: str, robot: str) -> None:
    registry = Registry(entry_points=False)
    testing.check_mapper(registry.get("mapper", mapper), robot=testing.make_robot(robot))  # type: ignore[arg-type]


# ---------------------------------------------------------------- what the kit makes


def test_frames_are_read_only_and_repeatable() -> None:
    frames, again = (
        testing.make_frames("walk", 40, loss=0.2, seed=1),
        testing.make_frames("walk", 40, loss=0.2, seed=1),
    )
    assert len(frames) == 40
    assert frames[0].valid.all()
    assert not all(f.valid.all() for f in frames)
    for a, b in zip(frames, again, strict=True):
        assert not a.position.flags.writeable
        np.testing.assert_array_equal(a.position, b.position)
    skeleton = testing.make_skeleton()
    assert frames[0].marker is not None and len(frames[0].marker) == len(skeleton.marker_names)
    assert frames[0].target is not None and len(frames[0].target) == len(skeleton.target_names)


def test_a_robot_of_ones_own_can_be_changed() -> None:
    robot = testing.make_robot(title="Mine")
    assert robot.card.title == "Mine"
    robot.lower[:] = 0.0
    assert (testing.make_robot().lower < 0).any()


# ---------------------------------------------------------------- what the kit sees
# One small plugin a fault. `sound` is what is right; each fault changes one thing.


class Still(Source[Config]):
    """Play a person who stands still."""

    name = "still"
    gives = frozenset({"com", "support"})

    def start(self) -> None:
        self.sent = testing.make_frames("stand", 20)
        self.skeleton, self.rate_hz, self.n_frames = testing.make_skeleton(), 30.0, 20

    def frames(self) -> Iterator[HumanFrame]:
        for f in self.sent:
            yield HumanFrame(f.time_s, f.position, f.valid, com=f.com, support=f.support)


class WritableSource(Still):
    """Fault."""

    def frames(self) -> Iterator[HumanFrame]:
        for f in super().frames():
            f.position = f.position.copy()
            yield f


class BackwardSource(Still):
    """Fault."""

    def frames(self) -> Iterator[HumanFrame]:
        yield from reversed(list(super().frames()))


class WrongRateSource(Still):
    """Fault."""

    def start(self) -> None:
        super().start()
        self.rate_hz = 60.0


class ShortSource(Still):
    """Fault."""

    def frames(self) -> Iterator[HumanFrame]:
        yield from list(super().frames())[:-1]


class DishonestSource(Still):
    """Fault."""

    def frames(self) -> Iterator[HumanFrame]:
        for f in super().frames():
            position = f.position.copy()
            position[3] = np.nan
            f.position = read_only(position)
            yield f


class OnceSource(Still):
    """Fault."""

    def start(self) -> None:
        super().start()
        self.iterator = super().frames()

    def frames(self) -> Iterator[HumanFrame]:
        yield from self.iterator


class SecretSource(Still):
    """Fault."""

    gives = frozenset({"com"})


class NamelessRoleSource(Still):
    """Fault."""

    def start(self) -> None:
        super().start()
        s = self.skeleton
        rest = s.rest_position.copy()
        rest[ROLE_INDEX["head"]] = np.nan
        self.skeleton = Skeleton(s.name, s.roles - {"head"}, rest, s.height_m)


class Keep(Filter[Config]):
    """Give the frame back."""

    name = "keep"

    def step(self, frame: HumanFrame) -> HumanFrame:
        return frame


class WritingFilter(Keep):
    """Fault."""

    def step(self, frame: HumanFrame) -> HumanFrame:
        frame.position[:] = 0.0
        return frame


class StealthyFilter(Keep):
    """Fault."""

    def step(self, frame: HumanFrame) -> HumanFrame:
        com = frame.com
        assert com is not None
        address, n = com.__array_interface__["data"][0], com.size
        import ctypes

        (ctypes.c_double * n).from_address(address)[0] += 1e-6
        return frame


class PromisingFilter(Keep):
    """Fault."""

    gives = frozenset({"support"})


class ForgetfulFilter(Keep):
    """Fault."""

    def step(self, frame: HumanFrame) -> HumanFrame:
        return HumanFrame(frame.time_s, frame.position, frame.valid)


class RememberingFilter(Keep):
    """Fault."""

    last: Any = None

    def step(self, frame: HumanFrame) -> HumanFrame:
        shift = 0.0 if self.last is None else 0.1 * self.last
        self.last = np.where(np.isnan(frame.position), 0.0, frame.position)
        return replace(frame, position=frame.position + shift)


class RandomFilter(Keep):
    """Fault."""

    def start(self) -> None:
        self.rng = np.random.default_rng()

    def step(self, frame: HumanFrame) -> HumanFrame:
        return replace(frame, position=frame.position + self.rng.normal(size=3))


class InventingFilter(Keep):
    """Fault."""

    def step(self, frame: HumanFrame) -> HumanFrame:
        return replace(frame, position=np.nan_to_num(frame.position))


class LateFilter(Keep):
    """Fault."""

    def step(self, frame: HumanFrame) -> HumanFrame:
        return replace(frame, time_s=frame.time_s + 0.1)


class CloseOnceFilter(Keep):
    """Fault."""

    handle: list[int] | None = None

    def start(self) -> None:
        self.handle = [1]

    def close(self) -> None:
        (self.handle or []).pop()


class Point(Mapper[Config]):
    """Point a forearm as the human does."""

    name = "point"
    declares: ClassVar[Mapping[str, TaskKind]] = {
        "left_forearm": TaskKind.DIRECTION,
        "waist": TaskKind.ORIENTATION,
    }

    def declare(self, stack: TaskStack) -> None:
        self.arm = stack.declare(
            "left_forearm", TaskKind.DIRECTION, frame="left_wrist", relative_to="left_elbow"
        )
        self.waist = stack.declare("waist", TaskKind.ORIENTATION, frame="waist")

    def reset(self) -> None:
        self.direction = np.array([0.0, 0.0, -1.0])

    def step(self, frame: HumanFrame, stack: TaskStack) -> None:
        d = frame.position[ROLE_INDEX["left_wrist"]] - frame.position[ROLE_INDEX["left_elbow"]]
        if np.isfinite(d).all():
            self.direction = d / np.linalg.norm(d)
        self.arm.target[:] = self.direction


class UndeclaredMapper(Point):
    """Fault."""

    declares: ClassVar[Mapping[str, TaskKind]] = {"left_forearm": TaskKind.DIRECTION}


class OtherKindMapper(Point):
    """Fault."""

    declares: ClassVar[Mapping[str, TaskKind]] = {
        "left_forearm": TaskKind.POSE,
        "waist": TaskKind.ORIENTATION,
    }


class LongMapper(Point):
    """Fault."""

    def step(self, frame: HumanFrame, stack: TaskStack) -> None:
        super().step(frame, stack)
        self.arm.target *= 1.1


class TwistedMapper(Point):
    """Fault."""

    def step(self, frame: HumanFrame, stack: TaskStack) -> None:
        super().step(frame, stack)
        self.waist.target[0, 1] = 0.1


class LosingMapper(Point):
    """Fault."""

    def step(self, frame: HumanFrame, stack: TaskStack) -> None:
        d = frame.position[ROLE_INDEX["left_wrist"]] - frame.position[ROLE_INDEX["left_elbow"]]
        self.arm.target[:] = d / np.linalg.norm(d)


class MovingMapper(Point):
    """Fault."""

    def step(self, frame: HumanFrame, stack: TaskStack) -> None:
        super().step(frame, stack)
        q = self.robot.standing.copy()
        q[7:] = self.robot.upper
        self.robot.update(q)


class FramelessMapper(Point):
    """Fault."""

    def declare(self, stack: TaskStack) -> None:
        super().declare(stack)
        self.waist.frame = "tail"


class FloatingMapper(Point):
    """Fault."""

    def step(self, frame: HumanFrame, stack: TaskStack) -> None:
        super().step(frame, stack)
        stack.anchor = "left_paw"


class Lift(Stabilizer[Config]):
    """Lift the CoM's target."""

    name = "lift"
    needs_tasks = frozenset({"com"})

    def step(self, frame: HumanFrame, stack: TaskStack, state: Configuration) -> None:
        stack["com"].target[2] += 0.01


class BreakingStabilizer(Lift):
    """Fault."""

    def step(self, frame: HumanFrame, stack: TaskStack, state: Configuration) -> None:
        stack["com"].target[2] = np.nan


class GraspingStabilizer(Lift):
    """Fault."""

    def step(self, frame: HumanFrame, stack: TaskStack, state: Configuration) -> None:
        state.q[7] += 0.1


class NeedyStabilizer(Lift):
    """Fault."""

    needs_tasks = frozenset({"comm"})


class DriftingStabilizer(Lift):
    """Fault."""

    sum = 0.0

    def step(self, frame: HumanFrame, stack: TaskStack, state: Configuration) -> None:
        self.sum += 0.001
        stack["com"].target[2] += self.sum


class ToPosture(Solver[Config]):
    """Move towards the posture."""

    name = "to_posture"
    serves: ClassVar[Mapping[TaskKind, Strictness]] = {TaskKind.POSTURE: Strictness.WEIGHTED}
    share, hold, clip = 0.5, True, True

    def prepare(self, stack: TaskStack) -> None:
        self.posture = stack["posture"]

    def step(self, stack: TaskStack, state: Configuration) -> None:
        joints = state.q[7:]
        if self.posture.active[0]:
            joints += self.share * (self.posture.target - joints)
        if self.clip:
            np.clip(joints, self.robot.lower, self.robot.upper, out=joints)
        self.robot.update(state.q)
        if stack.anchor and self.hold:
            self.robot.place(state.q, stack.anchor, stack.anchor_pose)


class LazySolver(ToPosture):
    """Fault."""

    share = 0.0001


class UnanchoredSolver(ToPosture):
    """Fault."""

    hold = False


class OvershootingSolver(ToPosture):
    """Fault."""

    share, clip = 1.99, False


class StaleSolver(ToPosture):
    """Fault."""

    def step(self, stack: TaskStack, state: Configuration) -> None:
        super().step(stack, state)
        self.robot.update(self.robot.standing)


class UncouplingSolver(ToPosture):
    """Fault."""

    def step(self, stack: TaskStack, state: Configuration) -> None:
        if self.robot.coupling is not None:
            state.q[7 + self.robot.joint_index("left_hip_pitch_joint")] += 0.01
        super().step(stack, state)


class NewArraySolver(ToPosture):
    """Fault."""

    def step(self, stack: TaskStack, state: Configuration) -> None:
        state.q = state.q.copy()
        super().step(stack, state)


class TaskChangingSolver(ToPosture):
    """Fault."""

    def step(self, stack: TaskStack, state: Configuration) -> None:
        super().step(stack, state)
        self.posture.target[:] = state.q[7:]


class BoastingSolver(ToPosture):
    """Fault."""

    serves: ClassVar[Mapping[TaskKind, Strictness]] = {
        TaskKind.POSTURE: Strictness.WEIGHTED,
        TaskKind.COM: Strictness.WEIGHTED,
    }


class Leave(Postprocessor[Config]):
    """Leave the configuration."""

    name = "leave"

    def step(self, stack: TaskStack, state: Configuration) -> None:
        self.robot.update(state.q)


class ShiftingPostprocessor(Leave):
    """Fault."""

    def step(self, stack: TaskStack, state: Configuration) -> None:
        state.q[0] += 0.001
        self.robot.update(state.q)


class TramplingPostprocessor(Leave):
    """Fault."""

    def step(self, stack: TaskStack, state: Configuration) -> None:
        state.q[7 + self.robot.joint_index("right_knee_joint")] = 0.3
        self.robot.update(state.q)
        if self.robot.coupling is None:
            self.robot.place(state.q, stack.anchor, stack.anchor_pose)


class NotANumberPostprocessor(Leave):
    """Fault."""

    def step(self, stack: TaskStack, state: Configuration) -> None:
        state.q[20] = np.nan


class Table(Sink[Config]):
    """Write the times."""

    name = "table"

    def open(self, run: RunInfo) -> None:
        self.path = run.out_dir / "table.csv"
        self.lines = ["time_s"]

    def write(self, record: Record) -> None:
        self.lines.append(f"{record.time_s} {record.state.q[7]}")

    def finish(self) -> SinkReport:
        self.path.write_text("\n".join(self.lines) + "\n")
        return SinkReport([self.path])


class EarlySink(Table):
    """Fault."""

    def open(self, run: RunInfo) -> None:
        super().open(run)
        self.path.write_text("time_s\n")


class ForgettingSink(Table):
    """Fault."""

    def write(self, record: Record) -> None:
        if record.index % 2:
            super().write(record)


class SecretiveSink(Table):
    """Fault."""

    def finish(self) -> SinkReport:
        super().finish()
        return SinkReport()


class UncopyingSink(Table):
    """Fault."""

    def open(self, run: RunInfo) -> None:
        super().open(run)
        self.kept: list[Any] = []

    def write(self, record: Record) -> None:
        self.kept.append(record.state.q)

    def finish(self) -> SinkReport:
        self.lines = ["q", *(f"{q[7]}" for q in self.kept)]
        return super().finish()


class OnlyOnceSink(Table):
    """Fault."""

    def finish(self) -> SinkReport:
        self.lines.append("" if self.path.exists() else "0")
        return super().finish()


class MeddlingSink(Table):
    """Fault."""

    def write(self, record: Record) -> None:
        super().write(record)
        record.stack["com"].target[0] += 1.0


SOUND = [Still, Keep, Point, Lift, ToPosture, Leave, Table]
FAULTS: list[tuple[Any, str]] = [
    (WritableSource, "position can be written"),
    (BackwardSource, "time does not increase"),
    (WrongRateSource, "rate_hz is 60.0, but frames come at 30.000 Hz"),
    (ShortSource, "n_frames is 20, but frames() yields 19"),
    (DishonestSource, "a point of position is not finite though valid says so"),
    (OnceSource, "it yields no frame"),
    (SecretSource, "holds support, which `gives` does not name"),
    (NamelessRoleSource, "has head, which the skeleton's roles do not name"),
    (WritingFilter, "it writes into an array that is not its own"),
    (StealthyFilter, "it wrote into com of the frame it was given"),
    (PromisingFilter, "support is missing from what it gives back"),
    (ForgetfulFilter, "com, markers, orientation, support, targets is missing"),
    (RememberingFilter, "run again after reset(): position of frame 0"),
    (RandomFilter, "randomness needs a seed"),
    (InventingFilter, "has a place though valid denies it"),
    (LateFilter, "(delay_frames is 0)"),
    (CloseOnceFilter, "close() after close() failed: IndexError"),
    (UndeclaredMapper, "it declares the task 'waist', which `declares` does not name"),
    (OtherKindMapper, "it declares 'left_forearm' as direction, but `declares` says pose"),
    (LongMapper, "has a direction of length 1.1, not 1"),
    (TwistedMapper, "the rotation of its target is none"),
    (LosingMapper, "task 'left_forearm' has the target [nan nan nan]"),
    (MovingMapper, "it moved the robot"),
    (FramelessMapper, "task 'waist': robot 'unitree_g1' has no frame 'tail'"),
    (FloatingMapper, "the anchor 'left_paw' is no frame of the robot"),
    (BreakingStabilizer, "task 'com' has the target"),
    (GraspingStabilizer, "it writes into an array that is not its own"),
    (NeedyStabilizer, "it needs the tasks comm"),
    (DriftingStabilizer, "run again after reset(): targets of frame 0"),
    (LazySolver, "though its target can be reached"),
    (UnanchoredSolver, "the anchor left_foot is"),
    (OvershootingSolver, "beyond its limit"),
    (StaleSolver, "the robot is not updated at the configuration"),
    (UncouplingSolver, "coupled joints are"),
    (NewArraySolver, "it put a new array in state.q"),
    (TaskChangingSolver, "it writes into an array that is not its own"),
    (BoastingSolver, "the error of 'com' goes from"),
    (ShiftingPostprocessor, "the anchor left_foot is"),
    (TramplingPostprocessor, "it moved the right foot, which stands"),
    (NotANumberPostprocessor, "the configuration is not finite"),
    (EarlySink, "table.csv was there before finish()"),
    (ForgettingSink, "table.csv holds 6 frames of 12"),
    (SecretiveSink, "it leaves table.csv, which its report does not name"),
    (UncopyingSink, "table.csv changes with what happens to the frames after `write`"),
    (OnlyOnceSink, "finish() after finish() damages table.csv"),
    (MeddlingSink, "it changed the record it was given"),
]


def check(cls: Any) -> None:
    getattr(testing, f"check_{cls.kind}")(cls)


@pytest.mark.parametrize("cls", SOUND)
def test_a_sound_plugin_passes(cls: Any) -> None:
    testing.check_component(cls)


@pytest.mark.parametrize(("cls", "said"), FAULTS, ids=[cls.__name__ for cls, _ in FAULTS])
def test_a_fault_is_seen(cls: Any, said: str) -> None:
    with pytest.raises(AssertionError) as caught:
        check(cls)
    text = str(caught.value)
    assert said in text
    assert text.startswith(f"{cls.kind} '{cls.name}': ")


class Ordered(Config):
    order: list[list[str]] = Field(description="Levels.")


class EqualSolver(Solver[Ordered]):
    """Serve all levels alike, though it says otherwise."""

    name = "equal"
    serves: ClassVar[Mapping[TaskKind, Strictness]] = {TaskKind.POSITION: Strictness.PRIORITISED}

    def prepare(self, stack: TaskStack) -> None:
        from imitor.ik.rows import TaskRows

        self.rows = TaskRows(self.robot, stack, [[n for level in self.config.order for n in level]], {})

    def step(self, stack: TaskStack, state: Configuration) -> None:
        robot, q = self.robot, state.q
        if stack.anchor:
            robot.place(q, stack.anchor, stack.anchor_pose)
        layout = self.rows.layout()
        self.rows.assemble(layout)
        v = np.zeros(robot.nv)
        if layout.m:
            J = layout.J
            v[6 - layout.first :] = np.clip(
                J.T @ np.linalg.solve(J @ J.T + 1e-3 * np.eye(layout.m), layout.e), -0.1, 0.1
            )
        q[:] = robot.integrate(q, v)
        np.clip(q[7:], robot.lower, robot.upper, out=q[7:])
        if robot.coupling is not None:
            q[7:] = robot.coupling @ q[7:][robot.coupling.argmax(axis=0)]
        robot.update(q)
        if stack.anchor:
            robot.place(q, stack.anchor, stack.anchor_pose)


def test_levels_that_are_none_are_seen() -> None:
    with pytest.raises(AssertionError, match="a lower level disturbs it"):
        testing.check_solver(EqualSolver)


class BareConfig(Config):
    speed: float = Field(1.0, description="How fast.")


class UndescribedConfig(Config):
    mode: str = "a"


class LooseConfig(Config):
    model_config: ClassVar[Any] = {"extra": "allow"}


class RefusingConfig(Config):
    count: int = Field(-1, ge=0, description="How many [-].", validate_default=True)


class ChangingConfig(Config):
    share: tuple[float, ...] = Field((1.0,), description="Shares [-].")

    def model_post_init(self, context: object) -> None:
        object.__setattr__(self, "share", (*self.share, 2.0))


def with_options(options: type[Config]) -> Any:
    """Return a filter with these options."""
    faulty = type("Faulty", (Keep,), {"name": "faulty", "__doc__": "Keep."})
    faulty.config_type = options  # type: ignore[attr-defined]
    return faulty


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (BareConfig, "option speed is a number without a unit"),
        (UndescribedConfig, "option mode has no description"),
        (LooseConfig, "it accepts options that it does not have"),
        (RefusingConfig, "its defaults are refused"),
        (ChangingConfig, "its options change on the way through YAML"),
    ],
)
def test_faulty_options_are_seen(options: Any, said: str) -> None:
    faulty = with_options(options)
    with pytest.raises(AssertionError, match=said):
        testing.check_config(faulty)


def test_options_without_default_are_named() -> None:
    needy = with_options(Ordered)
    testing.check_config(needy)
    with pytest.raises(
        AssertionError, match=r"filter 'faulty': its options order have no default; give a config"
    ):
        testing.check_component(needy)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"name": "BadName", "__doc__": "x"}, "not in lower_snake_case"),
        ({"name": "quiet"}, "it has no docstring"),
        ({"name": "odd", "__doc__": "x", "gives": frozenset({"joy"})}, "wants or gives joy"),
    ],
)
def test_faulty_names_are_seen(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(AssertionError, match=said):
        testing.check_names(type("Faulty", (Keep,), changes))


def test_a_heavy_import_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "heavy_plugin.py").write_text("import scipy.linalg\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    heavy = type("Heavy", (Keep,), {"__module__": "heavy_plugin", "name": "heavy", "__doc__": "Keep."})
    with pytest.raises(AssertionError, match="importing heavy_plugin imports scipy"):
        testing.check_import(heavy)


def test_a_module_that_needs_another_first_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lonely_plugin.py").write_text("import no_such_thing\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    lonely = type("Lonely", (Keep,), {"__module__": "lonely_plugin", "name": "lonely", "__doc__": "Keep."})
    with pytest.raises(AssertionError, match=r"cannot be imported by itself: .*no_such_thing"):
        testing.check_import(lonely)


def test_the_kit_itself_imports_nothing_heavy() -> None:
    from imitor.testing.imports import heavy_imports

    assert heavy_imports("imitor.testing", "") == ("", ())
    assert "imitor.testing" in sys.modules


def test_support_is_a_support() -> None:
    class Guessing(Keep):
        """Fault."""

        def step(self, frame: HumanFrame) -> HumanFrame:
            return replace(frame, support=(True, True))  # type: ignore[arg-type]

    assert isinstance(testing.make_frames(n=1)[0].support, Support)
    with pytest.raises(AssertionError, match="support is no Support"):
        testing.check_filter(Guessing)
