"""The performer: an authored human that performs named scenarios with exact ground truth."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from imitor import Config, HumanFrame, Source, Support, hookimpl
from imitor.errors import ImitorError
from imitor.human.body import Body, check_segment
from imitor.human.captured import Captured, Degradation, capture
from imitor.human.markers import MARKER_SEGMENTS, MARKERS_41, TARGETS
from imitor.human.performance import Truth
from imitor.human.scenarios import SCENARIOS, play
from imitor.human.scenarios.scenario import Options

ScenarioName = Literal[
    "cut_with_knife",
    "grate_food",
    "hand_updown",
    "open_close_drawer",
    "paddle_canoe",
    "pump_mattress",
    "single_leg_balance",
    "slow_dance",
    "squat",
    "stand",
    "step_forward",
    "t_pose",
    "turn_steering_wheel",
    "turn_valve",
    "two_steps_and_reach",
    "walk",
    "walk_in_place",
    "wave",
    "weight_shift_foot_lift",
]


class PerformerConfig(Config):
    """Who performs what, and how well it is captured."""

    scenario: ScenarioName = Field("step_forward", description="What is performed [-].")
    side: Literal["left", "right"] | None = Field(
        None, description="The hand or foot that leads; null for the scenario's own [-]."
    )
    height_m: float = Field(1.75, ge=0.5, le=2.5, description="Stature [m].")
    sex: Literal["male", "female"] = Field("male", description="Chooses the mass model [-].")
    mass_kg: float = Field(70.0, gt=0, description="Body mass [kg].")
    segment_ratios: dict[str, Annotated[float, Field(ge=0.5, le=2.0)]] = Field(
        default_factory=dict,
        description="Factors on single lengths, by name: thigh, shank, torso, neck, head, upper_arm, "
        "forearm, hand, foot, foot_width, hip_width, shoulder_width, ankle_height [-].",
    )
    speed: float = Field(1.0, ge=0.1, le=4.0, description="Factor on the pace of the performance [-].")
    duration_s: float | None = Field(
        None,
        gt=0,
        le=600.0,
        description="Length of the performance, by more repetitions or a longer hold; null for the "
        "scenario's own; only scenarios that can be stretched have it [s].",
    )
    rate_hz: float = Field(120.0, ge=5.0, le=1000.0, description="Frames per second [Hz].")
    step_length_m: float | None = Field(
        None,
        ge=0.0,
        le=0.8,
        description="Length of a step, for scenarios that step; null for the scenario's own [m].",
    )
    hand_speed_m_s: float = Field(
        0.6, gt=0, le=4.0, description="Greatest speed of the hand in every stroke of hand_updown [m/s]."
    )
    pull_m: float | None = Field(
        None,
        ge=0.0,
        le=0.6,
        description="How far the drawer of open_close_drawer is pulled; null for the scenario's own [m].",
    )
    grip_m: float | None = Field(
        None,
        ge=0.0,
        le=0.6,
        description="How far from its middle each hand holds the handle of open_close_drawer; null for the scenario's "
        "own [m].",
    )
    arms_forward_s: float = Field(
        0.0,
        ge=0,
        le=60.0,
        description="How long the arms are first held forward, palms down, to calibrate; not before t_pose [s].",
    )
    markers: Literal["none", "41"] = Field(
        "none", description="Optical markers on the skin: none or the set of 41 [-]."
    )
    targets: bool = Field(False, description="Whether 17 rigid 6-dof targets are worn [-].")
    noise_std_m: float = Field(
        0.0, ge=0, le=0.5, description="Standard deviation of white noise on every captured coordinate [m]."
    )
    orientation_noise_rad: float = Field(
        0.0,
        ge=0,
        le=1.0,
        description="Standard deviation of white noise on captured orientations, per axis [rad].",
    )
    skin_motion_m: float = Field(
        0.0,
        ge=0,
        le=0.2,
        description="Standard deviation of the motion of skin and clothes over the bones, 0.5 to 4 Hz [m].",
    )
    joint_motion_m: float | None = Field(
        None,
        ge=0,
        le=0.2,
        description="The same for joint centres alone, for a system that estimates them from the markers; null: as "
        "skin_motion_m [m].",
    )
    loss: float = Field(
        0.0, ge=0, lt=1.0, description="Probability that a captured point is lost in a frame [-]."
    )
    loss_burst_s: float = Field(0.1, ge=0, le=10.0, description="Mean length of a loss [s].")
    seed: int = Field(0, ge=0, description="Seed of noise, skin motion and loss [-].")

    @field_validator("markers", mode="before")
    @classmethod
    def _number_as_name(cls, value: object) -> object:
        return str(value) if isinstance(value, int) and not isinstance(value, bool) else value

    @field_validator("segment_ratios")
    @classmethod
    def _known_segments(cls, ratios: dict[str, float]) -> dict[str, float]:
        for name in ratios:
            try:
                check_segment(name)
            except ImitorError as error:
                raise ValueError(str(error)) from None
        return ratios

    @model_validator(mode="after")
    def _fits_the_scenario(self) -> PerformerConfig:
        scenario = SCENARIOS[self.scenario]
        if self.duration_s is not None:
            if scenario.least_s is None:
                legal = ", ".join(sorted(s.name for s in SCENARIOS.values() if s.stretchable))
                raise ValueError(
                    f"duration_s: '{self.scenario}' has its own length; change its speed, "
                    f"or choose one of {legal}"
                )
            if self.duration_s * self.speed < scenario.least_s:
                raise ValueError(
                    f"duration_s: '{self.scenario}' at speed {self.speed:g} needs at least "
                    f"{scenario.least_s / self.speed:.2f} s, got {self.duration_s:g}"
                )
        if self.step_length_m is not None and not scenario.steps:
            legal = ", ".join(sorted(s.name for s in SCENARIOS.values() if s.steps))
            raise ValueError(f"step_length_m: '{self.scenario}' makes no step; scenarios that do: {legal}")
        return self


class Performer(Source[PerformerConfig]):
    """An authored human performs a named scenario, with exact ground truth in ``truth``."""

    name = "performer"
    gives: ClassVar[frozenset[str]] = frozenset({"support", "com", "orientation", "markers", "targets"})

    truth: Truth
    """Exact positions, orientations, support, CoM, joint angles, markers and targets; set by `start`."""

    def start(self) -> None:
        """Perform the whole scenario."""
        c = self.config
        body = Body(c.height_m, c.sex, c.mass_kg, c.segment_ratios)
        options = Options(
            c.side,
            c.speed,
            c.duration_s,
            c.step_length_m,
            c.hand_speed_m_s,
            c.arms_forward_s,
            c.pull_m,
            c.grip_m,
        )
        truth = play(c.scenario, body, options, c.rate_hz)
        self.truth, self._captured = capture(
            truth,
            body,
            markers=c.markers == "41",
            targets=c.targets,
            degradation=Degradation(
                c.noise_std_m,
                c.orientation_noise_rad,
                c.skin_motion_m,
                c.loss,
                c.loss_burst_s * c.rate_hz,
                c.seed,
                c.joint_motion_m,
            ),
        )
        self.rate_hz = c.rate_hz
        self.n_frames = len(truth.time_s)
        worn = c.markers == "41"
        self.skeleton = body.skeleton(
            MARKERS_41 if worn else (), TARGETS if c.targets else (), MARKER_SEGMENTS if worn else {}
        )

    def frames(self) -> Iterator[HumanFrame]:
        """Yield the performance from time 0; the arrays are views that cannot be written."""
        seen: Captured = self._captured
        com = self.truth.com
        stances = {(l, r): Support(l, r) for l in (False, True) for r in (False, True)}
        support = [stances[l, r] for l, r in self.truth.support.tolist()]
        for i, time_s in enumerate(self.truth.time_s.tolist()):
            frame = HumanFrame(time_s, seen.position[i], seen.valid[i], seen.orientation[i])
            if seen.marker is not None and seen.marker_valid is not None:
                frame.marker, frame.marker_valid = seen.marker[i], seen.marker_valid[i]
            if seen.target is not None and seen.target_valid is not None:
                frame.target, frame.target_valid = seen.target[i], seen.target_valid[i]
            frame.com = com[i]
            frame.support = support[i]
            yield frame


@hookimpl
def imitor_components() -> list[type[Performer]]:
    """Register the source."""
    return [Performer]
