"""Collisions left in whole motions, counted by two engines, with and without fcl_collision.

    python benchmarks/collision_motions.py [RECORDING ...] [--robot R ...] [--scenario S ...] [--rate HZ] [--without]

Every robot imitates every scenario of the performer and every recording given, by the preset ``retarget`` with
fcl_collision as its last stage; NAO also by ``koenemann_2014``, which has it. Each command is looked at twice, with the
same pairs and the same convex hulls: by the collision figure of ``metrics.json``, and by MuJoCo's contacts. A frame
counts when links overlap by more than 1 mm. ``--without`` runs each motion also without the stage and tells how many
frames collide then, and by how much the joints differ where the stage changed nothing.

Columns: frames; frames deeper than 1 mm without the stage, with it by the figure, with it by MuJoCo; deepest overlap
[mm]; frames changed, and left nearer than the margin; largest change of a joint [rad]; frames in which the stage had
nothing to change and yet did (none is allowed); largest difference of a joint in frames that were not changed [rad],
which comes from the solver's own memory of frames that were.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from collision_time import with_stage

import imitor  # noqa: F401  (sets one BLAS thread before numpy is imported)
from imitor.human.scenarios import SCENARIOS
from imitor.metrics.collision import CollisionModel, full_configurations, robot_collision_model
from imitor.pipeline import Pipeline
from imitor.registry import Registry
from imitor.spec import PipelineSpec, load_pipeline
from imitor.types import Array

ROBOTS = ("nao_v4", "unitree_g1", "romeo", "talos")
DEPTH_M = 0.001


class SecondEngine:
    """MuJoCo's contacts between the hulls and pairs of a collision model."""

    def __init__(self, found: CollisionModel) -> None:
        import mujoco
        import pinocchio as pin

        self._mujoco, self._pin, self._found = mujoco, pin, found
        self._data, self._results = found.model.createData(), found.geometry.createData()
        spec = mujoco.MjSpec()
        spec.nconmax = 10_000
        for k, item in enumerate(found.geometry.geometryObjects):
            body = spec.worldbody.add_body(name=f"b{k}", mocap=True)
            geom = body.add_geom(name=f"g{k}", contype=0, conaffinity=0)
            self._shape(spec, geom, k, item.geometry)
        for pair in found.geometry.collisionPairs:
            spec.add_pair(geomname1=f"g{pair.first}", geomname2=f"g{pair.second}")
        self._model = spec.compile()
        self._state = mujoco.MjData(self._model)
        count = len(found.geometry.geometryObjects)
        self._rows = [self._model.body(f"b{k}").mocapid[0] for k in range(count)]

    def _shape(self, spec: Any, geom: Any, k: int, shape: Any) -> None:
        kinds, kind = self._mujoco.mjtGeom, type(shape).__name__
        if kind == "Box":
            geom.type, geom.size = kinds.mjGEOM_BOX, np.array(shape.halfSide)
        elif kind == "Sphere":
            geom.type, geom.size = kinds.mjGEOM_SPHERE, [shape.radius, 0.0, 0.0]
        elif kind in ("Cylinder", "Capsule"):
            geom.type = kinds.mjGEOM_CYLINDER if kind == "Cylinder" else kinds.mjGEOM_CAPSULE
            geom.size = [shape.radius, shape.halfLength, 0.0]
        else:
            points = np.array([shape.point(i) for i in range(shape.num_points)]).reshape(-1, 3)
            spec.add_mesh(name=f"m{k}", uservert=points.astype(np.float32).ravel())
            geom.type, geom.meshname = kinds.mjGEOM_MESH, f"m{k}"

    def depth(self, q: Array) -> float:
        """Return the deepest overlap at a configuration of the model [m]; 0 where there is none."""
        found, state = self._found, self._state
        self._pin.updateGeometryPlacements(found.model, self._data, found.geometry, self._results, q)
        for row, M in zip(self._rows, self._results.oMg, strict=True):
            state.mocap_pos[row] = M.translation
            state.mocap_quat[row] = self._pin.Quaternion(M.rotation).coeffs()[[3, 0, 1, 2]]
        self._mujoco.mj_kinematics(self._model, state)
        self._mujoco.mj_collision(self._model, state)
        return max(0.0, -float(state.contact.dist[: state.ncon].min(initial=0.0)))


