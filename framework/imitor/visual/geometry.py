"""The visible surface of a robot, fixed to its joints: from URDF or MJCF, thinned out, kept in a cache."""

from __future__ import annotations

import hashlib
import logging
import time
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from imitor.atomic import atomic
from imitor.cache import cache_folder
from imitor.environment import OBJECT_COLOUR, read_environment, triangles
from imitor.robot.model import RobotModel
from imitor.types import SIDES, Array
from imitor.visual import shapes
from imitor.visual.mjcf_visuals import read_geoms
from imitor.visual.shapes import Surface
from imitor.visual.urdf_visuals import Visual, read_visuals

log = logging.getLogger("imitor")

_CACHE_FORMAT: Final = "2"
_WORLD, _BASE = 0, 1
"""The world and the floating base among Pinocchio's joints."""


@dataclass(frozen=True)
class Part:
    """A surface of one colour that moves with one joint.

    Attributes:
        joint: Index of the joint in ``robot.model``.
        surface: In the joint's frame; its colour is set.
    """

    joint: int
    surface: Surface


def robot_parts(robot: RobotModel) -> list[Part]:
    """Return the visible surface of a robot; capsules from joint to joint where the model has none.

    Meshes are read and thinned out once a robot and kept in `cache_folder`.
    """
    if robot.files.is_mjcf:
        placed = _placements(robot)
        found = [(placed[b], s) for b, s in read_geoms(robot.files) if b in placed]
        return _parts([(joint, s.moved(T)) for (joint, T), s in found]) or _figure(robot)
    visuals = read_visuals(robot.files)
    path = cache_folder() / "visuals" / f"{robot.name}-{_key(robot, visuals)}.npz"
    parts = _load(path)
    if parts is None:
        begin = time.perf_counter()
        parts = _from_visuals(robot, visuals)
        if _store(path, parts):
            log.info(
                "%s: %d visual shapes converted in %.1f s, kept in %s",
                robot.name, len(visuals), time.perf_counter() - begin, path.parent,
            )  # fmt: skip
    return parts


def object_parts(environment: Sequence[Mapping[str, Any]]) -> list[Part]:
    """Return the objects around a robot as parts of the world, in order.

    Raises:
        ValueError: A mesh cannot be read; the message says which.
    """
    found = (triangles(item) for item in read_environment(environment))
    return [Part(_WORLD, Surface(v.astype(np.float32), f.astype(np.int32), OBJECT_COLOUR)) for v, f in found]


def _placements(robot: RobotModel) -> dict[str, tuple[int, Array]]:
    """Return link -> (joint, joint from link); links behind locked joints included."""
    frames = [f for f in robot.model.frames if f.type.name == "BODY" and f.parentJoint > 0]
    return {f.name: (int(f.parentJoint), np.array(f.placement.homogeneous)) for f in frames}


def _from_visuals(robot: RobotModel, visuals: Iterable[Visual]) -> list[Part]:
    placed = _placements(robot)
    found: list[tuple[int, Surface]] = []
    bare: dict[int, str] = {}
    for visual in visuals:
        if visual.link not in placed:
            continue
        joint, T = placed[visual.link]
        try:
            found += [(joint, s.moved(T)) for s in visual.surfaces()]
        except (OSError, ValueError) as error:
            bare.setdefault(joint, f"{visual.mesh_name}: {error}")
    if bare:
        log.warning(
            "robot '%s': meshes of %d links cannot be drawn, capsules stand for them; the first: %s",
            robot.name, len(bare), next(iter(bare.values())),
        )  # fmt: skip
    drawn = {joint for joint, _ in found}
    if not drawn:
        return _figure(robot)
    return _parts(found) + [p for p in _figure(robot) if p.joint in bare and p.joint not in drawn]


def _parts(found: Iterable[tuple[int, Surface]]) -> list[Part]:
    """Join the surfaces of each joint by colour and thin them out."""
    by_joint: dict[int, list[Surface]] = {}
    for joint, surface in found:
        coloured = Surface(surface.vertices, surface.faces, surface.rgba or shapes.GREY)
        by_joint.setdefault(joint, []).append(shapes.thinned(coloured))
    return [Part(joint, s) for joint in sorted(by_joint) for s in shapes.merged(by_joint[joint])]


def _figure(robot: RobotModel) -> list[Part]:
    """Return capsules from each joint to the next and plates under the feet."""
    model = robot.model
    found: list[tuple[int, Surface]] = []
    for j in range(_BASE + 1, model.njoints):
        end = np.array(model.jointPlacements[j].translation)
        length = float(np.linalg.norm(end))
        radius = min(max(0.12 * length, 0.015), 0.04)
        if length > 0.005:
            found.append((int(model.parents[j]), shapes.capsule_between(np.zeros(3), end, radius)))
        found.append((j, shapes.sphere(1.2 * radius)))
    for side, corners in zip(SIDES, robot.sole, strict=True):
        frame = model.frames[robot.frame_id(f"{side}_foot")]
        low, high = corners.min(axis=0), corners.max(axis=0)
        T = np.array(frame.placement.homogeneous)
        T[:3, 3] += T[:3, :3] @ (0.5 * (low + high) + [0.0, 0.0, 0.01])
        found.append((int(frame.parentJoint), shapes.box([*(high - low)[:2], 0.02]).moved(T)))
    return _parts(found)


def _key(robot: RobotModel, visuals: Iterable[Visual]) -> str:
    """Return a fingerprint of everything the surface depends on."""
    digest = hashlib.sha256(f"{_CACHE_FORMAT} {shapes.CELL_M} {shapes.DENSE_FACES} {robot.n}".encode())
    placed: Mapping[str, tuple[int, Array]] = _placements(robot)
    for v in visuals:
        joint, T = placed.get(v.link, (0, np.eye(4)))
        stat = v.mesh.stat() if v.mesh is not None else None
        facts = (v.form, v.size, v.rgba, v.mesh, joint, stat and (stat.st_size, stat.st_mtime_ns))
        digest.update(repr(facts).encode() + v.origin.tobytes() + T.tobytes())
    digest.update(np.array([p.translation for p in robot.model.jointPlacements]).tobytes())
    return digest.hexdigest()[:16]


def _store(path: Path, parts: list[Part]) -> bool:
    """Keep the parts; a cache that cannot be written costs time, not the run."""
    arrays = {"joint": np.array([p.joint for p in parts]), "rgba": np.array([p.surface.rgba for p in parts])}
    for i, part in enumerate(parts):
        arrays[f"v{i}"], arrays[f"f{i}"] = part.surface.vertices, part.surface.faces
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic(path) as temporary:
            np.savez(temporary, allow_pickle=False, **arrays)
    except OSError as error:
        log.warning("the cache folder %s cannot be written: %s", path.parent, error.strerror)
        return False
    return True


def _load(path: Path) -> list[Part] | None:
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as data:
            return [
                Part(int(joint), Surface(data[f"v{i}"], data[f"f{i}"], tuple(map(float, rgba))))  # type: ignore[arg-type]
                for i, (joint, rgba) in enumerate(zip(data["joint"], data["rgba"], strict=True))
            ]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
