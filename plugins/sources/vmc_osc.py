"""The source of the VMC protocol."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, Literal

import numpy as np
from pydantic import Field

from imitor import HumanFrame, Source, hookimpl
from imitor.errors import ImitorError
from imitor.live.body_options import BodyConfig
from imitor.live.bone_body import Bones, learn_bones
from imitor.live.osc import EXTRA
from imitor.live.sample import Decoder, Sample
from imitor.live.segment_body import SegmentBody
from imitor.live.sendable import check_sendable
from imitor.live.sender import Encoder
from imitor.live.source import LiveSource
from imitor.live.vmc import VmcDecoder
from imitor.live.vmc_body import BoneTree, VmcEncoder
from imitor.motion.skeletons import NodeNames, fit_card, load_card
from imitor.registry import Registry

CARD: Final = "unity_humanoid"
"""The skeleton card of the protocol's bones."""


class VmcOscConfig(BodyConfig):
    """Options of the VMC source."""

    port: int = Field(39539, ge=0, le=65535, description="Port to listen at; 0 takes a free one [-].")
    height_m: float | None = Field(
        None,
        gt=0.0,
        le=3.0,
        description="Stature of the person, to which the avatar is scaled; none: that of the avatar [m].",
    )
    rest: Literal["identity", "t_pose"] = Field(
        "identity",
        description="Rest pose of the bones: identity (no bone turned, as VRM 0 avatars) or t_pose (the person stands "
        "in a T-pose while learn_s lasts, for avatars whose bones are turned at rest) [-].",
    )


class VmcOsc(LiveSource[VmcOscConfig]):
    """Receives an avatar's bones by the VMC protocol, as VR tracking and VTuber programs send them."""

    name = "vmc_osc"
    extra = EXTRA
    gives = frozenset({"orientation"})
    _tree: BoneTree
    _body: SegmentBody

    def decoder(self) -> Decoder:
        """Return a decoder of OSC bundles."""
        return VmcDecoder()

    def learn(self, samples: Sequence[Sample]) -> None:
        """Find the tree, lengths, rest pose and floor.

        Raises:
            ImitorError: There is no body, or no rest pose.
        """
        self._tree = BoneTree([s.body for s in samples])
        poses = [self._tree.poses(s.body) for s in samples]
        seen = Bones(self._tree.nodes, np.stack([p for p, _ in poses]), np.stack([r for _, r in poses]))
        card = load_card(Registry().cards("skeletons")[CARD])
        fit, missing = fit_card(CARD, card, NodeNames(seen.nodes))
        if missing:
            raise ImitorError(
                f"the avatar has no bone {', '.join(missing)}; a body needs them: take another avatar"
            )
        t_pose = self.config.rest == "t_pose"
        self._body, self.skeleton = learn_bones(
            seen, fit, self.rate_hz, self.config, t_pose=t_pose, scaled=True
        )

    def human(self, sample: Sample, time_s: float) -> HumanFrame:
        """Return the frame of one instant."""
        return self._body.frame(*self._tree.poses(sample.body), time_s)

    @classmethod
    def encoder(cls, source: Source[Any]) -> Encoder:
        """Return what sends a recording as an avatar with the person's bones.

        Raises:
            ImitorError: The recording has no orientations, or lacks parts of the body.
        """
        check_sendable(cls.name, source)
        return VmcEncoder(source.skeleton)


@hookimpl
def imitor_components() -> list[type[VmcOsc]]:
    """Return the components of this module."""
    return [VmcOsc]
