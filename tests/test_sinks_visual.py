"""What pictures are made of: surfaces of robots, the frames that are shown, the camera."""

from __future__ import annotations

import logging
import math
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imitor.cache import cache_folder
from imitor.registry import Registry
from imitor.robot.files import share_of
from imitor.robot.model import RobotModel
from imitor.types import N_ROLES, ROLE_INDEX
from imitor.visual import camera, shapes
from imitor.visual.clip import Clip, make_clip, rotation_matrices, rows_at
from imitor.visual.geometry import Part, robot_parts
from imitor.visual.shapes import Surface
from imitor.visual.stick import HEAD_RADIUS, head_centre, stick_figure

G1 = "robots/g1_description/urdf/g1_29dof_rev_1_0.urdf"
CARD = Path(__file__).resolve().parents[1] / "plugins/robots/cards/unitree_g1.yaml"


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def _own_cache(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMITOR_CACHE", str(cache))


def load(name: str) -> RobotModel:
    return RobotModel.load(name, Registry(entry_points=False))


@pytest.fixture(autouse=True)
def _ros_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"/nowhere{os.pathsep}{share_of('example-robot-data')}")


def user_g1(folder: Path, change: Any) -> RobotModel:
    """A user's robot: the G1's URDF, changed, beside a card of its own; its meshes are found as in ROS."""
    text = (share_of("example-robot-data") / "example-robot-data" / G1).read_text(encoding="utf-8")
    (folder / "mine.urdf").write_text(change(text), encoding="utf-8")
    card = re.sub(r"model: \{.*\}", "model: {file: mine.urdf}", CARD.read_text(encoding="utf-8"))
    (folder / "mine.yaml").write_text(card, encoding="utf-8")
    return load(str(folder / "mine.yaml"))


def boxes(parts: list[Part]) -> dict[int, np.ndarray]:
    """Return joint -> lowest and highest corner of its surface."""
    out: dict[int, np.ndarray] = {}
    for part in parts:
        v = part.surface.vertices
        box = np.array([v.min(axis=0), v.max(axis=0)])
        if part.joint in out:
            box = np.array([np.minimum(box[0], out[part.joint][0]), np.maximum(box[1], out[part.joint][1])])
        out[part.joint] = box
    return out


# ---------------------------------------------------------------------- robots


