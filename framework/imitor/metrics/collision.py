"""Self-collision: which pairs of links to look at, and in which frames one penetrates the other."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from imitor.errors import UnknownLink
from imitor.metrics.figure import Outcome, Sample, Unmeasured, figure
from imitor.metrics.hulls import hulled_geometry
from imitor.metrics.kinematics import fresh_model
from imitor.metrics.run import Run
from imitor.robot.card import RobotCard, expand
from imitor.robot.files import ModelFiles
from imitor.types import Array

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

DEPTH_M: Final = 0.001
"""Two links that overlap by no more than this do not count [m]: hulls are a little larger than the links."""
RATE_HZ: Final = 50.0


@dataclass
class CollisionModel:
    """Hulls and pairs of a robot, ready to be asked.

    Attributes:
        model: The Pinocchio model, every joint in it.
        geometry: Hulls and pairs.
        rule: How the pairs were chosen, for people.
    """

    model: Any
    geometry: Any
    rule: str

    def __post_init__(self) -> None:
        self._data, self._results = self.model.createData(), self.geometry.createData()
        for request in self._results.collisionRequests:
            request.security_margin = -DEPTH_M

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """The pairs of links looked at (a link with several shapes appears several times)."""
        return [self._links(p) for p in self.geometry.collisionPairs]

    def _links(self, pair: Any) -> tuple[str, str]:
        a, b = (self.geometry.geometryObjects[i] for i in (pair.first, pair.second))
        return self.model.frames[a.parentFrame].name, self.model.frames[b.parentFrame].name

    def collisions(self, q: Array) -> list[tuple[float, tuple[str, str]]]:
        """Return depth [m] and links of every pair that overlaps by more than `DEPTH_M`."""
        import pinocchio as pin

        if not pin.computeCollisions(self.model, self._data, self.geometry, self._results, q, False):
            return []
        found = []
        for pair, result in zip(self.geometry.collisionPairs, self._results.collisionResults, strict=True):
            if result.isCollision():
                found.append((-float(result.getContact(0).penetration_depth), self._links(pair)))
        return found


def collision_model(card: RobotCard, files: ModelFiles, model: Any, standing: Array) -> CollisionModel:
    """Return the hulls of a robot and the pairs of links that are worth a look.

    All pairs but those on one link or on links joined by a joint, those that the SRDF disables or, where
    there is none, those that overlap in the standing posture, and those that the card skips.

    Args:
        card: The robot's card.
        files: The model's files.
        model: The Pinocchio model of the same file, every joint in it.
        standing: The standing configuration of that model.

    Raises:
        ValueError: There is no usable collision geometry; the message says why.
        UnknownLink: The card skips a pair with a link that is not in the model.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        import pinocchio as pin

    geometry = hulled_geometry(card, files, model)
    if geometry.ngeoms < 2:
        raise ValueError("its model has no collision geometry")
    geometry.removeAllCollisionPairs()
    geometry.addAllCollisionPairs()
    for pair in _pairs(geometry):
        a, b = (geometry.geometryObjects[i].parentJoint for i in (pair.first, pair.second))
        if model.parents[a] == b or model.parents[b] == a:
            geometry.removeCollisionPair(pair)
    _skip(card, model, geometry)
    if files.srdf is not None:
        pin.removeCollisionPairs(model, geometry, str(files.srdf), False)
        return CollisionModel(model, geometry, "without the pairs that the SRDF disables")
    everything = CollisionModel(model, geometry, "")
    overlapping = {links for _, links in everything.collisions(standing)}
    for pair, links in zip(_pairs(geometry), everything.pairs, strict=True):
        if links in overlapping:
            geometry.removeCollisionPair(pair)
    return CollisionModel(model, geometry, "without the pairs that overlap in the standing posture")


def robot_collision_model(robot: RobotModel, model: Any | None = None) -> CollisionModel:
    """Return the collision model of a robot; see `collision_model`.

    Args:
        robot: The robot.
        model: A model from `fresh_model` of the same robot, if there is one already.
    """
    model = model if model is not None else fresh_model(robot.card, robot.files)
    locked = {name: float(value) for name, value in expand(robot.card.locked).items()}
    standing = full_configurations(model, locked, robot.joint_names, robot.standing[None])[0]
    return collision_model(robot.card, robot.files, model, standing)


