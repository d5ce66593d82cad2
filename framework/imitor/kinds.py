"""The kinds of plugin. A stage touches only what its base class gives it, so a reader knows what it can break.

| kind | is given | may change |
|---|---|---|
| `Source` | its file or socket | nothing; yields human frames |
| `Filter` | human frame | the human frame |
| `Mapper` | human frame, robot | declares tasks when built, writes their targets per frame |
| `Stabilizer` | human frame, tasks, robot state | tasks (target, mask, gain, active), anchor, contact |
| `Solver` | tasks, robot state | the configuration |
| `Postprocessor` | configuration, tasks (read only) | the configuration |
| `Sink` | the finished record of a frame | the outside world |
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final, Generic, TypeVar, get_args, get_origin

from pydantic import BaseModel, ConfigDict

from imitor.errors import ImitorError
from imitor.tasks import TaskKind, TaskStack
from imitor.types import Configuration, HumanFrame, Skeleton

if TYPE_CHECKING:
    from imitor.robot.model import RobotModel


class Config(BaseModel):
    """Options of a component as a user writes them in YAML: unknown keys and NaN are refused.

    Give every field a ``Field(default, description="... [unit].")``; units also go into the name
    (``_m``, ``_s``, ``_rad``, ``_hz``).
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


C = TypeVar("C", bound=Config)

NOTHING: Final = 0.0
WHOLE_RECORDING: Final = math.inf
"""Values of `Component.calibration_s`: what a stage wants to see before the first frame."""


@dataclass(frozen=True)
class Context:
    """What the builder hands to the stages of one pipeline; each kind keeps what its row of the table names.

    Attributes:
        robot: The robot model, shared by all stages; always at the configuration so far.
        skeleton: Constant facts about the human.
        dt_s: Time between frames [s].
        environment: Objects around the robot, as written in the YAML; `imitor.environment` reads them.
    """

    robot: RobotModel
    skeleton: Skeleton
    dt_s: float
    environment: Sequence[Mapping[str, Any]] = ()


class Component(Generic[C]):
    """Base of every plugin class.

    A concrete class names itself (``name``), gives its options as the generic argument and writes ``step``. The
    first line of its docstring is what ``imitor list`` prints.

    Attributes:
        kind: The kind's name in YAML.
        name: The plugin's name in YAML.
        config_type: The options class, taken from the generic argument.
        extra: Name of the optional dependency group that the plugin needs, or empty.
        wants: What must be there before this stage: ``support``, ``com``, ``orientation``, ``markers``, ``targets``
            on the human frame, or ``configuration`` (a solver stands before it).
        gives: What it adds to the human frame, in the same words.
    """

    kind: ClassVar[str] = ""
    name: ClassVar[str] = ""
    config_type: ClassVar[type[Config]] = Config
    extra: ClassVar[str] = ""
    wants: ClassVar[frozenset[str]] = frozenset()
    gives: ClassVar[frozenset[str]] = frozenset()

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "config_type" in vars(cls):
            return
        for base in vars(cls).get("__orig_bases__", ()):
            args = get_args(base)
            origin = get_origin(base)
            of_component = isinstance(origin, type) and issubclass(origin, Component)
            if args and of_component and isinstance(args[0], type) and issubclass(args[0], Config):
                cls.config_type = args[0]

    def __init__(self, config: C, context: Context | None = None) -> None:
        self.config: C = config
        if context is not None:
            self._accept(context)

    def _accept(self, context: Context) -> None:
        """Keep of the context what this kind is given."""

    @property
    def calibration_s(self) -> float:
        """How much of the recording `calibrate` wants to see first [s]; `WHOLE_RECORDING` refuses a live source."""
        return NOTHING

    def calibrate(self, frames: Sequence[HumanFrame]) -> None:
        """Look at the first frames (T-pose, segment lengths) before the run starts."""

    @property
    def delay_frames(self) -> int:
        """How many frames later the stage gives back what it was given [frames]."""
        return 0

    def start(self) -> None:
        """Get ready for the first frame; import heavy packages here."""

    def reset(self) -> None:
        """Forget everything about earlier frames: after it, the same input gives the same output.

        What `calibrate` found is kept: it belongs to the person, not to a frame.
        """

    def close(self) -> None:
        """Release what is held; called at least once, safe to call again."""

    @classmethod
    def summary(cls) -> str:
        """Return the first line of the class docstring."""
        return (cls.__doc__ or "").strip().split("\n", 1)[0]


