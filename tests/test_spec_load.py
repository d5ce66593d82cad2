"""Pipelines that load: defaults, the command line's changes, and the way back to YAML."""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from imitor import SpecError
from imitor.registry import Registry
from imitor.spec import PipelineSpec, load_pipeline, load_text
from imitor.spec.schema import escaped
from toy_plugins import GOOD, FastConfig, toy_registry


@pytest.fixture(scope="module")
def registry() -> Iterator[Registry]:
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory() as folder:
        yield toy_registry(Path(folder), patch)


def load(registry: Registry, **changes: Any) -> PipelineSpec:
    return load_pipeline("toy", registry, **changes)


def refused(registry: Registry, **changes: Any) -> list[str]:
    with pytest.raises(SpecError) as caught:
        load(registry, **changes)
    *problems, tail = str(caught.value).splitlines()
    assert tail.endswith("found; nothing was run")
    return problems


def test_the_whole_specification(registry: Registry) -> None:
    spec = load(registry)
    assert (spec.name, spec.robot, spec.rate_hz, spec.settle_s, spec.seed) == ("toy", "toybot", None, 0.0, 0)
    assert spec.environment == []
    assert (spec.source.name, spec.source.id, spec.source.where) == ("actor", "source", "source")
    assert [(s.kind, s.name, s.id, s.where) for s in spec.stages] == [
        ("mapper", "imitate", "imitate", "stages[0]"),
        ("solver", "fast", "fast", "stages[1]"),
        ("postprocessor", "blend", "blend", "stages[2]"),
    ]
    assert [(s.kind, s.name, s.where) for s in spec.sinks] == [("sink", "log", "sinks[0]")]
    assert spec.stages[1].config == FastConfig.model_validate({"damping": 0.5})


def test_sinks_may_be_left_out(registry: Registry) -> None:
    assert load_text(GOOD.split("sinks:", maxsplit=1)[0], registry).sinks == []


def test_a_file_may_be_given_by_path(registry: Registry, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(GOOD)
    spec = load_pipeline(str(path), registry)
    assert (spec.name, spec.path) == ("mine", path)
    assert spec == load(registry)


def test_a_robot_card_may_lie_beside_the_pipeline(registry: Registry, tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(GOOD.replace("toybot", "./card.yaml"))
    (tmp_path / "card.yaml").write_text(registry.cards("robots")["toybot"].read_text())
    assert Path(load_pipeline(str(tmp_path / "mine.yaml"), registry).robot) == tmp_path / "card.yaml"


def test_a_broken_card_is_told_with_the_card_s_own_lines(registry: Registry, tmp_path: Path) -> None:
    card = tmp_path / "card.yaml"
    card.write_text(registry.cards("robots")["toybot"].read_text().replace("title:", "titel:"))
    said = refused(registry, robot=str(card))
    assert f"{card}:2:1: titel: there is no such key here" in said


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("tyo", "tyo: there is no preset and no file of this name; did you mean 'toy'?"),
        ("gone.yaml", "gone.yaml: there is no such file"),
        ("/", "/: this is a folder; a pipeline is a .yaml file"),
    ],
)
def test_no_such_pipeline(name: str, said: str, registry: Registry) -> None:
    with pytest.raises(SpecError) as caught:
        load_pipeline(name, registry)
    assert str(caught.value) == f"{said}\n1 problem found; nothing was run"


