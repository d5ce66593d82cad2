"""Skeleton cards: which joint of a file is which point of the human, and which card fits a file.

A card is a YAML file; `SkeletonCard` is its schema. Names are compared without a namespace
(``mixamorig:Hips``), a prefix that all joints share (``Character1_Hips``), upper case, blanks, ``.``, ``_``
and ``-``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from imitor.errors import Problem, SpecError, did_you_mean
from imitor.motion.bvh_hierarchy import Node
from imitor.motion.normalise import UNITS
from imitor.types import ROLES, SIDES

Card = TypeVar("Card", bound=BaseModel)

_SIDED: Final = tuple(r.removeprefix("left_") for r in ROLES if r.startswith("left_"))

MAIN_ROLES: Final = (
    "pelvis",
    "neck",
    "head",
    *(f"{side}_{r}" for side in SIDES for r in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")),
)
"""The roles that a skeleton must have; a card fits a file when the joints of all these are in it."""


class Between(BaseModel):
    """A point on the line between two others, for a skeleton that has no joint there."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    start: str = Field(alias="from", description="Joint where the line starts.")
    end: str = Field(alias="to", description="Joint where the line ends.")
    at: float = Field(default=0.5, description="Place on the line, 0 at its start and 1 at its end [-].")
    turns_with: str = Field(
        default="", description="Joint whose rotation the point has; the start by default."
    )


PointSpec = Annotated[
    str | list[str] | Between, "a joint, several of which the first present counts, or a line"
]


