r"""The CoM as one number: its offset along the line between the feet [koenemann2014] eqs. 6 and 7.

.. math::
    o = \frac{(p_{com} - p_l) \cdot (p_r - p_l)}{\|p_r - p_l\|^2}

is 0 over the left foot and 1 over the right one, for human and robot alike.
"""

from __future__ import annotations

from math import atan2, cos, sin, sqrt

import numpy as np

from imitor.types import Array

_TOGETHER = 1e-9  # [m^2]


def offset_of(com: Array, left: Array, right: Array) -> float:
    """Return the offset of a point along the line between the feet [-]; the middle when they coincide (eq. 6)."""
    line = right - left
    length2 = float(line.dot(line))
    return 0.5 if length2 < _TOGETHER else float((com - left).dot(line)) / length2


def shift_for(com: Array, moved: Array, other: Array, share: float) -> float:
    r"""Return how far a foot is to move towards the CoM so that the CoM projects where it shall (figure 5).

    With :math:`a = p_{com} - p_m`, :math:`b = p_o - p_m` and the moved foot at :math:`p_m + s a`, the condition
    :math:`(1 - s)\, a \cdot (b - s a) = o\, \|b - s a\|^2` is quadratic in :math:`s`; the smaller motion is taken.

    Args:
        com: The CoM, shape (3,) [m].
        moved: The foot to move, shape (3,) [m].
        other: The other foot, shape (3,) [m].
        share: Wanted offset measured from the moved foot to the other one [-].

    Returns:
        The share s of the way from the foot to the CoM; 0 where no motion on this line can do it.
    """
    a, b = com - moved, other - moved
    aa, ab, bb = float(a.dot(a)), float(a.dot(b)), float(b.dot(b))
    A, B, C = (1.0 - share) * aa, -(ab + aa - 2.0 * share * ab), ab - share * bb
    if abs(A) < 1e-12 * aa:
        return -C / B if abs(B) > 1e-12 else 0.0
    root = B * B - 4.0 * A * C
    if root < 0.0:
        return 0.0
    half = -0.5 * (B + (sqrt(root) if B >= 0.0 else -sqrt(root)))
    candidates = [half / A] + ([C / half] if half != 0.0 else [])
    return min(candidates, key=abs)


def foot_normal(com: Array, left: Array, right: Array, offset: float) -> Array:
    """Return the unit normal of the soles: from the point at an offset between the feet to the CoM (eq. 7)."""
    n = com - (left + offset * (right - left))
    return np.asarray(n / sqrt(n.dot(n)))


def upright(normal: Array) -> Array:
    """Return a rotation, the smallest but near half a turn, that takes a unit vector to the vertical, shape (3, 3)."""
    x, y, z = normal.tolist()
    if z < -0.9:  # nearly upside down: half a turn first, or rounding would grow
        half_turn = np.array([1.0, -1.0, -1.0])
        return np.asarray(upright(normal * half_turn) * half_turn)
    k = 1.0 / (1.0 + z)
    return np.array([[1.0 - k * x * x, -k * x * y, -x], [-k * x * y, 1.0 - k * y * y, -y], [x, y, z]])


def tilt_left(R: Array, turn: float) -> Array:
    """Return the tilt that is left of a rotation's z axis after it was turned towards the vertical [rad], (3, 3)."""
    x, y, z = R[:, 2].tolist()
    across = sqrt(x * x + y * y)
    angle = max(atan2(across, z) - turn, 0.0)
    if angle == 0.0 or across < 1e-9:
        return np.eye(3)
    c, s, a, b = cos(angle), sin(angle), x / across, y / across  # about the horizontal axis (-b, a, 0)
    k = 1.0 - c
    return np.array(
        [[c + k * b * b, -k * a * b, s * a], [-k * a * b, c + k * a * a, s * b], [-s * a, -s * b, c]]
    )


def yaw_of(R: Array) -> float:
    """Return the heading of a rotation's x axis [rad]."""
    return atan2(R[1, 0], R[0, 0])


def heading_of(R: Array) -> float:
    """Return the heading that a tilted rotation has once it is turned upright the shortest way [rad]."""
    return yaw_of(upright(R[:, 2]) @ R)


def yaw(angle: float) -> Array:
    """Return the rotation about the vertical, shape (3, 3)."""
    c, s = cos(angle), sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
