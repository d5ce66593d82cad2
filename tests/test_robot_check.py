"""What `imitor robot check` says about good and bad cards."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from imitor.errors import SpecError
from imitor.registry import Registry
from imitor.robot.check import Finding, check_card
from imitor.robot.rules import LEVELS
from small_humanoid import SmallHumanoid

REGISTRY = Registry(entry_points=False)


@pytest.fixture(autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMITOR_CACHE", str(tmp_path_factory.getbasetemp() / "hulls"))


def findings(human: SmallHumanoid, folder: Path, *, mjcf: bool = False) -> list[Finding]:
    return check_card(human.write(folder, mjcf=mjcf), REGISTRY)


def messages(found: list[Finding], *levels: str) -> list[str]:
    return [f.message for f in found if not levels or f.level in levels]


@pytest.mark.parametrize("name", ["unitree_g1", "romeo", "talos"])
def test_cards_that_come_along_are_sound(name: str) -> None:
    assert messages(check_card(name, REGISTRY), "error", "warning") == []


@pytest.mark.parametrize("mjcf", [False, True], ids=["urdf", "mjcf"])
def test_a_good_card_of_the_user_is_sound(tmp_path: Path, mjcf: bool) -> None:
    found = findings(SmallHumanoid(), tmp_path, mjcf=mjcf)
    assert messages(found, "error", "warning") == []
    assert any("pairs are looked at for self-collision" in m for m in messages(found, "note"))
    assert any("no speed limit" in m for m in messages(found, "note")) == mjcf


def mirror(human: SmallHumanoid) -> None:
    for role, frame in list(human.card["roles"].items()):
        if "{side}" in frame:
            link = frame.removeprefix("{side}_")
            human.card["roles"][role] = f"{{side}}_{link}"
    for link in human.links:
        link.at = (link.at[0], -link.at[1], link.at[2])


def look_backward(human: SmallHumanoid) -> None:
    for link in human.links:
        if link.name.endswith("shank"):
            link.range = (-2.3, 0.0)


def fall_forward(human: SmallHumanoid) -> None:
    human.link("chest").box_at = (0.4, 0.0, 0.14)


def lengthen(human: SmallHumanoid) -> None:
    link = human.link("left_forearm")
    link.at = (0.0, 0.0, 1.5 * link.at[2])


def no_mass(human: SmallHumanoid) -> None:
    for link in human.links:
        link.mass = 0.0


def no_boxes(human: SmallHumanoid) -> None:
    for link in human.links:
        link.box = (0.0, 0.0, 0.0)


def in_millimetres(human: SmallHumanoid) -> None:
    for link in human.links:
        link.mass *= 1000.0


def motors(human: SmallHumanoid) -> None:
    for link in human.links:
        link.speed = 30.0


def head_down(human: SmallHumanoid) -> None:
    for side in ("left", "right"):
        x, y, z = human.link(f"{side}_shoulder_carrier").at
        human.link(f"{side}_shoulder_carrier").at = (x, y, -z - 0.2)


def knee_on_hip(human: SmallHumanoid) -> None:
    human.card["roles"]["knee"] = "{side}_thigh"


def edit(**changes: object) -> Callable[[SmallHumanoid], None]:
    """Return a change of the card: ``soles__frame="x"`` sets ``card["soles"]["frame"]``."""

    def apply(human: SmallHumanoid) -> None:
        for key, value in changes.items():
            *path, last = key.split("__")
            place = human.card
            for step in path:
                place = place.setdefault(step, {})
            if value is None:
                del place[last]
            else:
                place[last] = value

    return apply


SOLE_CW = [[0.13, -0.04], [-0.05, -0.04], [-0.05, 0.04], [0.13, 0.04]]

BAD = [
    (edit(roles__elbow=None), "warning",
     "roles.elbow is not given: no left_upper_arm, right_upper_arm, left_forearm"),
    (edit(roles__hand=None), "warning", "roles.hand is not given: no left_hand, right_hand for this robot"),
    (edit(roles__head=None), "warning", "roles.head is not given: no head for this robot"),
    (edit(roles__neck=None), "note", "roles.neck is not given; no task needs it"),
    (edit(roles__chest=None), "note", "roles.chest is not given: the waist stands for it"),
    (edit(roles__elbow="{side}_forarm"), "error",
     "roles.left_elbow: the model has no link or joint 'left_forarm'; did you mean 'left_forearm'?"),
    (edit(roles__knee="left_shank"), "error",
     "roles.knee: 'left_shank' stands for both sides; write {side}, {s} or {S} for the side"),
    (edit(soles__frame="{side}_sole"), "error", "soles.frame: the model has no link or joint 'left_sole'"),
    (edit(standing={"left_kne": 0.1}), "error",
     "standing: the model has no joint 'left_kne'; did you mean 'left_knee'?"),
    (edit(limits__speed_rad_s={"waist": 1.0}), "error",
     "limits.speed_rad_s: the model has no joint 'waist'; did you mean 'waist_yaw'?"),
    (edit(collision={"skip": [["head", "chess"]]}), "error",
     "collision.skip: the model has no link 'chess'; did you mean 'chest'?"),
    (edit(coupled=[{"joints": ["left_knee", "left_ankle"]}]), "error",
     "coupled: the model has no joint 'left_ankle'"),
    (edit(locked={"waist_yaw": 0.0}, standing={"waist_yaw": 0.1}), "error",
     "standing.waist_yaw: the joint is in `locked`"),
    (edit(locked={"waist_yaw": 0.0}), "note", "1 joints are not moved: waist_yaw"),
    (edit(coupled=[{"joints": ["left_hip_roll", "right_hip_roll"]}]), "note",
     "17 joints, 16 of them independent"),
    (edit(standing={"waist_yaw": 3.0}), "warning",
     "standing.waist_yaw: 3 rad is outside its limits -2.500 to 2.500"),
    (edit(standing={"{side}_ankle_pitch": 0.2}), "warning", "the left sole is not flat when standing"),
    (edit(standing={"left_knee": 0.8, "left_ankle_pitch": -0.4, "left_hip_pitch": -0.4}), "warning",
     "mm apart in height when standing"),
    (edit(soles__polygon_m=SOLE_CW), "warning", "soles.polygon_m: list the corners counter-clockwise"),
    (edit(soles__polygon_m=[[0, 0], [0.1, 0], [0.2, 0]]), "error",
     "soles.polygon_m: its corners lie on a line"),
    (edit(soles__translation_m=[0.0, 0.3, -0.05]), "warning",
     "the left ankle is not over its sole when standing"),
    (edit(soles__translation_m=[0.0, 0.0, 0.05]), "error", "the left ankle lies below its sole"),
    (edit(soles__translation_m=[-0.09, 0.0, -0.05]), "warning",
     "the soles reach 0.040 m in front of the ankle and 0.140 m behind"),
    (edit(t_pose={}), "warning", "left_upper_arm points 90° away from sideways in `t_pose`"),
    (edit(limits={}), "note", "there are no acceleration limits"),
    (edit(model={"file": "gone.urdf"}), "error", "there is no model file"),
    (edit(licence=None), "error", "licence: required, but not given"),
    (mirror, "error", "all roles: left lies to the right of right (y is to the left)"),
    (look_backward, "warning", "left_knee bends so that the foot goes forward (x)"),
    (head_down, "error", "mid_shoulder is not above mid_hip when standing; the base link's z must be up"),
    (fall_forward, "warning", "m outside the soles when standing"),
    (lengthen, "warning", "left_upper_arm is 0.330 m long, right_upper_arm 0.220 m"),
    (knee_on_hip, "error", "left_thigh has no length: its two roles are one point"),
    (edit(roles__wrist="{side}_foot"), "warning", "a human as tall as the robot (1.26 m) has 0.184 m"),
    (no_mass, "error", "the model has no mass"),
    (in_millimetres, "warning", "a mass of 24800.00 kg is improbable for its size"),
    (no_boxes, "warning",
     "its model has no collision geometry: self-collision is neither measured nor avoided"),
    (motors, "warning",
     "speed limits above 15 rad/s are those of motors without load (left_hip_roll, "
     "left_hip_pitch, left_knee, left_ankle_pitch and 13 more)"),
]  # fmt: skip


@pytest.mark.parametrize(("spoil", "level", "text"), BAD, ids=[b[2][:40] for b in BAD])
def test_what_is_wrong_is_said(
    tmp_path: Path, spoil: Callable[[SmallHumanoid], None], level: str, text: str
) -> None:
    human = SmallHumanoid()
    assert not any(text in m for m in messages(findings(human, tmp_path)))
    spoil(human)
    found = findings(human, tmp_path)
    assert any(text in m for m in messages(found, level)), "\n".join(map(str, found))
    assert [LEVELS.index(f.level) for f in found] == sorted(LEVELS.index(f.level) for f in found)


def test_every_wrong_name_is_said_at_once(tmp_path: Path) -> None:
    human = SmallHumanoid()
    edit(roles__elbow="{side}_ulna", standing={"knee": 1.0}, locked={"thumb": 0.0})(human)
    assert len(messages(findings(human, tmp_path), "error")) == 4


def test_joints_without_limits(tmp_path: Path) -> None:
    path = SmallHumanoid().write(tmp_path, mjcf=True)
    model = tmp_path / "small.xml"
    text = model.read_text(encoding="utf-8")
    model.write_text(text.replace(' range="-0.6 0.6" limited="true"', ""), encoding="utf-8")
    found = messages(check_card(path, REGISTRY), "warning")
    joints = "left_hip_roll, left_ankle_roll, right_hip_roll, right_ankle_roll"
    assert f"no position limits: {joints}; ±2π is assumed; give limits.position_rad" in found


def test_a_joint_that_turns_for_ever(tmp_path: Path) -> None:
    path = SmallHumanoid().write(tmp_path)
    model = tmp_path / "small.urdf"
    text = model.read_text(encoding="utf-8")
    model.write_text(
        text.replace('"waist_yaw" type="revolute"', '"waist_yaw" type="continuous"'), encoding="utf-8"
    )
    (finding,) = check_card(path, REGISTRY)
    assert finding.level == "error"
    assert "not waist_yaw; give them limits in the model, or list them in `locked`" in finding.message


def test_a_link_and_a_joint_of_one_name(tmp_path: Path) -> None:
    human = SmallHumanoid()
    human.card["locked"] = {"left_shank": 0.0}
    path = human.write(tmp_path)
    model = tmp_path / "small.urdf"
    text = model.read_text(encoding="utf-8")
    model.write_text(text.replace('joint name="left_knee"', 'joint name="left_shank"'), encoding="utf-8")
    (finding,) = check_card(path, REGISTRY)
    assert finding.level == "error"
    assert "left_shank" in finding.message


def test_a_model_that_is_no_robot(tmp_path: Path) -> None:
    path = SmallHumanoid().write(tmp_path)
    (tmp_path / "small.urdf").write_text("<robot", encoding="utf-8")
    (finding,) = check_card(path, REGISTRY)
    assert finding.level == "error"
    assert "cannot be read as a robot" in finding.message


def test_a_card_that_is_not_there_is_an_error_of_the_call(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="no robot is called 'unitree_g2'"):
        check_card("unitree_g2", REGISTRY)
    with pytest.raises(SpecError, match="there is no such robot card file"):
        check_card(tmp_path / "x.yaml", REGISTRY)