class Source(Component[C]):
    """Yields the human frames of a file, a socket or an authored performer.

    Attributes:
        live: Whether frames come in real time.
        extensions: File name endings that ``--input`` recognises, e.g. ``(".bvh",)``; the config of such a source
            has a field ``path``.
    """

    kind = "source"
    live: ClassVar[bool] = False
    extensions: ClassVar[tuple[str, ...]] = ()

    skeleton: Skeleton
    """Set by `start`."""
    rate_hz: float
    """Frames per second, set by `start` [Hz]."""
    n_frames: int | None = None
    """Number of frames, once `start` knows it; ``None`` when open-ended."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell whether this source can read the file, by its name and first bytes."""
        return path.suffix.lower() in cls.extensions

    def frames(self) -> Iterator[HumanFrame]:
        """Yield the frames in order of time; may be called again after `reset`."""
        raise NotImplementedError

    def first_frames(self) -> Iterator[HumanFrame]:
        """Yield the frames that stages calibrate with: from the first on, as long as the source likes."""
        return self.frames()

    def ticks(self) -> Iterator[Tick] | None:
        """Return the steps of the live run that this source recorded; ``None``: it recorded none."""
        return None


class Filter(Component[C]):
    """Changes the human frame: fills gaps, smooths, marks support, adds the CoM."""

    kind = "filter"
    skeleton: Skeleton
    dt_s: float

    def _accept(self, context: Context) -> None:
        self.skeleton, self.dt_s = context.skeleton, context.dt_s

    def step(self, frame: HumanFrame) -> HumanFrame:
        """Return the changed frame; bind new arrays, never write into those of the input."""
        raise NotImplementedError


class _RobotStage(Component[C]):
    robot: RobotModel
    dt_s: float
    environment: Sequence[Mapping[str, Any]]

    def _accept(self, context: Context) -> None:
        self.robot, self.dt_s, self.environment = context.robot, context.dt_s, context.environment


class Mapper(_RobotStage[C]):
    """Turns the human frame into targets sized for the robot.

    Attributes:
        declares: Names and kinds of the tasks it can declare; it leaves out those the robot has no frame for.
    """

    kind = "mapper"
    skeleton: Skeleton
    declares: ClassVar[Mapping[str, TaskKind]] = {}

    def _accept(self, context: Context) -> None:
        super()._accept(context)
        self.skeleton = context.skeleton

    def declare(self, stack: TaskStack) -> None:
        """Declare the tasks; called once, before `TaskStack.compile`."""
        raise NotImplementedError

    def missing(self, frame: HumanFrame) -> Sequence[str]:
        """Return what it cannot do without and does not see; while there is something, the person counts as lost.

        Single points that are not known are its own business: it releases their tasks or keeps their last targets.
        """
        return () if frame.valid.any() else ("the whole body",)

    def step(self, frame: HumanFrame, stack: TaskStack) -> None:
        """Write the targets of this frame, the anchor and the contact."""
        raise NotImplementedError


class Stabilizer(_RobotStage[C]):
    """Changes tasks so that the robot can execute them: balance, support, contact.

    Attributes:
        needs_tasks: Tasks that some earlier stage must have declared.
        declares: Tasks of its own.
    """

    kind = "stabilizer"
    skeleton: Skeleton
    needs_tasks: ClassVar[frozenset[str]] = frozenset()
    declares: ClassVar[Mapping[str, TaskKind]] = {}

    def _accept(self, context: Context) -> None:
        super()._accept(context)
        self.skeleton = context.skeleton

    def declare(self, stack: TaskStack) -> None:
        """Declare tasks of its own, if any."""

    def step(self, frame: HumanFrame, stack: TaskStack, state: Configuration) -> None:
        """Change targets, masks, gains, active flags, the anchor or the contact; read ``state`` and the robot."""
        raise NotImplementedError


class Strictness(StrEnum):
    """How a solver treats a kind of task."""

    HARD = "hard"  # met exactly or the frame fails
    PRIORITISED = "prioritised"  # never disturbed by lower levels
    WEIGHTED = "weighted"  # traded against the others


class Solver(_RobotStage[C]):
    """Finds the configuration that serves the tasks.

    Attributes:
        serves: The task kinds it can serve, and how strictly.
    """

    kind = "solver"
    serves: ClassVar[Mapping[TaskKind, Strictness]] = {}

    def prepare(self, stack: TaskStack) -> None:
        """Look the tasks up once, after `TaskStack.compile`.

        Raises:
            ImitorError: The order names a task that is not declared or of a kind the solver does not serve.
        """
        raise NotImplementedError

    def step(self, stack: TaskStack, state: Configuration) -> None:
        """Change ``state.q`` in place, starting from it, and leave the robot updated at it."""
        raise NotImplementedError

    def settle(self, stack: TaskStack, state: Configuration) -> None:
        """Solve the first frame from the standing posture, with as many iterations as it takes."""
        self.step(stack, state)