def _pairs(geometry: Any) -> list[Any]:
    """Return copies of the pairs: the geometry's own change under a loop that removes some of them."""
    import pinocchio as pin

    return [pin.CollisionPair(p.first, p.second) for p in geometry.collisionPairs]


def _skip(card: RobotCard, model: Any, geometry: Any) -> None:
    links = {model.frames[item.parentFrame].name for item in geometry.geometryObjects}
    skipped = set()
    for pair in card.collision.skip:
        for side in range(2):
            a, b = (list(expand({name: 0.0}))[side if "{" in name else 0] for name in pair)
            for name in (a, b):
                if not model.existFrame(name):
                    raise UnknownLink(card.name, name, sorted(links), "collision.skip")
            skipped.add(frozenset((a, b)))
    for pair in _pairs(geometry):
        names = {
            model.frames[geometry.geometryObjects[i].parentFrame].name for i in (pair.first, pair.second)
        }
        if frozenset(names) in skipped:
            geometry.removeCollisionPair(pair)


def full_configurations(model: Any, locked: dict[str, float], joint_names: Sequence[str], q: Array) -> Array:
    """Return configurations of the model with every joint in it, shape (T, nq).

    Args:
        model: The Pinocchio model.
        locked: Joints that are not moved, and where they stay [rad].
        joint_names: The moved joints.
        q: Base position, quaternion x y z w and moved joints, shape (T, 7 + n).
    """
    import pinocchio as pin

    out: Array = np.tile(np.array(pin.neutral(model)), (len(q), 1))
    out[:, :7] = q[:, :7]
    columns = {
        **{n: np.full(len(q), v) for n, v in locked.items()},
        **dict(zip(joint_names, q[:, 7:].T, strict=True)),
    }
    for name, values in columns.items():
        joint = model.joints[model.getJointId(name)]
        if joint.nq == 2:  # a joint without limits keeps cosine and sine
            out[:, joint.idx_q], out[:, joint.idx_q + 1] = np.cos(values), np.sin(values)
        elif joint.nq == 1:
            out[:, joint.idx_q] = values
    return out


@figure(
    "self_collision_frames",
    unit="frames",
    formula=f"frames in which two links overlap by more than {1000 * DEPTH_M:.0f} mm: convex hulls of the "
    "collision geometry, without neighbours and the pairs that the SRDF disables or, where there is none, "
    f"that overlap in the standing posture; at most {RATE_HZ:.0f} frames a second are looked at",
    better="lower",
    about="Whether the robot would hit itself, how deep, and which pair most often.",
)
def self_collision(run: Run) -> Outcome:
    """Count the frames in which the robot penetrates itself."""
    if run.collision_every == 0:
        return Unmeasured("left out on request")
    every = run.collision_every or (
        max(1, int(np.ceil(round(1.0 / run.period_s / RATE_HZ, 6)))) if len(run) > 1 else 1
    )
    try:
        pairs = robot_collision_model(run.robot, run.model)
    except ValueError as error:
        return Unmeasured(f"robot '{run.robot.name}': {error}")
    hits: dict[tuple[str, str], int] = {}
    depth, count = 0.0, 0
    configurations = full_configurations(
        run.model, run.kinematics.locked, run.motion.joint_names, run.motion.configurations()[::every]
    )
    for q in configurations:
        found = pairs.collisions(q)
        count += bool(found)
        for pair in {links for _, links in found}:
            hits[pair] = hits.get(pair, 0) + 1
        depth = max([depth, *(d for d, _ in found)])
    values: dict[str, Any] = {
        "count": count,
        "share": count / len(configurations),
        "depth_m": depth,
        "every": every,
    }
    if hits:
        worst = max(sorted(hits), key=lambda pair: hits[pair])
        values["pair"] = " and ".join(worst)
    return Sample(values, len(configurations))
