"""Broken inputs, one a case: what a user types, what imitor answers, and with which exit status.

The test runs every case; the table in the documentation is written from the same list. A line of ``said`` that ends
with an ellipsis stands for a line that begins so.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from small_bvh import small_bvh

PIPELINE: Final = """\
imitor: 1
robot: talos
source: {use: performer, scenario: wave}
stages:
  - filter: support_by_height
  - filter: human_com
  - mapper: segment_scaling
    id: map
  - solver: prioritized
    id: solve
    order:
      - [left_foot, right_foot]
      - [torso, left_forearm, right_forearm]
sinks:
  - {use: motion_file}
"""

CARD: Final = """\
imitor_robot: 1
title: TALOS once more
licence: Apache-2.0
model:
  package: example-robot-data
  file: robots/talos_data/robots/talos_reduced.urdf
roles:
  waist: base_link
  chest: torso_2_link
  shoulder: "arm_{side}_2_link"
  elbow: "arm_{side}_4_link"
  wrist: "arm_{side}_7_link"
  hip: "leg_{side}_3_link"
  knee: "leg_{side}_4_link"
  ankle: "leg_{side}_6_link"
soles:
  frame: "{side}_sole_link"
  polygon_m: [[0.1, 0.06], [-0.1, 0.06], [-0.1, -0.06], [0.1, -0.06]]
