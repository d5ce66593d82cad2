"""Pairs of a robot without a list of its own: which links can meet at all, found by sampling.

A pair is looked at only if it is near in some configuration and apart in some other. Random configurations within the
limits settle most pairs. For a pair that was near in none of them, its distance is followed downhill from the nearest
few of them, by random steps of some of the joints between its two links; only a pair that stays far even so is taken
to never touch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from imitor.collision.store import digest, kept
from imitor.metrics.collision import CollisionModel, full_configurations
from imitor.types import Array, BoolArray

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel

SAMPLES: Final = 1000
"""Random configurations: of 20 000 pairs that are near in 1 % of all configurations one is near in none of these."""
SAFE_M: Final = 0.004
"""A pair never touches if it was never nearer than the margin and this [m]: what two simple shapes may stand out."""
_STARTS: Final = 3
"""Samples from which the distance of a pair that was near in none is followed downhill."""
_STEPS: Final = 150
"""Steps downhill from each, at first of `_WIDEST`, at last of `_FINEST` of a joint's range."""
_WIDEST: Final = 0.3
_FINEST: Final = 0.01
_SHARE: Final = 0.4
"""Share of the joints that move in a step [-]."""
_SEED: Final = 0


def meeting_pairs(
    robot: RobotModel, found: CollisionModel, geometry_digest: str, margin_m: float
) -> BoolArray:
    """Tell which pairs of a collision model can meet, and are not always touching, (P,); kept on disk.

    Args:
        robot: The robot: its moved joints, their limits and couplings, and where locked joints stay.
        found: All pairs that are not ruled out otherwise, with full hulls.
        geometry_digest: Digest of the hulls and where they are.
        margin_m: Distance that is asked for [m].
    """
    facts: list[Any] = [geometry_digest, SAMPLES, _STARTS, _STEPS, SAFE_M, _SEED, margin_m]
    facts += [robot.lower, robot.upper, *robot.joint_names, *robot.locked, *robot.locked.values()]
    facts += [robot.coupling if robot.coupling is not None else 0.0, robot.standing]
    facts += [(p.first, p.second) for p in found.geometry.collisionPairs]
    facts += [placement.homogeneous for placement in found.model.jointPlacements]
    arrays = kept(
        f"{robot.name}-pairs-{digest(facts)}",
        lambda: {"meet": _sampled(robot, found, margin_m + SAFE_M)},
        about=f"robot '{robot.name}': finding by sampling which links can touch",
    )
    return np.asarray(arrays["meet"], dtype=bool)


def _sampled(robot: RobotModel, found: CollisionModel, near_m: float) -> BoolArray:
    import pinocchio as pin

    geometry, model = found.geometry, found.model
    data, results = model.createData(), geometry.createData()
    rng = np.random.default_rng(_SEED)
    places = np.array([model.joints[model.getJointId(name)].idx_q for name in robot.joint_names])

    def distance(pair: int) -> float:
        return float(pin.computeDistance(geometry, results, pair).min_distance)

    joints = _coupled(robot, rng.uniform(robot.lower, robot.upper, (SAMPLES, robot.n)))
    base = np.tile(robot.standing[:7], (SAMPLES, 1))
    configurations = full_configurations(model, robot.locked, robot.joint_names, np.hstack([base, joints]))
    n_pairs = len(geometry.collisionPairs)
    sampled = np.full((n_pairs, SAMPLES), np.inf)
    near, apart = np.zeros(n_pairs, dtype=bool), np.zeros(n_pairs, dtype=bool)
    for i, q in enumerate(configurations):
        pin.updateGeometryPlacements(model, data, geometry, results, q)
        for pair in np.flatnonzero(~(near & apart)).tolist():
            d = sampled[pair, i] = distance(pair)
            near[pair] |= d < near_m
            apart[pair] |= d > 0.0

    for pair in np.flatnonzero(~near).tolist():
        between = np.flatnonzero(_between(robot, found, pair))
        starts = np.argsort(sampled[pair], kind="stable")[:_STARTS] if between.size else ()
        for start in starts:
            least, best, q = sampled[pair, start], joints[start], configurations[start].copy()
            for width in np.geomspace(_WIDEST, _FINEST, _STEPS):
                moved = between[rng.random(len(between)) < max(_SHARE, 1.5 / len(between))]
                step = rng.normal(0.0, width, len(moved)) * (robot.upper - robot.lower)[moved]
                tried = best.copy()
                tried[moved] = np.clip(tried[moved] + step, robot.lower[moved], robot.upper[moved])
                q[places] = tried = _coupled(robot, tried[None])[0]
                pin.updateGeometryPlacements(model, data, geometry, results, q)
                d = distance(pair)
                if d < least:
                    least, best = d, tried
                    if d < near_m:
                        break
            near[pair] |= least < near_m
            if near[pair]:
                break
    both: BoolArray = near & apart
    return both


def _coupled(robot: RobotModel, joints: Array) -> Array:
    """Let coupled joints follow, (N, n)."""
    S = robot.coupling
    return joints if S is None else np.asarray(joints[:, S.argmax(axis=0)] @ S.T)


def _between(robot: RobotModel, found: CollisionModel, pair: int) -> BoolArray:
    """Tell which moved joints lie between the links of a pair, (n,)."""
    model, chains = found.model, []
    items, both = found.geometry.geometryObjects, found.geometry.collisionPairs[pair]
    for at in (items[both.first].parentJoint, items[both.second].parentJoint):
        names, joint = set(), at
        while joint > 1:
            names.add(model.names[joint])
            joint = model.parents[joint]
        chains.append(names)
    moving = np.array([name in chains[0] ^ chains[1] for name in robot.joint_names])
    S = robot.coupling
    return moving if S is None else np.asarray((S @ (S.T @ moving.astype(float))) != 0.0)
