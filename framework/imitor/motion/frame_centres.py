"""Joint centres from markers for one frame at a time: the regressions of `joint_centres`, with constants found before.

Every number is as in a recording but one: while an arm is straight, the axis of its elbow is carried over from the
bent frames before, in the axes of the pelvis; a recording also knows the bent frames after.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any

from imitor.motion.joint_centres import (
    BACK,
    BENT,
    CHEST_SHARE,
    DOWN,
    HALF_WIDTH_M,
    HAND_SHARE,
    HEAD_OVER_NECK,
    HEAD_SHARE,
    INWARDS,
    NECK_DEPTH,
    PASSES,
    SHOULDER_DROP,
    CentreFit,
)
from imitor.motion.triples import (
    NOWHERE,
    Triple,
    Vector,
    across,
    cross,
    dot,
    known,
    length,
    minus,
    plus,
    towards,
    unit,
)
from imitor.types import SIDES

Points = Mapping[str, Vector]


class FrameCentres:
    """Finds the joint centres of one frame.

    Args:
        fit: What is constant of the person.
        landmarks: The landmarks that the set has and that were seen; each frame must tell them all, lost ones as NaN.
    """

    def __init__(self, fit: CentreFit, landmarks: Collection[str]) -> None:
        self._fit, self._has = fit, frozenset(landmarks)
        self._axes: dict[tuple[str, int], Triple] = {}

    @property
    def memory(self) -> Any:
        """The axes of the elbows when they were last bent; may be put back."""
        return dict(self._axes)

    @memory.setter
    def memory(self, axes: Any) -> None:
        self._axes = dict(axes)

    def place(self, points: Points) -> dict[str, Triple]:
        """Return role to position [m]; NaN where a marker that is needed is lost.

        Args:
            points: Landmark to position [m].
        """
        fit, has = self._fit, self._has
        out: dict[str, Triple] = {}
        left, right = points["left_asis"], points["right_asis"]
        back = points["sacrum"] if "sacrum" in has else towards(points["left_psis"], points["right_psis"])
        lateral = unit(minus(left, right))
        forward = unit(across(minus(towards(left, right), back), lateral))
        up = cross(forward, lateral)
        for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
            into = plus(plus(plus((0.0, 0.0, 0.0), lateral, -sign * INWARDS), forward, -BACK), up, -DOWN)
            out[f"{side}_hip"] = plus(points[f"{side}_asis"], into, fit.pelvis_m)
        pelvis = out["pelvis"] = towards(out["left_hip"], out["right_hip"])
        shoulders = None
        if "left_shoulder" in has and "right_shoulder" in has:
            shoulders = unit(minus(points["left_shoulder"], points["right_shoulder"]))
        neck = out["neck"] = self._neck(points, pelvis, forward, shoulders)
        trunk = unit(minus(neck, pelvis))
        for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
            self._leg(out, points, side, sign, lateral)
            if f"{side}_shoulder" in has:
                drop = -SHOULDER_DROP * fit.shoulders_m
                out[f"{side}_shoulder"] = plus(points[f"{side}_shoulder"], trunk, drop)
                self._arm(out, points, side, sign, shoulders, (forward, lateral, up))
        if fit.head and "head" in has:
            out["head"] = towards(neck, points["head"], HEAD_SHARE)
        else:
            out["head"] = plus(neck, trunk, HEAD_OVER_NECK * fit.height_m)
        if "sternum" in has and "t10" in has:
            out["chest"] = towards(points["sternum"], points["t10"])
        else:
            sides = [out.get(f"{s}_shoulder") for s in SIDES]
            top = neck if sides[0] is None or sides[1] is None else towards(sides[0], sides[1])
            out["chest"] = towards(pelvis, top, CHEST_SHARE)
        return out

    def _neck(self, points: Points, pelvis: Triple, forward: Triple, shoulders: Triple | None) -> Triple:
        c7, notch = "c7" in self._has, "clavicle" in self._has
        if c7 and notch:
            return towards(points["c7"], points["clavicle"])
        if not c7 and not notch:
            return towards(points["left_shoulder"], points["right_shoulder"])
        one = points["c7" if c7 else "clavicle"]
        ahead = forward if shoulders is None else unit(cross(shoulders, unit(minus(one, pelvis))))
        return plus(one, ahead, (1.0 if c7 else -1.0) * NECK_DEPTH * self._fit.height_m)

    def _leg(self, out: dict[str, Triple], points: Points, side: str, sign: float, lateral: Triple) -> None:
        has, hip, outer = self._has, out[f"{side}_hip"], points[f"{side}_knee_lateral"]
        feet = f"{side}_heel" in has and f"{side}_toe" in has
        low = points[f"{side}_ankle_lateral"]
        if f"{side}_knee_medial" in has:
            knee = towards(outer, points[f"{side}_knee_medial"])
        else:
            axis = lateral
            if feet:
                foot = unit(cross(minus(outer, low), minus(points[f"{side}_toe"], points[f"{side}_heel"])))
                axis = plus(lateral, foot) if known(foot) else lateral
            knee = inwards_of(outer, hip, axis, sign, HALF_WIDTH_M["knee"])
        if f"{side}_ankle_medial" in has:
            ankle = towards(low, points[f"{side}_ankle_medial"])
        else:
            ankle = inwards_of(low, knee, minus(outer, knee), 1.0, HALF_WIDTH_M["ankle"])
        out[f"{side}_knee"], out[f"{side}_ankle"] = knee, ankle
        for name in ("heel", "toe"):
            if f"{side}_{name}" in has:
                a, b, c = points[f"{side}_{name}"]
                out[f"{side}_{name}"] = a, b, c

    def _arm(
        self,
        out: dict[str, Triple],
        points: Points,
        side: str,
        sign: float,
        shoulders: Triple | None,
        pelvis: tuple[Triple, Triple, Triple],
    ) -> None:
        has = self._has
        if f"{side}_elbow_lateral" not in has:
            return
        outer, shoulder = points[f"{side}_elbow_lateral"], out[f"{side}_shoulder"]
        wrist: Triple | None = None
        if f"{side}_wrist_radial" in has and f"{side}_wrist_ulnar" in has:
            wrist = towards(points[f"{side}_wrist_radial"], points[f"{side}_wrist_ulnar"])
        elif f"{side}_wrist" in has:
            a, b, c = points[f"{side}_wrist"]
            wrist = a, b, c
        elbow: Triple = (outer[0], outer[1], outer[2])
        if f"{side}_elbow_medial" in has:
            elbow = towards(outer, points[f"{side}_elbow_medial"])
        else:
            for k in range(PASSES):
                axis = shoulders
                if wrist is not None:
                    axis = self._elbow_axis((side, k), shoulder, elbow, wrist, shoulders, pelvis)
                if axis is None:
                    break
                elbow = inwards_of(outer, shoulder, axis, sign, HALF_WIDTH_M["elbow"])
        out[f"{side}_elbow"] = elbow
        if wrist is None:
            return
        out[f"{side}_wrist"] = wrist
        if f"{side}_hand" in has:
            a, b, c = points[f"{side}_hand"]
            out[f"{side}_hand"] = a, b, c
        else:
            out[f"{side}_hand"] = plus(wrist, minus(wrist, elbow), HAND_SHARE)

    def _elbow_axis(
        self,
        which: tuple[str, int],
        shoulder: Triple,
        elbow: Triple,
        wrist: Triple,
        shoulders: Triple | None,
        pelvis: tuple[Triple, Triple, Triple],
    ) -> Triple | None:
        """Return the axis that the bent arm shows, else the one it had, else the line of the shoulders."""
        upper = unit(minus(elbow, shoulder))
        normal = cross(unit(minus(wrist, elbow)), upper)
        bend = length(normal)
        if math.isnan(bend):
            return NOWHERE
        if bend > BENT:
            axis = unit(across(unit(normal), upper))
            told = tuple(dot(axis, p) for p in pelvis)
            if known(told):
                self._axes[which] = told  # type: ignore[assignment]
            return axis
        held = self._axes.get(which)
        if held is None:
            return shoulders
        forward, lateral, up = pelvis
        world = plus(plus(plus((0.0, 0.0, 0.0), forward, held[0]), lateral, held[1]), up, held[2])
        return unit(across(world, upper))


def inwards_of(outer: Vector, above: Vector, outwards: Vector, sign: float, half_width_m: float) -> Triple:
    """Return a joint's centre; see `imitor.motion.joint_centres.inwards_of`.

    Args:
        outer, above: The outer marker and the next centre above [m].
        outwards: Direction from the centre to the marker, about.
        sign: -1 when ``outwards`` points the other way.
        half_width_m: From the marker to the centre [m].
    """
    limb = minus(above, outer)
    size = length(limb)
    if not size > 0.0:
        return NOWHERE
    along = (limb[0] / size, limb[1] / size, limb[2] / size)
    inwards = unit(across(outwards, along))
    cosine = min(half_width_m / size, 0.5)
    return plus(
        plus(outer, along, half_width_m * cosine),
        inwards,
        -sign * half_width_m * math.sqrt(1.0 - cosine * cosine),
    )


def heel_down(heel: Vector, toe: Vector, ankle: Vector, down: Vector) -> Triple:
    """Return the heel moved down to the sole; see `imitor.motion.marker_recording.find_heels`.

    Args:
        heel, toe, ankle: Their places [m].
        down: The way down, in the axes of the foot [m].
    """
    ahead = unit(minus(toe, heel))
    second = unit(across(minus(ankle, heel), ahead))
    third = cross(ahead, second)
    return plus(plus(plus(heel, ahead, down[0]), second, down[1]), third, down[2])


__all__ = ["FrameCentres", "heel_down", "inwards_of"]
