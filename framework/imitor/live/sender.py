"""What `imitor stream` needs of a protocol: datagrams for human frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from imitor.errors import ImitorError
from imitor.kinds import Source
from imitor.types import HumanFrame


class Encoder(Protocol):
    """Makes the datagrams of a protocol."""

    def encode(self, frame: HumanFrame, counter: int) -> Sequence[bytes]:
        """Return the datagrams of one instant, in the order in which they are to be sent.

        Args:
            frame: The person; ``frame.time_s`` is the sender's clock [s].
            counter: The sender's count of instants, from 0.
        """


def lacking(protocol: str, source: Source[Any], what: str, remedy: str) -> ImitorError:
    """Return the error of an encoder that needs what a recording has not.

    Args:
        protocol: Name of the live source.
        source: The recording's source.
        what: What is needed, in the plural: ``markers``.
        remedy: Which recordings have it.
    """
    return ImitorError(f"'{protocol}' sends {what}, and this recording ({source.name}) has none; {remedy}")


__all__ = ["Encoder", "lacking"]
