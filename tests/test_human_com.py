"""The filter human_com: the two mass tables, partial skeletons, losses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imitor import HumanFrame, Skeleton
from imitor.human import masses
from imitor.human.body import Body
from imitor.kinds import Context
from imitor.plugins.filters.human_com import HumanCom, HumanComConfig
from imitor.plugins.sources.performer import Performer, PerformerConfig
from imitor.types import N_ROLES, ROLE_INDEX, ROLES, Array, BoolArray

KINECT_15 = ("neck", "head", "chest", *(f"{s}_{j}" for s in ("left", "right") for j in (
    "shoulder", "elbow", "hand", "hip", "knee", "ankle")))  # fmt: skip


def make(skeleton: Skeleton, **options: Any) -> HumanCom:
    stage = HumanCom(HumanComConfig(**options), Context(None, skeleton, 0.01))  # type: ignore[arg-type]
    stage.start()
    return stage


def skeleton(roles: tuple[str, ...] = ROLES, sex: str = "male") -> Skeleton:
    return Skeleton("test", frozenset(roles), np.full((N_ROLES, 3), np.nan), 1.75, sex=sex)


def frame(position: Array, roles: tuple[str, ...] = ROLES) -> HumanFrame:
    valid = np.zeros(N_ROLES, dtype=bool)
    valid[[ROLE_INDEX[r] for r in roles]] = True
    seen = np.where(valid[:, None], position, np.nan)
    seen.flags.writeable = False
    return HumanFrame(0.0, seen, valid)


def performer(**options: Any) -> Performer:
    source = Performer(PerformerConfig(**options))
    source.start()
    return source


def standing(sex: str = "male") -> Array:
    """A person standing straight, arms down, of height 1."""
    position = Body(height_m=1.0, sex=sex).rest.copy()
    for side in ("left", "right"):
        shoulder = position[ROLE_INDEX[f"{side}_shoulder"]]
        for part in ("elbow", "wrist", "hand"):
            i = ROLE_INDEX[f"{side}_{part}"]
            position[i] = shoulder - [0, 0, np.linalg.norm(position[i] - shoulder)]
    return position


@pytest.mark.parametrize(("sex", "height"), [("male", 0.566), ("female", 0.569)])
def test_deleva_check_value(sex: str, height: float) -> None:
    com = make(skeleton(sex=sex)).step(frame(standing(sex))).com
    assert com is not None
    assert com[2] == pytest.approx(height, abs=0.002)
    assert not com.flags.writeable


def test_winter_check_value() -> None:
    stage = make(skeleton(KINECT_15))
    assert stage.model == "winter"
    position = standing()
    for side in ("left", "right"):  # a depth camera's hand point lies in the palm
        wrist = position[ROLE_INDEX[f"{side}_wrist"]]
        position[ROLE_INDEX[f"{side}_hand"]] = wrist - [0, 0, 0.054]
    position[ROLE_INDEX["head"], 2] = 0.93  # at the ear canal
    com = stage.step(frame(position, KINECT_15)).com
    assert com is not None
    assert com[2] == pytest.approx(0.577, abs=0.003)


def test_it_finds_the_performers_com() -> None:
    source = performer(scenario="single_leg_balance", sex="female")
    stage = make(source.skeleton, keep=False)
    for i, seen in enumerate(source.frames()):
        seen.com = None
        com = stage.step(seen).com
        assert com is not None
        np.testing.assert_allclose(com, source.truth.com[i], atol=1e-12)


def test_winter_agrees_with_deleva_on_a_moving_body() -> None:
    source = performer(scenario="single_leg_balance", rate_hz=10)
    stage = make(source.skeleton, model="winter")
    error = []
    for i, seen in enumerate(source.frames()):
        seen.com = None
        com = stage.step(seen).com
        assert com is not None
        error.append(np.linalg.norm(com[:2] - source.truth.com[i, :2]))
    assert max(error) < 0.06


def test_a_com_of_the_source_is_kept_unless_told_otherwise() -> None:
    given_com = np.array([1.0, 2.0, 3.0])
    seen = frame(standing())
    seen.com = given_com
    assert make(skeleton()).step(seen).com is given_com
    replaced = make(skeleton(), keep=False).step(seen).com
    assert replaced is not None
    assert replaced[2] == pytest.approx(0.566, abs=0.002)


def test_without_toes_and_fingers_little_changes() -> None:
    exact = make(skeleton()).step(frame(standing())).com
    fewer = tuple(r for r in ROLES if not r.endswith(("heel", "toe_tip", "hand", "head_top")))
    stage = make(skeleton(fewer))
    assert stage.model == "deleva"
    com = stage.step(frame(standing(), fewer)).com
    assert exact is not None
    assert com is not None
    np.testing.assert_allclose(com, exact, atol=0.004)


def test_a_lost_limb_falls_back_to_its_nearest_joint() -> None:
    position = standing()
    stage = make(skeleton())
    lost = tuple(r for r in ROLES if r not in {"left_elbow", "left_wrist", "left_hand"})
    com = stage.step(frame(position, lost)).com
    moved = position.copy()
    for part in ("elbow", "wrist", "hand"):
        moved[ROLE_INDEX[f"left_{part}"]] = position[ROLE_INDEX["left_shoulder"]]
    expected = make(skeleton()).step(frame(moved)).com
    assert com is not None
    assert expected is not None
    np.testing.assert_allclose(com, expected, atol=1e-12)


def test_while_the_trunk_is_lost_the_last_com_is_held() -> None:
    stage = make(skeleton())
    limbs = tuple(r for r in ROLES if r.endswith(("elbow", "wrist", "knee", "ankle")))
    assert stage.step(frame(standing(), limbs)).com is None
    before = stage.step(frame(standing())).com
    assert before is not None
    assert stage.step(frame(standing() + 1.0, limbs)).com is before
    stage.reset()
    assert stage.step(frame(standing(), limbs)).com is None


@given(st.lists(st.booleans(), min_size=N_ROLES, max_size=N_ROLES), st.sampled_from(["deleva", "winter"]))
def test_weights_are_an_average_of_known_roles(valid: list[bool], model: str) -> None:
    known: BoolArray = np.array(valid)
    w = masses.weights(masses.deleva("male") if model == "deleva" else masses.winter(), known)
    if w is not None:
        assert w.sum() == pytest.approx(1.0)
        assert not w[~known].any()
        shift = np.array([0.3, -0.2, 0.9])
        position = np.where(known[:, None], standing(), 0.0)
        moved = w @ (position + shift) - w @ position
        np.testing.assert_allclose(moved, shift, atol=1e-12)
    else:
        trunk = ("left_hip", "right_hip", "pelvis", "chest", "neck", "left_shoulder", "right_shoulder")
        assert not all(known[ROLE_INDEX[r]] for r in trunk)
