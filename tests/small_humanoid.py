"""A small humanoid of boxes, written as URDF or MJCF with its card, for tests.

Arms hang and legs are straight when all joints are 0. Every length is a plain number, so that answers can be
computed by hand.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from imitor.record import Motion, Reference
from imitor.robot.model import RobotModel
from imitor.types import ROLES, SIDES

THIGH, SHANK, ANKLE = 0.30, 0.30, 0.05
UPPER_ARM, FOREARM, HAND = 0.22, 0.18, 0.05
SHOULDER, HIP = (0.15, 0.30), (0.08, -0.05)  # y of the left one, z; from the pelvis [m]
SOLE = ((0.13, 0.04), (-0.05, 0.04), (-0.05, -0.04), (0.13, -0.04))


@dataclass
class Link:
    """A link with the joint that carries it: axis and range, or a fixed joint."""

    name: str
    parent: str
    at: tuple[float, float, float]
    axis: tuple[float, float, float] | None
    mass: float
    box: tuple[float, float, float]
    box_at: tuple[float, float, float]
    range: tuple[float, float] = (-2.5, 2.5)
    speed: float = 8.0


@dataclass
class SmallHumanoid:
    """The links of the robot and its card; change either before `write`."""

    links: list[Link] = field(default_factory=list)
    card: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.links = _links()
        self.card = {
            "imitor_robot": 1,
            "title": "Small humanoid of boxes",
            "licence": "CC0-1.0",
            "model": {"file": "small.urdf"},
            "roles": {
                "waist": "pelvis",
                "chest": "chest",
                "neck": "head",
                "head": "head",
                **{
                    role: f"{{side}}_{link}"
                    for role, link in {
                        "shoulder": "upper_arm",
                        "elbow": "forearm",
                        "wrist": "wrist",
                        "hand": "hand",
                        "hip": "thigh",
                        "knee": "shank",
                        "ankle": "foot",
                    }.items()
                },
            },
            "soles": {
                "frame": "{side}_foot",
                "translation_m": [0.0, 0.0, -ANKLE],
                "polygon_m": [list(p) for p in SOLE],
            },
            "t_pose": {"{side}_shoulder_roll": [1.5707, -1.5707]},
            "limits": {"acceleration_rad_s2": {"*": 100.0}},
            "sources": ["Made up."],
        }

    def link(self, name: str) -> Link:
        """Return a link by name."""
        return next(link for link in self.links if link.name == name)

    def write(self, folder: Path, *, mjcf: bool = False) -> Path:
        """Write model and card into a folder; return the card's path."""
        if mjcf:
            self.card["model"] = {"file": "small.xml"}
            (folder / "small.xml").write_text(self.mjcf(), encoding="utf-8")
        else:
            (folder / "small.urdf").write_text(self.urdf(), encoding="utf-8")
        path = folder / "small.yaml"
        path.write_text(yaml.safe_dump(self.card), encoding="utf-8")
        return path

    def urdf(self) -> str:
        """Return the model as URDF."""
        parts = ['<robot name="small">']
        for k in self.links:
            box, at = _numbers(k.box), _numbers(k.box_at)
            shape = f'<collision><origin xyz="{at}"/><geometry><box size="{box}"/></geometry></collision>'
            inertia = 'ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"'
            body = (
                f'<inertial><origin xyz="{at}"/><mass value="{k.mass}"/><inertia {inertia}/></inertial>'
                if k.mass
                else ""
            )
            parts.append(f'<link name="{k.name}">{body}{shape if any(k.box) else ""}</link>')
            if not k.parent:
                continue
            ends = f'<parent link="{k.parent}"/><child link="{k.name}"/><origin xyz="{_numbers(k.at)}"/>'
            if k.axis is None:
                parts.append(f'<joint name="{k.name}_fixed" type="fixed">{ends}</joint>')
                continue
            limit = f'<limit lower="{k.range[0]}" upper="{k.range[1]}" velocity="{k.speed}" effort="50"/>'
            axis = f'<axis xyz="{_numbers(k.axis)}"/>'
            parts.append(f'<joint name="{_joint(k)}" type="revolute">{ends}{axis}{limit}</joint>')
        return "\n".join([*parts, "</robot>"])

    def mjcf(self) -> str:
        """Return the model as MJCF; like most such files without a speed limit."""
        world = f"<worldbody>{self._body('pelvis')}</worldbody>"
        return f'<mujoco model="small"><compiler angle="radian"/>{world}</mujoco>'

    def _body(self, name: str) -> str:
        k = self.link(name)
        joint = '<freejoint name="root"/>'
        if k.parent:
            joint = ""
            if k.axis is not None:
                limits = f'range="{_numbers(k.range)}" limited="true"'
                joint = f'<joint name="{_joint(k)}" axis="{_numbers(k.axis)}" {limits}/>'
        half = _numbers([s / 2 for s in k.box])
        geom = f'<geom type="box" size="{half}" pos="{_numbers(k.box_at)}"/>' if any(k.box) else ""
        inertia = (
            f'<inertial pos="{_numbers(k.box_at)}" mass="{k.mass}" diaginertia="0.01 0.01 0.01"/>'
            if k.mass
            else ""
        )
        inner = "".join(self._body(c.name) for c in self.links if c.parent == name)
        return f'<body name="{k.name}" pos="{_numbers(k.at)}">{joint}{inertia}{geom}{inner}</body>'


