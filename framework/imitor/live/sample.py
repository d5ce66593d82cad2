"""What arrives: one whole instant of the sender, or a reason why a datagram is of no use."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol


@dataclass(frozen=True, slots=True)
class Sample:
    """One whole instant of the person, as the protocol tells it.

    Attributes:
        counter: The sender's count of instants; a larger one is newer.
        time_s: The sender's own clock, from whatever zero [s]; NaN when the protocol has none.
        body: What was told, in the protocol's own arrays, names and units; never written again.
    """

    counter: int
    time_s: float
    body: Any


class BadDatagram(Exception):
    """A datagram that is no use. It is counted and forgotten, and never ends a run."""


class Malformed(BadDatagram):
    """It claims to be of the protocol, but is truncated or contradicts itself."""


class Foreign(BadDatagram):
    """It is of another protocol, or from somebody who is not to be listened to."""


class Decoder(Protocol):
    """Makes samples out of datagrams. It bounds every length and count from the wire before it allocates."""

    def decode(self, datagram: bytes) -> Sample | None:
        """Return the instant that this datagram completes, or ``None`` when it completes none.

        Raises:
            BadDatagram: It is malformed or foreign; what was collected before stays as it was.
        """

    def reset(self) -> None:
        """Forget parts of instants that are not complete."""


__all__ = ["BadDatagram", "Decoder", "Foreign", "Malformed", "Sample"]