def test_a_file_that_is_not_text(registry: Registry, tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_bytes(b"imitor: 1\nrobot: \xff\n")
    with pytest.raises(SpecError) as caught:
        load_pipeline(str(path), registry)
    assert str(caught.value).startswith(f"{path}:2:8: not UTF-8 text (byte 0xff); save the file as UTF-8")


def test_variables_are_substituted(registry: Registry, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TOY_DAMPING", "0.25")
    text = GOOD.replace("0.5", "${TOY_DAMPING}").replace("toybot", "${TOY_ROBOT:toybot}")
    spec = load_text(text, registry)
    assert spec.robot == "toybot"
    assert spec.stages[1].options()["damping"] == 0.25


def test_set(registry: Registry) -> None:
    sets = [
        "fast.damping=1e-2",
        "fast.tolerance.position_m=0.5",
        "fast.iterations.arms=3",
        "fast.order.1=[com]",
        "fast.reach=[1, 2]",
        "source.scenario=walk",
        "source.note='12'",
        "log.file=${x}: y",
        "rate_hz=50",
        "seed=7",
        "settle_s=1.5",
    ]
    sets[7] = "log.file=out.txt"
    spec = load(registry, sets=sets)
    options = spec.stages[1].options()
    assert options["damping"] == 0.01
    assert options["tolerance"] == {"position_m": 0.5, "orientation_rad": 0.01}
    assert options["iterations"] == {"arms": 3, "legs": 5}  # the default keeps what was not set
    assert options["order"] == [["left_foot", "right_foot"], ["com"]]
    assert options["reach"] == [1.0, 2.0]
    assert spec.source.options() == {"scenario": "walk", "note": "12"}
    assert spec.sinks[0].options()["file"] == "out.txt"
    assert (spec.rate_hz, spec.seed, spec.settle_s) == (50.0, 7, 1.5)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("fast.dampin=3", "stages[1].dampin: 'fast' has no such option; did you mean 'damping'?"),
        ("fast.damping=11", "stages[1].damping: input should be less than or equal to 10, got 11"),
        ("fast.damping", "should be ID.option=value, e.g. --set balance.damping=0.1"),
        ("fst.damping=1", "no stage is called 'fst'; did you mean 'fast'?"),
        (
            "gain=3",
            "'gain' is no key to set; of a stage: ID.option=value; known: environment, rate_hz, robot, seed, settle_s, "
            "speed",
        ),
        ("rate_hz=0", "rate_hz: input should be greater than 0, got 0"),
        ("fast.order.7=[com]", "'7' is no index; the list has 2 items, from 0"),
        ("fast.damping.x=3", "there is no 'x': what stands before it is a single value"),
        ("fast.order=[1", "not valid YAML: did not find expected ',' or ']' (while parsing a flow sequence)"),
        (
            "fast.order=[[hed]]",
            "stages[1].order[0][0]: no stage before it declares a task 'hed'; did you mean 'head'?",
        ),
        ("fast.id=x", "'id' is no option; swap a plugin: --use fast=PLUGIN"),
        ("robot=toybto", "robot: no robot is called 'toybto'; did you mean 'toybot'?"),
    ],
)
def test_set_refused(text: str, said: str, registry: Registry) -> None:
    assert refused(registry, sets=[text]) == [f"--set {text}: {said}"]


TABLE = "[{name: table, shape: box, size_m: [1, 1, 0.03]}, {name: pole, shape: box, size_m: [0.1, 0.1, 2]}]"


def test_set_the_environment(registry: Registry) -> None:
    sets = [
        f"environment={TABLE}",
        "environment.table.position_m=[0.5, 0, 0.7]",
        "environment.table.size_m.2=0.05",
        "environment.pole.position_m.2=1.0",
    ]
    table, pole = load(registry, sets=sets).environment
    assert (list(table["position_m"]), list(table["size_m"])) == ([0.5, 0, 0.7], [1, 1, 0.05])
    assert (list(pole["position_m"]), list(pole["size_m"])) == ([0, 0, 1], [0.1, 0.1, 2])
    assert load(registry, sets=[*sets, "environment=[]"]).environment == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "environment.tabel.size_m=[1, 1, 1]",
            "the environment has no object 'tabel'; did you mean 'table'?",
        ),
        ("environment.table.size_m=[1, 1]", "environment[0].size_m[2]: required, but not given"),
        ("environment=[{name: table}]", "environment[0].shape: required, but not given"),
    ],
)
def test_set_the_environment_refused(text: str, said: str, registry: Registry) -> None:
    assert refused(registry, sets=[f"environment={TABLE}", text]) == [f"--set {text}: {said}"]


OF_ACTOR = """[{name: table, shape: box, size_m: [1, 1, 0.03], only_with: actor},
  {name: pole, shape: box, size_m: [1, 1, 2]},
  {name: drawer, shape: box, size_m: [1, 1, 1], only_with: actor, slide: {axis: [1, 0, 0], range_m: 0.1}},
  {name: handle, shape: box, size_m: [1, 1, 1], part_of: drawer}]"""


def test_objects_of_another_source_are_left_out_and_told(registry: Registry) -> None:
    own = load(registry, sets=[f"environment={OF_ACTOR}"])
    assert ([o["name"] for o in own.environment], own.dropped) == (["table", "pole", "drawer", "handle"], [])
    sets = [f"environment={OF_ACTOR.replace('actor', 'singer')}"]
    other = load(registry, sets=sets)
    assert [o["name"] for o in other.environment] == ["pole"]
    assert other.dropped == [
        "environment: without table, drawer, handle, which belong to the source 'singer', not to 'actor'; to keep one: "
        "--set environment.table.only_with=null"
    ]
    kept = load(registry, sets=[*sets, "environment.drawer.only_with=null"])
    assert [o["name"] for o in kept.environment] == ["pole", "drawer", "handle"]
    assert load_text(kept.to_yaml(), registry).environment == kept.environment


def test_set_an_object_of_what_is_no_list(registry: Registry) -> None:
    told = refused(registry, sets=["environment=5", "environment.table.size_m=[1, 1, 1]"])
    assert any("the environment has no object 'table'; there is none" in line for line in told)


