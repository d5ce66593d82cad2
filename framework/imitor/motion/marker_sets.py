"""Marker sets: cards that say which marker is which landmark of the body, and which card fits a file.

A card is a YAML file; `MarkerSetCard` is its schema. Labels are compared without a subject (``Anna:LASI``), upper
case, blanks, ``.``, ``_`` and ``-``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Field, model_validator

from imitor.errors import SourceError, did_you_mean
from imitor.motion.normalise import UNITS
from imitor.motion.skeletons import read_card
from imitor.types import SIDES

MIDDLE_LANDMARKS: Final = ("c7", "t10", "clavicle", "sternum", "sacrum", "head")
SIDED_LANDMARKS: Final = (
    "asis", "psis", "shoulder", "elbow_lateral", "elbow_medial", "wrist", "wrist_radial", "wrist_ulnar", "hand",
    "thigh", "knee_lateral", "knee_medial", "shank", "ankle_lateral", "ankle_medial", "heel", "toe",
)  # fmt: skip
LANDMARKS: Final = (*MIDDLE_LANDMARKS, *(f"{side}_{name}" for side in SIDES for name in SIDED_LANDMARKS))
"""Points that a marker can stand for: spinous processes of C7 and T10, ``clavicle`` (jugular notch), ``sternum``
(xiphoid process), ``sacrum`` (middle of the posterior iliac spines), ``head`` (middle of a head band), the anterior and
posterior iliac spines, ``shoulder`` (acromion), both epicondyles, ``wrist`` or its two sides, ``hand`` (knuckles),
``thigh`` and ``shank`` (a marker on the outer side), both sides of knee and ankle, ``heel``, ``toe`` (ball of the
foot).
"""
NEEDED: Final = tuple(
    f"{side}_{name}" for side in SIDES for name in ("asis", "knee_lateral", "ankle_lateral")
)
"""A card fits a file when the markers of these are in it, and one of `BACKS` and of `TOPS`."""
BACKS: Final = ("sacrum", "left_psis")
TOPS: Final = ("c7", "clavicle", "left_shoulder")


class Middle(BaseModel):
    """The middle of several markers."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    middle: list[str] = Field(
        min_length=1,
        description="Markers whose mean is the landmark, {side} for both sides; all must be seen.",
    )


Place = str | Middle
PlaceSpec = Annotated[
    Place | list[Place], "a marker, the middle of several, or a list whose first present counts"
]


