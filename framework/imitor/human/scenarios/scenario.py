"""What a scenario is, and the options that its author may read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from imitor.human.choreography import Choreography


@dataclass(frozen=True)
class Options:
    """How a scenario is performed.

    Attributes:
        side: The leading side; ``None`` for the scenario's own.
        speed: Factor on the pace [-].
        duration_s: Wanted length of the performance [s]; ``None`` for the scenario's own.
        step_length_m: Length of a step [m]; ``None`` for the scenario's own.
        hand_speed_m_s: Greatest speed of the hand in ``hand_updown`` [m/s].
        arms_forward_s: How long the arms are held forward first, for calibration, before they sink and the motion
            begins; 0 for not at all [s].
        pull_m: How far ``open_close_drawer`` pulls the drawer; ``None`` for a share of the arm [m].
        grip_m: How far from its middle each hand holds the drawer's handle; ``None`` for a share of the stature [m].
    """

    side: str | None = None
    speed: float = 1.0
    duration_s: float | None = None
    step_length_m: float | None = None
    hand_speed_m_s: float = 0.6
    arms_forward_s: float = 0.0
    pull_m: float | None = None
    grip_m: float | None = None


@dataclass(frozen=True)
class Scenario:
    """An authored motion, written for the left side leading.

    Attributes:
        name: Its name in YAML.
        summary: One line for the user.
        own_length_s: Authored length [s].
        author: Writes the channels; ``None`` for the rest pose.
        side: The side that leads when the user names none.
        least_s: Shortest authored length [s]; ``None`` where the length is the motion's own.
        steps: Whether ``step_length_m`` means something.
        quasi_static: Whether the CoM stays over the feet in contact throughout.
    """

    name: str
    summary: str
    own_length_s: float
    author: Callable[[Choreography, Options], None] | None
    side: str = "left"
    least_s: float | None = None
    steps: bool = False
    quasi_static: bool = True

    @property
    def stretchable(self) -> bool:
        """Whether ``duration_s`` means something: more repetitions or a longer hold."""
        return self.least_s is not None

    def length_s(self, options: Options) -> float:
        """Return the authored length under these options [s]."""
        if options.duration_s is None or not self.stretchable:
            return self.own_length_s
        return options.duration_s * options.speed
