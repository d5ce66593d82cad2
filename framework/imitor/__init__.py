"""imitor: humanoid robots imitate whole-body human motion, offline and live.

The public names; everything a plugin author needs is here.
"""

import os as _os

# One BLAS thread: small matrices gain nothing from more, and runs with several differ in their last bits.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    _os.environ.setdefault(_name, "1")

from imitor.errors import ImitorError, RobotError, RunError, SourceError, SpecError  # noqa: E402
from imitor.hooks import hookimpl  # noqa: E402
from imitor.kinds import (  # noqa: E402
    Component,
    Config,
    Filter,
    Mapper,
    Postprocessor,
    Record,
    RunInfo,
    Sink,
    SinkReport,
    Solver,
    Source,
    Stabilizer,
    Strictness,
)
from imitor.tasks import Task, TaskKind, TaskStack  # noqa: E402
from imitor.types import ROLES, SEGMENTS, Configuration, HumanFrame, Skeleton, Support  # noqa: E402

__version__ = "0.1.0"

__all__ = [
    "ROLES",
    "SEGMENTS",
    "Component",
    "Config",
    "Configuration",
    "Filter",
    "HumanFrame",
    "ImitorError",
    "Mapper",
    "Postprocessor",
    "Record",
    "RobotError",
    "RunError",
    "RunInfo",
    "Sink",
    "SinkReport",
    "Skeleton",
    "Solver",
    "Source",
    "SourceError",
    "SpecError",
    "Stabilizer",
    "Strictness",
    "Support",
    "Task",
    "TaskKind",
    "TaskStack",
    "__version__",
    "hookimpl",
]
