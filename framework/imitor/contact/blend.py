"""Between two poses."""

from __future__ import annotations

import pinocchio as pin

from imitor.types import Array


def blend(first: Array, second: Array, share: float) -> Array:
    """Return the pose at a share of the way from one pose to another, straight and turning evenly, shape (4, 4)."""
    out = first.copy()
    out[:3, 3] += share * (second[:3, 3] - first[:3, 3])
    out[:3, :3] = first[:3, :3] @ pin.exp3(share * pin.log3(first[:3, :3].T @ second[:3, :3]))
    return out
