"""The same tasks on placo's quadratic program: weighted levels, bounds as inequalities."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from imitor import Component, Strictness, TaskKind, hookimpl
from imitor.errors import NoSolution
from imitor.ik.iterate import Bounds, IterativeConfig, IterativeSolver
from imitor.types import Array

if TYPE_CHECKING:
    from imitor.ik.layout import Layout

_HEAVIEST = 1e9
"""Most that the first level weighs against the last [-]: beyond, quadratic programs were called infeasible."""


class PlacoConfig(IterativeConfig):
    """Options of the placo solver."""

    level_ratio: float = Field(
        1e3,
        gt=1,
        description="How many times more a level weighs than the next one below it; less where many levels would make "
        "the first one weigh more than 1e9 times the last, which the program could not tell from infinity [-].",
    )
    damping: float = Field(0.01, gt=0, description="Damping of all steps, lambda [-].")
    error_damping: float = Field(
        0.1,
        ge=0,
        description="Damping added with the error of the lowest level, lambda^2 += value * |e|^2 [-].",
    )


class Placo(IterativeSolver[PlacoConfig]):
    """The same stack as one quadratic program, solved by placo's QP (eiquadprog).

    Levels become weights, joint and speed limits become inequalities that the solution respects exactly; where the
    prioritised solver fixes joints one after the other, this finds the best step among all within limits.
    """

    name = "placo"
    serves: Mapping[TaskKind, Strictness] = dict.fromkeys(TaskKind, Strictness.WEIGHTED)  # type: ignore[misc]

    def start(self) -> None:
        """Import placo."""
        import placo

        self._problem = placo.Problem

    def bounded_step(self, layout: Layout, J: Array, g: Array, limits: Bounds, speeds: Bounds) -> Array:
        """Return the optimum of the weighted program."""
        config, e, first = self.config, layout.e, layout.first
        problem = self._problem()
        variable = problem.add_variable(J.shape[1])
        step = variable.expr()
        n_levels = len(layout.starts)
        ratio = min(config.level_ratio, _HEAVIEST ** (1.0 / max(n_levels - 1, 1)))
        for level, start in enumerate(layout.starts):
            end = layout.starts[level + 1] if level + 1 < n_levels else layout.m
            row = step.left_multiply(J[start:end]) == e[start:end]
            problem.add_constraint(row).configure("soft", ratio ** (n_levels - 1 - level))
        last = e[layout.starts[-1] :] if layout.m else e
        damping2 = config.damping**2 + config.error_damping * float(last @ last)
        problem.add_constraint(step == g).configure("soft", damping2)
        joints = step.slice(first, J.shape[1] - first) if first else step
        problem.add_constraint(joints <= np.clip(np.minimum(limits[1], speeds[1]), 0.0, config.max_step_rad))
        problem.add_constraint(joints >= np.clip(np.maximum(limits[0], speeds[0]), -config.max_step_rad, 0.0))
        try:
            problem.solve()
        except RuntimeError as error:
            raise NoSolution(f"placo found no step within the limits: {error}") from None
        return np.array(variable.value)


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the solver."""
    return [Placo]