def _joint(link: Link) -> str:
    """Return the name of a link's joint: that of what it turns."""
    names = {"thigh": "hip_pitch", "shank": "knee", "ankle_carrier": "ankle_pitch", "foot": "ankle_roll"}
    names |= {"hip_carrier": "hip_roll", "shoulder_carrier": "shoulder_pitch", "upper_arm": "shoulder_roll"}
    names |= {"forearm": "elbow", "chest": "waist_yaw"}
    side, _, part = link.name.partition("_")
    return f"{side}_{names[part]}" if side in SIDES else names[link.name]


def _links() -> list[Link]:
    x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    none, o = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    links = [
        Link("pelvis", "", o, None, 4.0, (0.12, 0.16, 0.06), o),
        Link("chest", "pelvis", (0.0, 0.0, 0.05), z, 8.0, (0.12, 0.20, 0.24), (0.0, 0.0, 0.14)),
        Link("head", "chest", (0.0, 0.0, 0.35), None, 1.0, (0.10, 0.10, 0.16), (0.0, 0.0, 0.08)),
    ]
    for side, s in zip(SIDES, (1.0, -1.0), strict=True):
        n = f"{side}_"
        links += [
            Link(n + "hip_carrier", "pelvis", (0.0, s * HIP[0], HIP[1]), x, 0.0, none, o, (-0.6, 0.6)),
            Link(n + "thigh", n + "hip_carrier", o, y, 2.0, (0.06, 0.06, 0.2), (0, 0, -0.15), (-2.0, 1.0)),
            Link(n + "shank", n + "thigh", (0, 0, -THIGH), y, 1.5, (0.06, 0.06, 0.2), (0, 0, -0.15),
                 (0.0, 2.3)),
            Link(n + "ankle_carrier", n + "shank", (0, 0, -SHANK), y, 0.0, none, o, (-1.2, 1.2)),
            Link(n + "foot", n + "ankle_carrier", o, x, 0.5, (0.18, 0.08, 0.03), (0.04, 0, -0.035),
                 (-0.6, 0.6)),
            Link(n + "shoulder_carrier", "chest", (0, s * SHOULDER[0], SHOULDER[1] - 0.05), y, 0.0, none, o),
            Link(n + "upper_arm", n + "shoulder_carrier", o, x, 1.0, (0.05, 0.05, 0.16), (0, 0, -0.11)),
            Link(n + "forearm", n + "upper_arm", (0, 0, -UPPER_ARM), y, 0.7, (0.05, 0.05, 0.12),
                 (0, 0, -0.09), (-2.4, 0.2)),
            Link(n + "wrist", n + "forearm", (0, 0, -FOREARM), None, 0.0, none, o),
            Link(n + "hand", n + "wrist", (0, 0, -HAND), None, 0.2, none, o),
        ]  # fmt: skip
    return links


def _numbers(values: Any) -> str:
    return " ".join(f"{v:g}" for v in values)


RATE_HZ = 50.0


def still(robot: RobotModel, frames: int = 20) -> tuple[Motion, Reference]:
    """Return a motion of a robot that stands, and a reference in which the human is the robot."""
    return moving(robot, np.tile(robot.standing, (frames, 1)))


def moving(robot: RobotModel, q: np.ndarray) -> tuple[Motion, Reference]:
    """Return the motion of configurations (T, nq), both feet in contact, and a human that does the same."""
    n = len(q)
    time = np.arange(n) / RATE_HZ
    motion = Motion(
        str(robot.card.path), time, robot.joint_names, q[:, 7:].copy(), q[:, :3].copy(),
        q[:, [6, 3, 4, 5]].copy(), np.ones((n, 2), dtype=bool), ["ok"] * n,
    )  # fmt: skip
    return motion, reference_of(robot, motion)


def reference_of(robot: RobotModel, motion: Motion) -> Reference:
    """Return the reference of a human whose points are the robot's."""
    n = len(motion)
    position, valid = np.full((n, len(ROLES), 3), np.nan), np.zeros((n, len(ROLES)), dtype=bool)
    for k, q in enumerate(motion.configurations()):
        robot.update(q)
        for i, role in enumerate(ROLES):
            if robot.has(role):
                position[k, i], valid[k, i] = robot.position(role), True
    robot.update(robot.standing)
    return Reference(
        motion.time_s, ROLES, position, valid, np.ones((n, 2), dtype=bool), np.ones(n, dtype=bool),
        np.full((n, 3), np.nan), {}, {}, {}, np.full(n, 0.002), 1.75, 0.08,
    )  # fmt: skip
