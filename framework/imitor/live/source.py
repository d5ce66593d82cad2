"""The base of live sources: a socket, what is learned of the person at the start, and the newest frame."""

from __future__ import annotations

import itertools
import math
import socket
import time
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, Final, TypeVar

import numpy as np
from pydantic import Field

from imitor.errors import ImitorError
from imitor.kinds import Config, Source
from imitor.live.receiver import NO_USE, Arrival, Receiver, Reception, bind
from imitor.live.sample import Decoder, Sample
from imitor.live.sender import Encoder
from imitor.types import N_ROLES, HumanFrame, read_only

NOMINAL_HZ: Final = (
    24,
    25,
    30,
    40,
    50,
    60,
    75,
    80,
    90,
    100,
    120,
    125,
    144,
    150,
    180,
    200,
    240,
    250,
    300,
    360,
    500,
    1000,
)
"""Rates that capture systems send at [Hz]; a measured one that is near to one of these is that one."""
_NEAR: Final = 0.04
_LEAST_SAMPLES: Final = 3
_NO_ORIENTATION: Final = read_only(np.full((N_ROLES, 3, 3), np.nan))


class LiveConfig(Config):
    """Where to listen, and how long to watch before the first frame."""

    host: str = Field(
        "127.0.0.1",
        description="Address to listen at; 127.0.0.1 hears this machine alone, 0.0.0.0 the whole network [-].",
    )
    port: int = Field(0, ge=0, le=65535, description="Port to listen at; 0 takes a free one [-].")
    senders: list[str] = Field(
        [], description="Addresses to listen to; empty: whoever sends to this port [-]."
    )
    wait_s: float = Field(
        10.0, gt=0, le=3600, description="How long to wait for a sender before giving up [s]."
    )
    learn_s: float = Field(
        1.0,
        gt=0,
        le=60,
        description="How long the person is watched at first: lengths, floor and rate are found then [s].",
    )
    rate_hz: float | None = Field(
        None, gt=0, le=1000, description="Instants a second; none: measured at the start [Hz]."
    )


C = TypeVar("C", bound=LiveConfig)