@pytest.mark.parametrize(
    ("name", "height_m"), [("unitree_g1", (1.25, 1.35)), ("romeo", (1.35, 1.45)), ("talos", (1.65, 1.80))]
)
def test_surfaces_are_where_pinocchio_puts_them(name: str, height_m: tuple[float, float]) -> None:
    """Pinocchio reads the same visuals with other code, the .dae of ROMEO too; only thinning differs."""
    import pinocchio as pin

    robot = load(name)
    parts = robot_parts(robot)
    files = robot.files
    geometry = pin.buildGeomFromUrdf(
        robot.full_model,
        str(files.model),
        pin.GeometryType.VISUAL,
        None,
        [str(d) for d in files.package_dirs],
    )
    expected: dict[int, list[np.ndarray]] = {}
    links = {f.name: f for f in robot.model.frames if f.type == pin.FrameType.BODY}
    for shape in geometry.geometryObjects:
        shape.geometry.computeLocalAABB()
        frame = links[robot.full_model.frames[shape.parentFrame].name]
        frame_from_shape = robot.full_model.frames[shape.parentFrame].placement.actInv(shape.placement)
        if hasattr(shape.geometry, "vertices"):
            points = np.array(shape.geometry.vertices())
            placed = frame.placement * frame_from_shape
            expected.setdefault(int(frame.parentJoint), []).append(
                points @ placed.rotation.T + placed.translation
            )
    seen = boxes(parts)
    meshes = {j: np.concatenate(p) for j, p in expected.items()}
    assert set(meshes) <= set(seen) and len(meshes) > 15
    for joint, points in meshes.items():
        box = np.array([points.min(axis=0), points.max(axis=0)])
        np.testing.assert_allclose(seen[joint], box, atol=2 * shapes.CELL_M, err_msg=robot.model.names[joint])
    pin.forwardKinematics(robot.model, robot.data, robot.standing)
    z = [
        (np.array(robot.data.oMi[p.joint].act(v.astype(float)))[2])
        for p in parts
        for v in p.surface.vertices[:: max(1, len(p.surface.vertices) // 200)]
    ]
    assert height_m[0] < max(z) - min(z) < height_m[1]
    assert abs(min(z)) < 0.02  # it stands on the floor


def test_the_second_reading_comes_from_the_cache(cache: Path, caplog: pytest.LogCaptureFixture) -> None:
    robot = load("romeo")
    for kept in (cache / "visuals").glob("romeo-*"):
        kept.unlink()
    with caplog.at_level(logging.INFO, "imitor"):
        first = robot_parts(robot)
        assert len(caplog.messages) == 1 and caplog.messages[0].startswith(
            "romeo: 20 visual shapes converted"
        )
        second = robot_parts(robot)
    assert len(caplog.messages) == 1
    for a, b in zip(first, second, strict=True):
        assert (a.joint, a.surface.rgba) == (b.joint, b.surface.rgba)
        np.testing.assert_array_equal(a.surface.vertices, b.surface.vertices)
        np.testing.assert_array_equal(a.surface.faces, b.surface.faces)
    (kept,) = (cache / "visuals").glob("romeo-*")
    kept.write_bytes(kept.read_bytes()[:1000])  # damaged: converted again
    assert len(robot_parts(robot)) == len(first) and kept.stat().st_size > 1000


def test_a_cache_that_cannot_be_written_is_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("IMITOR_CACHE", str(tmp_path / "file"))
    assert cache_folder() == tmp_path / "file"
    assert robot_parts(user_g1(tmp_path, lambda text: text))
    assert "cannot be written" in caplog.text


def test_meshes_that_are_missing_become_capsules(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    robot = user_g1(tmp_path, lambda text: text.replace("left_elbow_link.STL", "lost.STL"))
    parts = robot_parts(robot)
    elbow = robot.model.getJointId("left_elbow_joint")
    assert "meshes of 1 links cannot be drawn" in caplog.text and "lost.STL" in caplog.text
    assert elbow in boxes(parts)
    assert len(boxes(parts)) == robot.n + 1


def test_a_model_without_visuals_becomes_a_figure(tmp_path: Path) -> None:
    robot = user_g1(tmp_path, lambda text: re.sub(r"<visual>.*?</visual>", "", text, flags=re.S))
    parts = robot_parts(robot)
    assert set(boxes(parts)) == set(range(1, robot.n + 2))
    foot = boxes(parts)[robot.model.getJointId("left_ankle_roll_joint")]
    assert foot[0][2] == pytest.approx(-0.035, abs=1e-6)  # the sole's plate


MJCF = """
<mujoco model="walker">
  <compiler angle="radian"/>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="hips" pos="0 0 1">
      <freejoint/>
      <geom type="box" size="0.1 0.15 0.05" rgba="1 0 0 1"/>
      {legs}
    </body>
  </worldbody>
</mujoco>
"""
LEG = """
      <body name="{side}_thigh" pos="0.01 {y} -0.05" euler="0.1 0 0">
        <joint name="{side}_hip" type="hinge" axis="0 1 0" pos="0 0 0.02" range="-1 1"/>
        <geom type="capsule" fromto="0 0 0 0.02 0 -0.4" size="0.04" rgba="0 1 0 1"/>
        <body name="{side}_shank" pos="0 0 -0.42">
          <joint name="{side}_knee" type="hinge" axis="0 1 0" range="0 2"/>
          <geom type="cylinder" pos="0 0 -0.2" size="0.03 0.2" group="2"/>
          <geom type="sphere" pos="0 0 -0.2" size="0.5" group="3"/>
          <body name="{side}_sole" pos="0 0 -0.42">
            <geom type="ellipsoid" size="0.1 0.04 0.02" rgba="0 0 1 1"/>
          </body>
        </body>
      </body>
"""
MJCF_CARD = """
imitor_robot: 1
title: Walker
licence: CC0-1.0
model: {file: walker.xml}
roles: {hip: "{side}_thigh", knee: "{side}_shank", ankle: "{side}_sole"}
soles: {frame: "{side}_sole", polygon_m: [[0.1, 0.04], [-0.1, 0.04], [-0.1, -0.04], [0.1, -0.04]]}
"""


def test_an_mjcf_looks_as_mujoco_shows_it(tmp_path: Path) -> None:
    import mujoco
    import pinocchio as pin

    legs = LEG.format(side="left", y=0.1) + LEG.format(side="right", y=-0.1)
    (tmp_path / "walker.xml").write_text(MJCF.format(legs=legs))
    (tmp_path / "walker.yaml").write_text(MJCF_CARD)
    robot = load(str(tmp_path / "walker.yaml"))
    parts = robot_parts(robot)
    assert (
        len(parts) == 1 + 2 + 2 * 2
    )  # hips, thighs, and shank and foot in two colours; no floor, no big sphere
    q = robot.standing.copy()
    q[:7] = 0.3, -0.2, 1.1, *(np.array([0.1, 0.2, -0.3, 0.9]) / np.linalg.norm([0.1, 0.2, -0.3, 0.9]))
    q[7:] = 0.5, 0.7, -0.4, 0.2
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "walker.xml"))
    data = mujoco.MjData(model)
    pin.forwardKinematics(robot.model, robot.data, q)
    data.qpos[:7] = pin.SE3ToXYZQUAT(robot.data.oMi[1])[[0, 1, 2, 6, 3, 4, 5]]
    for name, value in zip(robot.joint_names, q[7:], strict=True):
        data.qpos[model.joint(name).qposadr[0]] = value
    mujoco.mj_forward(model, data)
    shown = [g for g in range(model.ngeom) if model.geom_bodyid[g] > 0 and model.geom_group[g] < 3]
    centres = np.array([data.geom_xpos[g] for g in shown])
    for part in parts:
        low, high = part.surface.vertices.min(axis=0), part.surface.vertices.max(axis=0)
        centre = np.array(robot.data.oMi[part.joint].act(0.5 * (low + high).astype(float)))
        nearest = int(np.argmin(np.linalg.norm(centres - centre, axis=1)))
        np.testing.assert_allclose(centres[nearest], centre, atol=5e-3)
        assert part.surface.rgba is not None
        np.testing.assert_allclose(part.surface.rgba, model.geom_rgba[shown[nearest]], atol=1e-6)


# ---------------------------------------------------------------------- shapes


def volume(surface: Surface) -> float:
    """Signed volume of a closed surface: positive where the triangles face outwards."""
    a, b, c = (surface.vertices[surface.faces[:, k]].astype(float) for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


@pytest.mark.parametrize(
    ("surface", "expected"),
    [
        (shapes.sphere(0.5), 4 / 3 * math.pi * 0.125),
        (shapes.box([1.0, 2.0, 3.0]), 6.0),
        (shapes.cylinder(0.5, 2.0), math.pi * 0.5),
        (shapes.capsule(0.5, 2.0), math.pi * 0.5 + 4 / 3 * math.pi * 0.125),
        (shapes.capsule_between(np.array([1.0, 2.0, 3.0]), np.array([1.0, 4.0, 3.0]), 0.5), 2.0944),
    ],
)
def test_shapes_have_their_volume_and_face_outwards(surface: Surface, expected: float) -> None:
    assert volume(surface) == pytest.approx(expected, rel=0.08)
    assert volume(surface.moved(np.diag([1.0, -1.0, 1.0, 1.0]))) == pytest.approx(volume(surface), rel=1e-4)


def test_a_capsule_lies_between_its_ends() -> None:
    a, b = np.array([0.1, 0.2, 0.3]), np.array([0.4, -0.2, 0.3])
    v = shapes.capsule_between(a, b, 0.05).vertices
    along = (v - a) @ (b - a) / 0.5
    assert along.min() == pytest.approx(-0.05, abs=1e-5) and along.max() == pytest.approx(0.55, abs=1e-5)
    across = np.linalg.norm((v - a) - np.outer(along, (b - a) / 0.5), axis=1)
    assert across.max() == pytest.approx(0.05, abs=1e-5)


def test_thinning_keeps_the_shape() -> None:
    import trimesh

    dense = trimesh.creation.icosphere(subdivisions=6, radius=0.1)
    surface = Surface(dense.vertices.astype(np.float32), dense.faces.astype(np.int32), shapes.GREY)
    thin = shapes.thinned(surface, 0.01)
    assert len(thin.faces) < 0.1 * len(surface.faces)
    assert volume(thin) == pytest.approx(volume(surface), rel=0.05)
    radius = np.linalg.norm(thin.vertices, axis=1)
    assert radius.min() > 0.09 and radius.max() <= 0.1 + 1e-6
    assert thin.rgba == shapes.GREY
    assert shapes.thinned(shapes.sphere(0.1)).faces.shape == shapes.sphere(0.1).faces.shape


# ---------------------------------------------------------------------- frames and camera


def walk(n: int, human_speed: float, robot_speed: float, yaw: float, sway: float = 0.0) -> Clip:
    """Human and robot as boxes of points that walk along a heading."""
    time_s = np.arange(n) / 25.0
    along = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    side = np.array([-along[1], along[0], 0.0])
    base = np.array([0.0, 0.0, 0.75]) + time_s[:, None] * robot_speed * along
    base = base + sway * np.sin(time_s)[:, None] * side
    human = np.full((n, N_ROLES, 3), np.nan)
    pelvis = np.array([5.0, -3.0, 0.95]) + time_s[:, None] * human_speed * along
    for role, offset in {"pelvis": (0, 0, 0), "head": (0, 0, 0.65), "left_toe": (0.2, 0.1, -0.95)}.items():
        human[:, ROLE_INDEX[role]] = pelvis + np.array(offset, dtype=float)
    valid = np.isfinite(human).all(axis=2)
    quaternion = np.zeros((n, 2, 4))
    quaternion[..., 2], quaternion[..., 3] = math.sin(yaw / 2), math.cos(yaw / 2)
    position = np.stack([np.zeros((n, 3)), base], axis=1)
    contact = np.ones((n, 2), dtype=bool)
    return Clip(
        time_s,
        position,
        quaternion,
        base,
        np.zeros((n, 2, 4, 3)),
        contact,
        {},
        human,
        valid,
        np.full((n, 3), np.nan),
    )


def seen_in(view: camera.View, points: np.ndarray, aspect: float) -> np.ndarray:
    """Project points (T, N, 3) as a pinhole camera does, to -1 ... 1 across and up the picture."""
    ca, sa = math.cos(view.azimuth), math.sin(view.azimuth)
    ce, se = math.cos(view.elevation), math.sin(view.elevation)
    forward, right = np.array([ce * ca, ce * sa, se]), np.array([sa, -ca, 0.0])
    away = points - (view.target - view.distance * forward)[:, None]
    focal = 1.0 / math.tan(0.5 * camera.FIELD_OF_VIEW)
    depth = away @ forward
    x, y = focal / aspect * (away @ right) / depth, focal * (away @ np.cross(right, forward)) / depth
    return np.stack([x, y, depth], axis=-1)


PARTS = [Part(1, shapes.box([0.3, 0.5, 1.5]))]


@given(
    speeds=st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5)),
    yaw=st.floats(-3.1, 3.1),
    sway=st.floats(0.0, 0.5),
    n=st.integers(1, 120),
    beside=st.booleans(),
)
def test_both_are_in_the_picture_at_all_times(
    speeds: tuple[float, float], yaw: float, sway: float, n: int, beside: bool
) -> None:
    clip = walk(n, *speeds, yaw, sway)
    robot, human = camera.robot_corners(clip, PARTS), camera.human_corners(clip)
    layout = camera.arrange(clip, robot, human, beside=beside)
    view = camera.frame_all(clip, robot, human + layout.shift, layout, 4 / 3)
    points = np.concatenate([robot, human + layout.shift], axis=1)
    shown = seen_in(view, points, 4 / 3)
    known = np.isfinite(points).all(axis=2)
    assert (shown[known][:, 2] > 0).all()
    assert np.abs(shown[known][:, :2]).max() <= 1.0 - 2.0 * camera.BORDER + 1e-6
    if beside:
        gap = (robot @ layout.right).min(axis=1) - np.nanmax((human + layout.shift) @ layout.right, axis=1)
        assert gap.min() == pytest.approx(0.25)
    else:
        between = clip.human_centre + layout.shift - clip.joint_position[:, 1]
        np.testing.assert_allclose(between.mean(axis=0)[:2], 0.0, atol=1e-9)


