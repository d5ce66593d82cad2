"""The prioritised solver: strict levels, gradients in the last null space, clamping loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from imitor import Component, Strictness, TaskKind, hookimpl
from imitor.ik.iterate import Bounds, IterativeConfig, IterativeSolver
from imitor.types import Array

if TYPE_CHECKING:
    from imitor.ik.layout import Layout

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


class PrioritizedConfig(IterativeConfig):
    """Options of the prioritised solver."""

    damping: Positive | Sequence[Positive] = Field(
        0.01,
        description="Damping lambda_0 of the projectors: what a level controls less is left to lower ones; one value, "
        "or one a level, the last for all further ones [-].",
    )
    yielding: NotNegative | Sequence[NotNegative] = Field(
        0.0,
        description="What a level's error adds to its lambda_0 (as squares): a level that cannot be reached leaves "
        "directions it hardly controls to lower ones; one value, or one a level [1/m, 1/rad].",
    )
    step_damping: float = Field(
        0.05,
        ge=0,
        description="Damping of the steps below the first level: keeps joints calm that a straight limb leaves "
        "almost without effect [-].",
    )
    error_damping: float = Field(
        1.0, ge=0, description="Damping of a level by its error, lambda^2 = value * |e|^2 [-]; bounds steps."
    )


class Prioritized(IterativeSolver[PrioritizedConfig]):
    """Strict task levels by the augmented Jacobian, with joint limits by clamping [pennapoubel2014] eqs. 2-8.

    Each level acts in the null space of those above it; the gradients of joint-limit avoidance and of the posture
    act in what is left. Joints that would leave their range (or exceed their speed) are fixed at the limit and the
    levels are solved again without them.
    """

    name = "prioritized"
    serves: Mapping[TaskKind, Strictness] = dict.fromkeys(TaskKind, Strictness.PRIORITISED)  # type: ignore[misc]

    def start(self) -> None:
        """Bind the kernel."""
        from imitor.ik.clamping import clamped_step

        self._clamped_step = clamped_step
        damping = self.config.damping
        self._by_level = not isinstance(damping, float)
        self._floor2 = np.square(np.atleast_1d(np.asarray(damping, dtype=float)))
        self._floor = float(self._floor2[0])
        self._yielding2 = np.square(np.atleast_1d(np.asarray(self.config.yielding, dtype=float)))
        self._yields = bool(self._yielding2.any())

    def bounded_step(self, layout: Layout, J: Array, g: Array, limits: Bounds, speeds: Bounds) -> Array:
        """Return the prioritised step within bounds, by clamping."""
        e, starts, config = layout.e, layout.starts, self.config
        calm = config.step_damping**2
        error2 = np.add.reduceat(e * e, starts) if layout.m else np.zeros(0)
        damping2 = (config.error_damping * error2 + calm).tolist()
        if damping2 and layout.first_level:
            damping2[0] -= calm
        floor2 = (
            self._floor2[np.minimum(layout.level, self._floor2.size - 1)] if self._by_level else self._floor
        )
        if self._yields and layout.m:
            share = self._yielding2[np.minimum(layout.level, self._yielding2.size - 1)]
            floor2 = floor2 + share * np.repeat(error2, np.diff([*starts, layout.m]))
        step, _ = self._clamped_step(
            J, e, g, starts, damping2, floor2, limits, speeds, layout.first, config.max_step_rad
        )
        return step


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the solver."""
    return [Prioritized]