class LiveSource(Source[C]):
    """Receives a person from a socket. A subclass decodes datagrams and knows what a body in them is.

    `start` waits for a sender, watches for ``learn_s`` seconds and hands what it saw to `learn`. Afterwards `take`
    returns the newest instant, as often as one arrives, and `human` makes a frame of it.

    Attributes:
        receiver: The thread at the socket; set by `start`.
    """

    live = True
    config_type: ClassVar[type[Config]] = LiveConfig
    receiver: Receiver | None = None
    _oriented: bool | None = None

    def decoder(self) -> Decoder:
        """Return a new decoder of the protocol."""
        raise NotImplementedError

    def learn(self, samples: Sequence[Sample]) -> None:
        """Set ``self.skeleton`` and whatever `human` needs, from the first instants.

        Raises:
            ImitorError: There is no body in them; says what is missing and what to do.
        """
        raise NotImplementedError

    def human(self, sample: Sample, time_s: float) -> HumanFrame:
        """Return the human frame of one instant.

        Args:
            sample: What was told.
            time_s: The time that the frame is to bear [s].
        """
        raise NotImplementedError

    @classmethod
    def encoder(cls, source: Source[Any]) -> Encoder:
        """Return what sends the frames of a started source in this protocol, for `imitor stream`.

        Raises:
            ImitorError: The source has not what the protocol tells; says what is missing.
        """
        raise ImitorError(f"'{cls.name}' cannot be sent")

    def open(self) -> socket.socket:
        """Return the bound socket."""
        return bind(self.config.host, self.config.port)

    @property
    def reception(self) -> Reception:
        """What was received so far."""
        return Reception() if self.receiver is None else self.receiver.reception

    def start(self) -> None:
        """Listen, wait for a sender, and learn who is there.

        Raises:
            ImitorError: Nobody sends, or what is sent has no body.
        """
        self.receiver = Receiver(self.open(), self.decoder(), self.config.senders)
        self.receiver.start()
        try:
            arrivals = self._watch(self.receiver)
            self.rate_hz = self.config.rate_hz or measured_rate(arrivals)
            self.learn([a.sample for a in arrivals])
        except BaseException:
            self.close()
            raise

    def _watch(self, receiver: Receiver) -> list[Arrival]:
        c, out = self.config, []
        first = receiver.box.take(c.wait_s)
        if first is None:
            raise ImitorError(self._nothing(receiver))
        out.append(first)
        while (left := out[0].at_s + c.learn_s - time.perf_counter()) > 0:
            arrival = receiver.box.take(left)
            if arrival is not None:
                out.append(arrival)
        if len(out) < _LEAST_SAMPLES:
            raise ImitorError(
                f"only {len(out)} instants came in {c.learn_s:g} s; is the sender still running? Set learn_s higher "
                "for a slow one"
            )
        return out

    def _nothing(self, receiver: Receiver) -> str:
        c, r = self.config, receiver.reception
        where = f"{c.host}:{receiver.port}"
        if r.datagrams == 0:
            loopback = (
                " (it hears this machine alone: set host to hear others)" if c.host.startswith("127.") else ""
            )
            return f"nothing arrived at {where} in {c.wait_s:g} s{loopback}; does the sender send there?"
        return (
            f"{r.datagrams} datagrams arrived at {where} in {c.wait_s:g} s, but none of use: {r.malformed} malformed, "
            f"{r.foreign} of another protocol or sender; does the sender speak {self.name}?"
        )

    def take(self, timeout_s: float = 0.0) -> Arrival | None:
        """Return the newest instant that was not taken yet, for `human`; ``None`` when none comes in time.

        Args:
            timeout_s: How long to wait for one [s].
        """
        return None if self.receiver is None else self.receiver.box.take(timeout_s)

    def person(self, arrival: Arrival, time_s: float) -> HumanFrame | None:
        """Return the human frame of an instant; ``None``, and counted, when there is no sense in it.

        Frames have orientations when the first one has, so that a recording tells all; NaN where there are none.

        Args:
            arrival: What arrived.
            time_s: The time that the frame is to bear [s].
        """
        try:
            frame = self.human(arrival.sample, time_s)
        except NO_USE:
            self.reception.malformed += 1
            return None
        if self._oriented is None:
            self._oriented = frame.orientation is not None
        if not self._oriented:
            frame.orientation = None
        elif frame.orientation is None:
            frame.orientation = _NO_ORIENTATION
        return frame

    def frames(self) -> Iterator[HumanFrame]:
        """Yield frames as they arrive, by the time of their arrival; ends when nothing comes for ``wait_s``."""
        start = time.perf_counter()
        last = -math.inf
        for _ in itertools.count():
            arrival = self.take(self.config.wait_s)
            if arrival is None:
                return
            time_s = max(arrival.at_s - start, 0.0)
            if time_s <= last:
                continue
            last = time_s
            frame = self.person(arrival, time_s)
            if frame is not None:
                yield frame

    def close(self) -> None:
        """Stop listening."""
        if self.receiver is not None:
            self.receiver.close()


def measured_rate(arrivals: Sequence[Arrival]) -> float:
    """Return the sender's rate from its own clock, or from arrivals where it has none [Hz]."""
    count = np.array([a.sample.counter for a in arrivals])
    time_s = np.array([a.sample.time_s for a in arrivals])
    if not np.isfinite(time_s).all() or not (np.diff(time_s) > 0).all():
        time_s = np.array([a.at_s for a in arrivals])
    steps, counts = np.diff(time_s), np.maximum(np.diff(count), 1)
    usual = float(np.median(steps / counts)) if np.isfinite(arrivals[0].sample.time_s) else math.nan
    even = (
        np.abs(steps / counts - usual) <= 0.5 * usual
    )  # without pauses; the mean is finer than the clock's ticks
    by_steps = float(steps[even].sum() / counts[even].sum()) if even.any() else math.nan
    whole = float((time_s[-1] - time_s[0]) / max(count[-1] - count[0], 1))
    period = by_steps if by_steps > 0 else whole
    if not period > 0:
        raise ImitorError("the sender's rate cannot be measured: its clock stands still; set rate_hz")
    rate = 1.0 / period
    nearest = min(NOMINAL_HZ, key=lambda hz: abs(math.log(hz / rate)))
    return float(nearest) if abs(nearest / rate - 1) < _NEAR else rate


__all__ = ["LiveConfig", "LiveSource", "measured_rate"]
