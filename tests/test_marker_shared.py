"""The shared optical recordings: read, sets found, gaps as their list says, one take against its skeleton file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from asf_amc import bone_ends, read_amc, read_asf
from imitor import testing
from imitor.motion.clip import Clip
from imitor.motion.marker_file import find_gaps
from imitor.motion.normalise import handedness
from imitor.motion.trc_file import read_trc
from imitor.plugins.sources.c3d import C3d, C3dConfig
from imitor.plugins.sources.trc import Trc, TrcConfig
from imitor.types import ROLE_INDEX
from known import known

pytestmark = pytest.mark.shared

SETS = {
    "cmu_c3d/02_01.c3d": "cmu_41", "cmu_c3d/05_13.c3d": "cmu_41", "cmu_c3d/cmu_dribble_shoot_basketball.c3d": "cmu_41",
    "c3d_markers/nick_freeform_001.c3d": "vicon_53", "c3d_markers/PiG_Motion-FlatFoot-Hole.c3d": "plug_in_gait",
    "c3d_markers/pycgm_Movement_trial.c3d": "plug_in_gait", "c3d_markers/rehazenter_2014001_C1_01.c3d": "isb_52",
    "c3d_markers/walking2.c3d": "lower_body_clusters", "trc/human.trc": "humanoid_35",
    "trc/walk_opensim_markers.trc": "rajagopal", "trc/STS1.trc": "opencap",
    "trc/markers_StairUp3.trc": "plug_in_gait_clusters", "trc/ballet_reduced.trc": "cmu_41", "trc/T.trc": "cmu_41",
    "trc/dataWithBlanksForMissingMarkers.trc": "lower_body_clusters",
}  # fmt: skip
NO_ARMS = ("c3d_markers/walking2.c3d", "trc/dataWithBlanksForMissingMarkers.trc")
SHORT = "trc/dataWithBlanksForMissingMarkers.trc"
"""Its person is seen for 13 frames."""


def read(shared: Path, file: str) -> C3d | Trc:
    path = str(shared / "mocap" / file)
    if file.endswith(".c3d"):
        pytest.importorskip("ezc3d")
        source: C3d | Trc = C3d(C3dConfig(path=path))
    else:
        source = Trc(TrcConfig(path=path))
    source.start()
    return source


def rows(shared: Path, folder: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the rows of the table of recordings in a folder: file, and its cells."""
    for line in (shared / "mocap" / folder / "SOURCES.md").read_text(encoding="utf-8").splitlines():
        cells = [c.strip() for c in line.strip("|").split("|")]
        if len(cells) == 8 and cells[0].endswith((".c3d`", ".trc`")):
            yield f"{folder}/{cells[0].strip('`')}", cells


def test_no_recording_is_left_out(shared: Path) -> None:
    mocap = shared / "mocap"
    found = {str(p.relative_to(mocap)) for p in mocap.rglob("*") if C3d.recognises(p) or Trc.recognises(p)}
    assert found == set(SETS)


@pytest.mark.parametrize("file", sorted(SETS))
def test_the_set_and_the_body_are_found(shared: Path, file: str) -> None:
    source = read(shared, file)
    assert source.skeleton.name == SETS[file]
    roles = {"pelvis", "chest", "neck", "head"}
    joints = ["hip", "knee", "ankle", "heel", "toe"]
    joints += [] if file in NO_ARMS else ["shoulder", "elbow", "wrist", "hand"]
    assert source.skeleton.roles == roles | {f"{s}_{j}" for s in ("left", "right") for j in joints}
    assert 1.5 < source.skeleton.height_m < 1.85
    clip = source.recording
    upright = np.nanmedian(
        clip.position[:, ROLE_INDEX["neck"], 2] - clip.position[:, ROLE_INDEX["pelvis"], 2]
    )
    assert upright > 0.35
    if file not in NO_ARMS:
        known_frames = clip.position[
            np.isfinite(clip.position[:, [ROLE_INDEX[r] for r in clip.skeleton.roles]]).all((1, 2))
        ]
        assert handedness(known_frames) > 0.6
        for side in ("left", "right"):
            for a, b, least, most in (("hip", "knee", 0.33, 0.5), ("knee", "ankle", 0.33, 0.5),
                                      ("shoulder", "elbow", 0.2, 0.36), ("elbow", "wrist", 0.17, 0.32)):  # fmt: skip
                bone = (
                    clip.position[:, ROLE_INDEX[f"{side}_{a}"]] - clip.position[:, ROLE_INDEX[f"{side}_{b}"]]
                )
                assert least < np.nanmedian(np.linalg.norm(bone, axis=-1)) < most, (side, a)


