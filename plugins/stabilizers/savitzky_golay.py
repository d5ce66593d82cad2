"""Smooth targets of hands by polynomials fitted to a moving window."""

from __future__ import annotations

from collections.abc import Sequence
from math import factorial
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from imitor import Component, Config, Configuration, HumanFrame, Stabilizer, TaskKind, TaskStack, hookimpl
from imitor.types import Array, BoolArray, IntArray


class SavitzkyGolayConfig(Config):
    """Options of the smoothing."""

    tasks: Sequence[str] = Field(
        ["left_hand", "right_hand"], description="Position and pose tasks to smooth, where declared [-]."
    )
    window: int = Field(11, ge=3, le=501, description="Samples of the window, an odd number [-].")
    order: int = Field(3, ge=0, le=9, description="Degree of the polynomial, less than window [-].")
    centred: bool = Field(
        False,
        description="Evaluate in the middle of the window: smoother, half a window late; no: at the newest.",
    )

    @model_validator(mode="after")
    def _fits(self) -> SavitzkyGolayConfig:
        if self.window % 2 == 0:
            raise ValueError(
                f"window {self.window} is even; it has a middle sample when odd: {self.window + 1}"
            )
        if self.order >= self.window:
            raise ValueError(f"order {self.order} needs a window of more than {self.order} samples")
        return self


class SavitzkyGolay(Stabilizer[SavitzkyGolayConfig]):
    """Smooth the hands' targets by least-squares polynomials over a moving window [savitzky1964], [tomic2018] T9.

    Centred, it changes no polynomial of degree up to `order` and no phase, and delays all by half a window, which
    the run accounts for: all tasks, the anchor and the contact are delayed alike. Otherwise it fits the samples so far.
    Rotations are smoothed as matrices and made rotations again.
    """

    name = "savitzky_golay"

    def start(self) -> None:
        """Compute the weights of the samples."""
        c = self.config
        self._weights = weights(c.window, c.order, c.window // 2 if c.centred else c.window - 1)

    @property
    def delay_frames(self) -> int:
        """Half a window, where centred."""
        return self.config.window // 2 if self.config.centred else 0

    def reset(self) -> None:
        """Forget the samples."""
        self._past: dict[str, Array] = {}
        self._flat: list[tuple[Array, BoolArray, Array, str, Array, BoolArray, IntArray, Array]] = []

    def step(self, frame: HumanFrame, stack: TaskStack, state: Configuration) -> None:
        """Replace the targets by smoothed ones."""
        smoothed = {}
        for name in self.config.tasks:
            if name in stack and stack[name].kind in (TaskKind.POSE, TaskKind.POSITION, TaskKind.COM):
                smoothed[name] = self._smooth(name, stack[name].target)
        if self.config.centred:
            self._delay(stack)
        for name, value in smoothed.items():
            task = stack[name]
            task.target[...] = value
            if task.kind is TaskKind.POSE:
                U, _, Vt = np.linalg.svd(value[:3, :3])
                task.target[:3, :3] = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
                task.target[3] = (0.0, 0.0, 0.0, 1.0)

    def _smooth(self, name: str, target: Array) -> Array:
        """Take a sample in and return the value of the polynomial; before the first sample all was like it."""
        if name not in self._past:
            self._past[name] = np.repeat(target[None], self.config.window, axis=0)
        past = self._past[name]
        past[:-1] = past[1:]
        past[-1] = target
        return np.asarray(np.tensordot(self._weights, past, axes=1))

    def _delay(self, stack: TaskStack) -> None:
        """Give everything back that was told half a window before."""
        now = (
            stack.flat_target.copy(), stack.flat_switch.copy(), stack.flat_gain.copy(),
            stack.anchor, stack.anchor_pose.copy(), stack.contact.copy(), stack.held.copy(), stack.object_shift.copy(),
        )  # fmt: skip
        if not self._flat:
            self._flat = [now] * self.delay_frames
        self._flat.append(now)
        target, switch, gain, anchor, pose, contact, held, shift = self._flat.pop(0)
        stack.flat_target[:], stack.flat_switch[:], stack.flat_gain[:] = target, switch, gain
        stack.anchor = anchor
        stack.anchor_pose[:], stack.contact[:] = pose, contact
        stack.held[:], stack.object_shift[:] = held, shift


def weights(window: int, order: int, at: int, derivative: int = 0) -> Array:
    """Return what each sample counts in the fitted polynomial's value or derivative at a sample, shape (window,) [-].

    Args:
        window: Number of samples.
        order: Degree of the polynomial.
        at: Index of the sample at which the polynomial is evaluated.
        derivative: Which derivative, per sample.
    """
    powers = np.vander(np.arange(window) - at, order + 1, increasing=True).astype(float)
    return np.asarray(factorial(derivative) * np.linalg.pinv(powers)[derivative])


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the stabilizer."""
    return [SavitzkyGolay]
