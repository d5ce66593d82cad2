"""The schema of a robot card: one YAML a robot, no code. What the model can tell is not in the card."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from imitor.errors import Problem, SpecError, did_you_mean
from imitor.registry import Registry
from imitor.types import SIDES

_SIDED_ROLES: Final = ("foot", "ankle", "knee", "hip", "shoulder", "elbow", "wrist", "hand")
ROBOT_ROLES: Final[tuple[str, ...]] = (
    "waist",
    "chest",
    "neck",
    "head",
    *(f"{side}_{role}" for side in SIDES for role in _SIDED_ROLES),
)
"""Roles of robot frames. ``waist`` is the base link, ``foot`` the sole (from the card's ``soles``)."""

_SIDE_WORDS: Final = ({"side": "left", "s": "l", "S": "L"}, {"side": "right", "s": "r", "S": "R"})

Point2 = tuple[float, float]
Point3 = tuple[float, float, float]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class ModelFile(_Part):
    """Where the kinematic model comes from."""

    package: str | None = Field(
        None, description="Python distribution that carries the file, e.g. example-robot-data."
    )
    description: str | None = Field(
        None, description="Module of the package robot_descriptions, e.g. g1_description."
    )
    file: str = Field("", description="URDF or MJCF: path in the package's share folder, or beside the card.")
    srdf: str | None = Field(None, description="SRDF with collision pairs to skip; same place as the model.")


class Sole(_Part):
    """The flat part under a foot."""

    frame: str = Field(
        description="Link or frame that carries the sole; a template such as {side}_ankle_link."
    )
    translation_m: Point3 = Field((0.0, 0.0, 0.0), description="Sole frame in that frame, left foot [m].")
    polygon_m: Sequence[Point2] = Field(
        description="Corners of the flat part in the sole frame (x forward, y left), left foot, counter-clockwise [m].",
        min_length=3,
    )


class Coupling(_Part):
    """Joints moved by one motor: each follows the first."""

    joints: Sequence[str] = Field(min_length=2, description="Joint names; the first is the independent one.")
    ratios: Sequence[float] = Field(
        (), description="Motion of each joint per motion of the first [-]; default 1."
    )

    @model_validator(mode="after")
    def _same_length(self) -> Coupling:
        if self.ratios and len(self.ratios) != len(self.joints):
            raise ValueError(
                f"{len(self.ratios)} ratios for {len(self.joints)} joints; give one each, the first 1.0"
            )
        return self


PerJoint = Mapping[str, float]


class Limits(_Part):
    """Limits that the model lacks or that are narrower than the model's. Keys are joint names, templates or ``*``."""

    position_rad: Mapping[str, tuple[float, float]] = Field(
        {}, description="Lower and upper joint limit [rad]."
    )
    speed_rad_s: Mapping[str, Annotated[float, Field(gt=0)]] = Field(
        {}, description="Joint speed limit [rad/s]."
    )
    acceleration_rad_s2: Mapping[str, Annotated[float, Field(gt=0)]] = Field(
        {}, description="Joint acceleration limit [rad/s^2]; none where not given."
    )


class Collision(_Part):
    """What is known about the robot's own collisions."""

    skip: Sequence[tuple[str, str]] = Field((), description="Pairs of links that need no check.")
    reason: str = Field("", description="Why these pairs are skipped.")


class RobotCard(_Part):
    """All data of one robot."""

    imitor_robot: int = Field(description="Version of this card format; 1.", ge=1, le=1)
    title: str = Field(description="Full name for people.")
    licence: str = Field(description="SPDX licence of the model files.")
    model: ModelFile
    roles: Mapping[str, str] = Field(
        description="Role -> link or joint whose origin is the role's point. A role without side stands for both "
        "sides when the name is a template: {side} = left, right; {s} = l, r; {S} = L, R."
    )
    soles: Sole
    standing: Mapping[str, float | tuple[float, float]] = Field(
        {},
        description="Joint positions when standing [rad]; a pair is left, right. Others are 0 or their limit.",
    )
    t_pose: Mapping[str, float | tuple[float, float]] = Field(
        {}, description="Joint positions of the T-pose, or of the nearest reachable pose [rad]."
    )
    reference_vectors: Mapping[str, Point3] = Field(
        {},
        description="Limb directions in a T-pose where the robot cannot reach one; left side, y is mirrored.",
    )
    locked: Mapping[str, float | tuple[float, float]] = Field(
        {}, description="Joints that imitor does not move, and where they stay [rad]: fingers, grippers."
    )
    coupled: Sequence[Coupling] = Field((), description="Joints that one motor moves together.")
    limits: Limits = Limits()
    collision: Collision = Collision()
    sources: Sequence[str] = Field((), description="Where the numbers come from.")

    name: str = Field("", description="Set from the file name.")
    path: Path | None = Field(None, description="Set to the file.")

    @field_validator("roles")
    @classmethod
    def _known_roles(cls, roles: Mapping[str, str]) -> Mapping[str, str]:
        legal = [*ROBOT_ROLES, *_SIDED_ROLES]
        for role in roles:
            if role not in legal:
                hint = did_you_mean(role, legal)
                raise ValueError(f"no robot role is called '{role}'" + (f"; {hint}" if hint else ""))
        return roles

    def sided_roles(self) -> dict[str, str]:
        """Return role -> frame name with templates written out."""
        out: dict[str, str] = {}
        for role, frame in self.roles.items():
            if role in _SIDED_ROLES:
                for side, words in zip(SIDES, _SIDE_WORDS, strict=True):
                    out[f"{side}_{role}"] = frame.format(**words)
            else:
                out[role] = frame
        return out


def expand(values: Mapping[str, Any]) -> dict[str, Any]:
    """Write out templates in joint names: ``{side}_knee`` with a number or a (left, right) pair becomes two entries.

    Limits keep their pairs: a tuple is split only when the key is a template and the value has the form of a pair of
    scalars for the two sides (standing, t_pose, locked).
    """
    out: dict[str, Any] = {}
    for name, value in values.items():
        if "{" not in name:
            out[name] = value
            continue
        for i, words in enumerate(_SIDE_WORDS):
            out[name.format(**words)] = value[i] if isinstance(value, tuple) else value
    return out


def expand_limits(values: Mapping[str, Any]) -> dict[str, Any]:
    """Write out templates in the keys; the value goes to both sides as it is."""
    return {
        key: value
        for name, value in values.items()
        for key in ([name] if "{" not in name else [name.format(**w) for w in _SIDE_WORDS])
    }


def find_card(name_or_path: str | Path, registry: Registry) -> Path:
    """Return the file of a robot card given by name or path.

    Raises:
        SpecError: No such robot.
    """
    text = str(name_or_path)
    cards = registry.cards("robots")
    if text in cards:
        return cards[text]
    path = Path(text)
    if path.suffix in (".yaml", ".yml") or "/" in text:
        if path.is_file():
            return path
        raise SpecError([Problem(text, 0, 0, "robot", "there is no such robot card file")])
    hint = did_you_mean(text, cards)
    raise SpecError(
        [
            Problem(
                text, 0, 0, "robot", f"no robot is called '{text}'; known: {', '.join(sorted(cards))}", hint
            )
        ]
    )


def load_card(name_or_path: str | Path, registry: Registry) -> RobotCard:
    """Load and validate a robot card.

    Raises:
        SpecError: The card does not exist or is wrong; every problem with file, line and column.
    """
    from imitor.spec.yaml_marks import parse_document, translate

    path = find_card(name_or_path, registry)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SpecError([Problem(str(path), 0, 0, "", f"cannot read the card: {error}")]) from None
    if text.lstrip().startswith("<"):
        raise SpecError(
            [Problem(str(path), 0, 0, "", "this is a robot model, not a card; write a card that names it as model.file "
                     "(docs/robots.md shows one)")]
        )  # fmt: skip
    document = parse_document(text, str(path))
    if document.problems:
        raise SpecError(document.problems)
    try:
        card = RobotCard.model_validate(document.data)
    except ValidationError as error:
        raise SpecError(translate(error, document, (), RobotCard)) from None
    return card.model_copy(update={"name": path.stem, "path": path})
