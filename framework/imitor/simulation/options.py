"""What a simulated robot can be told: its servos, the floor, what counts as a fall."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from imitor.errors import SinkError
from imitor.kinds import Config, RunInfo

if TYPE_CHECKING:
    from imitor.simulation.body import Body

_Positive = Annotated[float, Field(gt=0)]


class PhysicsConfig(Config):
    """The servos, the floor, and what counts as a fall."""

    kp_per_effort: float = Field(
        30.0, gt=0, description="Stiffness of the servos by their torque limit [1/rad]."
    )
    kv_per_kp: float = Field(0.05, gt=0, le=1, description="Damping of the servos by their stiffness [s].")
    kp_nm_per_rad: Mapping[str, _Positive] = Field(
        {}, description="Stiffness of single servos: joint, template or * [N m/rad]."
    )
    effort_nm: Mapping[str, _Positive] = Field(
        {}, description="Torque limits in place of the model's: joint, template or * [N m]."
    )
    velocity_reference: bool = Field(
        True,
        description="Whether servos damp the deviation from the commanded speed; all speed otherwise [-].",
    )
    armature_per_effort: float = Field(
        2e-4,
        ge=0,
        description="Inertia of motor and gear where the model has none, by the torque limit [kg m^2/(N m)].",
    )
    friction: float = Field(0.8, gt=0, le=5, description="Friction coefficient of floor and robot [-].")
    touch: Literal["points", "hulls"] = Field(
        "points",
        description="What feels the floor beside the soles: points at the joints, or hulls of the visible parts [-].",
    )
    step_s: float = Field(0.002, gt=0, le=0.01, description="Time step of the simulation [s].")
    fall_tilt_rad: float = Field(
        math.radians(45.0), gt=0, le=math.pi,
        description="A fall: the base tilts by so much more than the motion asks for [rad].",
    )  # fmt: skip
    fall_drop_share: float = Field(
        0.3, gt=0, le=1,
        description="A fall: the base is by so much of its standing height lower than the motion asks for [-].",
    )  # fmt: skip


def build_body(config: PhysicsConfig, run: RunInfo, *, held: bool = False) -> Body:
    """Return the robot of a run in MuJoCo.

    Args:
        config: The physics.
        run: The run.
        held: Whether the base is held where the motion has it, as on a stand.

    Raises:
        RobotError: The robot cannot be simulated so.
        SinkError: An object's mesh cannot be read.
    """
    from imitor.simulation.body import Body, Surroundings
    from imitor.simulation.drives import make_drives

    c = config
    drives = make_drives(
        run.robot, kp_per_effort=c.kp_per_effort, kv_per_kp=c.kv_per_kp, effort=c.effort_nm, kp=c.kp_nm_per_rad
    )  # fmt: skip
    around = Surroundings(
        step_s=c.step_s, friction=c.friction, armature_per_effort=c.armature_per_effort, touch=c.touch
    )
    try:
        return Body(run.robot, drives, around, visible=run.view, environment=run.environment, held=held)
    except ValueError as error:
        raise SinkError(str(error)) from None


__all__ = ["PhysicsConfig", "build_body"]
