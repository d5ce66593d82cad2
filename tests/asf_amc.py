"""A small reader of Acclaim ASF/AMC files, written apart from the package: the oracle of the BVH tests."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass
class Bone:
    direction: Array = field(default_factory=lambda: np.zeros(3))
    length: float = 0.0
    axis: Array = field(default_factory=lambda: np.eye(3))
    dof: list[str] = field(default_factory=list)
    parent: str = ""


def extrinsic_xyz(x: float, y: float, z: float) -> Array:
    """Rotation about the fixed axes x, then y, then z [degrees]."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(np.radians([x, y, z])), np.sin(np.radians([x, y, z]))
    rx = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    ry = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    rz = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(rz @ ry @ rx)


def read_asf(path: Path) -> dict[str, Bone]:
    """Read the bones; parents before children in the order of the hierarchy."""
    bones: dict[str, Bone] = {"root": Bone()}
    bone, name, section = Bone(), "", ""
    ordered: list[str] = []
    for line in path.read_text(encoding="latin-1").splitlines():
        words = line.split()
        if not words:
            continue
        if words[0].startswith(":"):
            section = words[0]
        elif section == ":bonedata":
            if words[0] == "begin":
                bone = Bone()
            elif words[0] == "name":
                name = words[1]
            elif words[0] == "direction":
                bone.direction = np.array(words[1:4], dtype=float)
            elif words[0] == "length":
                bone.length = float(words[1])
            elif words[0] == "axis":
                bone.axis = extrinsic_xyz(*map(float, words[1:4]))
            elif words[0] == "dof":
                bone.dof = words[1:]
            elif words[0] == "end":
                bones[name] = bone
        elif section == ":hierarchy" and words[0] not in ("begin", "end"):
            for child in words[1:]:
                bones[child].parent = words[0]
                ordered.append(child)
    return {"root": bones["root"], **{child: bones[child] for child in ordered}}


def read_amc(path: Path) -> list[dict[str, list[float]]]:
    """Read the frames: bone to values."""
    frames: list[dict[str, list[float]]] = []
    for line in path.read_text(encoding="latin-1").splitlines():
        words = line.split()
        if len(words) == 1 and words[0].isdigit():
            frames.append({})
        elif frames and words and not words[0].startswith(("#", ":")):
            frames[-1][words[0]] = [float(w) for w in words[1:]]
    return frames


def bone_ends(bones: dict[str, Bone], frame: dict[str, list[float]]) -> dict[str, Array]:
    """Return the far ends of the bones [file units]; ``root`` is the root's position."""
    values = frame["root"]
    place = {"root": np.array(values[:3])}
    turn = {"root": extrinsic_xyz(*values[3:])}
    for name, bone in bones.items():
        if name == "root":
            continue
        angle = dict.fromkeys("xyz", 0.0) | {
            dof[1]: value for dof, value in zip(bone.dof, frame.get(name, []), strict=True)
        }
        local = bone.axis @ extrinsic_xyz(angle["x"], angle["y"], angle["z"]) @ bone.axis.T
        turn[name] = turn[bone.parent] @ local
        place[name] = place[bone.parent] + turn[name] @ (bone.direction * bone.length)
    return place
