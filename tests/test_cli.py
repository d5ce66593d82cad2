"""The command line: what each command prints, its exit status, and what it does not import."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import imitor
from imitor.cli import main
from imitor.errors import RunError
from imitor.registry import Registry
from toy_plugins import GOOD, toy_registry

SHOWN = """\
solver fast

Solve quickly.

serves  pose (weighted), com (weighted)
from    toys

options
  name                       type                     default                           meaning
  order                      list of list of text     [[left_foot, right_foot], [com]]  Levels of tasks.
  damping                    number                   0.1                               Damping [-].
  iterations                 mapping to whole number  {arms: 30, legs: 5}               Iterations by limb.
  tolerance                  mapping                                                    When to stop.
  tolerance.position_m       number                   0.001                             Position [m].
  tolerance.orientation_rad  number                   0.01                              Orientation [rad].
  verbose                    true/false               false                             Say more.
  reach                      number | list of number  1.0                               Reach [m].
"""

HEAVY = ("pinocchio", "placo", "mujoco", "fcl", "rerun", "scipy", "rich")


@pytest.fixture
def registry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Registry:
    registry = toy_registry(tmp_path, monkeypatch)
    monkeypatch.setattr("imitor.cli.common.make_registry", lambda without=(): registry)
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.chdir(tmp_path)
    return registry


def call(capsys: pytest.CaptureFixture[str], *argv: str) -> tuple[int, str, str]:
    status = main(argv)
    return status, *capsys.readouterr()


# ---------------------------------------------------------------- the program


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, "--version") == (0, f"imitor {imitor.__version__}\n", "")


def test_help_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = call(capsys, "--help")
    assert (status, err) == (0, "")
    for command in ("run", "stream", "check", "list", "show", "evaluate", "robot", "new", "schema"):
        assert f"\n    {command} " in out


@pytest.mark.parametrize(
    "command", ["run", "stream", "check", "list", "show", "evaluate", "robot", "new", "schema"]
)
def test_each_command_has_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = call(capsys, command, "--help")
    assert status == 0
    assert out.startswith(f"usage: imitor {command}")


def test_nothing_given(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = call(capsys)
    assert (status, out) == (2, "")
    assert err.startswith("usage: imitor")


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["chek"], "imitor: there is no 'chek'; did you mean 'check'?\nhelp: imitor --help\n"),
        (["run"], "imitor run: the following arguments are required: PIPELINE\nhelp: imitor run --help\n"),
        (
            ["robot", "chck", "x"],
            "imitor robot: there is no 'chck'; did you mean 'check'?\nhelp: imitor robot --help\n",
        ),
        (
            ["run", "toy", "--frames", "0"],
            "imitor run: argument --frames: should be a whole number above 0, got '0'\n"
            "help: imitor run --help\n",
        ),
        (["list", "--nope"], "imitor: unrecognized arguments: --nope\nhelp: imitor --help\n"),
    ],
)
def test_wrong_arguments(argv: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, *argv) == (2, "", said)


# Every heavy package is watched in one process; a plugin that imports one at its top is named by the test.
PROBE = """
import sys
from imitor.cli import main
status = main(sys.argv[1:])
print("\\nheavy:", *[m for m in {heavy!r} if m in sys.modules])
raise SystemExit(status)
"""


@pytest.mark.parametrize("argv", [["--help"], ["list"], ["check", "{file}"], ["schema"]])
def test_light_commands_import_nothing_heavy(argv: list[str], tmp_path: Path) -> None:
    # Right in form; which problems the check finds does not matter here, only what it imports.
    (tmp_path / "p.yaml").write_text(
        "imitor: 1\nrobot: romeo\nsource: {use: bvh}\nstages: [{solver: placo}]\n"
    )
    arguments = [a.format(file=tmp_path / "p.yaml") for a in argv]
    done = subprocess.run(
        [sys.executable, "-c", PROBE.format(heavy=HEAVY), *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.splitlines()[-1] == "heavy:"
    assert "internal error" not in done.stderr


def test_a_reader_that_leaves_early_is_no_error() -> None:
    command = f"{sys.executable} -m imitor.cli schema | head -n 1"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("{\n", "")


def test_an_internal_error_is_one_message(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(without: object = ()) -> Registry:
        raise ZeroDivisionError("oh")

    monkeypatch.setattr("imitor.cli.common.make_registry", broken)
    status, out, err = call(capsys, "list")
    assert (status, out) == (1, "")
    assert err.splitlines()[0] == "internal error: ZeroDivisionError: oh"
    assert "Traceback" not in err
    monkeypatch.setenv("IMITOR_DEBUG", "1")
    assert "Traceback" in call(capsys, "list")[2]


def test_interruption_has_its_own_status(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(without: object = ()) -> Registry:
        raise KeyboardInterrupt

    monkeypatch.setattr("imitor.cli.common.make_registry", interrupted)
    assert call(capsys, "list") == (130, "", "interrupted\n")


# ---------------------------------------------------------------- check, list, show, schema, new


@pytest.mark.usefixtures("registry")
def test_check(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, "check", "toy") == (0, "ok: toy (toybot, 3 stages)\n", "")


@pytest.mark.usefixtures("registry")
def test_check_goes_on_after_a_wrong_one(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = call(capsys, "check", "a.yaml", "toy", "b.yaml")
    assert (status, out) == (2, "ok: toy (toybot, 3 stages)\n")
    assert (
        err
        == "a.yaml: there is no such file\nb.yaml: there is no such file\n2 problems found; nothing was run\n"
    )


@pytest.mark.usefixtures("registry")
def test_check_takes_the_changes_of_run(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = call(capsys, "check", "toy", "--use", "fast=exact", "--set", "fast.damping=0.1")
    assert (status, out) == (0, "ok: toy (toybot, 3 stages)\n")
    assert call(capsys, "check", "toy", "--set", "fast.damping=-1")[0] == 2


@pytest.mark.usefixtures("registry")
def test_list(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = call(capsys, "list")
    assert status == 0
    assert (
        "filter plugins\n"
        "  mark   Mark the feet in support. (toys)\n"
        "  weigh  Find the centre of mass. (toys)\n" in out
    )
    assert "\nrobots\n" in out
    assert "  toybot" in out
    assert out.endswith("not loaded\n  acme  acme_imitor.solvers  No module named 'acme_sdk'\n")


@pytest.mark.usefixtures("registry")
@pytest.mark.parametrize("word", ["solver", "solvers"])
def test_list_of_one_kind(word: str, capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = call(capsys, "list", word)
    assert out.startswith("exact  Solve exactly. (toys)\nfast   Solve quickly. (toys)\n\nnot loaded\n")


@pytest.mark.usefixtures("registry")
def test_list_of_an_unknown_kind(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, "list", "slover") == (2, "", "there is no kind 'slover'; did you mean 'solver'?\n")


@pytest.mark.usefixtures("registry")
def test_show_a_plugin(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = call(capsys, "show", "fast")
    assert (status, err) == (0, "")
    assert out == SHOWN


@pytest.mark.usefixtures("registry")
def test_show_a_source_with_a_required_option(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = call(capsys, "show", "clip")
    assert "reads  .both, .clip\n" in out
    assert "  path   text    required  The recording.\n" in out


@pytest.mark.usefixtures("registry")
def test_show_a_preset(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = call(capsys, "show", "toy")
    assert status == 0
    assert out.startswith("preset toy\n\nimitor: 1\nrobot: toybot\n")
    assert "- {postprocessor: blend, id: blend, gain: 0.3}\n" in out


@pytest.mark.usefixtures("registry")
def test_show_something_unknown(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, "show", "fst") == (
        2,
        "",
        "nothing is called 'fst'; did you mean 'fast'? (imitor list)\n",
    )
    assert call(capsys, "show", "acme")[2] == (
        "plugin 'acme' (acme_imitor.solvers) failed to load: No module named 'acme_sdk'\n"
    )


@pytest.mark.usefixtures("registry")
def test_schema(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    status, out, _ = call(capsys, "schema")
    assert status == 0
    assert json.loads(out)["title"] == "imitor pipeline"
    assert call(capsys, "schema", "--out", "s.json") == (0, "wrote s.json\n", "")
    assert (tmp_path / "s.json").read_text() == out
    assert call(capsys, "schema", "--out", "no/s.json") == (
        2, "", "cannot write no/s.json: No such file or directory\n",
    )  # fmt: skip


@pytest.mark.usefixtures("registry")
def test_evaluate_needs_a_folder(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = call(capsys, "evaluate", "gone")
    assert (status, out) == (2, "")
    assert err == "gone: there is no such folder; give the folder that a run has written (--out)\n"


@pytest.mark.usefixtures("registry")
def test_evaluate_prints_a_table_or_json(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    measured = {"figures": {"slip_m_s": {"mean": 0.01, "max": 0.5, "frames": 7}}}
    monkeypatch.setattr("imitor.metrics.evaluate_dir", lambda path, registry: measured)
    assert call(capsys, "evaluate", str(tmp_path))[1].splitlines()[1].split() == (
        ["slip", "0.01", "0.5", "m/s", "over", "7", "frames"]
    )
    assert json.loads(call(capsys, "evaluate", str(tmp_path), "--json")[1]) == measured


@pytest.mark.usefixtures("registry")
def test_robot_check_of_an_unknown_robot(capsys: pytest.CaptureFixture[str]) -> None:
    status, _, err = call(capsys, "robot", "check", "toybt")
    assert status == 2
    assert "no robot is called 'toybt'" in err


@pytest.mark.usefixtures("registry")
def test_robot_check_prints_findings(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = call(capsys, "robot", "check", "toybot")
    assert (status, err) == (2, "")  # the toy robot has no model
    assert out.splitlines()[0].startswith("error: ")
    assert out.splitlines()[-1].endswith("in toybot")


# ---------------------------------------------------------------- run


class FakeRun:
    """Stand in for the runner; remembers what it was asked and ends as told."""

    def __init__(self, status: str = "done", message: str = "") -> None:
        self.status, self.message = status, message
        self.spec: Any = None
        self.asked: dict[str, Any] = {}

    def __call__(self, spec: Any, registry: Registry, **asked: Any) -> Any:
        from imitor.run import RunResult

        self.spec, self.asked = spec, asked
        progress = asked["progress"]
        for i in range(1, 101):
            progress(i, 100)
        out_dir = asked["out_dir"] or Path("runs/toy")
        figures = {"figures": {"com_error_m": {"mean": 0.012, "max": 0.034, "frames": 100}}}
        return RunResult(out_dir, figures, self.status, self.message, [out_dir / "motion.npz"], 100)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch, registry: Registry) -> FakeRun:
    fake = FakeRun()
    monkeypatch.setattr("imitor.run.run", fake)
    return fake


def test_run(fake: FakeRun, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = call(
        capsys, "run", "toy", "--out", "there", "--frames", "5", "--set", "fast.damping=1"
    )
    assert status == 0
    assert (fake.asked["out_dir"], fake.asked["max_frames"], fake.asked["view"]) == (Path("there"), 5, False)
    assert fake.spec.stages[1].options()["damping"] == 1.0
    assert out == (
        "measured quality\n"
        "  figure     value  max  unit\n"
        "  com error     12   34  mm    over 100 frames\n"
        "100 frames in there\n  motion.npz\n"
    )
    assert [line.split(",")[0] for line in err.splitlines()] == [
        f"frame {n} of 100 ({n} %)" for n in range(10, 101, 10)
    ]


def test_run_quietly(fake: FakeRun, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, "run", "toy", "--quiet") == (0, "", "")
    assert fake.asked["out_dir"] is None


@pytest.mark.parametrize(("ending", "status"), [("failed", 1), ("stopped", 1), ("interrupted", 130)])
def test_run_that_does_not_end_well(
    ending: str, status: int, fake: FakeRun, capsys: pytest.CaptureFixture[str]
) -> None:
    fake.status, fake.message = ending, "frame 7, solver: no solution"
    found, out, err = call(capsys, "run", "toy")
    assert found == status
    assert err.splitlines()[-1] == f"{ending}: frame 7, solver: no solution"
    assert "100 frames in runs/toy" in out  # what was finished is told all the same


def test_run_that_cannot_start(
    fake: FakeRun, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def failing(*_: Any, **__: Any) -> Any:
        raise RunError("no solution", frame=3, time_s=0.1, stage="solver")

    monkeypatch.setattr("imitor.run.run", failing)
    assert call(capsys, "run", "toy") == (1, "", "frame 3 (t=0.100 s), solver: no solution\n")


def test_run_a_broken_pipeline(fake: FakeRun, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = call(capsys, "run", "toy", "--set", "fast.damping=-1")
    assert (status, out, fake.spec) == (2, "", None)
    assert err.endswith("1 problem found; nothing was run\n")


def test_run_tells_what_a_swap_drops(
    fake: FakeRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "p.yaml").write_text(GOOD.replace("damping: 0.5", "verbose: true"))
    status, _, err = call(capsys, "run", "p.yaml", "--use", "fast=exact")
    assert status == 0
    assert err.startswith("--use fast=exact: dropped verbose; 'exact' has no such option\n")


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ("--simulate", "--simulate needs the robot sink 'mujoco', which is not installed here"),
        ("--view", "--view needs the sink 'rerun', which is not installed here"),
        ("--live", "--live needs a live source, and 'actor' is not one; none is installed here"),
    ],
)
def test_run_without_the_plugin_an_option_needs(
    option: str, said: str, fake: FakeRun, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(capsys, "run", "toy", option) == (2, "", said + "\n")
    assert fake.spec is None


def test_arm_reaches_the_sink_that_moves_a_robot(
    fake: FakeRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(capsys, "run", "toy")[0] == 0
    assert fake.spec.sinks[0].options()["armed"] is False
    assert call(capsys, "run", "toy", "--arm")[0] == 0
    assert fake.spec.sinks[0].options()["armed"] is True
    (tmp_path / "p.yaml").write_text(GOOD.split("sinks:", maxsplit=1)[0])
    assert call(capsys, "run", "p.yaml", "--arm") == (
        2, "", "--arm needs a sink that moves a real robot, and this pipeline has none\n",
    )  # fmt: skip
