"""The Kinect source on tables written from an authored motion, of which everything is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from imitor import testing
from imitor.errors import SourceError
from imitor.motion.kinect_points import KINECT_V1, KINECT_V2, OPENNI, PointSet, canonical
from imitor.plugins.sources.kinect import Kinect, KinectConfig
from imitor.types import ROLE_INDEX, ROLES, SIDES
from known import known

Array = NDArray[np.float64]

DISTANCE_M, HEIGHT_M = 3.5, 0.9
SDK = {"left": "Left", "right": "Right"}
FRAMES = testing.make_frames("step_forward")
TRUTH = np.stack([f.position for f in FRAMES])


def sensor_points(points: PointSet, tilt_rad: float = 0.0, motion: Array = TRUTH) -> Array:
    """Return what a sensor at x = 3.5 m, 0.9 m over the floor, sees of a motion, shape (T, P, 3) [m]."""
    foot = "ankle" if points is OPENNI else "toe"
    roles = {
        "hip_center": "pelvis",
        "spine_base": "pelvis",
        "spine": "chest",
        "spine_mid": "chest",
        "torso": "chest",
    }
    roles |= {"shoulder_center": "neck", "spine_shoulder": "neck"}
    for side in SIDES:
        roles |= {
            f"{side}_foot": f"{side}_{foot}",
            f"{side}_thumb": f"{side}_hand",
            f"{side}_hand_tip": f"{side}_hand",
        }
    seen = motion[:, [ROLE_INDEX[roles.get(p, p)] for p in points.points]]
    x, y, z = np.moveaxis(seen, -1, 0)
    level = np.stack([-y, z - HEIGHT_M, DISTANCE_M - x], axis=-1)
    c, s = np.cos(tilt_rad), np.sin(tilt_rad)
    return np.asarray(level @ np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]]).T)


def sdk_name(point: str) -> str:
    """Return the name in the manner of the Microsoft SDK: HandTipLeft."""
    side, _, rest = point.partition("_")
    words = rest.split("_") if side in SIDES else point.split("_")
    return "".join(w.capitalize() for w in words) + SDK.get(side, "")


def as_cells(points: PointSet, p: Array) -> str:
    lines = ["; ".join(map(sdk_name, points.points))]
    lines += [";".join(" ".join(f"{v:.7g}" for v in point) for point in frame) + ";0" for frame in p]
    return "\n".join(lines) + "\n"


def as_rows(
    points: PointSet, p: Array, states: Any = None, stamps: Sequence[float | str] | None = None
) -> str:
    lines = ["Timestamp3,JointName,TrackingStatus,X,Y,Z"]
    for t, frame in enumerate(p):
        stamp = round(1000 * t / 30) if stamps is None else stamps[t]
        for k, (x, y, z) in enumerate(frame):
            state = "Tracked" if states is None else states[t][k]
            lines.append(f"{stamp},{sdk_name(points.points[k])},{state},{x:.7g},{y:.7g},{z:.7g}")
    return "\n".join(lines) + "\n"


def as_tuples(points: PointSet, p: Array) -> str:
    lines = ["Version0.1"]
    for t, frame in enumerate(p):
        groups = [
            f"({sdk_name(n)},Tracked,{x:.7g},{y:.7g},{z:.7g},0,0)"
            for n, (x, y, z) in zip(points.points, frame, strict=True)
        ]
        lines.append(f"{t},5,{round(1000 * t / 30)}," + ",".join(groups))
    return "\r\n".join(lines) + "\r\n"


def as_columns(points: PointSet, p: Array) -> str:
    """Write millimetres with confidences and microseconds, as OpenNI programs do."""
    lines = [
        "time,"
        + ",".join(f"JOINT_{n.upper()}_{a}" for n in points.points for a in ("x", "y", "z", "confidence"))
    ]
    for t, frame in enumerate(p):
        cells = [f"{1000 * x:.3f},{1000 * y:.3f},{1000 * z:.3f},1.0" for x, y, z in frame]
        lines.append(f"{round(1e6 * t / 30)}," + ",".join(cells))
    return "\n".join(lines) + "\n"


def as_numbers(
    points: PointSet, p: Array, mark: str = " ", extra: Sequence[float] = (), timed: bool = False
) -> str:
    lines = []
    for t, frame in enumerate(p):
        cells = [f"{t / 30:.6f}"] if timed else []
        cells += [f"{v:.7g}" for point in frame for v in (*point, *extra)]
        lines.append(mark.join(cells))
    return "\n".join(lines) + "\n"


LAYOUTS: dict[str, tuple[PointSet, Callable[[Array], str]]] = {
    "cells": (KINECT_V1, lambda p: as_cells(KINECT_V1, p)),
    "rows": (KINECT_V2, lambda p: as_rows(KINECT_V2, p)),
    "tuples": (KINECT_V2, lambda p: as_tuples(KINECT_V2, p)),
    "columns": (OPENNI, lambda p: as_columns(OPENNI, p)),
    "45 numbers": (OPENNI, lambda p: as_numbers(OPENNI, 1000 * p)),
    "46 numbers": (OPENNI, lambda p: as_numbers(OPENNI, p, ",", timed=True)),
    "60 numbers of 15": (OPENNI, lambda p: as_numbers(OPENNI, 1000 * p, ",", (0.5,))),
    "60 numbers of 20": (KINECT_V1, lambda p: as_numbers(KINECT_V1, p, ";")),
    "75 numbers": (KINECT_V2, lambda p: as_numbers(KINECT_V2, p, "\t")),
    "175 numbers": (KINECT_V2, lambda p: as_numbers(KINECT_V2, p, " ", (0.0, 0.0, 0.0, 1.0))),
}


def small_kinect(folder: Path) -> dict[str, Any]:
    """Write a person who steps forward; return the options that read the file."""
    file = folder / "person.csv"
    file.write_text(as_rows(KINECT_V2, sensor_points(KINECT_V2)))
    return {"path": str(file)}


def read(folder: Path, text: str, name: str = "clip.csv", **options: Any) -> Kinect:
    (folder / name).write_text(text)
    source = Kinect(KinectConfig(path=str(folder / name), **options))
    source.start()
    return source


def roles(source: Kinect, name: str) -> Array:
    return source.recording.position[:, ROLE_INDEX[name]]


def test_it_keeps_the_contract_of_a_source(tmp_path: Path) -> None:
    testing.check_component(Kinect, small_kinect(tmp_path))


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_back_the_motion(tmp_path: Path, layout: str) -> None:
    points, write = LAYOUTS[layout]
    text = write(sensor_points(points, tilt_rad=0.1))
    source = read(tmp_path, text, tilt_rad=0.1, floor=-HEIGHT_M)
    assert Kinect.recognises(tmp_path / "clip.csv")
    assert source.skeleton.name == points.name
    assert (source.n_frames, source.rate_hz) == (len(TRUTH), 30.0)
    given = [ROLE_INDEX[r] for r in ROLES if source.skeleton.has(r) and "wrist" not in r]
    seen = source.recording.position[:, given] + (DISTANCE_M, 0.0, 0.0)
    moving = 0.012 if source.recording.facts["layout"] in ("rows", "tuples") else 2e-4  # stamps in whole ms
    wanted = TRUTH[:, given]
    pelvis = given.index(ROLE_INDEX["pelvis"])
    wanted[:, pelvis] = 0.5 * (TRUTH[:, ROLE_INDEX["left_hip"]] + TRUTH[:, ROLE_INDEX["right_hip"]])
    np.testing.assert_allclose(seen, wanted, atol=moving)


@pytest.mark.parametrize("tilt", [-0.1, 0.0, 0.15])
def test_tilt_and_floor_are_found_from_standing_feet(tmp_path: Path, tilt: float) -> None:
    source = read(tmp_path, as_rows(KINECT_V2, sensor_points(KINECT_V2, tilt)))
    assert source.recording.facts["tilt_rad"] == pytest.approx(tilt, abs=0.035)
    for side in SIDES:
        standing = roles(source, f"{side}_ankle")[0]
        assert standing[2] == pytest.approx(TRUTH[0, ROLE_INDEX[f"{side}_ankle"], 2], abs=0.02)
    assert source.skeleton.height_m == pytest.approx(1.75, abs=0.08)


def test_the_15_points_are_derived_from_20_and_25(tmp_path: Path) -> None:
    given: dict[str, Any] = {"tilt_rad": 0.0, "floor": -HEIGHT_M}
    twenty = read(tmp_path, as_cells(KINECT_V1, sensor_points(KINECT_V1)), points=15, **given)
    full = read(tmp_path, as_rows(KINECT_V2, sensor_points(KINECT_V2)), points=15, **given)
    own = read(tmp_path, as_columns(OPENNI, sensor_points(OPENNI)), **given)
    assert twenty.skeleton.name == full.skeleton.name == own.skeleton.name == "openni"
    assert twenty.skeleton.roles == own.skeleton.roles
    assert not own.skeleton.has("left_toe")
    np.testing.assert_allclose(twenty.recording.position, own.recording.position, atol=2e-3)
    np.testing.assert_allclose(full.recording.position, own.recording.position, atol=0.012)


def test_the_wrist_of_15_points_lies_on_the_forearm(tmp_path: Path) -> None:
    source = read(tmp_path, as_columns(OPENNI, sensor_points(OPENNI)))
    elbow, wrist, hand = (roles(source, f"left_{j}") for j in ("elbow", "wrist", "hand"))
    np.testing.assert_allclose(wrist, elbow + 0.73 * (hand - elbow), atol=1e-9)


def test_tracking_states_are_kept_and_decide(tmp_path: Path) -> None:
    states = [["Tracked"] * 25 for _ in TRUTH]
    hand, wrist = (KINECT_V2.points.index(f"left_{j}") for j in ("hand", "wrist"))
    for t in range(20, 30):
        states[t][hand], states[t][wrist] = "Inferred", "NotTracked"
    stamps = [33.0 * t for t in range(len(TRUTH))]
    text = as_rows(KINECT_V2, sensor_points(KINECT_V2), states, stamps)
    kept = read(tmp_path, text, resample=False).recording
    at = [ROLE_INDEX["left_hand"], ROLE_INDEX["left_wrist"]]
    assert kept.valid[20:30, at].tolist() == [[True, False]] * 10
    assert kept.valid[:20, at].all()
    assert kept.valid[30:, at].all()
    assert known(kept.confidence)[25, at].tolist() == [0.5, 0.0]
    assert np.isnan(kept.position[20:30, at[1]]).all()
    strict = read(tmp_path, text, resample=False, min_confidence=1.0).recording
    assert not strict.valid[20:30, at].any()
    assert strict.valid[:20, at].all()


def test_points_at_zero_and_nan_are_lost(tmp_path: Path) -> None:
    p = sensor_points(KINECT_V1)
    elbow = KINECT_V1.points.index("right_elbow")
    p[10, elbow], p[11, elbow] = 0.0, np.nan
    valid = read(tmp_path, as_numbers(KINECT_V1, p)).recording.valid[:, ROLE_INDEX["right_elbow"]]
    assert np.flatnonzero(~valid).tolist() == [10, 11]


def test_uneven_stamps_are_resampled(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    time = np.arange(60) / 30 + rng.uniform(-0.008, 0.008, 60)
    time -= time[0]
    motion = np.broadcast_to(TRUTH[:1], (60, *TRUTH.shape[1:])).copy()
    motion[..., 0] += 0.5 * time[:, None]
    text = as_rows(
        KINECT_V2, sensor_points(KINECT_V2, motion=motion), stamps=[f"{1e3 * t:.4f}" for t in time]
    )
    source = read(tmp_path, text, tilt_rad=0.0)
    x = roles(source, "head")[:, 0]
    np.testing.assert_allclose(x - x[0], 0.5 * np.arange(len(x)) / 30, atol=1e-4)
    as_even = read(tmp_path, text, tilt_rad=0.0, resample=False)
    assert as_even.n_frames == 60
    assert as_even.rate_hz == pytest.approx(59 / time[-1])


def test_in_a_long_gap_the_points_are_lost(tmp_path: Path) -> None:
    kept = [t for t in range(len(TRUTH)) if not 30 <= t < 60]
    text = as_rows(KINECT_V2, sensor_points(KINECT_V2)[kept], stamps=[100 * t / 3 for t in kept])
    source = read(tmp_path, text)
    assert source.n_frames == len(TRUTH)
    lost = np.flatnonzero(~source.recording.valid.any(axis=1))
    assert set(range(31, 59)) <= set(lost.tolist()) <= set(range(29, 61))
    assert read(tmp_path, text, longest_gap_s=2.0).recording.valid[:, ROLE_INDEX["head"]].all()


def test_frames_without_a_body_at_the_ends_are_left_out(tmp_path: Path) -> None:
    p = sensor_points(KINECT_V1)
    p[:5], p[-3:] = 0.0, 0.0
    source = read(tmp_path, as_numbers(KINECT_V1, p))
    assert source.n_frames == len(p) - 8
    assert "5 frames before and 3 after the body is in view are left out" in source.skeleton.notes


def test_sides_are_checked_swapped_and_mirrored(tmp_path: Path) -> None:
    p = sensor_points(KINECT_V1)
    plain = read(tmp_path, as_numbers(KINECT_V1, p)).recording.position
    mirrored = as_numbers(KINECT_V1, p * (-1.0, 1.0, 1.0))
    with pytest.raises(SourceError) as refused:
        read(tmp_path, mirrored)
    assert str(refused.value) == (
        f"{tmp_path / 'clip.csv'}: left and right are swapped: the feet point backwards if the names are right. Set "
        "sides: swap if the names are those a viewer sees, sides: mirror if the whole picture is mirrored, sides: keep "
        "if it is right"
    )
    np.testing.assert_allclose(read(tmp_path, mirrored, sides="mirror").recording.position, plain, atol=1e-6)
    exchanged = [
        KINECT_V1.points.index(n.replace("left", "?").replace("right", "left").replace("?", "right"))
        for n in KINECT_V1.points
    ]
    swapped = as_numbers(KINECT_V1, p[:, exchanged])
    np.testing.assert_allclose(read(tmp_path, swapped, sides="swap").recording.position, plain, atol=1e-6)
    read(tmp_path, mirrored, sides="keep")


def test_a_part_is_read(tmp_path: Path) -> None:
    text = as_numbers(KINECT_V1, sensor_points(KINECT_V1))
    whole, part = read(tmp_path, text), read(tmp_path, text, start_s=1.0, stop_s=2.0)
    np.testing.assert_array_equal(part.recording.position, whole.recording.position[30:61])


def test_the_rest_pose_stands_on_the_floor_with_arms_out(tmp_path: Path) -> None:
    source = read(tmp_path, as_rows(KINECT_V2, sensor_points(KINECT_V2)))
    rest = {r: source.skeleton.rest_position[ROLE_INDEX[r]] for r in source.skeleton.roles}
    assert rest["left_ankle"][2] == pytest.approx(source.skeleton.ankle_height_m)
    assert (
        rest["left_hand"][1]
        > rest["left_shoulder"][1]
        > 0
        > rest["right_shoulder"][1]
        > rest["right_hand"][1]
    )
    assert rest["left_toe"][0] > rest["left_ankle"][0]
    assert rest["head"][2] > rest["neck"][2] > rest["chest"][2] > rest["pelvis"][2]


def test_names_of_points() -> None:
    assert canonical("HandTipLeft") == canonical("left_hand_tip") == "left_hand_tip"
    assert (
        canonical("XN_SKEL_LEFT_FOOT") == canonical("JOINT_LEFT_FOOT") == canonical("l_foot") == "left_foot"
    )
    assert canonical("HipCentre") == "hip_center"
    assert canonical("AU06") is None


@pytest.mark.parametrize(
    "text",
    [
        "a,b,c\n1,2,3\n",
        "0.1 0.2 0.3\n",
        "PathFileType\t4\t(X/Y/Z)\tx.trc\n",
        "Frame,Time,LFHD\n",
        "\n\n",
        "\x00\x01" * 40,
    ],
)
def test_other_tables_are_not_taken_for_ours(tmp_path: Path, text: str) -> None:
    (tmp_path / "other.csv").write_text(text)
    assert not Kinect.recognises(tmp_path / "other.csv")
    assert not Kinect.recognises(tmp_path / "nowhere.csv")
    (tmp_path / "other.dat").write_text(as_numbers(KINECT_V1, sensor_points(KINECT_V1)))
    assert not Kinect.recognises(tmp_path / "other.dat")


TABLE = as_numbers(OPENNI, sensor_points(OPENNI)[:3], ",").split("\n")
ROWS = as_rows(KINECT_V2, sensor_points(KINECT_V2)[:2]).split("\n")
NOT_A_TABLE = (
    "is no table of skeleton points: expected a header of point names, lines of x y z for 15, 20 or 25 points (45, 60 "
    "or 75 columns, also with confidences or quaternions and a leading time), or brackets (name,state,x,y,z)"
)


def changed(lines: list[str], line: int, old: str, new: str) -> str:
    """Return a text with one thing in one line (from 1) changed."""
    assert old in lines[line - 1]
    return "\n".join([*lines[: line - 1], lines[line - 1].replace(old, new, 1), *lines[line:]])


def cell(lines: list[str], line: int, k: int) -> str:
    return lines[line - 1].split(",")[k]


BROKEN: dict[str, tuple[str, str]] = {
    "empty": (" \n", ": the file is empty"),
    "binary": ("\0\1" * 50, ": is not a text file, so not a table of skeleton points (.csv, .txt)"),
    "another table": ("a,b\n1,2\n", f":1: {NOT_A_TABLE}"),
    "too few columns": (
        changed(TABLE, 2, cell(TABLE, 2, 0) + ",", ""),
        ":2: this line has 44 columns, the first has 45",
    ),
    "a word": (changed(TABLE, 3, cell(TABLE, 3, 4), "left"), ":3: value 5 of this line is 'left', not a number"),
    "infinite": (changed(TABLE, 3, cell(TABLE, 3, 0), "inf"), ":3: value 1 of this line is 'inf', not a finite number"),
    "only a header": (ROWS[0], ": holds no frame: there is only a header"),
    "a row cut off": (changed(ROWS, 4, "Tracked,", ""), ":4: this line has 5 columns, the header has 6"),
    "an unknown point": (
        changed(ROWS, 3, "SpineMid", "Tail"),
        ":3: 'Tail' is no point of a skeleton of 15, 20 or 25 points",
    ),
    "an unknown state": (
        changed(ROWS, 3, "Tracked", "Lost"),
        ":3: 'Lost' is no tracking state; legal are Tracked, Inferred, NotTracked and 0 to 1",
    ),
    "back in time": (
        as_rows(KINECT_V2, sensor_points(KINECT_V2)[:2], stamps=[66, 33]),
        ":27: time stamp 33 is not later than 66 before it; sort the frames and leave out repeated ones",
    ),
    "a bracket left open": (
        as_tuples(KINECT_V2, sensor_points(KINECT_V2)[:1]).replace("\r\n", "\n").rstrip(")\n"),
        ":2: a bracket of this line is not closed; is the file cut off?",
    ),
    "no body": (
        as_numbers(OPENNI, 0.0 * sensor_points(OPENNI)[:3]),
        ": head, left_shoulder, left_hip, right_shoulder, right_hip: never seen; a body needs head, shoulders and "
        "hips. Lower min_confidence, or capture again with the whole body in view",
    ),
    "a point only": (
        as_numbers(OPENNI, 0.0 * sensor_points(OPENNI)[:3] + 1.0),
        ": the skeleton has no size: all its points lie in one place",
    ),
    "a confidence of 7": (
        as_numbers(KINECT_V1, sensor_points(KINECT_V1)[:2], ",", (7.0,)),
        ":1: confidence of point 1 is 7; legal is 0 to 1",
    ),
    "mixed sets": (
        changed(ROWS, 3, "SpineMid", "HipCenter"),
        ": the points fit no skeleton of 15, 20 or 25 points; not of 20: left_hand_tip, left_thumb, neck, "
        "right_hand_tip, right_thumb, spine_base, spine_mid, spine_shoulder",
    ),
    "offsets alone": (
        ",".join(["1"] * 66) + "\n",
        ": holds 22 joints as offsets in their parents, which are no points without the joint angles; give their table "
        "with --set source.angles_path=FILE",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BROKEN)
def test_what_is_said_about_a_broken_file(tmp_path: Path, case: str) -> None:
    text, message = BROKEN[case]
    with pytest.raises(SourceError) as error:
        read(tmp_path, text)
    assert str(error.value) == f"{tmp_path / 'clip.csv'}{message}"


def test_what_is_said_about_files_that_are_not_there(tmp_path: Path) -> None:
    for path, message in ((tmp_path, "is a folder; give a table of skeleton points (.csv, .txt)"),
                          (tmp_path / "no.csv", "there is no such file")):  # fmt: skip
        with pytest.raises(SourceError) as error:
            Kinect(KinectConfig(path=str(path))).start()
        assert str(error.value) == f"{path}: {message}"
    with pytest.raises(
        SourceError, match=r"angles\.txt: there is no such file; 'm_positions\.txt' holds 22 joints"
    ):
        read(tmp_path, ",".join(["1"] * 66), "m_positions.txt")


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 4000), st.binary(min_size=1, max_size=3))
def test_damage_is_read_or_refused_with_a_message(
    tmp_path_factory: pytest.TempPathFactory, at: int, junk: bytes
) -> None:
    data = as_rows(KINECT_V2, sensor_points(KINECT_V2)[:3]).encode()
    file = tmp_path_factory.getbasetemp() / "damaged.csv"
    file.write_bytes(data[: at % len(data)] + junk + data[at % len(data) + len(junk) :])
    source = Kinect(KinectConfig(path=str(file)))
    try:
        source.start()
    except SourceError as error:
        assert str(error).startswith(str(file))
    else:
        assert np.isfinite(source.recording.position[source.recording.valid]).all()
