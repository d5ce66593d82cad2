"""The BVH source on authored skeletons: unit, axes, floor, rest pose, recognition and options."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from imitor.errors import SourceError, SpecError
from imitor.motion.bvh_file import write_bvh
from imitor.motion.bvh_hierarchy import Node
from imitor.motion.normalise import UNITS, UP_AXES, snap_rate
from imitor.motion.skeletons import MAIN_ROLES, load_card
from imitor.plugins.sources.bvh import Bvh, BvhConfig
from imitor.registry import Registry
from imitor.types import ROLE_INDEX, HumanFrame

Array = NDArray[np.float64]

ROOT = ("Xposition", "Yposition", "Zposition", "Zrotation", "Yrotation", "Xrotation")
TURN = ROOT[3:]

# A T-pose of 1.75 m, z up and facing +x: joint, parent, place [m].
BODY: Sequence[tuple[str, str, tuple[float, float, float]]] = (
    ("Hips", "", (0.0, 0.0, 0.95)),
    ("Spine", "Hips", (0.0, 0.0, 1.10)),
    ("Neck", "Spine", (0.0, 0.0, 1.48)),
    ("Head", "Neck", (0.0, 0.0, 1.58)),
    ("Head/end", "Head", (0.0, 0.0, 1.75)),
    *(
        (f"{side}{joint}", f"{side}{parent}" if parent[0] != "-" else parent[1:], (x, sign * y, z))
        for side, sign in (("Left", 1.0), ("Right", -1.0))
        for joint, parent, (x, y, z) in (
            ("Arm", "-Spine", (0.0, 0.18, 1.43)),
            ("ForeArm", "Arm", (0.0, 0.46, 1.43)),
            ("Hand", "ForeArm", (0.0, 0.71, 1.43)),
            ("UpLeg", "-Hips", (0.0, 0.09, 0.92)),
            ("Leg", "UpLeg", (0.0, 0.09, 0.50)),
            ("Foot", "Leg", (0.0, 0.09, 0.08)),
            ("ToeBase", "Foot", (0.13, 0.09, 0.02)),
            ("ToeBase/end", "ToeBase", (0.20, 0.09, 0.01)),
        )
    ),
)


def body(rename: Callable[[str], str] = str, axes: str = "y", unit: float = 0.01) -> list[Node]:
    """The nodes of the body in a file with another up axis and unit."""
    world = np.array(UP_AXES[axes]) / unit
    place = {name: np.array(p) @ world for name, _, p in BODY}
    index = {name: i for i, (name, _, _) in enumerate(BODY)}
    return [
        Node(
            "" if name.endswith("/end") else rename(name),
            index[parent] if parent else -1,
            place[name] - place[parent] if parent else place[name],
            () if name.endswith("/end") else TURN if parent else ROOT,
            name.endswith("/end"),
        )
        for name, parent, _ in BODY
    ]


def motion(nodes: Sequence[Node], frames: int = 60, sway: float = 5.0) -> Array:
    """The root at its offset, arms raised a little and lowered again."""
    columns = [(node.name, c) for node in nodes for c in node.channels]
    out = np.zeros((frames, len(columns)))
    wave = sway * np.sin(np.linspace(0.0, np.pi, frames))
    for k, (name, channel) in enumerate(columns):
        if channel.endswith("position"):
            out[:, k] = nodes[0].offset["XYZ".index(channel[0])]
        elif "ForeArm" in name and channel == "Yrotation":
            out[:, k] = wave
    return out


def source(path: Path, **options: Any) -> Bvh:
    made = Bvh(BvhConfig(path=str(path), **options))
    made.start()
    return made


def written(tmp_path: Path, nodes: Sequence[Node], values: Array | None = None, dt: float = 1 / 60) -> Path:
    path = tmp_path / "clip.bvh"
    write_bvh(path, nodes, motion(nodes) if values is None else values, dt)
    return path


def place(frame: HumanFrame, role: str) -> Array:
    return np.asarray(frame.position[ROLE_INDEX[role]])


@pytest.mark.parametrize("axes", list(UP_AXES))
@pytest.mark.parametrize("unit", list(UNITS))
def test_unit_and_up_axis_are_found(tmp_path: Path, axes: str, unit: str) -> None:
    made = source(written(tmp_path, body(axes=axes, unit=UNITS[unit])))
    assert made.recording.facts["up"] == axes
    assert made.recording.facts["unit"] == unit
    assert made.recording.facts["skeleton"] == "mixamo"
    first = next(made.frames())
    for name, role in (("Head", "head"), ("LeftHand", "left_wrist"), ("RightFoot", "right_ankle")):
        expected = next(p for n, _, p in BODY if n == name)
        np.testing.assert_allclose(place(first, role), expected, atol=1e-6)
    np.testing.assert_allclose(place(first, "pelvis"), [0.0, 0.0, 0.92], atol=1e-6)


def test_skeleton_facts_of_the_authored_body(tmp_path: Path) -> None:
    skeleton = source(written(tmp_path, body()), mass_kg=60, sex="female").skeleton
    assert skeleton.height_m == pytest.approx(1.75, abs=0.01)
    assert skeleton.ankle_height_m == pytest.approx(0.08, abs=1e-6)
    assert skeleton.toe_height_m == pytest.approx(0.02, abs=1e-6)
    assert (skeleton.mass_kg, skeleton.sex, skeleton.name) == (60, "female", "mixamo")
    assert skeleton.has(*MAIN_ROLES, "chest", "head_top", "left_toe", "right_toe_tip")
    assert not skeleton.has("left_heel")
    for name, role in (("Head/end", "head_top"), ("LeftHand", "left_wrist"), ("RightToeBase", "right_toe")):
        expected = next(p for n, _, p in BODY if n == name)
        np.testing.assert_allclose(skeleton.rest_position[ROLE_INDEX[role]], expected, atol=1e-6)


def test_frames_are_read_only_and_come_again_after_reset(tmp_path: Path) -> None:
    made = source(written(tmp_path, body(), dt=0.0166667))
    first = list(made.frames())
    made.reset()
    second = list(made.frames())
    assert made.rate_hz == 60.0
    assert made.n_frames == len(first) == len(second) == 60
    assert [f.time_s for f in first] == pytest.approx(np.arange(60) / 60.0)
    for a, b in zip(first, second, strict=True):
        assert np.array_equal(a.position, b.position, equal_nan=True)
        assert a.orientation is not None and a.orientation.shape == (25, 3, 3)
        assert not (a.position.flags.writeable or a.orientation.flags.writeable or a.valid.flags.writeable)
        assert np.array_equal(np.isnan(a.position).any(axis=1), ~a.valid)


def test_orientation_is_the_identity_in_the_rest_pose_and_carries_segments(tmp_path: Path) -> None:
    nodes = body()
    values = motion(nodes)
    values[:, 4] = np.linspace(0.0, 90.0, 60)  # the whole body turns left about the vertical of the file
    made = source(written(tmp_path, nodes, values))
    frames, rest = list(made.frames()), made.skeleton.rest_position
    orientation = frames[0].orientation
    assert orientation is not None
    np.testing.assert_allclose(
        orientation[frames[0].valid], np.eye(3)[None].repeat(frames[0].valid.sum(), 0), atol=1e-6
    )
    last = frames[-1].orientation
    assert last is not None
    for role in ("pelvis", "chest", "head", "left_ankle", "right_shoulder"):
        np.testing.assert_allclose(last[ROLE_INDEX[role]], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-6)
    for frame in frames[::7]:
        assert frame.orientation is not None
        for a, b in (("left_elbow", "left_wrist"), ("right_hip", "right_knee"), ("left_ankle", "left_toe")):
            i, j = ROLE_INDEX[a], ROLE_INDEX[b]
            np.testing.assert_allclose(
                frame.orientation[i] @ (rest[j] - rest[i]), frame.position[j] - frame.position[i], atol=1e-6
            )


def test_zero_angles_with_spread_legs_and_hanging_arms_get_the_same_rest_pose(tmp_path: Path) -> None:
    plain = source(written(tmp_path, body()))
    nodes = body()
    values = motion(nodes)
    # Turn the bones' offsets instead of their angles: the same motion, other zero angles.
    columns = [(node.name, c) for node in nodes for c in node.channels]
    c, s = np.cos(np.radians(20.0)), np.sin(np.radians(20.0))
    spread = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])  # about z of the file, which points forward
    odd = list(nodes)
    for side, turn in (("Left", spread), ("Right", spread.T)):
        for i, node in enumerate(nodes):
            parents = [nodes[k].name for k in (node.parent,) if k >= 0]
            if parents[:1] in ([f"{side}UpLeg"], [f"{side}Leg"], [f"{side}Foot"], [f"{side}ToeBase"]):
                odd[i] = Node(node.name, node.parent, turn @ node.offset, node.channels, node.is_end)
        k = columns.index((f"{side}UpLeg", "Zrotation"))
        values[:, k] = -20.0 if side == "Left" else 20.0
    made = source(written(tmp_path, odd, values))
    np.testing.assert_allclose(made.skeleton.rest_position, plain.skeleton.rest_position, atol=1e-6)
    a, b = next(made.frames()), next(plain.frames())
    np.testing.assert_allclose(a.position, b.position, atol=1e-6)
    assert a.orientation is not None and b.orientation is not None
    np.testing.assert_allclose(a.orientation, b.orientation, atol=1e-6)


def test_an_added_t_pose_is_dropped_unless_told(tmp_path: Path) -> None:
    nodes = body()
    values = motion(nodes, 90)
    columns = [(node.name, c) for node in nodes for c in node.channels]
    for side, sign in (("Left", -1.0), ("Right", 1.0)):
        values[1:, columns.index((f"{side}Arm", "Zrotation"))] = (
            sign * 80.0
        )  # arms hang after the first frame
    path = written(tmp_path, nodes, values)
    made = source(path)
    assert made.n_frames == 89
    assert made.recording.facts["dropped_tpose"] is True
    assert made.recording.facts["reference"] == "zero"
    assert next(made.frames()).time_s == 0.0
    assert source(path, drop_tpose=False).n_frames == 90
    assert source(written(tmp_path, nodes), drop_tpose="auto").n_frames == 60  # a T-pose that lasts is motion
    assert source(written(tmp_path, nodes), drop_tpose=True).n_frames == 59


def awkward(nodes: Sequence[Node], values: Array) -> tuple[list[Node], Array]:
    """The same motion in a file whose zero angles are no human pose: the legs point sideways there."""
    names = [n.name for n in nodes]
    turn = {"Left": 90.0, "Right": -90.0}
    odd, out = list(nodes), values.copy()
    columns = [(node.name, c) for node in nodes for c in node.channels]
    for side, angle in turn.items():
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        back = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        below = {names.index(f"{side}{j}") for j in ("UpLeg", "Leg", "Foot", "ToeBase")}
        for i, node in enumerate(nodes):
            if node.parent in below:
                odd[i] = Node(node.name, node.parent, back @ node.offset, node.channels, node.is_end)
        out[:, columns.index((f"{side}UpLeg", "Zrotation"))] -= angle
    return odd, out


def test_zero_angles_that_are_no_human_pose(tmp_path: Path) -> None:
    nodes = body()
    plain = source(written(tmp_path, nodes))
    made = source(written(tmp_path, *awkward(nodes, motion(nodes))))
    assert made.recording.facts["reference"] == "motion"
    assert any("zero angles are no human pose" in note for note in made.skeleton.notes)
    np.testing.assert_allclose(made.skeleton.rest_position, plain.skeleton.rest_position, atol=1e-6)
    a, b = next(made.frames()), next(plain.frames())
    np.testing.assert_allclose(a.position, b.position, atol=1e-6)
    assert a.orientation is not None and b.orientation is not None
    np.testing.assert_allclose(a.orientation, b.orientation, atol=1e-3)


def test_an_added_t_pose_helps_where_zero_angles_are_no_human_pose(tmp_path: Path) -> None:
    nodes = body()
    values = motion(nodes, 90)
    columns = [(node.name, c) for node in nodes for c in node.channels]
    for side, sign in (("Left", -1.0), ("Right", 1.0)):
        values[1:, columns.index((f"{side}Arm", "Zrotation"))] = sign * 80.0
    made = source(written(tmp_path, *awkward(nodes, values)))
    assert made.recording.facts["reference"] == "tpose"
    expected = source(written(tmp_path, nodes, values)).skeleton.rest_position
    np.testing.assert_allclose(made.skeleton.rest_position, expected, atol=1e-6)


def test_floor_follows_the_feet_or_what_is_said(tmp_path: Path) -> None:
    nodes = body()
    values = motion(nodes)
    values[:, 1] -= 90.0  # the file is in cm, y up
    path = written(tmp_path, nodes, values)
    assert place(next(source(path).frames()), "left_ankle")[2] == pytest.approx(0.08, abs=0.02)
    assert place(next(source(path, floor="file").frames()), "left_ankle")[2] == pytest.approx(-0.82)
    given = source(path, floor=-0.95)
    assert place(next(given.frames()), "left_ankle")[2] == pytest.approx(0.13)
    assert given.skeleton.ankle_height_m == pytest.approx(0.13)
    near = motion(nodes)
    near[:, 1] += 2.0
    kept = source(written(tmp_path, nodes, near))
    assert kept.recording.facts["floor_m"] == 0.0  # the file's zero, which is plausible
    assert kept.skeleton.ankle_height_m == pytest.approx(0.10)


def test_odd_scales_and_given_units(tmp_path: Path) -> None:
    path = written(tmp_path, body(unit=0.0391))
    assumed = source(path)
    assert assumed.skeleton.height_m == pytest.approx(1.75)
    assert any("no known length unit fits" in note for note in assumed.skeleton.notes)
    assert source(path, height_m=1.62).skeleton.height_m == pytest.approx(1.62)
    assert source(path, unit=0.0391).skeleton.height_m == pytest.approx(1.75, abs=0.01)
    small = written(tmp_path, body(unit=0.016))  # reads as 1.09 m in cm: no adult
    assert source(small, height_m=1.15).recording.facts["unit"] == "cm"
    assert source(small, unit="cm").skeleton.height_m == pytest.approx(1.09, abs=0.01)


def test_part_of_a_recording(tmp_path: Path) -> None:
    path = written(tmp_path, body())
    whole, part = source(path), source(path, start_s=0.25, stop_s=0.5)
    assert part.n_frames == 16
    first = next(part.frames())
    assert first.time_s == 0.0
    np.testing.assert_array_equal(first.position, list(whole.frames())[15].position)
    with pytest.raises(SourceError, match=r"no frame lies between 2 s and its end; the motion lasts 0.983 s"):
        source(path, start_s=2.0)
    with pytest.raises(SourceError, match=r"no frame lies between 0.5 s and 0.2 s"):
        source(path, start_s=0.5, stop_s=0.2)


def test_a_mirrored_body_is_refused(tmp_path: Path) -> None:
    def swap(name: str) -> str:
        return name.replace("Left", "#").replace("Right", "Left").replace("#", "Right")

    with pytest.raises(SourceError, match="left and right are swapped"):
        source(written(tmp_path, body(swap)))


@pytest.mark.parametrize("prefix", ["mixamorig:", "subject 1:", "Character1_", "ns:deep:"])
def test_prefixes_of_names_do_not_matter(tmp_path: Path, prefix: str) -> None:
    made = source(written(tmp_path, body(lambda name: prefix + name)))
    assert made.recording.facts["skeleton"] == "mixamo"
    assert made.skeleton.has("head_top", "left_toe_tip")


def test_fingers_props_and_equal_names_do_not_matter(tmp_path: Path) -> None:
    nodes = [
        *body(),
        Node("Sword", 0, np.array([0.0, 50.0, 0.0]), TURN),
        Node("LeftHand", 0, np.ones(3), TURN),
    ]
    made = source(written(tmp_path, nodes))
    np.testing.assert_allclose(place(next(made.frames()), "left_wrist"), [0.0, 0.71, 1.43], atol=1e-6)


def test_a_fixed_reference_root_and_six_channels_on_every_joint(tmp_path: Path) -> None:
    nodes = [Node("Reference", -1, np.zeros(3), ROOT)]
    nodes += [Node(n.name, n.parent + 1, n.offset, () if n.is_end else ROOT, n.is_end) for n in body()]
    columns = [(node, c) for node in nodes for c in node.channels]
    values = np.zeros((30, len(columns)))
    for k, (node, channel) in enumerate(columns):
        if channel.endswith("position"):
            values[:, k] = node.offset["XYZ".index(channel[0])]
    made = source(written(tmp_path, nodes, values))
    assert made.skeleton.height_m == pytest.approx(1.75, abs=0.01)
    np.testing.assert_allclose(place(next(made.frames()), "right_toe"), [0.13, -0.09, 0.02], atol=1e-6)
    np.testing.assert_allclose(
        made.skeleton.rest_position[ROLE_INDEX["left_wrist"]], [0, 0.71, 1.43], atol=1e-6
    )


def test_one_frame(tmp_path: Path) -> None:
    nodes = body()
    made = source(written(tmp_path, nodes, motion(nodes, 1), 0.25))
    assert (made.n_frames, made.rate_hz) == (1, 4.0)


ENGLISH = {
    "Hips": "pelvis",
    "Spine": "trunk",
    "Neck": "neck",
    "Head": "head",
    "Arm": "upperarm",
    "ForeArm": "forearm",
    "Hand": "hand",
    "UpLeg": "thigh",
    "Leg": "calf",
    "Foot": "foot",
    "ToeBase": "ball",
}


def english(name: str) -> str:
    for side, short in (("Left", "_l"), ("Right", "_r")):
        if name.startswith(side):
            return ENGLISH[name.removeprefix(side)] + short
    return ENGLISH[name]


def test_a_skeleton_without_a_card_is_read_by_names_and_symmetry(tmp_path: Path) -> None:
    made = source(written(tmp_path, body(english)))
    assert made.skeleton.name == "unknown"
    assert made.skeleton.has(*MAIN_ROLES, "chest", "left_toe")
    np.testing.assert_allclose(place(next(made.frames()), "right_knee"), [0.0, -0.09, 0.50], atol=1e-6)
    assert any("found by the joints' names" in note for note in made.skeleton.notes)


def test_an_unknown_skeleton_gets_a_card_to_complete(tmp_path: Path) -> None:
    path = written(tmp_path, body(lambda n: english(n).replace("head", "bone7")))
    with pytest.raises(SourceError) as error:
        source(path)
    text = str(error.value)
    assert text.startswith(f"{path}: no skeleton card fits the joints of this file; the nearest is ")
    assert "'pelvis', 'trunk', 'neck', 'bone7', 'upperarm_l'" in text
    assert "--set source.skeleton=FILE.yaml" in text
    card = text.partition("\n\n")[2]
    roles = yaml.safe_load(card)["roles"]
    assert roles["left_knee"] == "calf_l"
    assert roles["head"] == "?"
    # The card that the message prints works once its ? are filled in.
    mine = tmp_path / "mine.yaml"
    mine.write_text(card.replace("?", "bone7"))
    made = source(path, skeleton=str(mine))
    assert made.skeleton.name == "mine"
    assert made.skeleton.has("head")


def test_limbs_that_names_claim_and_the_tree_denies_are_not_believed(tmp_path: Path) -> None:
    nodes = [
        Node(n.name, n.parent, n.offset * (4.0 if n.name == "calf_l" else 1.0), n.channels, n.is_end)
        for n in body(english)
    ]
    with pytest.raises(SourceError, match='left_knee: "\\?"'):
        source(written(tmp_path, nodes))


def test_a_card_that_is_asked_for_and_does_not_fit(tmp_path: Path) -> None:
    path = written(tmp_path, body())
    assert source(path, skeleton="mixamo").skeleton.name == "mixamo"
    with pytest.raises(SourceError, match=r"skeleton 'xsens' does not fit: the file has no 'Chest4', "):
        source(path, skeleton="xsens")
    with pytest.raises(SourceError, match=r"no skeleton card is called 'mixmo'; did you mean 'mixamo'\?"):
        source(path, skeleton="mixmo")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("title: a\nroles: {pelvis: Hips", "no YAML: "),
        ("title: a\nroles: {pelvs: Hips}\n", "no role is called 'pelvs'; did you mean 'pelvis'?"),
        ("title: a\nroles: {pelvis: Hips}\n", "roles are missing: neck, head, left_shoulder"),
        ("title: a\nroles: {}\nunits: cm\n", "units: Extra inputs are not permitted"),
        ("title: a\nunit: yard\nroles: {}\n", "no unit is called 'yard'; legal are m, dm, cm, mm, inch, cmu"),
        ("just text", "valid dictionary"),
    ],
)
def test_a_wrong_card_is_told(tmp_path: Path, text: str, message: str) -> None:
    card = tmp_path / "card.yaml"
    card.write_text(text)
    with pytest.raises(SpecError) as error:
        source(written(tmp_path, body()), skeleton=str(card))
    assert str(card) in str(error.value)
    assert message in str(error.value)


def test_a_missing_card_is_told(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="the skeleton card cannot be read: No such file"):
        source(written(tmp_path, body()), skeleton=str(tmp_path / "none.yaml"))


@pytest.mark.parametrize("name", sorted(Registry(entry_points=False).cards("skeletons")))
def test_every_card_is_valid(name: str) -> None:
    card = load_card(Registry(entry_points=False).cards("skeletons")[name])
    assert card.title
    assert set(MAIN_ROLES) <= set(card.expanded())


@pytest.mark.parametrize(
    ("written_s", "rate"),
    [
        (0.0083333, 120.0),
        (0.008333, 120.0),
        (0.0333333, 30.0),
        (0.016667, 60.0),
        (0.008, 1 / 0.008),
        (0.004184, 1 / 0.004184),
        (0.008342, 1 / 0.008342),
        (0.04, 25.0),
        (1 / 29.97, 29.97),
    ],
)
def test_rates_are_snapped_within_a_thousandth(written_s: float, rate: float) -> None:
    assert snap_rate(written_s) == pytest.approx(rate, rel=1e-12)


def test_the_registry_knows_the_source() -> None:
    registry = Registry(entry_points=False)
    assert any(r.kind == "source" and r.name == "bvh" and r.component is Bvh for r in registry)
    assert Bvh.recognises(Path("walk.BVH")) and not Bvh.recognises(Path("walk.c3d"))


def test_a_body_without_size_is_refused(tmp_path: Path) -> None:
    nodes = [Node(n.name, n.parent, np.zeros(3), n.channels, n.is_end) for n in body()]
    with pytest.raises(SourceError, match="the skeleton has no height"):
        source(written(tmp_path, nodes))