def test_set_an_object_where_there_is_none(registry: Registry) -> None:
    text = "environment.table.size_m=[1, 1, 1]"
    said = "the environment has no object 'table'; there is none; set the whole list: environment=[...]"
    assert refused(registry, sets=[text]) == [f"--set {text}: {said}"]


def test_use_keeps_the_id_and_what_the_new_plugin_has_too(registry: Registry) -> None:
    spec = load(registry, uses=["fast=exact"])
    assert (spec.stages[1].name, spec.stages[1].id, spec.dropped) == ("exact", "fast", [])
    assert spec.stages[1].options()["damping"] == 0.5


def test_use_tells_what_it_drops(registry: Registry, tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(GOOD.replace("damping: 0.5", "damping: 5\n    verbose: true\n    iterations: {arms: 1}"))
    spec = load_pipeline(str(path), registry, uses=["fast=exact"], sets=["fast.iterations=4"])
    assert spec.dropped == [
        "--use fast=exact: dropped verbose; 'exact' has no such option",
        "--use fast=exact: dropped damping, iterations; 'exact' does not take the value it had for 'fast'",
    ]
    assert spec.stages[1].options() == {"order": [["left_foot"]], "damping": 0.0, "iterations": 4}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("fast=exct", "no solver is called 'exct'; did you mean 'exact'?"),
        ("fast=blend", "no solver is called 'blend'; it is a postprocessor"),
        ("fast=acme", "plugin 'acme' (acme_imitor.solvers) failed to load: No module named 'acme_sdk'"),
        ("fast", "should be ID=PLUGIN, e.g. --use posture=placo"),
        ("fst=exact", "no stage is called 'fst'; did you mean 'fast'?"),
    ],
)
def test_use_refused(text: str, said: str, registry: Registry) -> None:
    assert f"--use {text}: {said}" in refused(registry, uses=[text])


