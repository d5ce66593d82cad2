r"""The zero moment point of a whole body, from its momentum: exact, where the cart-table model takes a point mass.

Of a body with CoM :math:`c`, linear momentum :math:`P` and angular momentum :math:`L` about the origin the floor's
force and moment about the origin are, by Newton and Euler,

.. math::
    f = \dot P - m g, \qquad n = \dot L - c \times m g, \qquad p_x = -n_y / f_z, \quad p_y = n_x / f_z .

With :math:`\ddot c_z = 0` and no angular momentum about the CoM this is the cart-table model [kajita2003].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imitor.metrics.balance import GRAVITY
from imitor.robot.model import RobotModel
from imitor.types import Array


@dataclass(frozen=True)
class Momentum:
    """How a robot moves, frame by frame, in world.

    Attributes:
        mass_kg: Its mass [kg].
        com: Centre of mass, shape (T, 3) [m].
        linear: Linear momentum, shape (T, 3) [kg m/s].
        angular: Angular momentum about the world's origin, shape (T, 3) [kg m^2/s].
    """

    mass_kg: float
    com: Array
    linear: Array
    angular: Array

    @classmethod
    def of(cls, robot: RobotModel, q: Array, v: Array) -> Momentum:
        """Return the momentum of configurations (T, 7 + n) and Pinocchio velocities (T, 6 + n) [m/s, rad/s]."""
        import pinocchio as pin

        model = robot.model
        data = model.createData()
        com, h = np.empty((len(q), 3)), np.empty((len(q), 6))
        for k in range(len(q)):
            h[k] = pin.computeCentroidalMomentum(model, data, q[k], v[k]).vector
            com[k] = data.com[0]
        return cls(robot.mass_kg, com, h[:, :3], h[:, 3:] + np.cross(com, h[:, :3]))

    def zmp(self, period_s: float, frames: int = 1) -> Array:
        """Return the mean ZMP between each frame and the one ``frames`` later, shape (T - frames, 2) [m].

        It is the mean over that time weighted by the floor's vertical force, as a force plate's is.

        Args:
            period_s: Time between frames [s].
            frames: How many frames apart momenta are compared; more of them smooth.
        """
        weight = self.mass_kg * GRAVITY
        middle = 0.5 * (self.com[:-1] + self.com[1:])
        passed = np.vstack([np.zeros(3), np.cumsum(middle, axis=0)])
        com = (passed[frames:] - passed[:-frames]) / frames
        span = frames * period_s
        up = weight + (self.linear[frames:] - self.linear[:-frames])[:, 2] / span
        turn = (self.angular[frames:] - self.angular[:-frames]) / span
        return (
            np.column_stack([weight * com[:, 0] - turn[:, 1], weight * com[:, 1] + turn[:, 0]]) / up[:, None]
        )


def velocities(robot: RobotModel, q: Array, period_s: float) -> Array:
    """Return the velocities of a motion by central differences, Pinocchio's order, shape (T, 6 + n) [m/s, rad/s].

    Args:
        robot: The robot.
        q: Configurations, shape (T, 7 + n), at least two.
        period_s: Time between frames [s].
    """
    import pinocchio as pin

    out = np.empty((len(q), robot.nv))
    for k in range(len(q)):
        before, after = max(k - 1, 0), min(k + 1, len(q) - 1)
        out[k] = pin.difference(robot.model, q[before], q[after]) / ((after - before) * period_s)
    return out
