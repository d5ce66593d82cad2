"""The preset ``retarget`` on real captures of different systems: what the pictures showed, held by figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imitor import metrics
from imitor.kinds import RunInfo
from imitor.pipeline import Pipeline
from imitor.record import Motion, Recorder, Reference
from imitor.registry import Registry
from imitor.spec import load_pipeline

CAPTURES = {
    # system: file, robot, largest mean direction error [deg]
    "cmu": ("cmu_bvh/02_01.bvh", "unitree_g1", 1.0),
    "cmu_3dsmax": ("cmu_bvh/131_01_metres.bvh", "unitree_g1", 4.0),
    "daz": ("cmu_bvh/martial_04_daz.bvh", "unitree_g1", 4.0),
    "xsens": ("bvh_xsens/test_mocap.bvh", "talos", 3.0),
    "rokoko": ("bvh_rokoko/jesse_dance.bvh", "unitree_g1", 4.0),
    "perception_neuron": ("bvh_perception_neuron/milad.bvh", "unitree_g1", 4.0),
    "accad": ("bvh_other/Male1_B3_Walk.bvh", "talos", 5.0),
    "hvha": ("bvh_other/AV_8Walk_Meredith_HVHA_Rep1.bvh", "unitree_g1", 2.0),
    "fair1": ("bvh_other/fair1_wave_hello.bvh", "romeo", 9.0),
    "pybvh": ("bvh_other/bvh_mixed_orders.bvh", "unitree_g1", 4.0),
}


def played(path: Path, robot: str) -> tuple[Pipeline, Motion, Reference]:
    registry = Registry(entry_points=False)
    pipeline = Pipeline(load_pipeline("retarget", registry, robot=robot, input=path), registry)
    recorder = Recorder(
        RunInfo(
            Path(), pipeline.robot, pipeline.skeleton, pipeline.rate_hz, pipeline.stack, pipeline.n_frames
        )
    )
    for record in pipeline.records():
        recorder.add(record)
    pipeline.close()
    return pipeline, recorder.motion(), recorder.reference()


@pytest.mark.parametrize("system", CAPTURES)
def test_a_capture_is_imitated(shared: Path, system: str) -> None:
    file, robot, worst = CAPTURES[system]
    pipeline, motion, reference = played(shared / "mocap" / file, robot)
    figures: dict[str, Any] = metrics.evaluate(motion, reference, pipeline.robot, collision_every=0)[
        "figures"
    ]
    assert figures["direction_error_deg"]["mean"] <= worst
    assert figures["joint_limit_violation_frames"]["count"] == 0
    assert figures["joint_overspeed_frames"]["count"] == 0
    assert figures["joint_jump_frames"]["count"] == 0
    assert figures["foot_slip_human_contact_m_s"]["mean"] < 0.1
    assert facing_error_deg(pipeline, motion, reference) < 45.0


def facing_error_deg(pipeline: Pipeline, motion: Motion, reference: Reference) -> float:
    """Return the angle about the vertical between the chests of human and robot, 95th percentile [deg].

    Directions alone can be met by a robot that walks backwards: its chest must face where the human's does.
    """
    left = reference.role("left_shoulder") - reference.role("right_shoulder")
    errors = []
    for q, human in zip(motion.configurations()[::5], left[::5], strict=True):
        pipeline.robot.update(q)
        robot = pipeline.robot.position("left_shoulder") - pipeline.robot.position("right_shoulder")
        errors.append(np.arctan2(human[0] * robot[1] - human[1] * robot[0], human[:2] @ robot[:2]))
    return float(np.degrees(np.percentile(np.abs(errors), 95)))