standing: {"leg_{side}_4_joint": 0.8}
"""

BVH: Final = small_bvh(5)
RUN: Final = "run p.yaml --frames 4 --quiet --out out"


@dataclass(frozen=True)
class Case:
    """One broken input.

    Attributes:
        group: Heading in the documentation.
        wrong: What is wrong, for people.
        command: What is typed after ``imitor``.
        said: Lines of the answer, in a row.
        status: Exit status.
        files: Files in the working folder.
        first: Python statements that a process of its own carries out before, such as a limit on file sizes.
        kept: Frames that ``out/motion.npz`` holds afterwards.
    """

    group: str
    wrong: str
    command: str
    said: str
    status: int = 2
    files: Mapping[str, str | bytes] = field(default_factory=dict)
    first: str = ""
    kept: int = 0


Make = Callable[[], Iterator[Case]]


def _changed(text: str, old: str, new: str) -> str:
    if old not in text:
        raise ValueError(f"'{old}' is not in the text that a case changes")
    return text.replace(old, new, 1)


def _pipelines() -> Iterator[Case]:
    def case(wrong: str, old: str, new: str, said: str) -> Case:
        files = {"p.yaml": _changed(PIPELINE, old, new)}
        return Case("Pipelines", wrong, "check p.yaml", said, files=files)

    yield case(
        "a misspelt plugin", "prioritized", "prioritised",
        "p.yaml:9:13: stages[3].solver: no solver is called 'prioritised'\n"
        "     9 |   - solver: prioritised\n"
        "       |             ^ did you mean 'prioritized'?",
    )  # fmt: skip
    yield case(
        "a misspelt option", "id: map", "free_fot: ground",
        "p.yaml:8:5: stages[2].free_fot: 'segment_scaling' has no such option\n"
        "     8 |     free_fot: ground\n"
        "       |     ^ did you mean 'free_foot'?",
    )  # fmt: skip
    yield case(
        "a number out of range", "id: solve", "id: solve\n    damping: -1",
        "p.yaml:11:14: stages[3].damping: input should be greater than 0 or a list, got -1",
    )  # fmt: skip
    yield case(
        "a word for a number", "id: solve", "id: solve\n    iterations: many",
        "p.yaml:11:17: stages[3].iterations: input should be a whole number, got 'many'",
    )  # fmt: skip
    yield case(
        "not a number", "scenario: wave", "scenario: wave, speed: .nan",
        "p.yaml:3:49: source.speed: input should be a finite number, got nan",
    )  # fmt: skip
    yield case(
        "a choice that there is not", "scenario: wave", "sex: femal",
        "p.yaml:3:31: source.sex: input should be 'male' or 'female', got 'femal'\n"
        "     3 | source: {use: performer, sex: femal}\n"
        "       |                               ^ did you mean 'female'?",
    )  # fmt: skip
    yield case(
        "an unknown robot", "talos", "tallos",
        "p.yaml:2:8: robot: no robot is called 'tallos'\n"
        "     2 | robot: tallos\n"
        "       |        ^ did you mean 'talos'?",
    )  # fmt: skip
    yield case(
        "an unknown task in the order", "torso", "torsi",
        "p.yaml:13:10: stages[3].order[1][0]: no stage before it declares a task 'torsi'\n"
        "    13 |       - [torsi, left_forearm, right_forearm]\n"
        "       |          ^ did you mean 'torso'?",
    )  # fmt: skip
    yield case(
        "a weight of no task in the order", "torso, left_forearm, right_forearm]",
        "torso, left_forearm, right_forearm]\n    weights: {torsi: 0.1}",
        "p.yaml:14:15: stages[3].weights.torsi: 'torsi' has a weight but is not in the order\n"
        "    14 |     weights: {torsi: 0.1}\n"
        "       |               ^ did you mean 'torso'?",
    )  # fmt: skip
    yield case(
        "a null space that there is not", "torso, left_forearm, right_forearm]",
        "torso, left_forearm, right_forearm]\n    null_space: {limit: -0.1}",
        "p.yaml:14:18: stages[3].null_space.limit: input should be 'limits' or 'posture', got 'limit'\n"
        "    14 |     null_space: {limit: -0.1}\n"
        "       |                  ^ did you mean 'limits'?",
    )  # fmt: skip
    yield case(
        "no solver", PIPELINE[PIPELINE.index("  - solver") : PIPELINE.index("sinks")], "",
        "p.yaml:4:1: stages: no solver; a pipeline needs one to find the robot's configuration",
    )  # fmt: skip
    yield case(
        "a filter after the mapper", "  - solver", "  - filter: human_com\n    id: late\n  - solver",
        "p.yaml:9:13: stages[3] late: a filter changes the human, so it stands before the mapper (stages[2])",
    )  # fmt: skip
    yield case(
        "a key twice", "id: solve", "id: solve\n    id: again",
        "p.yaml:11:5: stages[3].id: key 'id' is given twice, first in line 10\n"
        "    11 |     id: again\n"
        "       |     ^ remove one of the two",
    )  # fmt: skip
    yield case(
        "a tab", "    id: map", "\tid: map",
        "p.yaml:8:1: not valid YAML: found a tab character that violates indentation (while scanning a plain scalar)\n"
        "     8 |  id: map\n"
        "       | ^ indent with spaces, not tabs",
    )  # fmt: skip
    yield case(
        "a variable that is not set", "talos", "${MY_ROBOT}",
        "p.yaml:2:8: robot: environment variable 'MY_ROBOT' is not set; "
        "set it, or give a default: ${MY_ROBOT:value}",
    )  # fmt: skip
    for wrong, text, said in (
        ("an empty file", "", "p.yaml:1:1: the file is empty"),
        ("no text", b"\xff\xfe\x00", "p.yaml:1:1: not UTF-8 text (byte 0xff); save the file as UTF-8"),
    ):
        yield Case("Pipelines", wrong, "check p.yaml", said, files={"p.yaml": text})
    yield Case(
        "Pipelines", "several mistakes at once", "check p.yaml",
        "p.yaml:2:8: robot: no robot is called 'tallos'\n"
        "     2 | robot: tallos\n"
        "       |        ^ did you mean 'talos'?\n"
        "p.yaml:3:1: sources: there is no such key here\n"
        "     3 | sources: {use: performer, scenario: wave}\n"
        "       | ^ did you mean 'source'?\n"
        "p.yaml:14:1: sink: there is no such key here\n"
        "    14 | sink:\n"
        "       | ^ did you mean 'sinks'?\n"
        "4 problems found; nothing was run",
        files={"p.yaml": PIPELINE.replace("talos", "tallos").replace("source:", "sources:").replace("sinks", "sink")},
    )  # fmt: skip


def _command_line() -> Iterator[Case]:
    for wrong, command, said in (
        ("a misspelt command", "rum demo", "imitor: there is no 'rum'; did you mean 'run'?"),
        ("a misspelt preset", "run demmo",
         "demmo: there is no preset and no file of this name; did you mean 'demo'?"),
        ("a pipeline that is not there", "check nowhere.yaml", "nowhere.yaml: there is no such file"),
        ("a folder for a pipeline", "check .", ".: this is a folder; a pipeline is a .yaml file"),
        ("no frames at all", "run demo --frames 0",
         "imitor run: argument --frames: should be a whole number above 0, got '0'"),
        ("an option without a value", "check demo --set solve",
         "--set solve: should be ID.option=value, e.g. --set balance.damping=0.1"),
        ("an option of no stage", "check demo --set slove.damping=1",
         "--set slove.damping=1: no stage is called 'slove'; did you mean 'solve'?"),
        ("an option's value out of range", "check demo --set solve.damping=-1",
         "--set solve.damping=-1: stages[3].damping: input should be greater than 0 or a list, got -1"),
        ("a rate of nothing", "check demo --set rate_hz=0",
         "--set rate_hz=0: rate_hz: input should be greater than 0, got 0"),
        ("a swap for what is not there", "check demo --use solve=plako",
         "--use solve=plako: no solver is called 'plako'; did you mean 'placo'?"),
        ("a recording that is not there", "run retarget --input nowhere.bvh",
         "--input nowhere.bvh: there is no such file"),
        ("a recording of an unknown format", "run retarget --input a.xyz",
         "--input a.xyz: no source recognises this file; known: …"),
        ("a misspelt source", "run retarget --source performr",
         "--source performr: no source is called 'performr'; did you mean 'performer'?"),
        ("a robot card that is not there", "run demo --robot cards/mine.yaml",
         "--robot cards/mine.yaml: robot: there is no robot card 'cards/mine.yaml'"),
        ("live from something authored", "run demo --live",
         "--live needs a live source, and 'performer' is not one; …"),
        ("to arm where nothing moves", "run demo --arm",
         "--arm needs a sink that moves a real robot, and this pipeline has none"),
        ("a robot that a sink cannot move", "run demo --robot nao_v4 --sink redis",
         "sinks[3] redis: TWIST2 moves 29 joints, and robot 'nao_v4' lacks left_hip_pitch_joint; …"),
        ("a receiver without an address", "run demo --sink udp_json --set udp_json.host=robot",
         "--set udp_json.host=robot: sinks[3].host: 'robot' is no IP address, such as 127.0.0.1"),
        ("a robot that does not answer", "run demo --robot unitree_g1 --sink redis --arm --set redis.port=1",
         "sinks[3] redis: no Redis store answers at 127.0.0.1:1: …"),
        ("a simulation that is not installed", "run demo --simulate --without mujoco",
         "--simulate needs the robot sink 'mujoco', which is not installed here"),
        ("nobody who sends", "run demo --live --source marker_udp --set source.port=0 --set source.wait_s=0.2",
         "source marker_udp: nothing arrived at 127.0.0.1:…"),
        ("a protocol that is none", "stream a.xyz --as markers_udp",
         "--as markers_udp: 'markers_udp' is no protocol; did you mean 'marker_udp'?"),
        ("nothing to send", "stream --as marker_udp",
         "nothing to send: give a RECORDING, or --source NAME, e.g. --source performer"),
        ("to send what a recording has not", "stream --source performer --as marker_udp",
         "'marker_udp' sends markers, and this recording (performer) has none; c3d and trc files have some, and the "
         "performer with --set source.markers=41"),
        ("to send to nowhere", "stream --source performer --as joints_udp --to 127.0.0.1:0",
         "--to 127.0.0.1:0: '0' is no port; write HOST:PORT with a port from 1 to 65535"),
        ("an unknown kind", "list robbots", "there is no kind 'robbots'; did you mean 'robots'?"),
        ("an unknown name", "show tallos", "nothing is called 'tallos'; did you mean 'talos'? (imitor list)"),
        ("a new plugin of no kind", "new fliter mine", "there is no kind 'fliter'; did you mean 'filter'?"),
        ("a run that is not there", "evaluate nowhere",
         "nowhere: there is no such folder; give the folder that a run has written (--out)"),
        ("a folder without a run", "evaluate .",
         "motion.npz: there is no such file; is this a run directory?"),
    ):  # fmt: skip
        yield Case("Command line", wrong, command, said, files={"a.xyz": "1 2 3\n"})


def _cards() -> Iterator[Case]:
    def case(wrong: str, old: str, new: str, said: str, command: str = f"{RUN} --robot mine.yaml") -> Case:
        files = {"p.yaml": PIPELINE, "mine.yaml": _changed(CARD, old, new)}
        return Case("Robot cards", wrong, command, said, files=files)

    check = "robot check mine.yaml"
    yield case(
        "no licence", "licence: Apache-2.0\n", "",
        "mine.yaml:1:1: licence: required, but not given\n"
        "     1 | imitor_robot: 1\n"
        "       | ^ SPDX licence of the model files.",
    )  # fmt: skip
    yield case(
        "a misspelt role", "hip:", "hipp:",
        "mine.yaml:8:3: roles: no robot role is called 'hipp'; did you mean 'hip'?",
    )  # fmt: skip
    yield case(
        "a link that the model lacks", "leg_{side}_3_link", "leg_{side}_33_link",
        "error: roles.left_hip: the model has no link or joint 'leg_left_33_link'; did you mean 'leg_left_3_link'?",
        check,
    )  # fmt: skip
    yield case(
        "a joint that the model lacks", "leg_{side}_4_joint", "leg_{side}_44_joint",
        "error: standing: the model has no joint 'leg_left_44_joint'; did you mean 'leg_left_4_joint'?",
        check,
    )  # fmt: skip
    yield case(
        "left and right swapped", 'hip: "leg_{side}_3_link"',
        "left_hip: leg_right_3_link\n  right_hip: leg_left_3_link",
        "error: hip: left lies to the right of right (y is to the left); swap the names, or turn the model so that "
        "x is forward",
        check,
    )  # fmt: skip
    yield case(
        "a sole without an area", "[-0.1, 0.06], [-0.1, -0.06], [0.1, -0.06]", "[0.0, 0.06], [-0.1, 0.06]",
        "error: soles.polygon_m: its corners lie on a line; the sole has no area",
        check,
    )  # fmt: skip
    yield case(
        "a package that is not installed", "package: example-robot-data", "package: robot-zoo",
        "the package 'robot-zoo' with the robot's model is not installed: pip install robot-zoo",
    )  # fmt: skip
    yield case(
        "a description that is not installed", "package: example-robot-data", "description: no_such_description",
        "robot 'mine': its model comes from the package robot_descriptions (No module named 'robot_descriptions…",
    )  # fmt: skip
    yield case(
        "limits that leave nothing", "standing:", "limits: {position_rad: {head_1_joint: [1.0, 0.5]}}\nstanding:",
        "robot 'mine': no range left between lower and upper limit of head_1_joint; correct limits.position_rad",
    )  # fmt: skip


def _recordings() -> Iterator[Case]:
    flat = re.sub("OFFSET .*", "OFFSET 0 0 0", BVH)
    for wrong, content, said in (
        ("an empty file", "", "walk.bvh: the file is empty"),
        ("no text", b"\0\1\2\3", "walk.bvh: is not a text file, so not a BVH file"),
        ("another format", "ezc3d\n", "walk.bvh:1: a BVH file begins with HIERARCHY, this one with 'ezc3d'"),
        ("a brace too few", _changed(BVH, "}\nMOTION", "MOTION"), "walk.bvh:3: the '{' of 'Hips' is never closed"),
        ("a misspelt channel", _changed(BVH, "Zrotation", "Zrotaton"),
         "walk.bvh:5: channel 4 of 6 of 'Hips' is 'Zrotaton'; legal are Xposition, Yposition, Zposition, Xrotation, "
         "Yrotation, Zrotation; did you mean 'Zrotation'?"),
        ("fewer frames than promised", _changed(BVH, "Frames: 5", "Frames: 6"),
         "walk.bvh:113: 'Frames:' says 6, but the motion holds 5 frames of 57 numbers"),
        ("a line cut off", BVH[:-20],
         "walk.bvh:119: this line has 52 numbers, the hierarchy has 57 channels (5 frames of 57 numbers make 285, the "
         "motion holds 280)"),
        ("no time between frames", _changed(BVH, "Time: 0.0333333", "Time: 0"),
         "walk.bvh:114: 'Frame Time:' is 0; the time between frames is greater than 0 s"),
        ("a decimal comma", _changed(BVH, "\n0 95 0 ", "\n0 95,2 0 "),
         "walk.bvh:115: value 2 of this line is '95,2', not a number"),
        ("not a number", _changed(BVH, "\n0 95 0 ", "\n0 nan 0 "),
         "walk.bvh:115: value 2 of this line is 'nan', not a finite number"),
        ("a body without size", flat, "walk.bvh: the skeleton has no height: are the OFFSETs zero?"),
        ("an unknown skeleton", re.sub("ForeArm|UpLeg|Foot", "Segment", BVH),
         "walk.bvh: no skeleton card fits the joints of this file; …"),
    ):  # fmt: skip
        yield Case("Recordings", wrong, "run retarget --input walk.bvh", said, files={"walk.bvh": content})
    yield Case(
        "Recordings", "a part that is not there", "run retarget --input walk.bvh --set source.start_s=9",
        "walk.bvh: no frame lies between 9 s and its end; the motion lasts 0.133 s", files={"walk.bvh": BVH},
    )  # fmt: skip


def plugin(name: str, code: str) -> dict[str, str]:
    """Return the files of an installed third-party plugin: its metadata, its entry point and its module."""
    return {
        f"{name}-1.dist-info/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n",
        f"{name}-1.dist-info/entry_points.txt": f"[imitor]\n{name} = {name}\n",
        f"{name}.py": code,
    }


_COMPONENT = """\
import signal
from imitor import Config, Filter, Postprocessor, Sink, hookimpl

