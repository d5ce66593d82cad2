"""Where a robot's model file is: beside the card, in an installed distribution, or in robot_descriptions."""

from __future__ import annotations

import functools
import importlib
import importlib.metadata
from dataclasses import dataclass
from pathlib import Path

from imitor.errors import RobotError
from imitor.robot.card import RobotCard


@dataclass(frozen=True)
class ModelFiles:
    """Paths of a model: the file, its SRDF if any, and the folders that resolve ``package://`` names."""

    model: Path
    srdf: Path | None
    package_dirs: tuple[Path, ...]

    @property
    def is_mjcf(self) -> bool:
        """Whether the model is MuJoCo XML rather than URDF."""
        return (
            b"<mujoco" in self.model.read_bytes()[:4096] and b"<robot" not in self.model.read_bytes()[:4096]
        )


@functools.cache
def share_of(package: str) -> Path:
    """Return ``.../share`` of an installed distribution that carries robot models.

    Raises:
        RobotError: It is not installed, or carries no ``package.xml``.
    """
    try:
        files = importlib.metadata.distribution(package).files or []
    except importlib.metadata.PackageNotFoundError:
        raise RobotError(
            f"the package '{package}' with the robot's model is not installed: pip install {package}"
        ) from None
    ending = f"share/{package}/package.xml"
    for entry in files:
        if str(entry).endswith(ending):
            return Path(str(entry.locate())).resolve().parents[1]
    raise RobotError(f"the package '{package}' carries no {ending}; is it a package of robot models?")


def locate(card: RobotCard) -> ModelFiles:
    """Find the files of a card's model.

    Raises:
        RobotError: A file is missing; says where it was looked for.
    """
    spec = card.model
    if spec.description is not None:
        try:
            module = importlib.import_module(f"robot_descriptions.{spec.description}")
        except ImportError as error:
            raise RobotError(
                f"robot '{card.name}': its model comes from the package robot_descriptions ({error}); "
                "pip install robot_descriptions"
            ) from None
        path = Path(getattr(module, "URDF_PATH", "") or module.MJCF_PATH)
        return ModelFiles(path, None, (Path(module.PACKAGE_PATH).parent, Path(module.PACKAGE_PATH)))
    if spec.package is not None:
        share = share_of(spec.package)
        root = share / spec.package
        dirs: tuple[Path, ...] = (share, root)
    else:
        root = card.path.parent if card.path is not None else Path.cwd()
        dirs = (root, root.parent)
    model = _existing(root, spec.file, card)
    srdf = _existing(root, spec.srdf, card) if spec.srdf else None
    return ModelFiles(model, srdf, dirs)


def _existing(root: Path, name: str, card: RobotCard) -> Path:
    path = (root / Path(name).expanduser()).resolve()
    if not path.is_file():
        raise RobotError(
            f"robot '{card.name}': there is no model file {path}; correct `model` in {card.path}"
        )
    return path