@pytest.mark.parametrize("folder", ["cmu_c3d", "c3d_markers", "trc"])
def test_frames_rate_unit_axis_and_gaps_are_those_of_the_list(shared: Path, folder: str) -> None:
    seen = 0
    for file, (_, frames, rate, markers, unit, up, _, _) in rows(shared, folder):
        seen += 1
        source = read(shared, file)
        facts = source.recording.facts
        if file != SHORT:  # listed as Y up; the body that is in it stands along z
            assert (str(facts["unit"]), str(facts["up"])) == (unit, up.lower())
        assert source.rate_hz == float(rate)
        left_out = next((n for n in source.skeleton.notes if n.endswith("are left out")), "0 0")
        assert len(source.recording) + sum(int(n) for n in re.findall(r"\d+", left_out)) == int(frames)
        if file == "c3d_markers/pycgm_Movement_trial.c3d":
            continue  # five markers of the set stand at the end of the file, behind the computed points
        if folder == "trc":  # the list counts every column, computed points too
            gaps = find_gaps(read_trc(shared / "mocap" / file).seen)
            lost = re.search(r"gaps in (\d+) markers, (\d+) marker-frames lost", markers)
            assert (gaps.markers, gaps.frames) == (tuple(map(int, lost.groups())) if lost else (0, 0))
            continue
        assert int(markers.split()[0]) == len(source.skeleton.marker_names)
        listed = re.search(
            r"gaps: (\d+) markers, (\d+) gaps, (\d+) marker-frames lost .* longest (\d+) frames", markers
        )
        expected = tuple(map(int, listed.groups())) if listed else (0, 0, 0, 0)
        found = tuple(int(facts[k]) for k in ("gap_markers", "gaps", "gap_frames", "longest_gap"))
        assert found == expected, file
    assert seen == {"cmu_c3d": 3, "c3d_markers": 5, "trc": 7}[folder]


@pytest.mark.parametrize(
    "file", ["c3d_markers/nick_freeform_001.c3d", "trc/human.trc", "trc/markers_StairUp3.trc"]
)
def test_it_keeps_the_contract_of_a_source(shared: Path, file: str) -> None:
    kind = C3d if file.endswith(".c3d") else Trc
    testing.check_component(kind, {"path": str(shared / "mocap" / file)})


def mean_error(clip: Clip, ends: list[dict[str, np.ndarray]], role: str, bone: str) -> float:
    """Return the mean distance of a role to the far end of a bone [m]; ASF x, y, z are C3D y, z, x."""
    true = 0.0254 / 0.45 * np.array([e[bone] for e in ends])[:, [2, 0, 1]]
    return float(np.linalg.norm(clip.position[:, ROLE_INDEX[role]] - true, axis=-1).mean())


def test_centres_lie_near_those_of_the_skeleton_file(shared: Path) -> None:
    # The skeleton was fitted to the same markers by others: neither is the truth.
    clip = read(shared, "cmu_c3d/02_01.c3d").recording
    folder = shared / "mocap" / "cmu_asf_amc"
    bones = read_asf(folder / "02.asf")
    ends = [bone_ends(bones, frame) for frame in read_amc(folder / "02_01.amc")]
    for side, s in (("left", "l"), ("right", "r")):
        for joint, bone, most in (("hip", "hipjoint", 0.035), ("knee", "femur", 0.035), ("ankle", "tibia", 0.02),
                                  ("shoulder", "clavicle", 0.035), ("elbow", "humerus", 0.04)):  # fmt: skip
            assert mean_error(clip, ends, f"{side}_{joint}", s + bone) < most, (side, joint)


def test_the_performer_and_a_recording_name_their_markers_alike(shared: Path) -> None:
    source = read(shared, "cmu_c3d/02_01.c3d")
    assert set(source.skeleton.marker_names) == set(known(source.skeleton.marker_segments)["left_foot"]) | {
        m for members in source.skeleton.marker_segments.values() for m in members
    }
    assert len(source.skeleton.marker_names) == 41
