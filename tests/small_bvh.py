"""A small BVH file as text: a person of 1.75 m in centimetres, y up, who waves the left forearm."""

from __future__ import annotations

import math

_TURN = "CHANNELS 3 Zrotation Yrotation Xrotation"
_CENTRE = ("Hips", "Spine", "Neck", "Head")
_SIDE = {
    "Spine": (("Arm", 18, -5, 0), ("ForeArm", 28, 0, 0), ("Hand", 25, 0, 0)),
    "Hips": (("UpLeg", 9, -3, 0), ("Leg", 0, -42, 0), ("Foot", 0, -42, 0), ("ToeBase", 0, -6, 13)),
}
"""Joint of the middle -> chain on each side: name and offset from its parent, left, up, forward [cm]."""


def small_bvh(frames: int = 30) -> str:
    """Return the text of the file."""
    lines = ["HIERARCHY"]
    joints: list[str] = []
    _open(lines, joints, "ROOT Hips", (0, 95, 0), "CHANNELS 6 Xposition Yposition Zposition " + _TURN[11:])
    _sides(lines, joints, "Hips")
    _open(lines, joints, "JOINT Spine", (0, 15, 0), _TURN)
    _sides(lines, joints, "Spine")
    _open(lines, joints, "JOINT Neck", (0, 38, 0), _TURN)
    _open(lines, joints, "JOINT Head", (0, 10, 0), _TURN)
    lines += ["End Site", "{", "OFFSET 0 17 0", "}", *["}"] * len(_CENTRE)]
    lines += ["MOTION", f"Frames: {frames}", "Frame Time: 0.0333333"]
    for i in range(frames):
        turn = 20 * math.sin(2 * math.pi * i / 30)
        angles = (f"0 {turn if joint == 'LeftForeArm' else 0:.4f} 0" for joint in joints)
        lines.append(" ".join(["0 95 0", *angles]))
    return "\n".join(lines) + "\n"


def _open(
    lines: list[str], joints: list[str], head: str, offset: tuple[int, int, int], channels: str
) -> None:
    joints.append(head.split()[1])
    lines += [head, "{", "OFFSET " + " ".join(map(str, offset)), channels]


def _sides(lines: list[str], joints: list[str], parent: str) -> None:
    for side, sign in (("Left", 1), ("Right", -1)):
        for name, left, up, forward in _SIDE[parent]:
            _open(lines, joints, f"JOINT {side}{name}", (sign * left, up, forward), _TURN)
        last = _SIDE[parent][-1]
        lines += ["End Site", "{", f"OFFSET {sign * last[1] // 2} 0 {last[3] // 2}", "}"]
        lines += ["}"] * len(_SIDE[parent])