@pytest.fixture
def recordings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("a.clip", "a.both", "a.txt"):
        (tmp_path / name).write_text("x")
    (tmp_path / "p.yaml").write_text(GOOD.replace("stages:", "stages:\n  - filter: mark"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.usefixtures("recordings")
def test_input_finds_the_source(registry: Registry) -> None:
    spec = load_pipeline("p.yaml", registry, input=Path("a.clip"))
    assert (spec.source.name, spec.source.options()) == ("clip", {"path": "a.clip", "scale": 1.0})
    spec = load_pipeline(
        "p.yaml", registry, input=Path("a.txt"), source="other_clip", sets=["source.scale=2"]
    )
    assert (spec.source.name, spec.source.options()) == ("other_clip", {"path": "a.txt", "scale": 2.0})


@pytest.mark.usefixtures("recordings")
def test_input_stands_in_for_a_missing_source(registry: Registry, tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(path.read_text().replace("source: {use: actor}\n", ""))
    assert load_pipeline("p.yaml", registry, input=Path("a.clip")).source.name == "clip"


@pytest.mark.usefixtures("recordings")
@pytest.mark.parametrize(
    ("file", "source", "said"),
    [
        ("a.both", None, "--input a.both: clip and other_clip can read this file; say which: --source NAME"),
        (
            "a.txt",
            None,
            "--input a.txt: no source recognises this file; known: clip (.clip .both), other_clip (.both)",
        ),
        ("b.clip", None, "--input b.clip: there is no such file"),
        ("a.txt", "actor", "--input a.txt: source 'actor' reads no file"),
        ("a.clip", "clop", "--source clop: no source is called 'clop'; did you mean 'clip'?"),
    ],
)
def test_input_refused(file: str, source: str | None, said: str, registry: Registry) -> None:
    assert refused(registry, input=Path(file), source=source) == [said]


def test_robot(registry: Registry) -> None:
    assert load(registry, robot="toybot").robot == "toybot"
    assert refused(registry, robot="toybt") == [
        "--robot toybt: robot: no robot is called 'toybt'; did you mean 'toybot'?"
    ]


def test_sinks_are_added_where_missing(registry: Registry) -> None:
    assert [s.name for s in load(registry, add_sinks=["log"]).sinks] == ["log"]
    text = GOOD.split("sinks:", maxsplit=1)[0]
    assert load_text(text, registry).sinks == []
    assert refused(registry, add_sinks=["lgo"]) == [
        "sink lgo: sinks[1].use: no sink is called 'lgo'; did you mean 'log'?"
    ]


def test_all_problems_come_together(registry: Registry) -> None:
    said = refused(registry, robot="x", sets=["fast.damping=11", "nope=1"], uses=["blend=no"])
    assert [s.split(":")[0] for s in said] == [
        "--use blend=no",
        "--set nope=1",
        "--robot x",
        "--set fast.damping=11",
    ]


NAMES = st.from_regex(r"[A-Za-z_][A-Za-z0-9_-]{0,8}", fullmatch=True)
TEXT = st.text(max_size=12)


@st.composite
def documents(draw: st.DrawFn) -> dict[str, Any]:
    """Return the data of a pipeline that is right."""
    ids = draw(st.lists(NAMES.filter(lambda n: n != "source"), min_size=4, max_size=4, unique=True))
    limb = st.dictionaries(TEXT, st.integers(-(10**20), 10**20), max_size=3)
    fast = st.fixed_dictionaries(
        {},
        optional={
            "damping": st.floats(0, 10) | st.integers(0, 10),
            "iterations": limb,
            "tolerance": st.fixed_dictionaries({}, optional={"position_m": st.floats(1e-300, 1e300)}),
            "verbose": st.booleans(),
            "reach": st.floats(-1e9, 1e9) | st.tuples(st.floats(-1, 1), st.floats(-1, 1)).map(list),
            "order": st.permutations(["left_foot", "right_foot", "com"]).flatmap(
                lambda names: st.integers(0, 3).map(lambda cut: [names[:cut], names[cut:]])
            ),
        },
    )
    return {
        "imitor": 1,
        "robot": "toybot",
        "rate_hz": draw(st.none() | st.floats(1e-3, 1000)),
        "settle_s": draw(st.floats(0, 600)),
        "seed": draw(st.integers(0, 2**70)),
        "environment": draw(
            st.lists(
                st.fixed_dictionaries(
                    {
                        "name": TEXT.filter(lambda name: name and "." not in name),
                        "shape": st.just("box"),
                        "size_m": st.lists(st.floats(1e-3, 100), min_size=3, max_size=3),
                    },
                    optional={"position_m": st.lists(st.floats(-10, 10), min_size=3, max_size=3)},
                ),
                max_size=2,
                unique_by=lambda item: str(item["name"]),
            )
        ),
        "source": {"use": "actor", "scenario": draw(st.sampled_from(["stand", "walk"])), "note": draw(TEXT)},
        "stages": [
            {"mapper": "imitate", "id": ids[0]},
            {"solver": "fast", "id": ids[1], **draw(fast)},
            {"postprocessor": "blend", "id": ids[2], "gain": draw(st.floats(0, 1, exclude_min=True))},
        ],
        "sinks": [{"use": "log", "id": ids[3], "file": draw(TEXT)}],
    }


def json_as_yaml(data: dict[str, Any]) -> str:
    """Return JSON, which is YAML but for characters beyond 16 bit: there YAML knows no pairs."""
    return re.sub(
        r"\\u(d[89ab]..)\\u(d[c-f]..)",
        lambda m: rf"\U{0x10000 + (int(m[1], 16) - 0xD800) * 0x400 + int(m[2], 16) - 0xDC00:08x}",
        json.dumps(escaped(data)),
    )


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(documents())
def test_what_loads_comes_back_through_yaml(registry: Registry, data: dict[str, Any]) -> None:
    spec = load_text(json_as_yaml(data), registry)
    text = spec.to_yaml()
    again = load_text(text, registry)
    assert again == spec
    assert again.to_yaml() == text


def test_every_default_is_written(registry: Registry) -> None:
    assert load(registry).to_yaml() == (
        "imitor: 1\nrobot: toybot\nspeed: 1.0\nsettle_s: 0.0\nseed: 0\n"
        "tracking: {predict_s: 0.1, stop_s: 1.0, stable_s: 0.2, resume: automatic, blend_m_s: 0.5, blend_rad_s: 1.5,\n"
        "  human_m_s: 20.0}\nenvironment: []\n"
        "source:\n  use: actor\n  scenario: stand\n  note: ''\n"
        "stages:\n"
        "- {mapper: imitate, id: imitate}\n"
        "- solver: fast\n  id: fast\n"
        "  order:\n  - [left_foot, right_foot]\n  - [com]\n"
        "  damping: 0.5\n"
        "  iterations: {arms: 30, legs: 5}\n"
        "  tolerance: {position_m: 0.001, orientation_rad: 0.01}\n"
        "  verbose: false\n  reach: 1.0\n"
        "- {postprocessor: blend, id: blend, gain: 0.3}\n"
        "sinks:\n- {use: log, id: log, file: log.txt, armed: false}\n"
    )


def test_text_that_looks_like_something_else_keeps_its_quotes(registry: Registry) -> None:
    for note in (
        "1e-4",
        "on",
        "010",
        "null",
        "${HOME}",
        "$${x}",
        "1:30",
        "",
        " x ",
        "a: b",
        "#",
        "0o7",
        ".inf",
    ):
        sets = [f"source.note='{note}'"]
        spec = load(registry, sets=sets)
        assert spec.source.options()["note"] == note
        assert load_text(spec.to_yaml(), registry) == spec
