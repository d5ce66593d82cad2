"""Collision geometry with a convex hull for every mesh, kept on disk because reading meshes is slow."""

from __future__ import annotations

import hashlib
import json
import logging
import platform
import re
import warnings
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from imitor.atomic import atomic
from imitor.cache import cache_folder
from imitor.robot.card import RobotCard
from imitor.robot.files import ModelFiles

_LOG: Final = logging.getLogger("imitor")
_MESH: Final = re.compile(rb"<mesh\b")


def hulled_geometry(card: RobotCard, files: ModelFiles, model: Any) -> Any:
    """Return the collision geometry of a model (Pinocchio ``GeometryModel``), a convex hull for every mesh.

    Args:
        card: The robot's card, for messages.
        files: The model's files.
        model: The Pinocchio model made of the same file, every joint in it.

    Raises:
        ValueError: A mesh cannot be read or has no volume; the message says which.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        import pinocchio as pin

    text = files.model.read_bytes()
    if not _MESH.search(text):  # boxes, spheres and capsules need no preparation
        return _read(files, model)
    stem = cache_folder() / "hulls" / f"{card.name}-{_key(text)}"
    geometry = _load(stem, pin)
    if geometry is not None:
        return geometry
    _LOG.info("robot '%s': preparing collision hulls (once)", card.name)
    geometry = _read(files, model)
    for item in geometry.geometryObjects:
        _to_hull(item)
    _save(stem, geometry)
    return geometry


def _read(files: ModelFiles, model: Any) -> Any:
    import pinocchio as pin

    kind = pin.GeometryType.COLLISION
    try:
        if files.is_mjcf:
            return pin.buildGeomFromMJCF(model, str(files.model), kind)
        return pin.buildGeomFromUrdf(
            model, str(files.model), kind, None, [str(d) for d in files.package_dirs]
        )
    except (ValueError, RuntimeError) as error:
        raise ValueError(f"its collision meshes cannot be read: {error}") from None


def _to_hull(item: Any) -> None:
    if not hasattr(item.geometry, "buildConvexHull"):
        return
    try:
        item.geometry.buildConvexHull(True, "Qt")
        hull = item.geometry.convex
    except RuntimeError as error:
        raise ValueError(
            f"the collision mesh of '{item.name}' has no convex hull: {str(error).splitlines()[0]}"
        ) from None
    if hull is None:
        raise ValueError(f"the collision mesh of '{item.name}' has no convex hull: it has no volume")
    item.geometry = hull


def _key(text: bytes) -> str:
    """Return a name for hulls of this model text by this version of the engines on this kind of machine."""
    engines = f"{version('pin')} {version('coal')} {platform.machine()}".encode()
    return hashlib.sha256(text + engines).hexdigest()[:16]


def _load(stem: Path, pin: Any) -> Any | None:
    """Return the hulls kept under a name; ``None`` where there are none or a mesh changed since."""
    try:
        facts = json.loads(stem.with_suffix(".json").read_text(encoding="utf-8"))
        kept = stem.with_suffix(".bin")
        # The engine crashes on a damaged file, so what is written beside it must match first.
        if _digest(kept) != facts["hulls"] or any(_digest(Path(p)) != d for p, d in facts["meshes"].items()):
            return None
        geometry = pin.GeometryModel()
        geometry.loadFromBinary(str(kept))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RuntimeError):
        return None
    return geometry


def _save(stem: Path, geometry: Any) -> None:
    try:
        stem.parent.mkdir(parents=True, exist_ok=True)
        meshes = {item.meshPath for item in geometry.geometryObjects if Path(item.meshPath).is_file()}
        with atomic(stem.with_suffix(".bin")) as temporary:
            geometry.saveToBinary(str(temporary))
        facts = {
            "hulls": _digest(stem.with_suffix(".bin")),
            "meshes": {path: _digest(Path(path)) for path in sorted(meshes)},
        }
        with atomic(stem.with_suffix(".json")) as temporary:
            temporary.write_text(json.dumps(facts, indent=1), encoding="utf-8")
    except (OSError, RuntimeError) as error:
        _LOG.warning("collision hulls are not kept in %s: %s", stem.parent, error)


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
