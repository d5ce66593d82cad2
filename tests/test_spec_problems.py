"""Every kind of mistake in a pipeline: the whole message, the place and the exit status."""

from __future__ import annotations

from pathlib import Path

import pytest

from imitor.cli import main
from imitor.registry import Registry
from toy_plugins import GOOD, toy_registry

BROKEN = [
    (
        "unknown_plugin",
        "solver: fast",
        "solver: fsat",
        """
p.yaml:6:13: stages[1].solver: no solver is called 'fsat'
     6 |   - solver: fsat
       |             ^ did you mean 'fast'?
""",
    ),
    (
        "plugin_of_another_kind",
        "solver: fast",
        "solver: blend\n    id: b",
        """
p.yaml:6:13: stages[1].solver: no solver is called 'blend'
     6 |   - solver: blend
       |             ^ it is a postprocessor
""",
    ),
    (
        "plugin_that_failed_to_load",
        "solver: fast",
        "solver: acme",
        """
p.yaml:6:13: stages[1].solver: plugin 'acme' (acme_imitor.solvers) failed to load: No module named 'acme_sdk'
     6 |   - solver: acme
       |             ^
""",
    ),
    (
        "unknown_option",
        "damping: 0.5",
        "dampin: 0.5",
        """
p.yaml:7:5: stages[1].dampin: 'fast' has no such option
     7 |     dampin: 0.5
       |     ^ did you mean 'damping'?
""",
    ),
    (
        "unknown_nested_option",
        "damping: 0.5",
        "tolerance: {positon_m: 0.1}",
        """
p.yaml:7:17: stages[1].tolerance.positon_m: there is no such key here
     7 |     tolerance: {positon_m: 0.1}
       |                 ^ did you mean 'position_m'?
""",
    ),
    (
        "out_of_range",
        "damping: 0.5",
        "damping: 11",
        """
p.yaml:7:14: stages[1].damping: input should be less than or equal to 10, got 11
     7 |     damping: 11
       |              ^
""",
    ),
    (
        "wrong_type",
        "damping: 0.5",
        "damping: much",
        """
p.yaml:7:14: stages[1].damping: input should be a number, got 'much'
     7 |     damping: much
       |              ^
""",
    ),
    (
        "quoted_number",
        "damping: 0.5",
        'damping: "0.5"',
        """
p.yaml:7:14: stages[1].damping: input should be a number, got '0.5'
     7 |     damping: "0.5"
       |              ^ remove the quotes
""",
    ),
    (
        "boolean_for_number",
        "damping: 0.5",
        "damping: true",
        """
p.yaml:7:14: stages[1].damping: input should be a number, got true
     7 |     damping: true
       |              ^
""",
    ),
    (
        "on_for_boolean",
        "damping: 0.5",
        "verbose: on",
        """
p.yaml:7:14: stages[1].verbose: input should be true or false, got 'on'
     7 |     verbose: on
       |              ^ write true
""",
    ),
    (
        "not_a_number",
        "damping: 0.5",
        "damping: .nan",
        """
p.yaml:7:14: stages[1].damping: input should be a finite number, got nan
     7 |     damping: .nan
       |              ^
""",
    ),
    (
        "neither_branch_of_a_union",
        "damping: 0.5",
        "reach: far",
        """
p.yaml:7:12: stages[1].reach: input should be a number or a list, got 'far'
     7 |     reach: far
       |            ^
""",
    ),
    (
        "deeper_branch_of_a_union",
        "damping: 0.5",
        "reach: [1, far]",
        """
p.yaml:7:16: stages[1].reach[1]: input should be a number, got 'far'
     7 |     reach: [1, far]
       |                ^
""",
    ),
    (
        "wrong_item_of_a_mapping",
        "damping: 0.5",
        "iterations: {arms: 1.5}",
        """
p.yaml:7:24: stages[1].iterations.arms: input should be a whole number, got 1.5
     7 |     iterations: {arms: 1.5}
       |                        ^
""",
    ),
    (
        "choice",
        "{use: actor}",
        "{use: actor, scenario: wlak}",
        """
p.yaml:3:32: source.scenario: input should be 'stand' or 'walk', got 'wlak'
     3 | source: {use: actor, scenario: wlak}
       |                                ^ did you mean 'walk'?
""",
    ),
    (
        "missing_option",
        "{use: actor}",
        "{use: clip}",
        """
p.yaml:3:9: source.path: required, but not given
     3 | source: {use: clip}
       |         ^ The recording.
p.yaml:5:13: stages[0] imitate: needs the human's support, which nothing before it gives
     5 |   - mapper: imitate
       |             ^ put 'filter: mark' before it
""",
    ),
    (
        "number_for_text",
        "{use: actor}",
        "{use: actor, note: 010}",
        """
p.yaml:3:28: source.note: input should be text, got 10
     3 | source: {use: actor, note: 010}
       |                            ^ write it in quotes
""",
    ),
    (
        "unknown_top_level_key",
        "imitor: 1",
        "imitor: 1\nrate: 30",
        """
p.yaml:2:1: rate: there is no such key here
     2 | rate: 30
       | ^ did you mean 'rate_hz'?
""",
    ),
    (
        "wrong_version",
        "imitor: 1",
        "imitor: 2",
        """
p.yaml:1:9: imitor: version 2 of the format is unknown here
     1 | imitor: 2
       |         ^ write imitor: 1
""",
    ),
    (
        "unknown_robot",
        "toybot",
        "toybto",
        """
p.yaml:2:8: robot: no robot is called 'toybto'
     2 | robot: toybto
       |        ^ did you mean 'toybot'?
""",
    ),
    (
        "no_robot_card",
        "toybot",
        "cards/mine.yaml",
        """
p.yaml:2:8: robot: there is no robot card 'cards/mine.yaml'
     2 | robot: cards/mine.yaml
       |        ^
""",
    ),
    (
        "missing_robot",
        "robot: toybot\n",
        "",
        """
p.yaml:1:1: robot: required, but not given
     1 | imitor: 1
       | ^ Name of a robot (imitor list robots) or path of a robot card.
""",
    ),
    (
        "duplicate_key",
        "damping: 0.5",
        "damping: 0.5\n    damping: 0.6",
        """
p.yaml:8:5: stages[1].damping: key 'damping' is given twice, first in line 7
     8 |     damping: 0.6
       |     ^ remove one of the two
""",
    ),
    (
        "duplicate_id",
        "  - postprocessor: blend",
        "  - solver: exact\n    id: fast\n  - postprocessor: blend",
        """
p.yaml:9:9: stages[2].id: id 'fast' is used before, in line 6
     9 |     id: fast
       |         ^ give this one another: 'id: ...'
""",
    ),
    (
        "bad_id",
        "  - postprocessor: blend",
        "  - postprocessor: blend\n    id: 2nd go",
        """
p.yaml:9:9: stages[2].id: an id is a word of letters, digits, _ and -, and starts with a letter
     9 |     id: 2nd go
       |         ^
""",
    ),
    (
        "tab",
        "    damping: 0.5",
        "\tdamping: 0.5",
        """
p.yaml:7:1: not valid YAML: found a tab character that violates indentation (while scanning a plain scalar)
     7 |  damping: 0.5
       | ^ indent with spaces, not tabs
""",
    ),
    (
        "bad_syntax",
        "damping: 0.5",
        "damping: [0.5",
        """
p.yaml:8:18: not valid YAML: did not find expected ',' or ']' (while parsing a flow sequence)
     8 |   - postprocessor: blend
       |                  ^
""",
    ),
    (
        "colon_in_text",
        "{use: actor}",
        "{use: actor}: x: y",
        """
p.yaml:3:21: not valid YAML: mapping values are not allowed in this context
     3 | source: {use: actor}: x: y
       |                     ^ put text with ': ' in quotes, or check the indentation
""",
    ),
    (
        "python_tag",
        "damping: 0.5",
        "damping: !!python/name:os.system x",
        """
p.yaml:7:14: stages[1].damping: tag '!!python/name:os.system' is not allowed
     7 |     damping: !!python/name:os.system x
       |              ^ remove the tag; plain YAML is all there is
""",
    ),
    (
        "alias_without_anchor",
        "damping: 0.5",
        "damping: *d",
        """
p.yaml:7:14: not valid YAML: found undefined alias
     7 |     damping: *d
       |              ^
""",
    ),
    (
        "unset_variable",
        "toybot",
        "${TOY_UNSET}",
        """
p.yaml:2:8: robot: environment variable 'TOY_UNSET' is not set; set it, or give a default: ${TOY_UNSET:value}
     2 | robot: ${TOY_UNSET}
       |        ^
""",
    ),
    (
        "bad_substitution",
        "toybot",
        "${1}",
        """
p.yaml:2:8: robot: '${1}' is no substitution; write ${NAME} or ${NAME:default}
     2 | robot: ${1}
       |        ^
""",
    ),
    (
        "stage_is_a_word",
        "mapper: imitate",
        "imitate",
        """
p.yaml:5:5: stages[0]: a stage is a mapping that starts with its kind, such as 'filter: NAME'
     5 |   - imitate
       |     ^ write 'mapper: imitate'
""",
    ),
    (
        "stage_without_kind",
        "solver: fast",
        "slover: fast",
        """
p.yaml:6:5: stages[1].slover: a stage names its kind: filter, mapper, stabilizer, solver, postprocessor
     6 |   - slover: fast
       |     ^ did you mean 'solver'?
""",
    ),
    (
        "stage_of_two_kinds",
        "damping: 0.5",
        "filter: mark",
        """
p.yaml:7:5: stages[1].filter: a stage is of one kind, here solver and filter
     7 |     filter: mark
       |     ^ make it two stages
""",
    ),
    (
        "sink_is_a_word",
        "{use: log}",
        "log",
        """
p.yaml:10:5: sinks[0]: a sink is a mapping, such as {use: NAME}
    10 |   - log
       |     ^ write {use: log}
""",
    ),
    (
        "sink_without_use",
        "{use: log}",
        "{file: a.txt}",
        """
p.yaml:10:5: sinks[0]: a sink names its plugin: use: NAME
    10 |   - {file: a.txt}
       |     ^
""",
    ),
    (
        "sinks_are_no_list",
        "sinks:\n  - {use: log}",
        "sinks: {use: log}",
        """
p.yaml:9:8: sinks: input should be a list, got a mapping
     9 | sinks: {use: log}
       |        ^
""",
    ),
    (
        "source_is_a_word",
        "{use: actor}",
        "actor",
        """
p.yaml:3:9: source: a source is a mapping, such as {use: NAME}
     3 | source: actor
       |         ^ write {use: actor}
""",
    ),
    (
        "stage_name_is_a_number",
        "solver: fast",
        "solver: 5",
        """
p.yaml:6:13: stages[1].solver: should be the name of a solver
     6 |   - solver: 5
       |             ^ imitor list solver shows them
""",
    ),
    (
        "no_mapper",
        "  - mapper: imitate\n",
        "",
        """
p.yaml:4:1: stages: no mapper; a pipeline needs one to turn the human into tasks
     4 | stages:
       | ^ imitor list mapper shows them
""",
    ),
    (
        "no_solver",
        "  - solver: fast\n    damping: 0.5\n",
        "",
        """
p.yaml:4:1: stages: no solver; a pipeline needs one to find the robot's configuration
     4 | stages:
       | ^ imitor list solver shows them
""",
    ),
    (
        "filter_after_mapper",
        "  - solver: fast",
        "  - filter: weigh\n  - solver: fast",
        """
p.yaml:6:13: stages[1] weigh: a filter changes the human, so it stands before the mapper (stages[0])
     6 |   - filter: weigh
       |             ^
""",
    ),
    (
        "solver_before_mapper",
        "  - mapper: imitate\n  - solver: fast\n    damping: 0.5\n",
        "  - solver: fast\n  - mapper: imitate\n",
        """
p.yaml:5:13: stages[0] fast: needs tasks, but no mapper stands before it
     5 |   - solver: fast
       |             ^
""",
    ),
    (
        "stabilizer_needs_configuration",
        "  - solver: fast",
        "  - stabilizer: retarget\n  - solver: fast",
        """
p.yaml:6:17: stages[1] retarget: needs a configuration, but no solver stands before it
     6 |   - stabilizer: retarget
       |                 ^
""",
    ),
    (
        "postprocessor_needs_configuration",
        "  - solver: fast",
        "  - postprocessor: blend\n    id: early\n  - solver: fast",
        """
p.yaml:6:20: stages[1] early: needs a configuration, but no solver stands before it
     6 |   - postprocessor: blend
       |                    ^
""",
    ),
    (
        "needs_support",
        "{use: actor}",
        "{use: clip, path: a.clip}",
        """
p.yaml:5:13: stages[0] imitate: needs the human's support, which nothing before it gives
     5 |   - mapper: imitate
       |             ^ put 'filter: mark' before it
""",
    ),
    (
        "needs_a_task",
        "  - solver: fast",
        "  - stabilizer: lower\n  - solver: fast",
        """
p.yaml:6:17: stages[1] lower: needs the human's com, which nothing before it gives
     6 |   - stabilizer: lower
       |                 ^ put 'filter: weigh' before it
p.yaml:6:17: stages[1] lower: needs the task 'waist', which no stage before it declares
     6 |   - stabilizer: lower
       |                 ^
""",
    ),
    (
        "order_names_no_task",
        "damping: 0.5",
        "order: [[left_foot], [hed]]",
        """
p.yaml:7:27: stages[1].order[1][0]: no stage before it declares a task 'hed'
     7 |     order: [[left_foot], [hed]]
       |                           ^ did you mean 'head'?
""",
    ),
    (
        "order_names_unserved_task",
        "damping: 0.5",
        "order: [[left_foot], [head]]",
        """
p.yaml:7:27: stages[1].order[1][0]: 'fast' does not serve 'head', a direction task
     7 |     order: [[left_foot], [head]]
       |                           ^ it serves pose, com
""",
    ),
    (
        "order_names_a_task_twice",
        "damping: 0.5",
        "order: [[left_foot], [com, left_foot]]",
        """
p.yaml:7:32: stages[1].order[1][1]: 'left_foot' is in the order already, at stages[1].order[0][0]
     7 |     order: [[left_foot], [com, left_foot]]
       |                                ^
""",
    ),
]
"""Name, what in the good pipeline is replaced, by what, and what is said."""