class SkeletonCard(BaseModel):
    """The skeleton of one capture system, converter or tool.

    A role whose name lacks its side stands for both; ``{side}`` in its joint becomes the word of ``sides``.
    ``Joint/end`` is the End Site of a joint.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    title: str = Field(description="What the skeleton is, in words.")
    roles: dict[str, PointSpec] = Field(description="Role to joint.")
    sides: dict[str, str] = Field(default={}, description="Words that replace {side} for left and right.")
    marks: list[str] = Field(
        default=[], description="Joints that tell this skeleton from its relatives; all must be there."
    )
    unit: str = Field(default="", description="Unit that such files usually have; tried first.")
    notes: str = Field(default="", description="What a reader should know; printed in the report.")

    @model_validator(mode="after")
    def _roles_are_legal(self) -> SkeletonCard:
        legal = [*ROLES, *_SIDED]
        for role in self.roles:
            if role not in legal:
                hint = did_you_mean(role, legal)
                raise ValueError(f"no role is called '{role}'" + (f"; {hint}" if hint else ""))
        if self.unit and self.unit not in UNITS:
            raise ValueError(f"no unit is called '{self.unit}'; legal are {', '.join(UNITS)}")
        missing = [r for r in MAIN_ROLES if r not in self.expanded()]
        if missing:
            raise ValueError(f"roles are missing: {', '.join(missing)}")
        return self

    def expanded(self) -> dict[str, PointSpec]:
        """Return role to joint with both sides written out."""
        full: dict[str, PointSpec] = {}
        for role, point in self.roles.items():
            if role in ROLES:
                full[role] = point
            else:
                for side in SIDES:
                    full[f"{side}_{role}"] = _with_side(point, self.sides.get(side, side))
        return full


@dataclass(frozen=True)
class RolePoint:
    """Where a role is in a file's tree.

    Attributes:
        start: Index of a node.
        end: Index of another; the point lies on the line between them.
        at: Place on that line, 0 at the start [-].
        turns_with: Index of the node whose rotation counts.
    """

    start: int
    end: int
    at: float
    turns_with: int


@dataclass(frozen=True)
class SkeletonFit:
    """A card fitted to a file.

    Attributes:
        name: The card's name.
        card: The card.
        points: Role to place in the tree.
    """

    name: str
    card: SkeletonCard
    points: Mapping[str, RolePoint]


def load_card(path: str | Path) -> SkeletonCard:
    """Read a card.

    Raises:
        SpecError: The file is not there, is no YAML or no skeleton card.
    """
    return read_card(path, SkeletonCard, "skeleton card")


def read_card(path: str | Path, schema: type[Card], what: str) -> Card:
    """Read a data card of a source.

    Args:
        path: The file.
        schema: What it must be.
        what: How messages call it.

    Raises:
        SpecError: The file is not there, is no YAML or no such card.
    """
    try:
        data: Any = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
        return schema.model_validate(data)
    except OSError as error:
        problem = Problem(str(path), 0, 0, "", f"the {what} cannot be read: {error.strerror}")
    except UnicodeDecodeError:
        problem = Problem(str(path), 0, 0, "", f"the {what} is not UTF-8 text")
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line, column = (mark.line + 1, mark.column + 1) if mark else (0, 0)
        problem = Problem(str(path), line, column, "", f"no YAML: {getattr(error, 'problem', None) or error}")
    except ValidationError as error:
        raise SpecError(
            [
                Problem(str(path), 0, 0, ".".join(map(str, e["loc"])), e["msg"].removeprefix("Value error, "))
                for e in error.errors()
            ]
        ) from None
    raise SpecError([problem])


class NodeNames:
    """The nodes of a tree by their names, read with tolerance; of equal names the first counts."""

    def __init__(self, nodes: Sequence[Node]) -> None:
        joints = [n.name for n in nodes if not n.is_end]
        bare = [name.rsplit(":", 1)[-1] for name in joints]
        cut = _common_prefix(bare).rfind("_") + 1 if len(bare) > 4 else 0
        self.joints = [name[cut:] for name in bare]
        self._index: dict[str, int] = {}
        names = iter(self.joints)
        for i, node in enumerate(nodes):
            if not node.is_end:
                self._index.setdefault(_key(next(names)), i)
        for i, node in enumerate(nodes):
            if node.is_end and self.find(nodes[node.parent].name[cut:]) in (node.parent, None):
                parent = nodes[node.parent].name.rsplit(":", 1)[-1][cut:]
                self._index.setdefault(_key(f"{parent}/end"), i)

    def find(self, name: str) -> int | None:
        """Return the index of a node, ``Joint`` or ``Joint/end``; None when it is not there."""
        return self._index.get(_key(name))

    def __contains__(self, name: str) -> bool:
        return self.find(name) is not None


def fit_card(name: str, card: SkeletonCard, names: NodeNames) -> tuple[SkeletonFit, list[str]]:
    """Place the roles of a card in a tree.

    Returns:
        The fit, and the joints that a fit needs and the tree lacks (an empty list: the card fits).
    """
    missing = [mark for mark in card.marks if mark not in names]
    points: dict[str, RolePoint] = {}
    for role, spec in card.expanded().items():
        point = _place(spec, names)
        if point is not None:
            points[role] = point
        elif role in MAIN_ROLES:
            missing.append(_first_name(spec))
    return SkeletonFit(name, card, points), missing


def recognise(nodes: Sequence[Node], cards: Mapping[str, SkeletonCard]) -> SkeletonFit | None:
    """Return the card that fits a tree, of several the one that names most of its joints; None: none fits."""
    names = NodeNames(nodes)
    best: SkeletonFit | None = None
    best_score = -1
    for name, card in sorted(cards.items()):
        fit, missing = fit_card(name, card, names)
        score = len(set(card.marks)) + len(fit.points)
        if not missing and score > best_score:
            best, best_score = fit, score
    return best


def _common_prefix(names: Sequence[str]) -> str:
    low, high = min(names), max(names)
    same = next((i for i, (a, b) in enumerate(zip(low, high, strict=False)) if a != b), len(low))
    return low[:same]


def _key(name: str) -> str:
    return re.sub(r"[\s._\-]+", "", name).casefold()


def _with_side(point: PointSpec, word: str) -> PointSpec:
    if isinstance(point, Between):
        return point.model_copy(
            update={k: getattr(point, k).replace("{side}", word) for k in ("start", "end", "turns_with")}
        )
    if isinstance(point, list):
        return [name.replace("{side}", word) for name in point]
    return point.replace("{side}", word)


def _candidates(spec: PointSpec) -> Iterable[str]:
    if isinstance(spec, Between):
        return [spec.start, spec.end]
    return spec if isinstance(spec, list) else [spec]


def _first_name(spec: PointSpec) -> str:
    return next(iter(_candidates(spec)), "?")


def _place(spec: PointSpec, names: NodeNames) -> RolePoint | None:
    if isinstance(spec, Between):
        start, end = names.find(spec.start), names.find(spec.end)
        turns = names.find(spec.turns_with) if spec.turns_with else start
        if start is None or end is None or turns is None:
            return None
        return RolePoint(start, end, spec.at, turns)
    for name in _candidates(spec):
        index = names.find(name)
        if index is not None:
            return RolePoint(index, index, 0.0, index)
    return None