def test_the_camera_sees_the_robot_from_the_front() -> None:
    clip = walk(2, 0.0, 0.0, yaw=1.0)
    robot, human = camera.robot_corners(clip, PARTS), camera.human_corners(clip)
    azimuth = camera.arrange(clip, robot, human, beside=True).azimuth
    assert camera.heading(clip) == pytest.approx(1.0)
    assert math.cos(azimuth - 1.0) == pytest.approx(-math.cos(camera.TURN))


def test_the_camera_follows_smoothly() -> None:
    clip = walk(100, 0.0, 0.0, 0.0)
    clip.joint_position[50:, 1, 0] += 1.0  # a jump
    robot, human = camera.robot_corners(clip, PARTS), camera.human_corners(clip)
    layout = camera.arrange(clip, robot, human, beside=True)
    target = camera.frame_all(clip, robot, human + layout.shift, layout, 1.0).target
    steps = np.linalg.norm(np.diff(target, axis=0), axis=1)
    assert 0.4 < np.linalg.norm(target[-1] - target[0]) < 0.6  # half the jump: the human stayed
    assert steps.max() < 0.03


@given(
    n=st.integers(1, 400),
    rate=st.sampled_from([10.0, 25.0, 30.0, 100.0, 120.0]),
    wanted=st.floats(1.0, 200.0),
    start=st.floats(0.0, 100.0),
)
def test_rows_follow_an_even_grid(n: int, rate: float, wanted: float, start: float) -> None:
    time_s = start + np.arange(n) / rate
    rows = rows_at(time_s, wanted)
    assert rows[0] == 0 and (np.diff(rows) > 0).all() and rows[-1] < n
    grid = time_s[0] + np.arange(int((time_s[-1] - time_s[0]) * wanted + 1e-6) + 1) / wanted
    nearest = np.abs(grid[:, None] - time_s[rows]).min(axis=1)
    assert nearest.max() <= 0.5 / rate + 1e-9
    if wanted <= rate:
        assert len(rows) == len(grid)


