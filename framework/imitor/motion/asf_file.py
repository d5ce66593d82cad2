"""Acclaim skeletons (ASF): the bones of a person, read into a tree of joints.

A bone turns about its near end and carries its own vector. In the tree a node lies at the near end of its bone and has
the bone's name; the far end of a bone without children is an End Site. In the zero pose all axes are the world's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from imitor.errors import SourceError, did_you_mean
from imitor.motion.bvh_hierarchy import Node
from imitor.motion.text_file import read_lines
from imitor.types import Array

INCH_M: Final = 0.0254
MAX_BONES: Final = 1000
ROOT: Final = "root"
_ROOT_DOF: Final = ("tx", "ty", "tz", "rx", "ry", "rz")
_BONE_DOF: Final = ("rx", "ry", "rz")
EULER: Final = ("Zrotation", "Yrotation", "Xrotation")
"""The channels of a node in the tree: R_z R_y R_x."""


@dataclass(frozen=True)
class Bone:
    """A bone; of the root only axis, order and dof count.

    Attributes:
        name: Its name.
        vector: From its near to its far end in the zero pose, shape (3,) [file units].
        axis: The axes that its values turn about, world from bone, shape (3, 3).
        order: Order of its rotations about fixed axes, such as ``xyz``.
        dof: What its values in a motion file mean, in their order.
    """

    name: str
    vector: Array
    axis: Array
    order: str
    dof: tuple[str, ...]


@dataclass(frozen=True)
class Asf:
    """A skeleton.

    Attributes:
        bones: The bones by their place, parents before children; the root first.
        parent: Index of each bone's parent; -1 for the root.
        metres: Metres per file unit.
        degrees: Whether angles are in degrees.
        root_position: Added to the root's translation, shape (3,) [file units].
    """

    bones: tuple[Bone, ...]
    parent: tuple[int, ...]
    metres: float
    degrees: bool
    root_position: Array

    def nodes(self) -> tuple[tuple[Node, ...], list[int]]:
        """Return the tree [m], and for every bone its node."""
        nodes: list[Node] = []
        place: list[int] = []
        for i, bone in enumerate(self.bones):
            channels = EULER if any(d.startswith("r") for d in bone.dof) else ()
            if i == 0:
                position = ("Xposition", "Yposition", "Zposition")
                nodes.append(Node(ROOT, -1, np.zeros(3), (*position, *EULER)))
            else:
                above = self.parent[i]
                offset = self.metres * self.bones[above].vector if above else np.zeros(3)
                nodes.append(Node(bone.name, place[above], offset, channels))
            place.append(len(nodes) - 1)
        for i, bone in enumerate(self.bones):
            if i and i not in self.parent:
                nodes.append(Node("", place[i], self.metres * bone.vector, is_end=True))
        return tuple(nodes), place


def extrinsic(order: str, angles: Array) -> Array:
    """Return rotations about fixed axes, one after the other, shape (..., 3, 3).

    Args:
        order: Axes in the order of the turns, such as ``xyz`` for R_z R_y R_x.
        angles: About x, y, z, shape (..., 3) [rad].
    """
    out = np.broadcast_to(np.eye(3), (*angles.shape[:-1], 3, 3)).copy()
    for name in order:
        k = "xyz".index(name)
        i, j = (k + 1) % 3, (k + 2) % 3
        turn = np.zeros_like(out)
        c, s = np.cos(angles[..., k]), np.sin(angles[..., k])
        turn[..., k, k] = 1.0
        turn[..., i, i], turn[..., j, j] = c, c
        turn[..., i, j], turn[..., j, i] = -s, s
        out = turn @ out
    return out


def read_asf(path: str | Path) -> Asf:
    """Read a skeleton.

    Raises:
        SourceError: The file is broken or no ASF file; says where and why.
    """
    return _Parser(path, read_lines(path, "an ASF file")).parse()


class _Parser:
    def __init__(self, path: str | Path, lines: Sequence[str]) -> None:
        self.path = path
        self.lines = lines
        self.number = 0
        self.scale, self.degrees = 1.0, True
        self.root = Bone(ROOT, np.zeros(3), np.eye(3), "xyz", _ROOT_DOF)
        self.root_position = np.zeros(3)
        self.bones: dict[str, Bone] = {}
        self.children: list[tuple[str, list[str], int]] = []
        self.facts: dict[str, list[str]] = {}

    def fail(self, message: str) -> SourceError:
        return SourceError(self.path, message, self.number or None)

    def parse(self) -> Asf:
        section, open_at, seen = "", 0, set[str]()
        for number, line in enumerate(self.lines, 1):
            self.number = number
            words = line.split("#", 1)[0].split()
            if not words:
                continue
            if words[0].startswith(":"):
                section = words[0].lower()
                seen.add(section)
            elif section == ":units":
                self.units(words)
            elif section == ":root":
                self.root_fact(words)
            elif section == ":bonedata":
                if words[0] == "begin":
                    self.facts, open_at = {}, self.number
                elif words[0] == "end":
                    self.bone()
                    open_at = 0
                else:
                    self.facts[words[0].lower()] = words[1:]
            elif section == ":hierarchy" and words[0] not in {"begin", "end"}:
                self.children.append((words[0], words[1:], self.number))
        missing = [s for s in (":root", ":bonedata", ":hierarchy") if s not in seen]
        if missing:
            self.number = 0
            raise self.fail(
                f"an ASF file has the sections :root, :bonedata, :hierarchy; {missing[0]} is missing"
            )
        if open_at:
            self.number = open_at
            raise self.fail("the bone that begins here does not end: the file is cut off")
        return self.tree()

    def units(self, words: list[str]) -> None:
        if words[0] == "length":
            self.scale = self.numbers(words[1:], 1)[0]
            if not self.scale > 0.0:
                raise self.fail(f"the unit of length is {self.scale:g}, not greater than 0")
        elif words[0] == "angle" and len(words) > 1:
            if words[1] not in {"deg", "rad"}:
                raise self.fail(f"angles are in '{words[1]}', legal are deg and rad")
            self.degrees = words[1] == "deg"

    def root_fact(self, words: list[str]) -> None:
        root = self.root
        if words[0] == "order":
            dof = tuple(w.lower() for w in words[1:])
            if sorted(dof) != sorted(_ROOT_DOF):
                raise self.fail(
                    f"the root's order is '{' '.join(words[1:])}', not TX TY TZ RX RY RZ in some order"
                )
            self.root = Bone(ROOT, root.vector, root.axis, root.order, dof)
        elif words[0] == "axis":
            self.root = Bone(ROOT, root.vector, root.axis, self.axis_order(words[1:2]), root.dof)
        elif words[0] == "position":
            self.root_position = self.numbers(words[1:], 3)
        elif words[0] == "orientation":
            axis = extrinsic(self.root.order, self.radians(self.numbers(words[1:], 3)))
            self.root = Bone(ROOT, root.vector, axis, root.order, root.dof)

    def bone(self) -> None:
        facts = self.facts
        name = (facts.get("name") or [""])[0]
        if not name:
            raise self.fail("the bone that ends here has no name")
        if name in self.bones or name == ROOT:
            raise self.fail(f"bone '{name}' is described twice")
        for needed in ("direction", "length"):
            if needed not in facts:
                raise self.fail(f"bone '{name}' has no {needed}")
        axis = facts.get("axis", ["0", "0", "0", "XYZ"])
        order = self.axis_order(axis[3:4])
        dof = tuple(w.lower() for w in facts.get("dof", []))
        strange = [d for d in dof if d not in _BONE_DOF]
        if strange or len(set(dof)) < len(dof):
            raise self.fail(f"bone '{name}': dof '{' '.join(dof)}'; legal are rx, ry, rz, each once")
        vector = self.numbers(facts["direction"], 3) * self.numbers(facts["length"], 1)[0]
        turn = extrinsic(order, self.radians(self.numbers(axis[:3], 3)))
        self.bones[name] = Bone(name, vector, turn, order, dof)
        if len(self.bones) > MAX_BONES:
            raise self.fail(f"more than {MAX_BONES} bones")

    def tree(self) -> Asf:
        order, parent = [self.root], [-1]
        index = {ROOT: 0}
        for above, below, number in self.children:
            self.number = number
            if above not in index:
                known = above in self.bones
                raise self.fail(
                    f"'{above}' is a parent before it is a child" if known else self.unknown(above)
                )
            for name in below:
                if name not in self.bones:
                    raise self.fail(self.unknown(name))
                if name in index:
                    raise self.fail(f"bone '{name}' has two parents")
                index[name] = len(order)
                order.append(self.bones[name])
                parent.append(index[above])
        if len(order) == 1:
            self.number = 0
            raise self.fail("the :hierarchy holds no bone")
        metres = INCH_M / self.scale
        return Asf(tuple(order), tuple(parent), metres, self.degrees, self.root_position)

    def unknown(self, name: str) -> str:
        hint = did_you_mean(name, self.bones)
        return f"the :hierarchy names the bone '{name}', :bonedata does not" + (f"; {hint}" if hint else "")

    def axis_order(self, words: list[str]) -> str:
        word = (words or ["XYZ"])[0].lower()
        if sorted(word) != ["x", "y", "z"]:
            raise self.fail(f"the order of axes is '{word}', not one such as XYZ")
        return word

    def radians(self, angles: Array) -> Array:
        return np.deg2rad(angles) if self.degrees else angles

    def numbers(self, words: list[str], count: int) -> Array:
        try:
            values = np.array([float(w) for w in words[:count]])
        except ValueError:
            raise self.fail(f"'{' '.join(words[:count])}' are no numbers") from None
        if len(values) < count or not np.isfinite(values).all():
            raise self.fail(f"'{' '.join(words[:count])}': {count} finite numbers are expected")
        return values
