"""What is wrong or improbable about a robot card: ``imitor robot check CARD``.

Names first, because a card with wrong names makes no model; then the rules of `imitor.robot.rules`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from imitor.errors import RobotError, SpecError, did_you_mean
from imitor.metrics.kinematics import fresh_model
from imitor.registry import Registry
from imitor.robot.card import RobotCard, expand, expand_limits, find_card, load_card
from imitor.robot.files import locate
from imitor.robot.rules import LEVELS, RULES, Finding

__all__ = ["Finding", "check_card"]


def check_card(name_or_path: str | Path, registry: Registry) -> list[Finding]:
    """Return what is wrong with a card, errors first.

    Raises:
        SpecError: There is no such card.
    """
    find_card(name_or_path, registry)
    try:
        card = load_card(name_or_path, registry)
    except SpecError as error:
        return [Finding("error", str(problem)) for problem in error.problems]
    try:
        names = list(_names(card, fresh_model(card, locate(card))))
        if names:
            return names
        from imitor.robot.model import RobotModel

        robot = RobotModel.from_card(card)
    except RobotError as error:
        return [Finding("error", str(error))]
    except ValueError as error:  # the engine refuses, e.g. a link and a joint of one name
        return [Finding("error", f"the model cannot be used: {error}")]
    found = [finding for rule in RULES for finding in rule(robot)]
    return sorted(found, key=lambda finding: LEVELS.index(finding.level))


def _names(card: RobotCard, model: Any) -> Iterator[Finding]:
    """Say which names of the card are not in the model."""
    frames = [f.name for f in model.frames if f.name != "universe"]
    joints = list(model.names)[2:]
    limits = card.limits
    given: list[tuple[str, list[str], list[str], str]] = [
        *((f"roles.{role}", [frame], frames, "link or joint") for role, frame in card.sided_roles().items()),
        ("soles.frame", list(expand({card.soles.frame: 0.0})), frames, "link or joint"),
        *(
            (key, list(expand(getattr(card, key))), joints, "joint")
            for key in ("standing", "t_pose", "locked")
        ),
        ("coupled", [n for c in card.coupled for j in c.joints for n in expand({j: 0.0})], joints, "joint"),
        ("limits.position_rad", list(expand_limits(limits.position_rad)), joints, "joint"),
        ("limits.speed_rad_s", list(expand_limits(limits.speed_rad_s)), joints, "joint"),
        ("limits.acceleration_rad_s2", list(expand_limits(limits.acceleration_rad_s2)), joints, "joint"),
        (
            "collision.skip",
            [n for p in card.collision.skip for j in p for n in expand({j: 0.0})],
            frames,
            "link",
        ),
    ]
    for where, names, legal, what in given:
        for name in names:
            if name not in legal and name != "*":
                hint = did_you_mean(name, legal) or f"it has: {', '.join(legal[:8])}, …"
                yield Finding("error", f"{where}: the model has no {what} '{name}'; {hint}")
    locked = expand(card.locked)
    for key in ("standing", "t_pose"):
        for name in sorted(expand(getattr(card, key)).keys() & locked.keys()):
            yield Finding(
                "error", f"{key}.{name}: the joint is in `locked`, where its place is given; remove it here"
            )
    for role, frame in card.sided_roles().items():
        if role.startswith("left_") and card.sided_roles()[f"right_{role[5:]}"] == frame:
            yield Finding(
                "error",
                f"roles.{role[5:]}: '{frame}' stands for both sides; "
                "write {side}, {s} or {S} for the side",
            )