def test_rows_of_a_part() -> None:
    time_s = np.arange(100) / 50.0
    assert rows_at(time_s, 25.0, 0.4, 0.8).tolist() == [20, 22, 24, 26, 28, 30, 32, 34, 36, 38, 40]
    assert rows_at(time_s, 25.0, 50.0, 60.0).tolist() == [99]


def test_a_clip_agrees_with_the_robot_model() -> None:
    from imitor.record import Motion, Reference

    robot = load("talos")
    rng = np.random.default_rng(5)
    q = np.repeat(robot.standing[None], 3, axis=0)
    q[:, 7:] += rng.normal(0.0, 0.2, (3, robot.n))
    q[:, :3] += rng.normal(0.0, 0.5, (3, 3))
    q[:, 3:7] = rng.normal(size=(3, 4))
    q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
    time_s = np.arange(3) / 10.0
    both = np.ones((3, 2), dtype=bool)
    motion = Motion(
        "talos", time_s, robot.joint_names, q[:, 7:], q[:, :3], q[:, [6, 3, 4, 5]], both, ["ok"] * 3
    )
    nothing = np.full((3, N_ROLES, 3), np.nan)
    valid = np.zeros((3, N_ROLES), dtype=bool)
    reference = Reference(
        time_s,
        list(ROLE_INDEX),
        nothing,
        valid,
        both,
        both[:, 0],
        nothing[:, 0],
        {},
        {},
        {},
        time_s,
        1.7,
        0.1,
    )
    clip = make_clip(robot, motion, reference, np.array([0, 2]), ["left_hand"])
    for i, row in enumerate([0, 2]):
        robot.update(q[row])
        np.testing.assert_allclose(clip.com[i], robot.com, atol=1e-12)
        np.testing.assert_allclose(clip.sole[i], robot.sole_corners(), atol=1e-12)
        np.testing.assert_allclose(clip.frame["left_hand"][i], robot.pose("left_hand"), atol=1e-12)
        joint = robot.model.getJointId("arm_left_4_joint")
        np.testing.assert_allclose(
            clip.joint_position[i, joint], robot.data.oMi[joint].translation, atol=1e-12
        )
        R = rotation_matrices(clip.joint_quaternion[i, joint])
        np.testing.assert_allclose(R, robot.data.oMi[joint].rotation, atol=1e-12)


