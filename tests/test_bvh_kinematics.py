"""Forward kinematics of BVH files against a plain walk of the tree and against ASF/AMC of the same takes."""

from __future__ import annotations

import importlib.util
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from imitor.motion.bvh_file import read_bvh, write_bvh
from imitor.motion.bvh_hierarchy import CHANNELS, Node
from imitor.motion.kinematics import forward_kinematics

Array = NDArray[np.float64]


def _load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


asf_amc = _load("asf_amc")


def walk(nodes: Sequence[Node], row: Array) -> tuple[Array, Array]:
    """Positions and rotations of one frame, written as the format is defined."""
    values = iter(row)
    places: list[Array] = []
    turns: list[Array] = []
    for node in nodes:
        place, turn = node.offset.copy(), np.eye(3)
        for channel in node.channels:
            value, axis = next(values), "XYZ".index(channel[0])
            if channel.endswith("position"):
                place[axis] = value
            else:
                angles = [0.0, 0.0, 0.0]
                angles[axis] = value
                turn = turn @ asf_amc.extrinsic_xyz(*angles)
        if node.parent >= 0:
            place = places[node.parent] + turns[node.parent] @ place
            turn = turns[node.parent] @ turn
        places.append(place)
        turns.append(turn)
    return np.array(places), np.array(turns)


@st.composite
def clips(draw: st.DrawFn) -> tuple[list[Node], Array, float]:
    """Random trees with random channels, in depth-first order as a file has them."""
    number = st.floats(-1e4, 1e4, allow_subnormal=False)
    nodes: list[Node] = []
    path: list[int] = []
    for i in range(draw(st.integers(1, 8))):
        if i:
            path = path[: draw(st.integers(1, len(path)))]
        rotations = draw(st.lists(st.sampled_from(CHANNELS[3:]), max_size=3))
        positions = draw(st.lists(st.sampled_from(CHANNELS[:3]), unique=True, max_size=3))
        channels = draw(st.permutations([*positions, *rotations]))
        name = draw(st.sampled_from(["Hips", "mixamorig:Spine", "Left Arm", "joint.001", "é"]))
        offset = np.array(draw(st.tuples(number, number, number)))
        is_end = i > 0 and draw(st.booleans())
        nodes.append(
            Node(
                "" if is_end else name,
                path[-1] if i else -1,
                offset,
                () if is_end else tuple(channels),
                is_end,
            )
        )
        if not is_end:
            path = [*path, i]
    if not any(n.channels for n in nodes):
        nodes[0] = Node(nodes[0].name, -1, nodes[0].offset, ("Yposition", "Zrotation"))
    width = sum(len(n.channels) for n in nodes)
    rows = draw(st.lists(st.lists(number, min_size=width, max_size=width), min_size=1, max_size=3))
    return nodes, np.array(rows), draw(st.floats(1e-4, 1.0))


@settings(max_examples=60, deadline=None)
@given(clips())
def test_what_is_written_is_read_again(clip: tuple[list[Node], Array, float]) -> None:
    nodes, motion, dt = clip
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "clip.bvh"
        write_bvh(path, nodes, motion, dt)
        back = read_bvh(path)
    assert [(n.name, n.parent, n.channels, n.is_end) for n in back.nodes] == [
        (n.name, n.parent, n.channels, n.is_end) for n in nodes
    ]
    assert all(np.array_equal(a.offset, b.offset) for a, b in zip(back.nodes, nodes, strict=True))
    assert np.array_equal(back.motion, motion)
    assert back.frame_time_s == dt
    there, here = forward_kinematics(back.nodes, back.motion), forward_kinematics(nodes, motion)
    assert np.array_equal(there.position, here.position)
    assert np.array_equal(there.rotation, here.rotation)


@settings(max_examples=60, deadline=None)
@given(clips())
def test_vectorised_kinematics_equal_a_walk_of_the_tree(clip: tuple[list[Node], Array, float]) -> None:
    nodes, motion, _ = clip
    poses = forward_kinematics(nodes, motion)
    for t, row in enumerate(motion):
        position, rotation = walk(nodes, row)
        np.testing.assert_allclose(poses.position[t], position, atol=1e-9, rtol=1e-9)
        np.testing.assert_allclose(poses.rotation[t], rotation, atol=1e-9)


