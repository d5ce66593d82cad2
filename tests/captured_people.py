"""The performer as optical and 6-dof captures see it: marker files, target tables, Acclaim files of a known person."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from imitor.human.markers import MARKERS_41, TARGETS
from imitor.human.performance import Truth
from imitor.motion.art_file import BODY_17
from imitor.motion.c3d_file import write_c3d
from imitor.motion.marker_file import MarkerFile
from imitor.motion.trc_file import write_trc
from imitor.plugins.sources.performer import Performer, PerformerConfig
from imitor.types import Array
from known import known


@dataclass(frozen=True)
class Person:
    """A performance: its exact motion, and its 41 markers as a file would hold them [m]."""

    truth: Truth
    file: MarkerFile


def perform(scenario: str = "two_steps_and_reach", *, rate_hz: float = 60.0, **options: Any) -> Person:
    """Let the performer wear the 41 markers."""
    performer = Performer(PerformerConfig(scenario=scenario, markers="41", rate_hz=rate_hz, **options))
    performer.start()
    marker = np.array([known(f.marker) for f in performer.frames()])
    seen = np.array([known(f.marker_valid) for f in performer.frames()])
    marker[~seen] = np.nan
    return Person(performer.truth, MarkerFile(MARKERS_41, marker, rate_hz, unit="m", up="z"))


def in_unit(file: MarkerFile, unit: str, metres: float) -> MarkerFile:
    """Return the file in another unit."""
    return replace(file, position=file.position / metres, unit=unit)


def with_labels(file: MarkerFile, labels: dict[str, str]) -> MarkerFile:
    """Return the file with other labels."""
    return replace(file, labels=tuple(labels.get(label, label) for label in file.labels))


def small_c3d(folder: Path) -> dict[str, Any]:
    """Write a person who waves; return the options that read the file."""
    write_c3d(folder / "person.c3d", in_unit(perform("wave", rate_hz=30.0).file, "mm", 0.001))
    return {"path": str(folder / "person.c3d")}


def small_trc(folder: Path) -> dict[str, Any]:
    """Write a person who waves; return the options that read the file."""
    write_trc(folder / "person.trc", in_unit(perform("wave", rate_hz=30.0).file, "mm", 0.001))
    return {"path": str(folder / "person.trc")}


def target_table(truth: Truth) -> str:
    """Return the text of a table of the performer's 17 targets [mm]."""
    pose = np.asarray(truth.target)[:, [TARGETS.index(n) for n in BODY_17]]
    values = np.concatenate([1000.0 * pose[..., :3, 3], quaternions(pose[..., :3, :3])], axis=-1)
    return "".join(" ".join(f"{v:.6f}" for v in row) + " \r\n" for row in values.reshape(len(values), -1))


def quaternions(R: Array) -> Array:
    """Return x y z w of rotations, shape (..., 4): the row of q qᵀ that is largest."""
    t = np.trace(R, axis1=-2, axis2=-1)
    outer = np.empty((*R.shape[:-2], 4, 4))
    for i in range(3):
        for j in range(3):
            outer[..., i, j] = R[..., i, j] + R[..., j, i] if i != j else 1.0 + 2.0 * R[..., i, i] - t
        j, k = (i + 1) % 3, (i + 2) % 3
        outer[..., i, 3] = outer[..., 3, i] = R[..., k, j] - R[..., j, k]
    outer[..., 3, 3] = 1.0 + t
    row = np.argmax(np.einsum("...ii->...i", outer), axis=-1)
    q = np.take_along_axis(outer, row[..., None, None], axis=-2)[..., 0, :]
    return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True))


def perform_with_targets(scenario: str, **options: Any) -> Truth:
    """Let the performer wear the 17 targets."""
    performer = Performer(PerformerConfig(scenario=scenario, targets=True, rate_hz=60.0, **options))
    performer.start()
    return performer.truth


def small_targets(folder: Path) -> dict[str, Any]:
    """Write the targets of a person who squats; return the options that read the file."""
    (folder / "person.txt").write_text(target_table(perform_with_targets("squat")))
    return {"path": str(folder / "person.txt")}