WHOLE = [
    (
        "empty",
        "",
        """
p.yaml:1:1: the file is empty
""",
    ),
    (
        "comments_only",
        "# nothing here\n",
        """
p.yaml:1:1: the file is empty
     1 | # nothing here
       | ^
""",
    ),
    (
        "a_list",
        "- imitor: 1\n",
        """
p.yaml:1:1: the top of the file must be a mapping (key: value), not a list
     1 | - imitor: 1
       | ^
""",
    ),
    (
        "null",
        "null\n",
        """
p.yaml:1:1: there is nothing but 'null'
     1 | null
       | ^
""",
    ),
    (
        "two_documents",
        "imitor: 1\n---\nimitor: 1\n",
        """
p.yaml:2:1: not valid YAML: but found another document (expected a single document in the stream)
     2 | ---
       | ^ one file holds one document; remove the '---'
""",
    ),
    (
        "only_version",
        "imitor: 1\n",
        """
p.yaml:1:1: robot: required, but not given
     1 | imitor: 1
       | ^ Name of a robot (imitor list robots) or path of a robot card.
p.yaml:1:1: source: required, but not given
     1 | imitor: 1
       | ^ Where human motion comes from: {use: NAME, ...options}.
p.yaml:1:1: stages: required, but not given
     1 | imitor: 1
       | ^ Stages in order: {KIND: NAME, ...options}.
""",
    ),
    (
        "top_level_types",
        "imitor: one\nrobot: 5\nrate_hz: 0\nsettle_s: -1\n"
        "seed: 1.5\nenvironment: box\nsource: [actor]\nstages: many\n",
        """
p.yaml:1:9: imitor: input should be a whole number, got 'one'
     1 | imitor: one
       |         ^
p.yaml:2:8: robot: input should be text, got 5
     2 | robot: 5
       |        ^ write it in quotes
p.yaml:3:10: rate_hz: input should be greater than 0, got 0
     3 | rate_hz: 0
       |          ^
p.yaml:4:11: settle_s: input should be greater than or equal to 0, got -1
     4 | settle_s: -1
       |           ^
p.yaml:5:7: seed: input should be a whole number, got 1.5
     5 | seed: 1.5
       |       ^
p.yaml:6:14: environment: input should be a list, got 'box'
     6 | environment: box
       |              ^
p.yaml:7:9: source: a source is a mapping, such as {use: NAME}
     7 | source: [actor]
       |         ^
p.yaml:8:9: stages: input should be a list, got 'many'
     8 | stages: many
       |         ^
""",
    ),
    (
        "control_character",
        "imitor: \x07\n",
        """
p.yaml:1:9: character #x0007 is not allowed in YAML
     1 | imitor:  
       |         ^
""",
    ),
]
"""Name, text of the whole file, and what is said."""


@pytest.fixture
def registry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Registry:
    registry = toy_registry(tmp_path, monkeypatch)
    monkeypatch.setattr("imitor.cli.common.make_registry", lambda without=(): registry)
    monkeypatch.chdir(tmp_path)
    return registry


def check(text: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    Path("p.yaml").write_text(text, encoding="utf-8")
    status = main(["check", "p.yaml"])
    out, err = capsys.readouterr()
    assert out == ""
    return status, err


def with_tail(said: str) -> str:
    n = sum(line.startswith("p.yaml:") for line in said.splitlines())
    return said.removeprefix("\n") + f"{n} problem{'s' if n > 1 else ''} found; nothing was run\n"


@pytest.mark.parametrize(("old", "new", "said"), [c[1:] for c in BROKEN], ids=[c[0] for c in BROKEN])
@pytest.mark.usefixtures("registry")
def test_mistake(old: str, new: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert old in GOOD
    assert check(GOOD.replace(old, new, 1), capsys) == (2, with_tail(said))


@pytest.mark.parametrize(("text", "said"), [c[1:] for c in WHOLE], ids=[c[0] for c in WHOLE])
@pytest.mark.usefixtures("registry")
def test_whole_file(text: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert check(text, capsys) == (2, with_tail(said))
