"""The report: from a run directory to metrics.json, and the table in the documentation."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imitor import metrics
from imitor.errors import SourceError, SpecError
from imitor.metrics import balance, catalogue, collision, feet, imitation, joints, support, timing
from imitor.metrics.doc import table
from imitor.metrics.figure import BETTER, Figure, Sample, Unmeasured
from imitor.record import MOTION_FILE, REFERENCE_FILE
from imitor.robot.model import RobotModel
from small_humanoid import SmallHumanoid, still

ROOT = Path(__file__).resolve().parents[1]
UNIT_ENDINGS = {
    "deg": "_deg", "m": "_m", "m/s": "_m_s", "rad/s": "_rad_s", "rad/s³": "_rad_s3", "s": "_s", "-": "_ratio",
    "frames": "_frames", "phases": "_phases",
}  # fmt: skip


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    """A run directory of a robot that stands."""
    robot = RobotModel.load(str(SmallHumanoid().write(tmp_path)))
    motion, reference = still(robot)
    motion.save(tmp_path / MOTION_FILE)
    reference.save(tmp_path / REFERENCE_FILE)
    return tmp_path


def test_a_run_directory_is_measured_from_its_two_files(run_dir: Path) -> None:
    report = metrics.evaluate_dir(run_dir)
    assert report["schema"] == "imitor-metrics-1"
    assert report["robot"] == str(run_dir / "small.yaml")
    assert (report["frames"], report["duration_s"]) == (20, pytest.approx(0.38))
    assert report["figures"]["direction_error_deg"]["mean"] == pytest.approx(0.0)
    assert report["figures"]["self_collision_frames"]["frames"] == 20
    metrics.write(report, run_dir / metrics.METRICS_FILE)
    assert json.loads((run_dir / "metrics.json").read_text(encoding="utf-8"))["frames"] == 20


def test_a_directory_without_files_and_a_robot_that_is_gone(run_dir: Path) -> None:
    (run_dir / "small.yaml").unlink()
    with pytest.raises(SpecError, match="there is no such robot card file"):
        metrics.evaluate_dir(run_dir)
    (run_dir / REFERENCE_FILE).unlink()
    with pytest.raises(SourceError, match="there is no such file; is this a run directory"):
        metrics.evaluate_dir(run_dir)


def test_written_numbers_have_six_digits_and_keys_are_sorted(tmp_path: Path) -> None:
    path = tmp_path / "metrics.json"
    metrics.write({"b": {"y": 1234.56789, "x": 1 / 3}, "a": [7, 1e-9 / 3, -1e-17], "c": "text"}, path)
    lines = ["{", '  "a": [', "    7,", "    3.33333e-10,", "    0.0", "  ],"]
    lines += ['  "b": {', '    "x": 0.333333,', '    "y": 1234.57', "  },", '  "c": "text"', "}", ""]
    assert path.read_text(encoding="utf-8") == "\n".join(lines)
    with pytest.raises(ValueError, match="JSON"):
        metrics.write({"a": math.nan}, path)
    assert json.loads(path.read_text(encoding="utf-8"))["a"][0] == 7  # the old file is still whole


def test_a_report_holds_plain_numbers_only(run_dir: Path) -> None:
    def leaves(value: Any) -> list[Any]:
        return (
            [leaf for item in value.values() for leaf in leaves(item)] if isinstance(value, dict) else [value]
        )

    assert {type(leaf) for leaf in leaves(metrics.evaluate_dir(run_dir))} <= {str, int, float}


def test_samples_leave_out_frames_that_were_not_taken() -> None:
    sample = Sample.over([1.0, np.nan, 3.0], reason="nothing")
    assert isinstance(sample, Sample)
    assert sample.as_dict() == {"mean": 2.0, "max": 3.0, "frames": 2}
    assert Sample.over([np.nan], reason="nothing") == Unmeasured("nothing")
    assert Sample.count([True, True, False], [True, False, True], reason="") == Sample(
        {"count": 1, "share": 0.5}, 2
    )
    assert Sample.count([True], [False], reason="never") == Unmeasured("never")


def test_a_value_that_is_not_finite_is_not_a_figure() -> None:
    broken = Figure("x_m", "m", "", "lower", "", lambda run: Sample({"mean": math.inf}, 3))
    assert broken.measure(None) == {"x_m": Unmeasured("its value is not finite")}  # type: ignore[arg-type]


def test_every_figure_is_in_the_catalogue_with_its_unit_in_the_name() -> None:
    modules = (balance, collision, feet, imitation, joints, support, timing)
    defined = [v for module in modules for v in vars(module).values() if isinstance(v, Figure)]
    assert {f.name for f in defined} == {f.name for f in catalogue.FIGURES}
    names = [name for f in catalogue.FIGURES for name in f.full_names]
    assert len(names) == len(set(names))
    for f in catalogue.FIGURES:
        assert f.better in BETTER
        assert f.name.endswith(UNIT_ENDINGS[f.unit])
        assert f.formula
        assert f.about.endswith(".")


def test_the_documentation_holds_the_table() -> None:
    text = (ROOT / "docs" / "metrics.md").read_text(encoding="utf-8")
    assert table() in text, "run python -m imitor.metrics.doc and put its output into docs/metrics.md"


def test_the_table_is_printed_and_measuring_imports_nothing_heavy() -> None:
    code = (
        "import sys, runpy; runpy.run_module('imitor.metrics.doc', run_name='__main__'); "
        "heavy = {'pinocchio', 'mujoco', 'scipy', 'coal', 'placo', 'fcl', 'rerun'} & sys.modules.keys(); "
        "sys.exit(str(heavy)) if heavy else None"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == table()
