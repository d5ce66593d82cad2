"""The source of an optical tracking system's ASCII datagrams: rigid targets, or a human model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Literal

import numpy as np
from pydantic import Field, field_validator

from imitor import hookimpl
from imitor.errors import ImitorError, SourceError, did_you_mean
from imitor.human.markers import TARGETS
from imitor.kinds import Source
from imitor.live.art import ArtFrame, read_art, write_art
from imitor.live.body_options import AxesConfig
from imitor.live.points import NEEDED, PointBody, no_points
from imitor.live.sample import Decoder, Sample
from imitor.live.sender import Encoder, lacking
from imitor.live.source import LiveSource
from imitor.live.targets import TargetPerson
from imitor.motion.art_file import BODY_17
from imitor.motion.target_recording import TargetOptions, check_names, learn_targets
from imitor.types import ROLE_INDEX, ROLES, Array, HumanFrame

PORT: Final = 5000
_ARM: Final = ("", "shoulder", "elbow", "wrist")
_LEG: Final = ("hip", "knee", "ankle")
JOINTS_61: Final = (
    "pelvis", "", "", "chest", "", "neck", "head",
    *(f"{side}_{j}" if j else "" for side in ("left", "right") for j in _ARM),
    *(f"{side}_{j}" for side in ("left", "right") for j in _LEG),
)  # fmt: skip
"""Roles by the joint ids of the human model of 61 joints; without fingers."""


class ArtUdpConfig(AxesConfig):
    """Options of the source of an optical tracking system."""

    port: int = Field(PORT, ge=0, le=65535, description="Port to listen at; 0 takes a free one [-].")
    learn_s: float = Field(
        3.0,
        gt=0,
        le=60,
        description="How long the person is watched at first: joints that bend then are found from it [s].",
    )
    body: Literal["auto", "targets", "human"] = Field(
        "auto",
        description="Joint centres from the rigid bodies on the person, from the human model, or auto: from the model "
        "where one is sent.",
    )
    targets: list[str] = Field(
        list(BODY_17),
        description="Names of the 17 targets by the id of their body, from 0; '' for other bodies.",
    )
    joints: list[str] = Field(
        list(JOINTS_61),
        description="Roles by the id of the human model's joints, from 0; '' for other joints.",
    )
    person: int = Field(0, ge=0, description="Id of the human model to imitate [-].")

    @field_validator("joints")
    @classmethod
    def _known_roles(cls, names: list[str]) -> list[str]:
        for name in names:
            if name and name not in ROLE_INDEX:
                raise ValueError(f"there is no role '{name}'; {did_you_mean(name, ROLES) or f'{ROLES}'}")
        return names

    @field_validator("targets")
    @classmethod
    def _known_targets(cls, names: list[str]) -> list[str]:
        try:
            check_names("targets", [name for name in names if name])
        except SourceError as error:
            raise ValueError(str(error).removeprefix("targets: targets: ")) from None
        return names


@dataclass(frozen=True, slots=True)
class Told:
    """Room from target, shape (17, 4, 4) [mm], and joints of the human model, shape (R, 3) [m]; NaN where lost."""

    target: Array
    joint: Array


class ArtDecoder:
    """Reads the bodies and joints that the tables name."""

    def __init__(self, targets: Sequence[str], joints: Sequence[str], person: int) -> None:
        names = [name for name in targets if name]
        self._targets = {i: names.index(name) for i, name in enumerate(targets) if name}
        self._joints = {i: ROLE_INDEX[name] for i, name in enumerate(joints) if name}
        self._person = person

    def decode(self, datagram: bytes) -> Sample:
        """Return the instant of a datagram.

        Raises:
            Foreign: It is no text with a frame counter.
            Malformed: A line contradicts itself.
        """
        told = read_art(datagram)
        target = np.full((len(self._targets), 4, 4), np.nan)
        for ident, pose in told.bodies.items():
            if ident in self._targets:
                target[self._targets[ident]] = pose
        joint = no_points()
        for ident, pose in told.humans.get(self._person, {}).items():
            if ident in self._joints:
                joint[self._joints[ident]] = 0.001 * pose[:3, 3]
        return Sample(told.counter, told.time_s, Told(target, joint))

    def reset(self) -> None:
        """Nothing is kept between datagrams."""


class ArtEncoder:
    """Tells the 17 targets as bodies, or without them the roles as a human model."""

    def __init__(self, targets: Sequence[str]) -> None:
        self._ids = [BODY_17.index(name) for name in targets]
        self._joints = [(i, ROLE_INDEX[name]) for i, name in enumerate(JOINTS_61) if name]

    def encode(self, frame: HumanFrame, counter: int) -> Sequence[bytes]:
        """Return one datagram."""
        bodies: dict[int, Array] = {}
        if frame.target is not None and frame.target_valid is not None and self._ids:
            seen = np.flatnonzero(frame.target_valid).tolist()
            bodies = {self._ids[i]: _in_mm(frame.target[i, :3, :3], frame.target[i, :3, 3]) for i in seen}
        humans: dict[int, dict[int, Array]] = {}
        if not self._ids:
            humans[0] = {
                i: _in_mm(_turn(frame, role), frame.position[role])
                for i, role in self._joints
                if frame.valid[role]
            }
        return [write_art(ArtFrame(counter, frame.time_s, bodies, humans), len(self._ids))]


def _in_mm(R: Array, t: Array) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, 1000.0 * t
    return pose


def _turn(frame: HumanFrame, role: int) -> Array:
    """Return the orientation of a role; the identity where it is not known, since the protocol needs one."""
    R = None if frame.orientation is None else frame.orientation[role]
    return np.eye(3) if R is None or not np.isfinite(R).all() else R


class ArtUdp(LiveSource[ArtUdpConfig]):
    """Receives rigid 6-dof targets or a human model from ART DTrack over UDP."""

    name = "art_udp"
    gives: ClassVar[frozenset[str]] = frozenset({"targets"})

    def decoder(self) -> Decoder:
        """Return a decoder for the tables of the options."""
        return ArtDecoder(self.config.targets, self.config.joints, self.config.person)

    def learn(self, samples: Sequence[Sample]) -> None:
        """Find where the joints lie in the targets, lengths and floor.

        Raises:
            ImitorError: There is no body; says what is missing.
        """
        c = self.config
        joint = np.array([s.body.joint for s in samples])
        modelled = np.isfinite(joint).all(axis=2).any(axis=0)
        if c.body == "human" or (c.body == "auto" and all(modelled[ROLE_INDEX[r]] for r in NEEDED)):
            self._person: PointBody | TargetPerson = PointBody(self.name, joint, self.rate_hz, c)
        else:
            self._person = self._learn_targets(np.array([s.body.target for s in samples]))
        self.skeleton = self._person.skeleton

    def _learn_targets(self, pose: Array) -> TargetPerson:
        c = self.config
        names = [name for name in c.targets if name]
        never = [n for i, n in enumerate(names) if not np.isfinite(pose[:, i]).all(axis=(1, 2)).any()]
        if never:
            if len(never) == len(names):
                what, remedy = "no rigid body", f"nor a human model {c.person}; let the sender tell 6d or 6dj"
            else:
                what, remedy = (
                    f"{', '.join(never)}: not",
                    "put the ids of their bodies into the option targets",
                )
            raise ImitorError(f"{what} seen in the first {c.learn_s:g} s, {remedy}, or set learn_s higher")
        options = TargetOptions(
            rate_hz=self.rate_hz,
            up=c.up,
            floor=c.recorded_floor,
            height_m=c.height_m,
            mass_kg=c.mass_kg,
            sex=c.sex,
            rate_note="as measured",
        )
        return TargetPerson(names, learn_targets(self.name, pose, names, options))

    def human(self, sample: Sample, time_s: float) -> HumanFrame:
        """Return the frame of one instant."""
        told: Told = sample.body
        if isinstance(self._person, PointBody):
            return self._person.frame(time_s, told.joint)
        return self._person.frame(time_s, told.target)

    @classmethod
    def encoder(cls, source: Source[Any]) -> Encoder:
        """Return what sends the targets of a recording, or without them its joints as a human model.

        Raises:
            ImitorError: It has some targets, but others than the 17.
        """
        names = source.skeleton.target_names
        if names and set(names) != set(TARGETS):
            raise lacking(cls.name, source, "the 17 targets", "art_targets files have them")
        return ArtEncoder(names)


@hookimpl
def imitor_components() -> list[type[ArtUdp]]:
    """Return the components of this module."""
    return [ArtUdp]
