"""The files that ``imitor new`` writes: a small working plugin of each kind."""

from __future__ import annotations

from typing import Final

import imitor

_PYPROJECT: Final = """\
[build-system]
requires = ["setuptools>=77"]
build-backend = "setuptools.build_meta"

[project]
name = "imitor-{dash}"
version = "0.1.0"
description = "The {kind} {name} for imitor."
requires-python = ">=3.11"
dependencies = ["imitor"]

[project.entry-points.imitor]
{name} = "imitor_{name}"

[tool.setuptools]
py-modules = ["imitor_{name}"]

[tool.pytest.ini_options]
pythonpath = ["."]
"""

_TEST: Final = '''\
"""Tests of the {kind} {name}."""

from imitor_{name} import {cls}

from imitor.registry import Registry
from imitor.testing import check_component


def test_keeps_the_contract_of_its_kind() -> None:
    check_component({cls})


def test_is_found_under_its_name() -> None:
    registry = Registry(entry_points=False)
    registry.add({cls}, "imitor_{name}")
    assert registry.get("{kind}", "{name}") is {cls}
'''

_PLUGIN: Final = '''\
"""The {kind} {name}."""

from __future__ import annotations
{imports}

class {cls}Config(Config):
    """Options of {name}."""

{options}

class {cls}({base}[{cls}Config]):
    """{summary}"""

    name = "{name}"
{body}

@hookimpl
def imitor_components() -> list[type[{cls}]]:
    """Register the {kind}."""
    return [{cls}]
'''

_SOURCE: Final = (
    "Play a person who stands and sways from side to side.",
    """
from collections.abc import Iterator

import numpy as np
from pydantic import Field

from imitor import ROLES, Config, HumanFrame, Skeleton, Source, hookimpl
from imitor.types import N_ROLES, ROLE_INDEX, read_only
""",
    """\
    duration_s: float = Field(2.0, gt=0, description="Length of the motion [s].")
    rate_hz: float = Field(60.0, gt=0, description="Frames per second [Hz].")
    sway_m: float = Field(0.03, ge=0, description="How far the body moves to each side [m].")
""",
    '''
    # Joint centres of a person of 1.75 m who stands with hanging arms: side [m], height [m].
    BODY = {
        "pelvis": (0.0, 0.95), "chest": (0.0, 1.2), "neck": (0.0, 1.45), "head": (0.0, 1.55),
        "shoulder": (0.18, 1.42), "elbow": (0.2, 1.12), "wrist": (0.2, 0.87), "hand": (0.2, 0.79),
        "hip": (0.09, 0.92), "knee": (0.09, 0.5), "ankle": (0.09, 0.08), "toe": (0.09, 0.02),
    }  # fmt: skip

    def start(self) -> None:
        """Place the joints and describe the person."""
        rest = np.full((N_ROLES, 3), np.nan)
        for role in ROLES:
            side, part = role.split("_", 1) if role.startswith(("left_", "right_")) else ("", role)
            if part in self.BODY:
                y, z = self.BODY[part]
                forward = 0.12 if part == "toe" else 0.0
                rest[ROLE_INDEX[role]] = (forward, -y if side == "right" else y, z)
        self.valid = read_only(~np.isnan(rest[:, 0]))
        roles = frozenset(role for role, known in zip(ROLES, self.valid, strict=True) if known)
        self.skeleton = Skeleton("{name}", roles, rest, height_m=1.75)
        self.rate_hz = self.config.rate_hz
        self.n_frames = round(self.config.duration_s * self.rate_hz)

    def frames(self) -> Iterator[HumanFrame]:
        """Yield the frames: everything above the ankles moves, the feet stand."""
        rest = self.skeleton.rest_position
        share = np.clip((rest[:, 2] - 0.08) / 0.9, 0.0, 1.0)
        for i in range(self.n_frames or 0):
            time_s = i / self.rate_hz
            position = rest.copy()
            position[:, 1] += share * self.config.sway_m * np.sin(np.pi * time_s)
            yield HumanFrame(time_s, read_only(position), self.valid)
''',
)

_FILTER: Final = (
    "Smooth every point exponentially.",
    """
import dataclasses

import numpy as np
from pydantic import Field

from imitor import Config, Filter, HumanFrame, hookimpl
from imitor.types import Array
""",
    """\
    time_constant_s: float = Field(0.05, gt=0, description="Time for 63 % of a change [s].")
""",
    '''
    def start(self) -> None:
        """Compute the share of the newest frame."""
        self.share = 1.0 - float(np.exp(-self.dt_s / self.config.time_constant_s))
        self.reset()

    def reset(self) -> None:
        """Forget the last frame."""
        self.last: Array | None = None

    def step(self, frame: HumanFrame) -> HumanFrame:
        """Return the frame with smoothed positions; a point that was not seen starts afresh."""
        position = frame.position
        if self.last is not None:
            smooth = self.last + self.share * (position - self.last)
            position = np.where(np.isnan(smooth), position, smooth)
        self.last = position
        return dataclasses.replace(frame, position=position)
''',
)

