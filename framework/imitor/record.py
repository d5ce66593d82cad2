"""The record of a run: ``motion.npz`` (what the robot was told) and ``reference.npz`` (what it was meant to do).

Both are plain arrays without pickles; together they are enough to measure a run again without its source.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from imitor.atomic import atomic
from imitor.errors import SourceError
from imitor.kinds import Record, RunInfo
from imitor.rows import Rows
from imitor.types import ROLES, Array, BoolArray, IntArray

SCHEMA: Final = "imitor-motion-1"
MOTION_FILE: Final = "motion.npz"
REFERENCE_FILE: Final = "reference.npz"
_OBJECTS: Final = ("object_names", "object_shift_m", "held_object")
"""Arrays that runs without objects may lack."""


@dataclass
class Motion:
    """The robot's motion, T frames of n joints.

    Attributes:
        robot: Name or path of the robot's card.
        time_s: shape (T,) [s].
        joint_names: The n joints.
        joint_position_rad: shape (T, n) [rad].
        root_position_m: Base link in world, shape (T, 3) [m].
        root_quaternion_wxyz: Rotation of the base link, world from base, shape (T, 4).
        contact: The feet the robot stands on, left and right, shape (T, 2).
        status: ``ok``, ``held`` or ``stopped`` per frame, shape (T,).
    """

    robot: str
    time_s: Array
    joint_names: Sequence[str]
    joint_position_rad: Array
    root_position_m: Array
    root_quaternion_wxyz: Array
    contact: BoolArray
    status: Sequence[str]

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def rate_hz(self) -> float:
        """Frames per second [Hz]; 0 for a single frame."""
        return (len(self) - 1) / float(self.time_s[-1] - self.time_s[0]) if len(self) > 1 else 0.0

    def configurations(self) -> Array:
        """Return Pinocchio configurations (base position, quaternion x y z w, joints), shape (T, 7 + n)."""
        quaternion = self.root_quaternion_wxyz[:, [1, 2, 3, 0]]
        return np.hstack([self.root_position_m, quaternion, self.joint_position_rad])

    def save(self, path: Path) -> None:
        """Write ``motion.npz``; it appears whole or not at all, and equal motions give equal bytes."""
        write_arrays(
            path,
            {
                "schema": np.array(SCHEMA),
                "robot": np.array(self.robot),
                "time_s": self.time_s,
                "joint_names": np.array(list(self.joint_names)),
                "joint_position_rad": self.joint_position_rad,
                "root_position_m": self.root_position_m,
                "root_quaternion_wxyz": self.root_quaternion_wxyz,
                "contact": self.contact,
                "status": np.array(list(self.status), dtype="U7"),
            },
        )

    @classmethod
    def load(cls, path: Path) -> Motion:
        """Read a ``motion.npz``.

        Raises:
            SourceError: The file is missing, damaged or of another schema.
        """
        data = read_arrays(path)
        try:
            if str(data["schema"]) != SCHEMA:
                raise SourceError(path, f"schema '{data['schema']}', expected '{SCHEMA}'")
            return cls(
                str(data["robot"]),
                data["time_s"],
                data["joint_names"].tolist(),
                data["joint_position_rad"],
                data["root_position_m"],
                data["root_quaternion_wxyz"],
                data["contact"],
                data["status"].tolist(),
            )
        except KeyError as error:
            raise SourceError(path, f"the array {error} is missing") from None


@dataclass
class Reference:
    """What the human did and what the tasks asked for, T frames.

    Attributes:
        time_s: shape (T,) [s].
        role_names: The R roles.
        role_position_m: Human points in world, shape (T, R, 3) [m].
        role_valid: shape (T, R).
        human_support: Feet of the human in contact, left and right, shape (T, 2).
        human_support_known: shape (T,).
        human_com_m: shape (T, 3) [m], NaN where unknown.
        target: Task name -> targets, shape (T, ...) after the task's kind.
        target_kind: Task name -> kind.
        target_active: Task name -> shape (T,).
        compute_s: Time spent on each frame without sinks, shape (T,) [s].
        human_height_m: Stature [m].
        human_ankle_height_m: Height of the ankle joints when standing flat [m].
        object_names: The K objects around the robot.
        object_shift_m: How far each was to be moved from where it stood, in world, shape (T, K, 3) [m].
        held_object: Number of the object that each hand, left and right, was to hold, -1 for none, shape (T, 2).
    """

    time_s: Array
    role_names: Sequence[str]
    role_position_m: Array
    role_valid: BoolArray
    human_support: BoolArray
    human_support_known: BoolArray
    human_com_m: Array
    target: Mapping[str, Array]
    target_kind: Mapping[str, str]
    target_active: Mapping[str, BoolArray]
    compute_s: Array
    human_height_m: float
    human_ankle_height_m: float
    object_names: Sequence[str] = ()
    object_shift_m: Array = field(default_factory=lambda: np.zeros((0, 0, 3)))
    held_object: IntArray = field(default_factory=lambda: np.zeros((0, 2), dtype=int))

    def __post_init__(self) -> None:
        n = len(self.time_s)
        if not len(self.object_shift_m):
            self.object_shift_m = np.zeros((n, len(self.object_names), 3))
        if not len(self.held_object):
            self.held_object = np.full((n, 2), -1)

    def role(self, name: str) -> Array:
        """Return the positions of one role, ``mid_hip`` and ``mid_shoulder`` included, shape (T, 3) [m]."""
        if name.startswith("mid_"):
            return 0.5 * (self.role(f"left_{name[4:]}") + self.role(f"right_{name[4:]}"))
        return np.asarray(self.role_position_m[:, list(self.role_names).index(name)])

    def save(self, path: Path) -> None:
        """Write ``reference.npz``; it appears whole or not at all."""
        write_arrays(
            path,
            {
                "schema": np.array(SCHEMA),
                "time_s": self.time_s,
                "role_names": np.array(list(self.role_names)),
                "role_position_m": self.role_position_m,
                "role_valid": self.role_valid,
                "human_support": self.human_support,
                "human_support_known": self.human_support_known,
                "human_com_m": self.human_com_m,
                "compute_s": self.compute_s,
                "human_height_m": np.array(self.human_height_m),
                "human_ankle_height_m": np.array(self.human_ankle_height_m),
                "object_names": np.array(list(self.object_names), dtype="U"),
                "object_shift_m": self.object_shift_m,
                "held_object": self.held_object,
                "task_names": np.array(list(self.target), dtype="U"),
                "task_kinds": np.array([self.target_kind[n] for n in self.target], dtype="U"),
                **{f"target/{n}": a for n, a in self.target.items()},
                **{f"active/{n}": a for n, a in self.target_active.items()},
            },
        )

    @classmethod
    def load(cls, path: Path) -> Reference:
        """Read a ``reference.npz``.

        Raises:
            SourceError: The file is missing, damaged or of another schema.
        """
        data = read_arrays(path)
        try:
            names = data["task_names"].tolist()
            return cls(
                data["time_s"],
                data["role_names"].tolist(),
                data["role_position_m"],
                data["role_valid"],
                data["human_support"],
                data["human_support_known"],
                data["human_com_m"],
                {n: data[f"target/{n}"] for n in names},
                dict(zip(names, data["task_kinds"].tolist(), strict=True)),
                {n: data[f"active/{n}"] for n in names},
                data["compute_s"],
                float(data["human_height_m"]),
                float(data["human_ankle_height_m"]),
                *(
                    [data[_OBJECTS[0]].tolist(), *(data[n] for n in _OBJECTS[1:])]
                    if _OBJECTS[0] in data
                    else ()
                ),
            )
        except KeyError as error:
            raise SourceError(path, f"the array {error} is missing") from None


class Recorder:
    """Collects the frames of a run into growing arrays: one row copy a frame and array, nothing else.

    A live run has no known end: its frames go to disk, so that memory does not grow.
    """

    def __init__(self, run: RunInfo) -> None:
        self._run = run
        robot, stack = run.robot, run.stack
        number, flag = np.float64, np.bool_
        self._rows = Rows(
            {
                "time": ((), number),
                "compute": ((), number),
                "q": ((robot.nq,), number),
                "contact": ((2,), flag),
                "status": ((), np.int8),
                "position": ((len(ROLES), 3), number),
                "valid": ((len(ROLES),), flag),
                "support": ((2,), flag),
                "support_known": ((), flag),
                "com": ((3,), number),
                "shift": (stack.object_shift.shape, number),
                "held": ((2,), np.int_),
                "target": ((stack.flat_target.size,), number),
                "switch": ((stack.flat_switch.size,), flag),
            },
            size=run.n_frames or 1024,
            folder=run.out_dir if run.live else None,
        )

    def add(self, record: Record) -> None:
        """Copy one frame."""
        rows, i = self._rows.next()
        human, state = record.human, record.state
        rows["time"][i], rows["compute"][i] = record.time_s, record.compute_s
        rows["q"][i], rows["contact"][i], rows["status"][i] = state.q, state.contact, state.status
        rows["position"][i], rows["valid"][i] = human.position, human.valid
        rows["com"][i] = np.nan if human.com is None else human.com
        if human.support is not None:
            rows["support"][i] = human.support.left, human.support.right
            rows["support_known"][i] = True
        stack = record.stack
        rows["target"][i], rows["switch"][i] = stack.flat_target, stack.flat_switch
        rows["shift"][i], rows["held"][i] = stack.object_shift, stack.held

    def __len__(self) -> int:
        return len(self._rows)

    def clear(self) -> None:
        """Forget the frames so far, where they are kept in memory; what was returned before is written over."""
        self._rows.clear()

    def close(self) -> None:
        """Give the disk space of a live run back; what was returned before stays."""
        self._rows.close()

    def motion(self) -> Motion:
        """Return the robot's motion so far."""
        from imitor.types import STATUS

        rows = self._rows.arrays()
        q = rows["q"]
        card = self._run.robot.card
        return Motion(
            robot=self._run.robot.name if _is_known_name(card.path) else str(Path(card.path or "").resolve()),
            time_s=rows["time"],
            joint_names=self._run.robot.joint_names,
            joint_position_rad=q[:, 7:],
            root_position_m=q[:, :3],
            root_quaternion_wxyz=q[:, [6, 3, 4, 5]],
            contact=rows["contact"],
            status=[STATUS[s] for s in rows["status"]],
        )

    def reference(self) -> Reference:
        """Return what was asked for so far."""
        rows = self._rows.arrays()
        stack, skeleton = self._run.stack, self._run.skeleton
        target: dict[str, Array] = {}
        active: dict[str, BoolArray] = {}
        at, n_switches = 0, stack.flat_switch.size
        tasks = list(stack)
        for i, task in enumerate(tasks):
            shape, size = task.target.shape, task.target.size
            target[task.name] = rows["target"][:, at : at + size].reshape(-1, *shape)
            active[task.name] = rows["switch"][:, n_switches - len(tasks) + i]
            at += size
        return Reference(
            time_s=rows["time"],
            role_names=ROLES,
            role_position_m=rows["position"],
            role_valid=rows["valid"],
            human_support=rows["support"],
            human_support_known=rows["support_known"],
            human_com_m=rows["com"],
            target=target,
            target_kind={t.name: str(t.kind) for t in tasks},
            target_active=active,
            compute_s=rows["compute"],
            human_height_m=skeleton.height_m,
            human_ankle_height_m=skeleton.ankle_height_m,
            object_names=self._object_names(),
            object_shift_m=rows["shift"],
            held_object=rows["held"],
        )

    def _object_names(self) -> Sequence[str]:
        """Return the names of the objects, of which the stack may know none."""
        names = [str(item["name"]) for item in self._run.environment]
        return names[: len(self._run.stack.object_shift)]


def _is_known_name(path: Path | None) -> bool:
    return (
        path is not None
        and path.resolve().parent == (Path(__file__).parent / "plugins/robots/cards").resolve()
    )


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write an npz without compression and with fixed time stamps: equal arrays give equal bytes."""
    with atomic(path) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            entry = zipfile.ZipInfo(f"{name}.npy", date_time=(1980, 1, 1, 0, 0, 0))
            with archive.open(entry, "w", force_zip64=True) as stream:
                np.lib.format.write_array(  # type: ignore[no-untyped-call]
                    stream, np.asarray(array, order="C"), allow_pickle=False
                )


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        with path.open("rb") as stream:
            if not zipfile.is_zipfile(stream):
                raise SourceError(path, "is not an npz archive, or a damaged one")
            stream.seek(0)
            with np.load(stream, allow_pickle=False) as data:
                return {name: data[name] for name in data.files}
    except FileNotFoundError:
        raise SourceError(path, "there is no such file; is this a run directory?") from None
    except (OSError, ValueError, zipfile.BadZipFile, EOFError) as error:
        raise SourceError(path, f"cannot be read as an npz archive: {error}") from None