class Mine({base}[Config]):
    name = "{name}"
    count = 0

    def {method}:
        self.count += 1
        if self.count == 3:
            {deed}
        {rest}

@hookimpl
def imitor_components():
    return [Mine]
"""


def _plugins() -> Iterator[Case]:
    def case(
        wrong: str, name: str, code: str, said: str, command: str = "check p.yaml", status: int = 2
    ) -> Case:
        files = plugin(name, code) | {"p.yaml": PIPELINE.replace("human_com", name)}
        return Case("Plugins", wrong, command, said, status, files)

    def mine(name: str) -> str:
        return _COMPONENT.format(
            name=name, base="Filter", method="step(self, frame)", deed="pass", rest="return frame"
        )

    yield case(
        "a plugin whose library is missing", "acme_gloves", "import acme_sdk\n",
        "p.yaml:6:13: stages[1].filter: plugin 'acme_gloves' (acme_gloves) failed to load: No module named 'acme_sdk'",
    )  # fmt: skip
    yield case(
        "a plugin that is no Python", "acme_typo", "def imitor_components(:\n",
        "p.yaml:6:13: stages[1].filter: plugin 'acme_typo' (acme_typo) failed to load: SyntaxError: invalid syntax "
        "(acme_typo.py, line 1)",
    )  # fmt: skip
    yield case(
        "a plugin without a name", "acme_anonymous", mine(""),
        "  acme_anonymous  acme_anonymous  acme_anonymous.Mine has no `name`; give it one",
        "list filter", 0,
    )  # fmt: skip
    yield case(
        "a name that is taken", "acme_twin", mine("support_by_height"),
        "filter 'support_by_height' is registered twice: imitor.plugins.filters.support_by_height and acme_twin. "
        "Block one: --without acme_twin.",
    )  # fmt: skip


def _running() -> Iterator[Case]:
    def case(
        wrong: str, name: str, stage: str, said: str, status: int = 1, kept: int = 2, **code: str
    ) -> Case:
        text = _changed(PIPELINE, "sinks:\n", stage.format(name) + "\n")
        files = plugin(name, _COMPONENT.format(name=name, **code)) | {"p.yaml": text}
        return Case("While running", wrong, RUN, said, status, files, kept=kept)

    filtering = {"base": "Filter", "method": "step(self, frame)", "rest": "return frame"}
    late = "  - postprocessor: {}\nsinks:"
    taking = "sinks:\n  - {{use: {}}}"

    def filter_case(wrong: str, name: str, said: str, deed: str, status: int = 1, first: str = "") -> Case:
        files = plugin(name, _COMPONENT.format(name=name, deed=deed, **filtering))
        files["p.yaml"] = PIPELINE.replace("human_com", name)
        return Case("While running", wrong, RUN, said, status, files, first, kept=2)

    yield filter_case(
        "a filter that gives up", "acme_lost",
        "failed: frame 2 (t=0.017 s), stages[1] acme_lost: ValueError: no glove in sight. The frames before are kept.",
        "raise ValueError('no glove in sight')",
    )  # fmt: skip
    yield filter_case(
        "a filter that writes into its input", "acme_writes",
        "failed: frame 2 (t=0.017 s), stages[1] acme_writes: ValueError: assignment destination is read-only. "
        "The frames before are kept.",
        "frame.position[0] = 0.0",
    )  # fmt: skip
    yield filter_case(
        "Ctrl-C", "acme_stop", "interrupted: interrupted after 2 frames",
        "signal.raise_signal(signal.SIGINT)", 130,
        "import signal\nsignal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores it\n",
    )  # fmt: skip
    yield case(
        "a sink that fails", "acme_arm", taking,
        "failed: frame 2 (t=0.017 s), sinks[0] acme_arm: the cable is out. The frames before are kept.",
        deed="raise OSError(5, 'the cable is out')", kept=2,
        base="Sink", method="write(self, record)", rest="pass",
    )  # fmt: skip
    yield case(
        "numbers that are none: the guard holds the robot", "acme_nan", late, "", 0, 4,
        deed="state.q[:] = float('nan')",
        base="Postprocessor", method="step(self, stack, state)", rest="pass",
    )  # fmt: skip
    yield Case(
        "While running", "a file where the run directory should be", RUN,
        "cannot write to the run directory out: File exists; choose another with --out",
        files={"p.yaml": PIPELINE, "out": ""},
    )  # fmt: skip
    yield Case(
        "While running", "a folder that cannot be made", "run p.yaml --frames 4 --out a.txt/out",
        "cannot write to the run directory a.txt/out: Not a directory; choose another with --out",
        files={"p.yaml": PIPELINE, "a.txt": ""},
    )  # fmt: skip
    yield Case(
        "While running", "a full disk", RUN,
        "failed: sinks[0] motion_file: cannot write out/motion.npz: File too large; make room or mend the folder, or "
        "choose another with --out",
        1, {"p.yaml": PIPELINE},
        "import resource, signal\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))\n",
    )  # fmt: skip
    yield Case(
        "While running", "no display for a window", f"{RUN} --view --without mujoco",
        "sinks[1] rerun: there is no display here for the viewer; "
        "run without --view and open the .rrd file elsewhere",
        2, {"p.yaml": PIPELINE}, "import os\nos.environ.pop('DISPLAY', 0)\nos.environ.pop('WAYLAND_DISPLAY', 0)\n",
    )  # fmt: skip


GROUPS: Final[tuple[Make, ...]] = (_pipelines, _command_line, _cards, _recordings, _plugins, _running)
CASES: Final[tuple[Case, ...]] = tuple(case for make in GROUPS for case in make())


def prepare(case: Case, folder: Path) -> None:
    """Write the files of a case."""
    for name, content in case.files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)
