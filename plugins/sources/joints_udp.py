"""The source of joint positions in JSON datagrams; docs/sources/joints_udp.md describes them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, ClassVar, Final, NoReturn

import numpy as np
from pydantic import Field, field_validator

from imitor import hookimpl
from imitor.errors import did_you_mean
from imitor.kinds import Source
from imitor.live.body_options import AxesConfig
from imitor.live.points import PointBody, no_points
from imitor.live.quaternions import quaternions, rotations
from imitor.live.sample import Decoder, Foreign, Malformed, Sample
from imitor.live.sender import Encoder
from imitor.live.source import LiveSource
from imitor.types import N_ROLES, ROLE_INDEX, ROLES, Array, HumanFrame

SCHEMA: Final = "imitor.joints.1"
PORT: Final = 9771
MOST_BYTES: Final = 16384
MOST_NAMES: Final = 256
FARTHEST_M: Final = 1000.0
"""A position beyond this is no person's [m]."""
_NUMBERS: Final = frozenset({int, float})


class JointsUdpConfig(AxesConfig):
    """Options of the source of joint positions."""

    port: int = Field(PORT, ge=0, le=65535, description="Port to listen at; 0 takes a free one [-].")
    names: dict[str, str] = Field(
        {},
        description="The sender's names of joints to roles, for those that differ: {SpineBase: pelvis} [-].",
    )
    min_confidence: float = Field(
        0.5, ge=0, le=1, description="A joint told with less confidence is lost [-]."
    )

    @field_validator("names")
    @classmethod
    def _known_roles(cls, names: dict[str, str]) -> dict[str, str]:
        for role in names.values():
            if role not in ROLE_INDEX:
                hint = did_you_mean(role, ROLES) or f"roles: {', '.join(ROLES)}"
                raise ValueError(f"there is no role '{role}'; {hint}")
        return names


@dataclass(frozen=True, slots=True)
class Told:
    """Role positions, shape (R, 3) [m], and orientations, shape (R, 3, 3) or none, in the sender's axes."""

    position: Array
    orientation: Array | None


class JointsDecoder:
    """Reads one JSON object a datagram."""

    def __init__(self, names: Mapping[str, str], min_confidence: float) -> None:
        self._index = dict(ROLE_INDEX) | {name: ROLE_INDEX[role] for name, role in names.items()}
        self._min_confidence = min_confidence

    def decode(self, datagram: bytes) -> Sample:
        """Return the instant of a datagram.

        Raises:
            Foreign: It is no JSON object of this schema.
            Malformed: A value is missing or none of its kind.
        """
        if not datagram.startswith(b"{") or len(datagram) > MOST_BYTES:
            raise Foreign
        try:
            told = _JSON.decode(datagram.decode())
        except (ValueError, RecursionError):
            raise Malformed from None
        if told.get("schema") != SCHEMA:
            raise Foreign
        counter, time_s = told.get("counter"), told.get("time_s", math.nan)
        if type(counter) is not int or not 0 <= counter < 1 << 63 or type(time_s) not in (int, float):
            raise Malformed
        position = no_points()
        self._fill(position, told, "joints")
        if "confidence" in told:
            confidence = np.full((N_ROLES, 1), np.nan)
            self._fill(confidence, told, "confidence")
            position[confidence[:, 0] < self._min_confidence] = np.nan
        orientation = None
        if "orientation_wxyz" in told:
            quaternion = np.full((N_ROLES, 4), np.nan)
            self._fill(quaternion, told, "orientation_wxyz")
            orientation = rotations(quaternion)
        return Sample(counter, float(time_s), Told(position, orientation))

    def _fill(self, out: Array, message: Mapping[str, Any], key: str) -> None:
        """Write what is told under a key into rows by role; names that are no roles, and lost joints, are left out.

        Args:
            out: Where to, shape (R, K).
            message: The object of the datagram.
            key: What of it: name -> K numbers or null where lost; a number alone where K is 1.
        """
        values = message.get(key, {})
        if type(values) is not dict or len(values) > MOST_NAMES:
            raise Malformed
        index, width = self._index, out.shape[1]
        known = [name for name, told in values.items() if name in index and (told is not None or width == 1)]
        if not known:
            return
        rows = [values[name] for name in known]
        if width > 1:
            if {*map(type, rows)} != {list} or {*map(len, rows)} != {width}:
                raise Malformed
            rows = [*chain.from_iterable(rows)]
        if not {*map(type, rows)} <= _NUMBERS:
            raise Malformed
        try:
            numbers = np.array(rows, dtype=np.float64)
        except OverflowError:  # a whole number of hundreds of digits
            raise Malformed from None
        if not (np.abs(numbers) < FARTHEST_M).all():
            raise Malformed
        out[[index[name] for name in known]] = numbers.reshape(-1, width)

    def reset(self) -> None:
        """Nothing is kept between datagrams."""


def _refuse(name: str) -> NoReturn:
    raise Malformed  # NaN and Infinity are no JSON


_JSON: Final = json.JSONDecoder(parse_constant=_refuse)


class JointsEncoder:
    """Tells the valid roles of a frame, and orientations where it has them."""

    def encode(self, frame: HumanFrame, counter: int) -> Sequence[bytes]:
        """Return one datagram."""
        told: dict[str, Any] = {"schema": SCHEMA, "counter": counter, "time_s": round(frame.time_s, 6)}
        valid = np.flatnonzero(frame.valid).tolist()
        told["joints"] = {ROLES[i]: [round(v, 5) for v in frame.position[i].tolist()] for i in valid}
        if frame.orientation is not None:
            known = np.flatnonzero(np.isfinite(frame.orientation).all(axis=(1, 2))).tolist()
            q = quaternions(frame.orientation[known]).tolist()
            told["orientation_wxyz"] = {
                ROLES[i]: [round(v, 6) for v in values] for i, values in zip(known, q, strict=True)
            }
        return [json.dumps(told, separators=(",", ":")).encode()]


class JointsUdp(LiveSource[JointsUdpConfig]):
    """Receives joint positions, and orientations where sent, as JSON over UDP."""

    name = "joints_udp"
    gives: ClassVar[frozenset[str]] = frozenset({"orientation"})

    def decoder(self) -> Decoder:
        """Return a decoder for the names of the options."""
        return JointsDecoder(self.config.names, self.config.min_confidence)

    def learn(self, samples: Sequence[Sample]) -> None:
        """Find stature, lengths and floor.

        Raises:
            ImitorError: There is no body.
        """
        position = np.array([s.body.position for s in samples])
        self._body = PointBody(self.name, position, self.rate_hz, self.config)
        self.skeleton = self._body.skeleton

    def human(self, sample: Sample, time_s: float) -> HumanFrame:
        """Return the frame of one instant."""
        told: Told = sample.body
        return self._body.frame(time_s, told.position, told.orientation)

    @classmethod
    def encoder(cls, source: Source[Any]) -> Encoder:
        """Return what sends any recording."""
        return JointsEncoder()


@hookimpl
def imitor_components() -> list[type[JointsUdp]]:
    """Return the components of this module."""
    return [JointsUdp]