ASF = """\
# a small person
:version 1.10
:name small
:units
  mass 1.0
  length 1.0
  angle deg
:documentation
   written by a test
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 0 0 0
   orientation 0 0 0
:bonedata
{bones}
:hierarchy
  begin
    root lhipjoint rhipjoint lowerback
    lhipjoint lfemur
    lfemur ltibia
    ltibia lfoot
    lfoot ltoes
    rhipjoint rfemur
    rfemur rtibia
    rtibia rfoot
    rfoot rtoes
    lowerback upperback
    upperback thorax
    thorax lowerneck lclavicle rclavicle
    lowerneck upperneck
    upperneck head
    lclavicle lhumerus
    lhumerus lradius
    lradius lwrist
    lwrist lhand
    lhand lfingers
    rclavicle rhumerus
    rhumerus rradius
    rradius rwrist
    rwrist rhand
    rhand rfingers
  end
"""
_INCH = 39.37007874
_LEFT = {
    "hipjoint": ((1, 0, 0), 0.09, ""), "femur": ((0, -1, 0), 0.42, "rx ry rz"), "tibia": ((0, -1, 0), 0.41, "rx"),
    "foot": ((0, -0.4, 1), 0.14, "rx rz"), "toes": ((0, 0, 1), 0.06, "rx"),
    "clavicle": ((1, 0.1, 0), 0.18, "ry rz"), "humerus": ((1, 0, 0), 0.28, "rx ry rz"),
    "radius": ((1, 0, 0), 0.25, "rx"), "wrist": ((1, 0, 0), 0.04, "ry"), "hand": ((1, 0, 0), 0.06, "rx rz"),
    "fingers": ((1, 0, 0), 0.05, "rx"),
}  # fmt: skip
_MIDDLE = {
    "lowerback": ((0, 1, 0), 0.12, "rx ry rz"), "upperback": ((0, 1, 0), 0.12, "rx ry rz"),
    "thorax": ((0, 1, 0), 0.12, "rx ry rz"), "lowerneck": ((0, 1, 0), 0.08, "rx ry rz"),
    "upperneck": ((0, 1, 0), 0.08, "rx ry rz"), "head": ((0, 1, 0), 0.14, "rx ry rz"),
}  # fmt: skip


def acclaim_bones() -> dict[str, tuple[tuple[float, float, float], float, str]]:
    """Return direction, length [m] and dof of the bones of a small person."""
    bones: dict[str, tuple[tuple[float, float, float], float, str]] = dict(_MIDDLE)
    for name, ((x, y, z), length, dof) in _LEFT.items():
        bones[f"l{name}"], bones[f"r{name}"] = ((x, y, z), length, dof), ((-x, y, z), length, dof)
    return bones


def small_acclaim(folder: Path) -> dict[str, Any]:
    """Write a person who raises the left arm; return the options that read the files."""
    blocks = []
    for i, (name, (direction, length, dof)) in enumerate(acclaim_bones().items(), 1):
        vector = np.array(direction) / np.linalg.norm(direction)
        lines = [
            "  begin", f"     id {i}", f"     name {name}", f"     direction {' '.join(f'{v:.9f}' for v in vector)}",
            f"     length {length * _INCH:.9f}", "     axis 0 0 20 XYZ",
        ]  # fmt: skip
        if dof:
            lines += [f"    dof {dof}", "    limits " + " ".join("(-180.0 180.0)" for _ in dof.split())]
        blocks.append("\n".join([*lines, "  end"]))
    (folder / "p.asf").write_text(ASF.format(bones="\n".join(blocks)))
    rows = ["#!OML:ASF small", ":FULLY-SPECIFIED", ":DEGREES"]
    for frame in range(1, 41):
        rows += [str(frame), f"root 0 {0.93 * _INCH:.6f} {0.002 * frame * _INCH:.6f} 0 0 0"]
        for name, (_, _, dof) in acclaim_bones().items():
            if dof:
                angle = 2.0 * frame if name == "lhumerus" else 0.0
                rows.append(f"{name} " + " ".join(f"{angle if d == 'rz' else 0.0:.6f}" for d in dof.split()))
    (folder / "p_01.amc").write_text("\n".join(rows) + "\n")
    return {"path": str(folder / "p_01.amc")}
