"""Collisions: links that come too near one another or an object around the robot are moved apart."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, Final

from pydantic import Field

from imitor import Component, Config, Configuration, Postprocessor, TaskStack, hookimpl
from imitor.errors import ImitorError

if TYPE_CHECKING:
    from imitor.collision.correction import Correction

_LOG: Final = logging.getLogger("imitor")


class FclCollisionConfig(Config):
    """How far apart links stay, and how quickly they are moved."""

    margin_m: float = Field(
        0.005, ge=0, le=0.1, description="Distance that links keep from one another and from objects [m]."
    )
    iterations: int = Field(6, ge=1, le=50, description="Linearisations of the distances a frame [-].")
    speed_share: float = Field(
        0.8, gt=0, le=1, description="Share of a joint's speed that a correction may grow with [-]."
    )
    release_s: float = Field(
        0.15, gt=0, description="Time in which a correction fades to 37 % when no longer needed [s]."
    )
    slide: bool = Field(
        False, description="Whether a standing foot that is not the anchor may slide on the ground [-]."
    )
    hold: bool = Field(
        True,
        description="Whether a pose whose links would still overlap is approached at half or a quarter of the step, "
        "and the last command repeated if that does not help; it is sent otherwise [-].",
    )
    interim: bool = Field(
        False,
        description="Whether later stages set the feet on the ground anew: then standing feet may move, and the pose "
        "is not slowed down to what the guard lets through [-].",
    )


class FclCollision(Postprocessor[FclCollisionConfig]):
    """Keep links off one another and off objects by the smallest change of joints that carry no standing foot.

    Distances come from python-fcl between simple shapes around the collision geometry, and objects of the pipeline's
    ``environment``, which it follows where they are moved; hands may touch those that are ``graspable``. A
    configuration in which nothing is near is left as it is, to the last bit.
    """

    name = "fcl_collision"

    correction: Correction
    """What it changed: ``changed`` and ``left`` frames, ``largest_rad``; set by `start`."""

    def start(self) -> None:
        """Prepare shapes and pairs.

        Raises:
            ImitorError: The robot has no usable collision geometry, or an object's mesh cannot be used.
        """
        from imitor.collision.correction import Correction, Settings
        from imitor.collision.obstacles import graspable, obstacles
        from imitor.collision.shapes import robot_shapes

        try:
            around = obstacles(self.environment)
        except ValueError as error:
            raise ImitorError(f"environment: {error}") from None
        try:
            shapes = robot_shapes(self.robot, self.config.margin_m, around, graspable(self.environment))
        except ValueError as error:
            raise ImitorError(
                f"robot '{self.robot.name}' cannot be checked for collisions: {error}"
            ) from None
        c = self.config
        settings = Settings(
            self.dt_s, c.margin_m, c.iterations, c.speed_share, c.release_s, c.interim, c.slide, c.hold
        )
        self.correction = Correction(self.robot, shapes, settings)
        self._told = False

    def reset(self) -> None:
        """Forget earlier frames."""
        self.correction.reset()
        self._told = False

    def step(self, stack: TaskStack, state: Configuration) -> None:
        """Move links apart that are nearer than the margin."""
        self.correction.apply(stack, state)

    def close(self) -> None:
        """Say once what was changed."""
        correction = getattr(self, "correction", None)
        if correction is None or self._told:
            return
        self._told = True
        _LOG.info(
            "fcl_collision: %d frames changed, by at most %.3f rad a joint, %d slowed down, %d held; %d frames with "
            "links still too near",
            correction.changed,
            correction.largest_rad,
            correction.slowed,
            correction.held,
            correction.left,
        )


@hookimpl
def imitor_components() -> list[type[Component[Any]]]:
    """Register the post-processor."""
    return [FclCollision]
