"""Which skeleton a file has: a card by name, the card that fits, or the roles read off the joints' names.

Names alone are not trusted: ``LeftShoulder`` is a clavicle in one system and the shoulder joint in the next.
A guess counts only when the tree confirms it: the same lengths on either side, and human proportions.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from imitor.errors import SourceError, did_you_mean
from imitor.motion.bvh_hierarchy import Node
from imitor.motion.skeletons import (
    MAIN_ROLES,
    NodeNames,
    RolePoint,
    SkeletonCard,
    SkeletonFit,
    fit_card,
    load_card,
)
from imitor.motion.skeletons import recognise as recognise_card
from imitor.types import ROLES, SIDES, Array

GUESSED: Final = "unknown"
"""Name of a skeleton that no card describes."""

_WORD = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")
_SIDE_WORDS: Final = {"left": "left", "l": "left", "right": "right", "r": "right"}
_FINGERS: Final = ("thumb", "index", "middle", "mid", "ring", "pinky", "little", "finger", "fingers")
_NO_JOINT: Final = {*_FINGERS, "toe", "toes", "ball", "heel", "end", "top", "nub", "twist", "roll", "eye"}
# Limb: role, words that its joint's name may hold; from the far end to the near one.
_LEG: Final = (
    ("ankle", {"foot", "ankle"}),
    ("knee", {"leg", "knee", "shin", "calf", "tibia", "lowerleg", "lower"}),
    ("hip", {"leg", "upleg", "hip", "thigh", "femur", "upperleg", "upper", "up"}),
)
_ARM: Final = (
    ("wrist", {"hand", "wrist"}),
    ("elbow", {"forearm", "fore", "elbow", "lowerarm", "lower", "radius"}),
    ("shoulder", {"arm", "shoulder", "shldr", "upperarm", "upper", "up", "uparm", "humerus"}),
)


def choose_skeleton(
    path: str | Path, nodes: Sequence[Node], position: Array, wanted: str, cards: Mapping[str, Path]
) -> SkeletonFit:
    """Return the skeleton of a file.

    Args:
        path: The file, for messages.
        nodes: Its tree.
        position: Positions of all nodes in one frame, shape (N, 3) [file units].
        wanted: ``auto``, the name of a card or the path of one.
        cards: The cards known by name.

    Raises:
        SourceError: No card fits, or the one wanted does not; says which joints there are and what to write.
        SpecError: A card is wrong.
    """
    names = NodeNames(nodes)
    if wanted != "auto":
        name, card = _wanted_card(path, wanted, cards)
        fit, missing = fit_card(name, card, names)
        if missing:
            raise SourceError(
                path,
                f"skeleton '{name}' does not fit: the file has no {_listing(missing)} "
                f"(its joints: {_listing(names.joints)}); set skeleton to auto or to another card",
            )
        return fit
    loaded = {name: load_card(card) for name, card in cards.items()}
    found = recognise_card(nodes, loaded)
    if found is not None:
        return found
    roles = guess_roles(nodes, position)
    if all(r in roles for r in MAIN_ROLES):
        card = SkeletonCard(
            title="roles found by the joints' names and the symmetry of the tree",
            roles={r: nodes[i].name for r, i in roles.items()},
        )
        return SkeletonFit(GUESSED, card, {r: RolePoint(i, i, 0.0, i) for r, i in roles.items()})
    raise SourceError(path, _explain(nodes, names, roles, loaded))


def guess_roles(nodes: Sequence[Node], position: Array) -> dict[str, int]:
    """Guess the roles of joints by name and tree; a limb that the tree does not confirm is left out.

    Args:
        nodes: The tree.
        position: Positions of all nodes in one frame, shape (N, 3).

    Returns:
        Role to node.
    """
    words = [_words(node) for node in nodes]
    sides = [next((_SIDE_WORDS[w] for w in ws if w in _SIDE_WORDS), "") for ws in words]
    roles: dict[str, int] = {}
    for limb in (_LEG, _ARM):
        pair = {
            s: _limb(
                nodes, position, [w if s == own else set() for w, own in zip(words, sides, strict=True)], limb
            )
            for s in SIDES
        }
        if all(pair.values()) and _mirrored(pair["left"], pair["right"], position):
            for side in SIDES:
                roles |= {f"{side}_{joint}": i for (joint, _), i in zip(limb, pair[side], strict=True)}
    for side in SIDES:
        toes = [
            i
            for i, node in enumerate(nodes)
            if node.parent == roles.get(f"{side}_ankle", -2) and words[i] & {"toe", "toes", "ball"}
        ]
        roles |= {f"{side}_toe": i for i in toes[:1]}
    if "left_hip" in roles and "left_shoulder" in roles:
        pelvis = _common_ancestor(nodes, roles["left_hip"], roles["right_hip"])
        chest = _common_ancestor(nodes, roles["left_shoulder"], roles["right_shoulder"])
        if pelvis is not None and chest is not None and pelvis in [chest, *_ancestors(nodes, chest)]:
            roles |= {"pelvis": pelvis, "chest": chest}
    heads = [i for i, ws in enumerate(words) if "head" in ws and not ws & _NO_JOINT and not sides[i]]
    if heads:
        roles["head"] = heads[0]
        necks = [i for i in _ancestors(nodes, heads[0]) if "neck" in words[i]]
        necks = [i for i in necks if _apart(position, i, nodes[i].parent)] or necks
        if necks:
            roles["neck"] = necks[-1]
    return roles


def _wanted_card(path: str | Path, wanted: str, cards: Mapping[str, Path]) -> tuple[str, SkeletonCard]:
    if wanted in cards:
        return wanted, load_card(cards[wanted])
    if wanted.endswith((".yaml", ".yml")) or "/" in wanted:
        return Path(wanted).stem, load_card(wanted)
    hint = did_you_mean(wanted, cards)
    raise SourceError(
        path,
        f"no skeleton card is called '{wanted}'"
        + (f"; {hint}" if hint else "")
        + f" (cards: {', '.join(sorted(cards))}; or the path of a .yaml file)",
    )


def _words(node: Node) -> set[str]:
    return {w.lower() for w in _WORD.findall(node.name.rsplit(":", 1)[-1])}


def _ancestors(nodes: Sequence[Node], i: int) -> list[int]:
    out = []
    while nodes[i].parent >= 0:
        i = nodes[i].parent
        out.append(i)
    return out


def _common_ancestor(nodes: Sequence[Node], a: int, b: int) -> int | None:
    others = set(_ancestors(nodes, b))
    return next((i for i in _ancestors(nodes, a) if i in others), None)


def _limb(
    nodes: Sequence[Node], position: Array, words: Sequence[set[str]], limb: Sequence[tuple[str, set[str]]]
) -> list[int]:
    """Return the joints of one limb from its far end, or an empty list; joints of no side have no words."""
    ends = [i for i, ws in enumerate(words) if ws & limb[0][1] and not ws & _NO_JOINT]
    if not ends:
        return []
    chain = [ends[0]]
    for _, legal in limb[1:]:
        above = [i for i in _ancestors(nodes, chain[-1]) if words[i] and _apart(position, i, chain[-1])]
        if not above or not words[above[0]] & legal:
            return []
        chain.append(above[0])
    lower, upper = _lengths(chain, position)
    return chain if 0.6 < upper / lower < 1.7 else []


def _apart(position: Array, a: int, b: int) -> bool:
    return bool(np.any(position[a] != position[b]))


def _lengths(chain: Sequence[int], position: Array) -> Array:
    return np.asarray(np.linalg.norm(np.diff(position[list(chain)], axis=0), axis=1))


def _mirrored(left: Sequence[int], right: Sequence[int], position: Array) -> bool:
    a, b = _lengths(left, position), _lengths(right, position)
    return not set(left) & set(right) and bool(np.allclose(a, b, rtol=0.15))


def _listing(names: Sequence[str]) -> str:
    return ", ".join(f"'{n}'" for n in names)


def _explain(
    nodes: Sequence[Node], names: NodeNames, roles: Mapping[str, int], cards: Mapping[str, SkeletonCard]
) -> str:
    """Return what to do about a skeleton that nobody knows: the joints and a card to complete."""
    nearest = min(
        ((fit_card(name, card, names)[1], name) for name, card in sorted(cards.items())),
        key=lambda pair: len(pair[0]),
        default=None,
    )
    lines = ["no skeleton card fits the joints of this file"]
    if nearest:
        lines[0] += f"; the nearest is '{nearest[1]}', but there is no {_listing(nearest[0])}"
    lines.append("Joints: " + _listing(names.joints))
    lines.append(
        "Write the card below to a file, replace each ? by a joint, leave out what is not there, and give it"
    )
    lines.append("with --set source.skeleton=FILE.yaml:")
    lines += ["", "title: my skeleton", "roles:"]
    wanted = [r for r in ROLES if r in MAIN_ROLES or r in roles or r.endswith("_toe") or r == "chest"]
    lines += [f'  {r}: "{nodes[roles[r]].name if r in roles else "?"}"' for r in wanted]
    return "\n".join(lines)
