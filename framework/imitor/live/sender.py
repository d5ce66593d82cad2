"""What `imitor stream` needs of a protocol: datagrams for human frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from imitor.types import HumanFrame


class Encoder(Protocol):
    """Makes the datagrams of a protocol."""

    def encode(self, frame: HumanFrame, counter: int) -> Sequence[bytes]:
        """Return the datagrams of one instant, in the order in which they are to be sent.

        Args:
            frame: The person; ``frame.time_s`` is the sender's clock [s].
            counter: The sender's count of instants, from 0.
        """


__all__ = ["Encoder"]
