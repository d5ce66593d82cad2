"""What is known about a robot, for people: ``imitor show unitree_g1``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from imitor.metrics.collision import CollisionModel, robot_collision_model
from imitor.robot.card import RobotCard
from imitor.types import SIDES

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

HUMAN_HEIGHT_M: Final = 1.75
HUMAN_FRACTION: Final = {
    "torso": 0.288,
    "upper_arm": 0.186,
    "forearm": 0.146,
    "thigh": 0.245,
    "shank": 0.246,
    "hips": 0.105,
    "shoulders": 0.215,
    "ankle_height": 0.039,
}
"""Lengths as fractions of stature, joint centre to joint centre [winter2009] figure 4.1; the two widths are
those of the joint centres, narrower than the body's."""


@dataclass(frozen=True)
class Section:
    """A table of facts under a heading.

    Attributes:
        title: The heading.
        rows: Cells as text, all of one length.
        columns: Heads of the columns; empty for facts by name.
    """

    title: str
    rows: Sequence[Sequence[str]]
    columns: Sequence[str] = ()

    def __str__(self) -> str:
        table = [*([self.columns] if self.columns else []), *self.rows]
        widths = [max(len(cell) for cell in column) for column in zip(*table, strict=True)]
        lines = ["  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in table]
        return "\n".join([self.title, *(f"  {line}" for line in lines)])


def describe(card: RobotCard) -> str:
    """Return everything known about a card's robot as text.

    Raises:
        RobotError: The model is missing or does not fit the card.
    """
    from imitor.robot.model import RobotModel

    return "\n\n".join(str(section) for section in sections(RobotModel.from_card(card)))


def sections(robot: RobotModel) -> list[Section]:
    """Return everything known about a robot, section by section; sections without facts are left out."""
    collision = collision_or_reason(robot)
    found = [
        Section(f"{robot.name}: {robot.card.title}", _overview(robot, collision)),
        Section("Roles", _roles(robot), ("role", "frame")),
        Section("Segment lengths", _lengths(robot), ("segment", "length", f"of a {HUMAN_HEIGHT_M} m human")),
        Section("Soles", _soles(robot)),
        Section(
            "Joints",
            _joints(robot),
            ("joint", "range [rad]", "range [deg]", "speed [rad/s]", "standing [rad]"),
        ),
        Section("Joints that one motor moves", [(", ".join(c.joints),) for c in robot.card.coupled]),
        Section(
            "Joints that are not moved", [(name, f"{value:.3f} rad") for name, value in robot.locked.items()]
        ),
        Section("Sources", [(text,) for text in robot.card.sources]),
    ]
    return [section for section in found if section.rows]


def collision_or_reason(robot: RobotModel) -> CollisionModel | str:
    """Return the collision model of a robot, or why there is none."""
    try:
        return robot_collision_model(robot)
    except ValueError as reason:
        return str(reason)


def height_m(robot: RobotModel, collision: CollisionModel | str) -> float:
    """Return the height over the soles with all joints at 0 (or their limit) [m].

    Up to the highest point of the collision geometry; up to the highest role where there is none.
    """
    q = robot.standing.copy()
    q[7:] = np.clip(0.0, robot.lower, robot.upper)
    robot.update(q)
    floor = float(robot.sole_corners()[..., 2].min())
    top = max(float(robot.position(role)[2]) for role in robot.roles)
    robot.update(robot.standing)
    if not isinstance(collision, str):
        top = max(top, _highest_point(robot, collision, q))
    return top - floor


def _highest_point(robot: RobotModel, collision: CollisionModel, q: Any) -> float:
    import pinocchio as pin

    from imitor.metrics.collision import full_configurations

    model, geometry = collision.model, collision.geometry
    q_full = full_configurations(model, robot.locked, robot.joint_names, q[None])[0]
    data, places = model.createData(), geometry.createData()
    pin.updateGeometryPlacements(model, data, geometry, places, q_full)
    top = -np.inf
    for item, place in zip(geometry.geometryObjects, places.oMg, strict=True):
        up = np.array(place.rotation)[2]
        top = max(top, float((_outline(item.geometry) @ up).max()) + float(place.translation[2]))
    return top


def _outline(shape: Any) -> Any:
    """Return points around a shape: the corners of a hull, the box around anything else, shape (P, 3) [m]."""
    if hasattr(shape, "num_points"):
        return np.array([shape.point(i) for i in range(shape.num_points)])
    shape.computeLocalAABB()
    box = np.array([shape.aabb_local.min_, shape.aabb_local.max_])
    return np.array([(box[i, 0], box[j, 1], box[k, 2]) for i in (0, 1) for j in (0, 1) for k in (0, 1)])


def human_length_m(segment: str, stature_m: float) -> float | None:
    """Return the length of a human's segment at a stature [m]; ``None`` where no fraction is known."""
    part = segment.removeprefix("left_").removeprefix("right_")
    return HUMAN_FRACTION[part] * stature_m if part in HUMAN_FRACTION else None


def _overview(robot: RobotModel, collision: CollisionModel | str) -> list[tuple[str, str]]:
    card = robot.card
    pairs = collision if isinstance(collision, str) else f"{len(collision.pairs)}, {collision.rule}"
    measured = (
        "" if not isinstance(collision, str) else " (to the highest role: there is no collision geometry)"
    )
    facts = [
        ("licence", card.licence),
        ("model", str(robot.files.model)),
        ("card", str(card.path) if card.path else ""),
        ("joints", f"{robot.n} moved" + (f", {len(robot.locked)} not moved" if robot.locked else "")),
        ("independent", str(robot.coupling.shape[1]) if robot.coupling is not None else ""),
        ("mass", f"{robot.mass_kg:.2f} kg"),
        ("height", f"{height_m(robot, collision):.2f} m{measured}"),
        ("collision pairs", pairs),
    ]
    return [(name, text) for name, text in facts if text]


def _roles(robot: RobotModel) -> list[tuple[str, str]]:
    given = robot.card.sided_roles()
    return [(role, given[role]) for role in robot.roles if role in given]


def _lengths(robot: RobotModel) -> list[tuple[str, str, str]]:
    rows = []
    for segment, length in robot.segment_lengths().items():
        human = human_length_m(segment, HUMAN_HEIGHT_M)
        rows.append((segment, f"{length:.4f} m", f"{length / human:.0%}" if human else ""))
    return rows


def _soles(robot: RobotModel) -> list[tuple[str, str]]:
    card = robot.card.soles
    corners = np.array(card.polygon_m)
    length, width = corners.max(axis=0) - corners.min(axis=0)
    offset = (
        robot.position(f"{SIDES[0]}_foot") - robot.position("left_ankle") if robot.has("left_ankle") else None
    )
    facts = [
        ("frame", card.frame),
        ("size", f"{length:.3f} m long, {width:.3f} m wide"),
        ("polygon, left [m]", " ".join(f"({x:g}, {y:g})" for x, y in card.polygon_m)),
    ]
    if offset is not None:
        facts.append(("under the ankle", f"{-offset[2]:.4f} m"))
    return facts


def _joints(robot: RobotModel) -> list[tuple[str, str, str, str, str]]:
    rows = []
    for i, name in enumerate(robot.joint_names):
        lower, upper = robot.lower[i], robot.upper[i]
        rows.append(
            (
                name,
                f"{lower:7.3f} to {upper:6.3f}",
                f"{np.degrees(lower):6.1f} to {np.degrees(upper):6.1f}",
                f"{robot.speed[i]:.2f}",
                f"{robot.standing[7 + i]:.3f}",
            )
        )
    return rows