def test_the_writer_puts_columns_in_the_order_of_the_file(tmp_path: Path) -> None:
    nodes = [
        Node("Hips", -1, np.zeros(3), ("Xposition",)),
        Node("Left", 0, np.array([1.0, 0, 0]), ("Xrotation",)),
        Node("Right", 0, np.array([-1.0, 0, 0]), ("Yrotation",)),
        Node("LeftTip", 1, np.array([0, 1.0, 0]), ("Zrotation",)),
    ]
    write_bvh(tmp_path / "a.bvh", nodes, np.array([[1.0, 2, 3, 4]]), 0.01)
    back = read_bvh(tmp_path / "a.bvh")
    assert [n.name for n in back.nodes] == ["Hips", "Left", "LeftTip", "Right"]
    assert back.motion.tolist() == [[1, 2, 4, 3]]


def test_only_wanted_nodes_are_returned_in_the_order_asked() -> None:
    nodes = [
        Node("a", -1, np.zeros(3), ("Zrotation",)),
        Node("b", 0, np.array([1.0, 0, 0]), ("Zrotation",)),
        Node("c", 1, np.array([1.0, 0, 0])),
        Node("d", 0, np.array([0, 1.0, 0])),
    ]
    some = forward_kinematics(nodes, np.array([[90.0, 90.0]]), [2, 0])
    assert some.position.shape == (1, 2, 3)
    np.testing.assert_allclose(some.position[0], [[-1, 1, 0], [0, 0, 0]], atol=1e-12)


LEGS_AND_SPINE = {
    "root": "Hips",
    **{
        f"{short}{bone}": f"{side}{joint}"
        for short, side in (("l", "Left"), ("r", "Right"))
        for bone, joint in (
            ("hipjoint", "UpLeg"),
            ("femur", "Leg"),
            ("tibia", "Foot"),
            ("foot", "ToeBase"),
        )
    },
    "lowerback": "Spine",
    "upperback": "Spine1",
}
ABOVE_THE_THORAX = {
    "lowerneck": "Neck1",
    "upperneck": "Head",
    "lclavicle": "LeftArm",
    "lhumerus": "LeftForeArm",
    "lradius": "LeftHand",
    "rclavicle": "RightArm",
    "rhumerus": "RightForeArm",
    "rradius": "RightHand",
}


@pytest.mark.shared
@pytest.mark.parametrize("take", ["02_01", "02_06", "05_13", "49_18"])
def test_bvh_agrees_with_asf_amc_of_the_same_take(shared: Path, take: str) -> None:
    bvh = read_bvh(shared / "mocap" / "cmu_bvh" / f"{take}.bvh")
    bones = asf_amc.read_asf(shared / "mocap" / "cmu_asf_amc" / f"{take[:2]}.asf")
    frames = asf_amc.read_amc(shared / "mocap" / "cmu_asf_amc" / f"{take}.amc")
    assert len(frames) == len(bvh.motion) - 1  # the first BVH frame is an added T-pose
    index = {node.name: i for i, node in enumerate(bvh.nodes) if not node.is_end}
    position = forward_kinematics(bvh.nodes, bvh.motion[1:]).position
    thorax = bones["thorax"].length
    for t in range(0, len(frames), max(1, len(frames) // 60)):
        ends = asf_amc.bone_ends(bones, frames[t])
        for bone, joint in LEGS_AND_SPINE.items():
            np.testing.assert_allclose(
                position[t, index[joint]], ends[bone], atol=2e-4, err_msg=f"{take} frame {t} {bone}"
            )
        for bone, joint in ABOVE_THE_THORAX.items():
            left_out = ends["thorax"] - ends["upperback"]
            assert np.linalg.norm(left_out) == pytest.approx(thorax)
            np.testing.assert_allclose(
                position[t, index[joint]] + left_out,
                ends[bone],
                atol=2e-4,
                err_msg=f"{take} frame {t} {bone}",
            )