class MarkerSetCard(BaseModel):
    """A set of markers.

    A segment or landmark whose name lacks its side stands for both; ``{side}`` in a label becomes the word of
    ``sides``. A label with ``{side}`` in a segment of the middle stands for both.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    title: str = Field(description="What the set is, in words.")
    segments: dict[str, list[str]] = Field(
        description="Markers that move together, by segment: all of the set."
    )
    landmarks: dict[str, PlaceSpec] = Field(description="Landmark to marker.")
    virtual: list[str] = Field(
        default=[],
        description="Points for landmarks that are computed and no markers; {side} for both sides.",
    )
    sides: dict[str, str] = Field(
        default={"left": "L", "right": "R"}, description="Words that replace {side} for left and right."
    )
    marks: list[str] = Field(
        default=[], description="Markers that tell this set from its relatives; all must be there."
    )
    unit: str = Field(default="", description="Unit of files that do not name theirs.")
    notes: str = Field(default="", description="What a reader should know; printed in the report.")

    @model_validator(mode="after")
    def _is_legal(self) -> MarkerSetCard:
        legal = [*LANDMARKS, *SIDED_LANDMARKS]
        for name in self.landmarks:
            if name not in legal:
                hint = did_you_mean(name, legal)
                raise ValueError(f"no landmark is called '{name}'" + (f"; {hint}" if hint else ""))
        if self.unit and self.unit not in UNITS:
            raise ValueError(f"no unit is called '{self.unit}'; legal are {', '.join(UNITS)}")
        if set(self.sides) != set(SIDES):
            raise ValueError("sides: give a word for left and one for right")
        words = [self.sides[side] for side in SIDES]
        known = {key(w) for label in [*self.labels(), *self.virtual] for w in _words(label, words)}
        for name, spec in self.expanded().items():
            for label in _labels(spec):
                if key(label) not in known:
                    raise ValueError(f"landmarks.{name}: '{label}' is in no segment and not virtual")
        missing = [n for n in NEEDED if n not in self.expanded()]
        missing += [" or ".join(group) for group in (BACKS, TOPS) if not set(group) & set(self.expanded())]
        if missing:
            raise ValueError(f"landmarks are missing: {', '.join(missing)}")
        return self

    def expanded(self) -> dict[str, PlaceSpec]:
        """Return landmark to marker with both sides written out."""
        out: dict[str, PlaceSpec] = {}
        for name, spec in self.landmarks.items():
            if name in SIDED_LANDMARKS:
                for side in SIDES:
                    out[f"{side}_{name}"] = _with_sides(spec, [self.sides[side]])
            else:
                out[name] = _with_sides(spec, [self.sides[side] for side in SIDES])
        return out

    def clusters(self) -> dict[str, list[str]]:
        """Return segment to labels with both sides written out."""
        middle = {"head", "thorax", "pelvis"}
        out: dict[str, list[str]] = {}
        for name, labels in self.segments.items():
            if name in middle or name.startswith(("left_", "right_")):
                out[name] = [w for label in labels for w in _words(label, [self.sides[s] for s in SIDES])]
            else:
                for side in SIDES:
                    out[f"{side}_{name}"] = [label.replace("{side}", self.sides[side]) for label in labels]
        return out

    def labels(self) -> list[str]:
        """Return every label of the set, in the order of the segments."""
        return list(dict.fromkeys(label for labels in self.clusters().values() for label in labels))


@dataclass(frozen=True)
class MarkerSetFit:
    """A card fitted to a file.

    Attributes:
        name: The card's name.
        card: The card.
        columns: The file's columns that are markers of the set, in the order of the file.
        labels: Their labels, without a subject.
        landmarks: Landmark to the columns whose middle it is.
        segments: Segment to labels out of ``labels``.
    """

    name: str
    card: MarkerSetCard
    columns: tuple[int, ...]
    labels: tuple[str, ...]
    landmarks: Mapping[str, tuple[int, ...]]
    segments: Mapping[str, tuple[str, ...]]


class Labels:
    """The labels of a file, read with tolerance.

    Attributes:
        bare: The labels without a subject.
        subjects: The subjects named, in order.
    """

    def __init__(self, labels: Sequence[str], subject: str = "") -> None:
        parts = [label.rpartition(":") for label in labels]
        self.subjects = tuple(dict.fromkeys(before for before, colon, _ in parts if colon))
        self.bare = [name.strip() for _, _, name in parts]
        self._index: dict[str, int] = {}
        for i, (before, colon, name) in enumerate(parts):
            if not subject or not colon or before.casefold() == subject.casefold():
                self._index.setdefault(key(name), i)

    def find(self, label: str) -> int | None:
        """Return the column of a label; None when it is not there."""
        return self._index.get(key(label))


def key(label: str) -> str:
    """Return what labels are compared by."""
    return re.sub(r"[\s._\-]+", "", label).casefold()


def load_marker_set(path: str | Path) -> MarkerSetCard:
    """Read a card.

    Raises:
        SpecError: The file is not there, is no YAML or no marker set card.
    """
    return read_card(path, MarkerSetCard, "marker set card")


def fit_marker_set(name: str, card: MarkerSetCard, labels: Labels) -> tuple[MarkerSetFit, list[str]]:
    """Find the markers of a card in a file.

    Returns:
        The fit, and what it needs and the file lacks (an empty list: the card fits).
    """
    missing = [mark for mark in card.marks if labels.find(mark) is None]
    landmarks: dict[str, tuple[int, ...]] = {}
    for landmark, spec in card.expanded().items():
        columns = _find(spec, labels)
        if columns is not None:
            landmarks[landmark] = columns
        elif landmark in NEEDED:
            missing.append(next(_labels(spec)))
    for group in (BACKS, TOPS):
        if not any(n in landmarks for n in group):
            missing += [next(_labels(card.expanded()[n])) for n in group if n in card.expanded()][:1]
    found = {i: label for label in card.labels() if (i := labels.find(label)) is not None}
    columns = tuple(sorted(found))
    present = {key(found[i]) for i in columns}
    segments = {
        segment: tuple(labels.bare[i] for label in members if (i := labels.find(label)) is not None)
        for segment, members in card.clusters().items()
        if any(key(label) in present for label in members)
    }
    fit = MarkerSetFit(name, card, columns, tuple(labels.bare[i] for i in columns), landmarks, segments)
    return fit, list(dict.fromkeys(missing))


def choose_marker_set(
    path: str | Path, labels: Sequence[str], wanted: str, subject: str, cards: Mapping[str, Path]
) -> MarkerSetFit:
    """Return the marker set of a file.

    Args:
        path: The file, for messages.
        labels: Its labels.
        wanted: ``auto``, the name of a card or the path of one.
        subject: The subject to take of several, or empty.
        cards: The cards known by name.

    Raises:
        SourceError: No card fits, the one wanted does not, or there are several subjects.
        SpecError: A card is wrong.
    """
    names = Labels(labels, subject)
    if subject and subject.casefold() not in [s.casefold() for s in names.subjects]:
        there = ", ".join(names.subjects) or "none is named"
        raise SourceError(path, f"no label belongs to a subject '{subject}'; subjects: {there}")
    if len(names.subjects) > 1 and not subject:
        raise SourceError(
            path, f"it holds several subjects: {', '.join(names.subjects)}; set subject to one of them"
        )
    if wanted != "auto":
        name, card = _wanted(path, wanted, cards)
        fit, missing = fit_marker_set(name, card, names)
        if missing:
            raise SourceError(
                path,
                f"marker set '{name}' does not fit: the file has no {_listing(missing)} "
                f"(its markers: {_listing(names.bare)}); set marker_set to auto or to another card",
            )
        return fit
    best: MarkerSetFit | None = None
    nearest: tuple[list[str], str] | None = None
    for name, file in sorted(cards.items()):
        fit, missing = fit_marker_set(name, load_marker_set(file), names)
        if not missing and (best is None or len(fit.columns) > len(best.columns)):
            best = fit
        if missing and (nearest is None or len(missing) < len(nearest[0])):
            nearest = missing, name
    if best is not None:
        return best
    raise SourceError(path, _explain(names, nearest))


def _wanted(path: str | Path, wanted: str, cards: Mapping[str, Path]) -> tuple[str, MarkerSetCard]:
    if wanted in cards:
        return wanted, load_marker_set(cards[wanted])
    if wanted.endswith((".yaml", ".yml")) or "/" in wanted:
        return Path(wanted).stem, load_marker_set(wanted)
    hint = did_you_mean(wanted, cards)
    raise SourceError(
        path,
        f"no marker set is called '{wanted}'"
        + (f"; {hint}" if hint else "")
        + f" (cards: {', '.join(sorted(cards))}; or the path of a .yaml file)",
    )


def _explain(names: Labels, nearest: tuple[list[str], str] | None) -> str:
    """Return what to do about a set that nobody knows: the markers and a card to complete."""
    text = "no marker set fits the markers of this file"
    if nearest:
        text += f"; the nearest is '{nearest[1]}', but there is no {_listing(nearest[0])}"
    lines = [text, "Markers: " + _listing(names.bare)]
    lines.append(
        "Write the card below to a file, replace each ? by a marker, leave out what is not there, and give it"
    )
    lines.append("with --set source.marker_set=FILE.yaml:")
    lines += ["", "title: my marker set", "segments:"]
    for name in ("head", "thorax", "pelvis"):
        lines.append(f"  {name}: [?]")
    for name in ("upper_arm", "forearm", "hand", "thigh", "shank", "foot"):
        lines += [f"  {side}_{name}: [?]" for side in SIDES]
    lines.append("landmarks:")
    wanted = [n for n in LANDMARKS if not n.endswith(("_wrist", "_thigh", "_shank", "_medial"))]
    lines += [f"  {name}: ?" for name in wanted]
    return "\n".join(lines)


def _listing(names: Iterable[str]) -> str:
    return ", ".join(f"'{n}'" for n in names)


def _words(label: str, words: Sequence[str]) -> list[str]:
    return [label.replace("{side}", word) for word in words] if "{side}" in label else [label]


def _with_sides(spec: PlaceSpec, words: Sequence[str]) -> PlaceSpec:
    if isinstance(spec, list):
        return [place for item in spec if not isinstance(place := _with_sides(item, words), list)]
    if isinstance(spec, Middle):
        return Middle(middle=[w for label in spec.middle for w in _words(label, words)])
    both = _words(spec, words)
    return both[0] if len(both) == 1 else Middle(middle=both)


def _labels(spec: PlaceSpec) -> Iterator[str]:
    for item in spec if isinstance(spec, list) else [spec]:
        yield from item.middle if isinstance(item, Middle) else [item]


def _find(spec: PlaceSpec, labels: Labels) -> tuple[int, ...] | None:
    for item in spec if isinstance(spec, list) else [spec]:
        columns: list[Any] = [labels.find(label) for label in _labels(item)]
        if None not in columns:
            return tuple(columns)
    return None