# ---------------------------------------------------------------------- the human


def test_a_stick_figure_joins_what_is_known() -> None:
    everything = stick_figure(np.ones(N_ROLES, dtype=bool))
    pairs = {tuple(b) for b in everything.bones.tolist()}
    assert (ROLE_INDEX["neck"], ROLE_INDEX["left_shoulder"]) in pairs
    assert everything.bone_side.count("left") == everything.bone_side.count("right") == 11
    known = np.ones(N_ROLES, dtype=bool)
    known[[ROLE_INDEX["neck"], ROLE_INDEX["left_wrist"]]] = False
    pairs = {tuple(b) for b in stick_figure(known).bones.tolist()}
    assert (ROLE_INDEX["chest"], ROLE_INDEX["left_shoulder"]) in pairs  # the next best carrier
    assert (ROLE_INDEX["left_elbow"], ROLE_INDEX["left_hand"]) in pairs
    nothing = stick_figure(np.zeros(N_ROLES, dtype=bool))
    assert nothing.bones.shape == (0, 2) and nothing.joint_colour.shape == (0, 3)


def test_the_head_ends_at_its_top() -> None:
    position = np.zeros((N_ROLES, 3))
    position[ROLE_INDEX["head"]], position[ROLE_INDEX["head_top"]] = (0.0, 0.0, 1.5), (0.0, 0.0, 1.75)
    valid = np.ones(N_ROLES, dtype=bool)
    centre = head_centre(position, valid)
    assert centre is not None and centre[2] == pytest.approx(1.75 - HEAD_RADIUS)
    valid[ROLE_INDEX["head_top"]] = False
    centre = head_centre(position, valid)
    assert centre is not None and centre[2] == 1.5
    valid[ROLE_INDEX["head"]] = False
    assert head_centre(position, valid) is None
