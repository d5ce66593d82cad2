"""The source of OptiTrack's NatNet."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from typing import Any, Final, Literal

import numpy as np
from pydantic import Field

from imitor import HumanFrame, Source, hookimpl
from imitor.errors import ImitorError
from imitor.live.asker import Asker
from imitor.live.body_options import BodyConfig
from imitor.live.bone_body import Bones, learn_bones
from imitor.live.markers import MarkerPerson
from imitor.live.natnet_body import NatNetBones, of_skeleton
from imitor.live.natnet_decoder import NatNetDecoder, NatNetMarkers, NatNetPose
from imitor.live.natnet_sender import NatNetEncoder
from imitor.live.receiver import bind
from imitor.live.sample import Decoder, Sample
from imitor.live.segment_body import SegmentBody
from imitor.live.sendable import check_sendable
from imitor.live.sender import Encoder
from imitor.live.source import LiveSource
from imitor.motion.marker_file import MarkerFile
from imitor.motion.marker_recording import MarkerOptions, learn_markers
from imitor.motion.marker_sets import choose_marker_set
from imitor.motion.recognition import choose_skeleton
from imitor.registry import Registry

_ASK_EVERY_S: Final = 0.5


class OptitrackConfig(BodyConfig):
    """Options of the OptiTrack source."""

    port: int = Field(1511, ge=0, le=65535, description="Port to listen at; 0 takes a free one [-].")
    server: str = Field(
        "",
        description="Address of the machine with Motive, to be asked for its version and skeletons; empty: only listen "
        "[-].",
    )
    command_port: int = Field(1510, ge=1, le=65535, description="Port at which the server is asked [-].")
    multicast: str = Field(
        "",
        pattern=r"^$|^2(2[4-9]|3\d)(\.\d{1,3}){3}$",
        description="Group to join on the interface of host, Motive's is 239.255.42.99; empty: unicast [-].",
    )
    version: str = Field(
        "",
        pattern=r"^$|^[2-4]\.\d{1,2}$",
        description="NatNet version of the server, such as 3.1; empty: as it tells [-].",
    )
    body: Literal["skeleton", "markers"] = Field(
        "skeleton", description="What shows the person: a skeleton that Motive solves, or a marker set [-]."
    )
    asset: str = Field("", description="Name of the skeleton or marker set in Motive; empty: the first [-].")
    skeleton: str = Field(
        "auto", description="Skeleton card of the names of bones: auto, a card's name or a path [-]."
    )
    marker_set: str = Field(
        "auto", description="Marker set of the names of markers: auto, a card's name or a path [-]."
    )
    coordinates: Literal["global", "local"] = Field(
        "global",
        description="Motive's setting Skeleton Coordinates: global, or local to the parent bone [-].",
    )
    up: Literal["y", "z"] = Field("y", description="Motive's setting Up Axis: y or z [-].")
    rest: Literal["identity", "t_pose"] = Field(
        "identity",
        description="Rest pose of the bones: identity (no bone turned) or t_pose (the person stands in a T-pose while "
        "learn_s lasts) [-].",
    )


class Optitrack(LiveSource[OptitrackConfig]):
    """Receives a skeleton or a marker set that OptiTrack Motive streams by NatNet, versions 2.0 to 4.1."""

    name = "optitrack"
    gives = frozenset({"orientation", "markers"})
    _wire: NatNetDecoder | None = None
    _asker: Asker | None = None
    _bones: NatNetBones
    _body: SegmentBody
    _markers: MarkerPerson | None = None

    def decoder(self) -> Decoder:
        """Return a decoder of frames and descriptions."""
        c = self.config
        major, _, minor = c.version.partition(".")
        version = (int(major), int(minor)) if c.version else None
        self._wire = NatNetDecoder(c.asset, version, markers=c.body == "markers")
        return self._wire

    def open(self) -> socket.socket:
        """Return the bound socket, from which the server is asked, too.

        Raises:
            ImitorError: There is no such server, or the address to listen at is not to be had.
        """
        c = self.config
        address = _found(c.server) if c.server else ""
        sock = bind(c.host, c.port, multicast=c.multicast)
        if address:
            self._asker = Asker(sock, (address, c.command_port), self._requests, _ASK_EVERY_S)
        return sock

    def _requests(self) -> Sequence[bytes]:
        return () if self._wire is None else self._wire.requests()

    def start(self) -> None:
        """Ask the server, wait for it, and learn who is there.

        Raises:
            ImitorError: Nobody sends, or what is sent has no body.
        """
        try:
            super().start()
        except ImitorError:
            lacking = "" if self._wire is None else self._wire.lacking()
            if lacking and not self.reception.samples:
                raise ImitorError(lacking) from None
            raise

    def learn(self, samples: Sequence[Sample]) -> None:
        """Find lengths, rest pose and floor.

        Raises:
            ImitorError: There is no body, or no rest pose.
        """
        if self.config.body == "markers":
            self._learn_markers([s.body for s in samples])
        else:
            self._learn_skeleton([s.body for s in samples])

    def _learn_markers(self, told: Sequence[NatNetMarkers]) -> None:
        c, labels = self.config, told[-1].labels
        position = np.array([t.position for t in told if t.labels == labels])
        fit = choose_marker_set(self.name, labels, c.marker_set, "", Registry().cards("markersets"))
        file = MarkerFile(labels, position, self.rate_hz, unit="m")
        options = MarkerOptions(
            up=c.up, floor=c.recorded_floor, height_m=c.height_m, mass_kg=c.mass_kg, sex=c.sex
        )
        self._markers = MarkerPerson(labels, fit, learn_markers(self.name, file, fit, options), position)
        self.skeleton = self._markers.skeleton

    def _learn_skeleton(self, poses: Sequence[NatNetPose]) -> None:
        c = self.config
        poses = of_skeleton(poses)
        self._bones = NatNetBones(poses[-1].model, c.up, local=c.coordinates == "local")
        seen = [self._bones.poses(p) for p in poses]
        position, rotation = np.stack([p for p, _ in seen]), np.stack([r for _, r in seen])
        bones = Bones(self._bones.nodes(position, rotation), position, rotation)
        where = f"skeleton '{poses[-1].model.name}'"
        fit = choose_skeleton(where, bones.nodes, position[-1], c.skeleton, Registry().cards("skeletons"))
        t_pose = c.rest == "t_pose"
        self._body, self.skeleton = learn_bones(bones, fit, self.rate_hz, c, t_pose=t_pose, scaled=False)

    def human(self, sample: Sample, time_s: float) -> HumanFrame:
        """Return the frame of one instant."""
        if self._markers is not None:
            return self._markers.frame(time_s, sample.body.labels, sample.body.position)
        return self._body.frame(*self._bones.poses(sample.body), time_s)

    def reset(self) -> None:
        """Forget how the elbows were last bent, where markers show it."""
        if self._markers is not None:
            self._markers.reset()

    def close(self) -> None:
        """Stop asking and listening."""
        if self._asker is not None:
            self._asker.close()
        super().close()

    @classmethod
    def encoder(cls, source: Source[Any]) -> Encoder:
        """Return what sends a recording as Motive does.

        Raises:
            ImitorError: The recording has neither orientations of a whole body nor markers.
        """
        markers_alone = "orientation" not in source.gives and bool(source.skeleton.marker_names)
        if not markers_alone:
            check_sendable(cls.name, source)
        return NatNetEncoder(source.skeleton, source.rate_hz, bones=not markers_alone)


def _found(server: str) -> str:
    """Return the address of a machine."""
    try:
        return str(socket.getaddrinfo(server, None, socket.AF_INET)[0][4][0])
    except (OSError, UnicodeError):
        raise ImitorError(f"no machine is known as server '{server}'; give its address") from None


@hookimpl
def imitor_components() -> list[type[Optitrack]]:
    """Return the components of this module."""
    return [Optitrack]