_MAPPER: Final = (
    "Keep the standing posture and lean the CoM as the human does.",
    """
from collections.abc import Mapping
from typing import ClassVar

from pydantic import Field

from imitor import Config, HumanFrame, Mapper, TaskKind, TaskStack, hookimpl
from imitor.types import ROLE_INDEX, Array
""",
    """\
    scale: float = Field(0.5, ge=0, le=1, description="Share of the pelvis motion that is followed [-].")
""",
    '''    declares: ClassVar[Mapping[str, TaskKind]] = {"com": TaskKind.COM, "posture": TaskKind.POSTURE}

    def declare(self, stack: TaskStack) -> None:
        """Declare the tasks."""
        self.com = stack.declare("com", TaskKind.COM)
        self.posture = stack.declare("posture", TaskKind.POSTURE)

    def start(self) -> None:
        """Note where the robot's CoM is when it stands."""
        self.robot.update(self.robot.standing)
        self.standing_com = self.robot.com.copy()
        self.reset()

    def reset(self) -> None:
        """Forget where the human started."""
        self.origin: Array | None = None

    def step(self, frame: HumanFrame, stack: TaskStack) -> None:
        """Write the targets of this frame."""
        self.posture.target[:] = self.robot.standing[7:]
        pelvis = frame.position[ROLE_INDEX["pelvis"]]
        if not frame.valid[ROLE_INDEX["pelvis"]]:
            return
        if self.origin is None:
            self.origin = pelvis.copy()
        self.com.target[:] = self.standing_com + self.config.scale * (pelvis - self.origin)
''',
)

_STABILIZER: Final = (
    "Lower the target of the CoM.",
    """
from pydantic import Field

from imitor import Config, Configuration, HumanFrame, Stabilizer, TaskStack, hookimpl
""",
    """\
    lower_m: float = Field(0.02, ge=0, description="How much lower the CoM is [m].")
""",
    '''    needs_tasks = frozenset({"com"})

    def step(self, frame: HumanFrame, stack: TaskStack, state: Configuration) -> None:
        """Change the target of this frame; the mapper writes it anew for each frame."""
        stack["com"].target[2] -= self.config.lower_m
''',
)

_SOLVER: Final = (
    "Move the joints towards the posture task, and nothing else.",
    """
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from imitor import Config, Configuration, Solver, Strictness, TaskKind, TaskStack, hookimpl
""",
    """\
    share: float = Field(0.5, gt=0, le=1, description="Share of the error that a frame removes [-].")
""",
    '''    serves: ClassVar[Mapping[TaskKind, Strictness]] = {TaskKind.POSTURE: Strictness.WEIGHTED}

    def prepare(self, stack: TaskStack) -> None:
        """Look up the task."""
        self.posture = stack["posture"]

    def step(self, stack: TaskStack, state: Configuration) -> None:
        """Change the configuration in place, within limits, holding the anchor."""
        if self.posture.active[0]:
            joints = state.q[7:]
            joints += self.config.share * self.posture.gain[0] * (self.posture.target - joints)
            np.clip(joints, self.robot.lower, self.robot.upper, out=joints)
        self.robot.update(state.q)
        if stack.anchor:
            self.robot.place(state.q, stack.anchor, stack.anchor_pose)
''',
)

_POSTPROCESSOR: Final = (
    "Blend each configuration with the last one.",
    """
from pydantic import Field

from imitor import Config, Configuration, Postprocessor, TaskStack, hookimpl
from imitor.types import Array
""",
    """\
    gain: float = Field(0.5, gt=0, le=1, description="Share of the newest configuration [-].")
""",
    '''    last: Array | None = None

    def reset(self) -> None:
        """Forget the last configuration."""
        self.last = None

    def step(self, stack: TaskStack, state: Configuration) -> None:
        """Change the configuration in place, holding the anchor."""
        if self.last is not None:
            state.q[:] = self.robot.interpolate(self.last, state.q, self.config.gain)
        self.robot.update(state.q)
        if stack.anchor:
            self.robot.place(state.q, stack.anchor, stack.anchor_pose)
        self.last = state.q.copy()
''',
)

_SINK: Final = (
    "Write the joint positions as a table.",
    """
from pathlib import Path

from pydantic import Field

from imitor import Config, Record, RunInfo, Sink, SinkReport, hookimpl
from imitor.atomic import atomic
""",
    """\
    file: str = Field("{name}.csv", description="Name of the file in the run directory.")
""",
    '''
    def open(self, run: RunInfo) -> None:
        """Note where to write, and the head of the table."""
        self.path: Path = run.out_dir / self.config.file
        self.rows = [",".join(["time_s", *run.robot.joint_names])]

    def write(self, record: Record) -> None:
        """Keep one frame; its arrays are valid only now."""
        self.rows.append(",".join([f"{{record.time_s:.6f}}", *(f"{{v:.6f}}" for v in record.state.q[7:])]))

    def finish(self) -> SinkReport:
        """Write the file."""
        with atomic(self.path) as temporary:
            temporary.write_text("\\n".join(self.rows) + "\\n", encoding="utf-8")
        return SinkReport(files=[self.path])
''',
)

_KINDS: Final = {
    "source": _SOURCE,
    "filter": _FILTER,
    "mapper": _MAPPER,
    "stabilizer": _STABILIZER,
    "solver": _SOLVER,
    "postprocessor": _POSTPROCESSOR,
    "sink": _SINK,
}
"""Kind -> summary, imports, options, body of the class."""


def plugin_files(kind: str, name: str) -> dict[str, str]:
    """Return the files of a new plugin: path in its folder -> text."""
    summary, imports, options, body = _KINDS[kind]
    words = {"kind": kind, "name": name, "dash": name.replace("_", "-"), "base": kind.capitalize()}
    words["cls"] = "".join(part.capitalize() for part in name.split("_"))
    if words["cls"] in imitor.__all__:  # the class must not hide what the module imports
        words["cls"] += "Plugin"
    plugin = _PLUGIN.format(
        **words,
        summary=summary,
        imports=imports,
        options=options.replace("{name}", name),
        body=body.replace("{name}", name).replace("{{", "{").replace("}}", "}"),
    )
    return {
        "pyproject.toml": _PYPROJECT.format(**words),
        f"imitor_{name}.py": plugin,
        f"tests/test_{name}.py": _TEST.format(**words),
    }