def run(spec: PipelineSpec, registry: Registry, engines: dict[str, Any]) -> dict[str, Any]:
    """Run a pipeline and return joints, depths of both engines, and what its last fcl_collision did."""
    pipeline = Pipeline(spec, registry)
    robot = pipeline.robot
    if robot.name not in engines:
        first = robot_collision_model(robot)
        engines[robot.name] = first, SecondEngine(first)
    first, second = engines[robot.name]
    stages: list[Any] = [c for _, c in pipeline.stages if c.name == "fcl_collision"]
    untouched, false = [], 0
    if stages:
        step, correction = stages[-1].step, stages[-1].correction

        def watched(stack: Any, state: Any) -> None:
            nonlocal false
            before, count = state.q.copy(), correction.changed
            step(stack, state)
            untouched.append(correction.changed == count)
            slowed = state.sent is not None and (np.abs(before[7:] - state.sent[7:]) > limit).any()
            false += untouched[-1] and not slowed and not np.array_equal(before, state.q)

        limit = robot.speed / pipeline.rate_hz - 1e-9
        stages[-1].step = watched
        pipeline._bind()
    joints, by_first, by_second, pairs = [], [], [], set()
    for record in pipeline.records():
        q = full_configurations(first.model, robot.locked, robot.joint_names, record.state.q[None])[0]
        found = first.collisions(q)
        by_first.append(max([d for d, _ in found], default=0.0))
        pairs.update(links for _, links in found)
        by_second.append(second.depth(q))
        joints.append(record.state.q[7:].copy())
    pipeline.close()
    return {
        "joints": np.array(joints), "first": np.array(by_first), "second": np.array(by_second), "pairs": pairs,
        "untouched": np.array(untouched), "false": false, "correction": stages[-1].correction if stages else None,
    }  # fmt: skip


def line(title: str, spec: PipelineSpec, bare: PipelineSpec | None, registry: Registry, engines: Any) -> str:
    """Return one line of the table."""
    done = run(spec, registry, engines)
    collided, differs = "", ""
    if bare is not None:
        other = run(bare, registry, engines)
        collided = str(int((other["first"] > DEPTH_M).sum()))
        calm = done["untouched"]
        apart = np.abs(done["joints"][calm] - other["joints"][calm])
        differs = f"{apart.max(initial=0.0):.1e}"
    correction = done["correction"]
    deepest = 1e3 * max(done["first"].max(), done["second"].max())
    named = "; ".join(" and ".join(p) for p in sorted(done["pairs"]))
    return (
        f"| {title} | {len(done['joints'])} | {collided} | {int((done['first'] > DEPTH_M).sum())} | "
        f"{int((done['second'] > DEPTH_M).sum())} | {deepest:.1f} | {correction.changed} | {correction.left} | "
        f"{correction.largest_rad:.3f} | {done['false']} | {differs} | {named} |"
    )


def main() -> None:
    """Run all motions and print a line each."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("recordings", nargs="*", type=Path)
    parser.add_argument("--robot", nargs="+", default=list(ROBOTS))
    parser.add_argument("--scenario", nargs="*", default=sorted(SCENARIOS))
    parser.add_argument("--rate", type=float, help="output rate [Hz]; default: the source's")
    parser.add_argument("--without", action="store_true", help="run each motion without the stage, too")
    args = parser.parse_args()
    registry, engines = Registry(entry_points=False), {}
    options = registry.get("postprocessor", "fcl_collision").config_type()
    print(
        "| motion | frames | colliding without | by the figure | by MuJoCo | deepest [mm] | changed | left | "
        "largest [rad] | changed without need | differs [rad] | pairs |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|---|", flush=True)
    for robot in args.robot:
        motions: Sequence[Any] = [*args.scenario, *args.recordings]
        for preset in ("retarget", "koenemann_2014") if robot == "nao_v4" else ("retarget",):
            for motion in motions:
                given: dict[str, Any] = {"sets": [f"source.scenario={motion}"]}
                if isinstance(motion, Path):
                    given = {"input": motion}
                bare = load_pipeline(preset, registry, robot=robot, **given)
                if args.rate and preset == "retarget":
                    bare = dataclasses.replace(bare, rate_hz=args.rate)
                spec = with_stage(bare, options) if preset == "retarget" else bare
                if preset != "retarget":
                    bare = dataclasses.replace(
                        bare, stages=[s for s in bare.stages if s.name != "fcl_collision"]
                    )
                name = motion.stem if isinstance(motion, Path) else motion
                title = f"{robot}, {preset}, {name}"
                print(line(title, spec, bare if args.without else None, registry, engines), flush=True)


if __name__ == "__main__":
    main()