class Postprocessor(_RobotStage[C]):
    """Changes the solved configuration: collisions, smoothing. Keeps limits, anchor, contacts and CoM target."""

    kind = "postprocessor"
    wants = frozenset({"configuration"})

    def step(self, stack: TaskStack, state: Configuration) -> None:
        """Change ``state.q`` in place and leave the robot updated at it; the tasks are read only."""
        raise NotImplementedError


@dataclass(frozen=True)
class RunInfo:
    """What a sink learns when a run starts.

    Attributes:
        out_dir: The run directory.
        robot: The robot model; a sink may read it at ``record.state.q`` but not during the frame loop of others.
        skeleton: Constant facts about the human.
        rate_hz: Output rate [Hz]: how often this sink is written to, live a robot oftener than a file.
        stack: The tasks (names, kinds, views of the targets).
        n_frames: Expected number of frames, when known.
        environment: Objects around the robot.
        pipeline: The resolved pipeline, every default written out, as YAML text.
        pipeline_name: Its name, for titles.
        view: Whether the user asked for a window (``--view``).
        live: Whether frames come in real time and without a known end.
    """

    out_dir: Path
    robot: RobotModel
    skeleton: Skeleton
    rate_hz: float
    stack: TaskStack
    n_frames: int | None = None
    environment: Sequence[Mapping[str, Any]] = ()
    pipeline: str = ""
    pipeline_name: str = ""
    view: bool = False
    live: bool = False


@dataclass(slots=True)
class Record:
    """The finished frame that sinks receive. Read only; its arrays are valid during `Sink.write` alone: copy.

    Attributes:
        index: Number of the frame.
        time_s: Its time [s].
        human: The person.
        stack: The tasks.
        state: The configuration.
        compute_s: Time spent on the frame without sinks [s].
        latency_s: From a datagram's arrival to the solution [s]; NaN where nothing new had arrived and offline. Only
            sinks that get the newest frame are told.
    """

    index: int
    time_s: float
    human: HumanFrame
    stack: TaskStack
    state: Configuration
    compute_s: float = 0.0
    latency_s: float = math.nan


@dataclass(slots=True)
class Tick:
    """A step of a live run, or of its recording: what was received for it, and what the operator asked for.

    Attributes:
        time_s: Time of the step [s]; increases.
        frame: The newest frame, or ``None`` where nothing new had arrived.
        request: ``pause``, ``resume``, ``stop`` or nothing.
    """

    time_s: float
    frame: HumanFrame | None
    request: str = ""


@dataclass
class SinkReport:
    """What a sink tells at its end: files written, figures for ``metrics.json``."""

    files: list[Path] = field(default_factory=list)
    figures: dict[str, Any] = field(default_factory=dict)


class Sink(Component[C]):
    """Takes the finished frames to the outside world: a file, a viewer, a robot.

    Attributes:
        realtime: Whether it takes commands: a live run writes to it at the output rate, from a thread of its own.
        newest: Whether it may miss frames, as a viewer: a live run writes the newest one to it when it is ready. All
            other sinks get every frame.
    """

    kind = "sink"
    realtime: ClassVar[bool] = False
    newest: ClassVar[bool] = False

    def open(self, run: RunInfo) -> None:
        """Get ready: check the folder, open the window."""

    def write(self, record: Record) -> None:
        """Take one frame."""
        raise NotImplementedError

    def finish(self) -> SinkReport:
        """Write what is written at the end; called once after the last frame, also of a failed or stopped run.

        Files appear whole or not at all: use `imitor.atomic`.
        """
        return SinkReport()


KINDS: Final[Mapping[str, type[Component[Any]]]] = {
    "source": Source,
    "filter": Filter,
    "mapper": Mapper,
    "stabilizer": Stabilizer,
    "solver": Solver,
    "postprocessor": Postprocessor,
    "sink": Sink,
}
STAGE_KINDS: Final = ("filter", "mapper", "stabilizer", "solver", "postprocessor")


def kind_of(cls: type[Component[Any]]) -> str:
    """Return the kind of a component class.

    Raises:
        ImitorError: The class derives from no kind.
    """
    for kind, base in KINDS.items():
        if issubclass(cls, base):
            return kind
    raise ImitorError(f"{cls.__module__}.{cls.__qualname__} derives from none of {', '.join(KINDS)}")
