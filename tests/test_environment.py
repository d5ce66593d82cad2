"""Objects around the robot: what may be written, where they are, and that arms and simulation feel them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imitor import Configuration, TaskKind, TaskStack, testing
from imitor.collision.obstacles import obstacles
from imitor.environment import read_environment, triangles
from imitor.errors import ImitorError, RunError, SpecError
from imitor.metrics.collision import robot_collision_model
from imitor.pipeline import Pipeline
from imitor.registry import Registry
from imitor.robot.model import RobotModel
from imitor.simulation.body import OBJECT, OTHER, Body, Surroundings
from imitor.simulation.drives import make_drives
from imitor.spec import load_pipeline, load_text

REGISTRY = Registry(entry_points=False)
TEXT = """\
imitor: 1
robot: unitree_g1
source: {use: performer, scenario: wave}
environment:
%s
stages:
  - mapper: segment_scaling
  - solver: prioritized
    order: [[left_foot, right_foot]]
"""


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return testing.make_robot("unitree_g1")


def write_stl(path: Path, low: Any, high: Any) -> None:
    """Write a box as a text .stl, in millimetres."""
    import trimesh

    mesh = trimesh.creation.box(bounds=1000.0 * np.array([low, high]))
    path.write_text(trimesh.exchange.stl.export_stl_ascii(mesh), encoding="utf-8")


# ------------------------------------------------------------------ what may be written


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        (
            "{name: a, shape: box, size_m: [1, -1, 1]}",
            "5:39: environment[0].size_m[1]: input should be greater than 0, got -1",
        ),
        ("{name: a, size_m: [1, 1, 1]}", "5:5: environment[0].shape: required, but not given"),
        (
            "{name: a, shape: cylindre}",
            "5:22: environment[0].shape: should be 'box', 'cylinder' or 'mesh', got 'cylindre'",
        ),
        (
            "{name: a, shape: cylinder, radius_m: 1}",
            "5:5: environment[0].length_m: required, but not given",
        ),
        (
            "{name: a, shape: box, size_m: [1, 1, 1], position: [0, 0, 0]}",
            "5:46: environment[0].position: there is no such key here",
        ),
        (
            "{name: a, shape: box, size_m: [1, 1, 1], rpy_rad: [0, 0, 0], quaternion_wxyz: [1, 0, 0, 0]}",
            "5:5: environment[0]: its rotation is given twice; leave out rpy_rad or quaternion_wxyz",
        ),
        (
            "{name: a, shape: box, size_m: [1, 1, 1], quaternion_wxyz: [2, 0, 0, 0]}",
            "5:5: environment[0]: the length of quaternion_wxyz should be 1; no rotation is [1, 0, 0, 0]",
        ),
        (
            "{name: a, shape: mesh, path: no.stl}",
            "5:34: environment[0].path: there is no mesh file 'no.stl'",
        ),
        (
            "{name: a, shape: box, size_m: [1, 1, 1]}\n  - {name: a, shape: box, size_m: [1, 1, 1]}",
            "6:12: environment[1].name: another object is called 'a'",
        ),
    ],
)
def test_a_wrong_object_is_told_at_its_place(entry: str, expected: str) -> None:
    with pytest.raises(SpecError) as caught:
        load_text(TEXT % f"  - {entry}", REGISTRY, "p.yaml")
    assert [f"{p.path}:{p.line}:{p.column}: {p.where}: {p.message}" for p in caught.value.problems] == [
        f"p.yaml:{expected}"
    ]


def test_every_wrong_object_is_told_at_once() -> None:
    entries = (
        "  - {name: a, shape: box, size_m: 3}\n  - {name: b, shape: cylinder, radius_m: x}\n  - {name: c}"
    )
    with pytest.raises(SpecError) as caught:
        load_text(TEXT % entries, REGISTRY, "p.yaml")
    assert [p.where for p in caught.value.problems] == [
        "environment[0].size_m", "environment[1].length_m", "environment[1].radius_m", "environment[2].shape",
    ]  # fmt: skip


def test_a_mesh_lies_beside_the_pipeline(tmp_path: Path) -> None:
    write_stl(tmp_path / "stool.stl", [0, 0, 0], [0.3, 0.3, 0.4])
    path = tmp_path / "p.yaml"
    path.write_text(TEXT % "  - {name: stool, shape: mesh, path: stool.stl, scale: 0.001}", encoding="utf-8")
    spec = load_pipeline(str(path), REGISTRY)
    assert spec.environment[0]["path"] == str(tmp_path / "stool.stl")
    assert load_text(spec.to_yaml(), REGISTRY) == spec
    (item,) = read_environment(spec.environment)
    np.testing.assert_allclose(triangles(item)[0].max(axis=0), [0.3, 0.3, 0.4], atol=1e-6)


# ------------------------------------------------------------------ where they are


@given(st.tuples(*[st.floats(-3.1, 3.1)] * 3), st.tuples(*[st.floats(-5, 5)] * 3))
def test_both_rotations_mean_the_same(rpy: tuple[float, float, float], at: tuple[float, ...]) -> None:
    turn = pin.rpy.rpyToMatrix(*rpy)
    x, y, z, w = pin.Quaternion(turn).coeffs()
    box = {"name": "a", "shape": "box", "size_m": [1, 1, 1], "position_m": at}
    one, two = read_environment([{**box, "rpy_rad": rpy}, {**box, "quaternion_wxyz": [w, x, y, z]}])
    for item in (one, two):
        np.testing.assert_allclose(item.placement()[:3, :3], turn, atol=1e-9)
        np.testing.assert_allclose(item.placement()[:3, 3], at)


def test_a_mesh_that_cannot_be_used_is_told(tmp_path: Path, robot: RobotModel) -> None:
    for content, expected in (
        ("solid a\nendsolid a\n", "the mesh .* of 'thing' cannot be"),
        ("nonsense", "the mesh .* of 'thing' cannot be read"),
    ):
        path = tmp_path / "thing.stl"
        path.write_text(content, encoding="utf-8")
        around = [{"name": "thing", "shape": "mesh", "path": str(path)}]
        cls = REGISTRY.get("postprocessor", "fcl_collision")
        context = dataclasses.replace(testing.make_context(robot), environment=around)
        with pytest.raises(ImitorError, match=expected):
            cls(cls.config_type(), context).start()


# ------------------------------------------------------------------ the arm keeps off


def table(robot: RobotModel) -> tuple[np.ndarray, np.ndarray]:
    """Return corners (low, high) of a table top under the left hand of the lifted arm [m]."""
    robot.update(robot.standing)
    x, y, z = robot.position("left_hand")
    return np.array([x - 0.04, y - 0.15, z - 0.01]), np.array([x + 0.40, y + 0.25, z + 0.05])


def things(robot: RobotModel, folder: Path) -> dict[str, Mapping[str, Any]]:
    low, high = table(robot)
    middle = (0.5 * (low + high)).tolist()
    write_stl(folder / "table.stl", low, high)
    lying = {
        "position_m": [float(low[0]) + 0.06, middle[1], float(high[2]) - 0.06],
        "rpy_rad": [1.5708, 0.0, 0.0],
    }
    return {
        "box": {"name": "table", "shape": "box", "size_m": (high - low).tolist(), "position_m": middle},
        "cylinder": {"name": "bar", "shape": "cylinder", "radius_m": 0.06, "length_m": 0.5, **lying},
        "mesh": {"name": "table", "shape": "mesh", "path": str(folder / "table.stl"), "scale": 0.001},
    }


def lowered(robot: RobotModel, share: float) -> np.ndarray:
    """Return the standing posture with the left arm lifted, and lowered by a share."""
    q = robot.standing.copy()
    q[7 + robot.joint_index("left_shoulder_pitch_joint")] -= 0.9 * (1.0 - share)
    return q


@pytest.mark.parametrize("kind", ["box", "cylinder", "mesh"])
def test_an_arm_that_comes_down_stays_over_an_object(robot: RobotModel, tmp_path: Path, kind: str) -> None:
    import coal

    around = [things(robot, tmp_path)[kind]]
    cls: Any = REGISTRY.get("postprocessor", "fcl_collision")
    made = cls(
        cls.config_type(margin_m=0.01), dataclasses.replace(testing.make_context(robot), environment=around)
    )
    made.start()
    stack = TaskStack(robot.n)
    stack.declare("com", TaskKind.COM)
    stack.compile()
    robot.update(robot.standing)
    stack.anchor, stack.anchor_pose = "left_foot", robot.pose("left_foot")

    # judged by another engine, with the full hulls and the object's triangles
    full = robot_collision_model(robot)
    data, results = full.model.createData(), full.geometry.createData()
    corners = triangles(read_environment(around)[0])[0]
    points = coal.StdVec_Vec3s()
    for corner in corners.astype(float):
        points.append(corner)
    other = coal.Convex.convexHull(points, True, "Qt")

    def nearest(q: np.ndarray) -> Any:
        pin.updateGeometryPlacements(full.model, data, full.geometry, results, q)
        return min(
            coal.distance(item.geometry, coal.Transform3s(M.rotation, M.translation), other,
                          coal.Transform3s(), coal.DistanceRequest(), coal.DistanceResult())
            for item, M in zip(full.geometry.geometryObjects, results.oMg, strict=True)
        )  # fmt: skip

    hit, last = 0, None
    for share in (*np.linspace(0.0, 1.0, 60), *np.ones(10), *np.linspace(1.0, 0.0, 60), *np.zeros(250)):
        q = lowered(robot, float(share))
        hit += nearest(q) < 0.0
        state = Configuration(q.copy(), np.ones(2, dtype=bool))
        robot.update(q)
        feet = {side: robot.pose(f"{side}_foot") for side in ("left", "right")}
        made.step(stack, state)
        assert nearest(state.q) > 0.009
        assert (state.q[7:] >= robot.lower).all() and (state.q[7:] <= robot.upper).all()
        for side, pose in feet.items():
            np.testing.assert_allclose(robot.pose(f"{side}_foot"), pose, atol=1e-6)
        if last is not None:
            assert (np.abs(state.q[7:] - last[7:]) <= robot.speed * made.dt_s).all()
        last = state.q.copy()
    assert hit > 10
    assert made.correction.left == 0
    assert state.q.tobytes() == q.tobytes()  # with the arm up again nothing is changed


def test_a_pipeline_keeps_the_hand_off_its_table(tmp_path: Path, robot: RobotModel) -> None:
    low, high = table(robot)
    sets = (0.5 * (low + high)).tolist(), (high - low).tolist()
    entry = f"  - {{name: table, shape: box, position_m: {sets[0]}, size_m: {sets[1]}}}"
    text = TEXT.replace("scenario: wave", "scenario: squat") % entry
    pipeline = Pipeline(load_text(text + "  - postprocessor: fcl_collision\n", REGISTRY), REGISTRY)
    (stage,) = [c for _, c in pipeline.stages if c.name == "fcl_collision"]
    shapes = stage.correction.separation.distances.shapes  # type: ignore[attr-defined]
    names = {shapes.links[a] for a, b in shapes.pairs if shapes.links[b] == "table"}
    assert "left_wrist_yaw_link" in names
    assert not any("ankle_roll" in name for name in names)  # the feet may stand on things
    pipeline.close()


@pytest.mark.parametrize(("at", "said"), [("[0, 0, 0.9]", True), ("[0.6, 0, 0.9]", False)])
def test_a_robot_does_not_begin_inside_an_object(at: str, said: bool) -> None:
    entry = f"  - {{name: post, shape: box, position_m: {at}, size_m: [0.1, 0.1, 0.4]}}"
    text = TEXT.replace("scenario: wave", "scenario: stand") % entry + "  - postprocessor: fcl_collision\n"
    pipeline = Pipeline(load_text(text, REGISTRY), REGISTRY)
    if said:
        with pytest.raises(
            RunError, match=r"begins inside 'post' .* mm deep in it.*environment\.post\.position_m"
        ):
            next(iter(pipeline.records()))
    else:
        assert [r.state.status for r in pipeline.records(5)] == [0] * 5
    pipeline.close()


# ------------------------------------------------------------------ simulation


@pytest.mark.parametrize("kind", ["box", "cylinder", "mesh"])
def test_the_simulated_robot_touches_objects(robot: RobotModel, tmp_path: Path, kind: str) -> None:
    import mujoco

    drives = make_drives(robot, kp_per_effort=30.0, kv_per_kp=0.05)
    body = Body(robot, drives, Surroundings(), environment=[things(robot, tmp_path)[kind]])
    assert (body.kind == OBJECT).sum() == 1
    data = mujoco.MjData(body.model)
    touched = []
    for share in (0.0, 1.0):
        data.qpos[:] = body.qpos(lowered(robot, share))
        mujoco.mj_forward(body.model, data)
        kinds = body.kind[data.contact.geom]
        touched.append({tuple(sorted(k)) for k in kinds.tolist()})
    assert (OBJECT, OTHER) not in touched[0]
    assert (OBJECT, OTHER) in touched[1]


def test_objects_are_named_alike_everywhere(robot: RobotModel, tmp_path: Path) -> None:
    around = list(things(robot, tmp_path).values())[:2]
    assert [p.link for p in obstacles(around)] == ["table", "bar"]
    drives = make_drives(robot, kp_per_effort=30.0, kv_per_kp=0.05)
    names = Body(robot, drives, Surroundings(), environment=around).geom_names
    assert {"object/table", "object/bar"} <= set(names)
    run = testing.make_run(tmp_path)
    info = dataclasses.replace(run.info, environment=around)
    sink: Any = REGISTRY.get("sink", "rerun")
    made = sink(sink.config_type())
    made.start()
    made.open(info)
    for record in run.records():
        made.write(record)
    (path,) = made.finish().files
    content = path.read_bytes()
    assert b"/world/environment/table" in content
    assert b"/world/environment/bar" in content
