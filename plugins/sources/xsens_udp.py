"""The source of Xsens MVN's network streaming."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pydantic import Field

from imitor import HumanFrame, Source, hookimpl
from imitor.live.body_options import BodyConfig
from imitor.live.sample import Decoder, Sample
from imitor.live.segment_body import SegmentBody
from imitor.live.sendable import check_sendable
from imitor.live.sender import Encoder
from imitor.live.source import LiveSource
from imitor.live.xsens_body import learn_body
from imitor.live.xsens_sender import XsensEncoder
from imitor.live.xsens_wire import XsensDecoder, XsensPose


class XsensUdpConfig(BodyConfig):
    """Options of the Xsens MVN source."""

    port: int = Field(9763, ge=0, le=65535, description="Port to listen at; 0 takes a free one [-].")
    character: int = Field(
        0, ge=0, le=255, description="Which person of the stream to take, in the order of MVN, from 0 [-]."
    )


class XsensUdp(LiveSource[XsensUdpConfig]):
    """Receives the poses that Xsens MVN streams over UDP: positions and orientations of 23 segments."""

    name = "xsens_udp"
    gives = frozenset({"orientation"})
    _body: SegmentBody

    def decoder(self) -> Decoder:
        """Return a decoder of types 01 and 02."""
        return XsensDecoder(self.config.character)

    def learn(self, samples: Sequence[Sample]) -> None:
        """Find lengths, floor and stature.

        Raises:
            ImitorError: No instant shows the whole body.
        """
        self._body, self.skeleton = learn_body([s.body for s in samples], self.config)

    def human(self, sample: Sample, time_s: float) -> HumanFrame:
        """Return the frame of one pose."""
        pose: XsensPose = sample.body
        return self._body.frame(pose.position, pose.rotation, time_s)

    @classmethod
    def encoder(cls, source: Source[Any]) -> Encoder:
        """Return what sends a recording as MVN does.

        Raises:
            ImitorError: The recording has no orientations, or lacks parts of the body.
        """
        check_sendable(cls.name, source)
        return XsensEncoder(source.skeleton, source.rate_hz)


@hookimpl
def imitor_components() -> list[type[XsensUdp]]:
    """Return the components of this module."""
    return [XsensUdp]
