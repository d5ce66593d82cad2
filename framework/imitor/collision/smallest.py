r"""The smallest motion under linear inequalities, by non-negative least squares.

:math:`\min \|x\|^2` with :math:`G x \ge h` is the non-negative least-squares problem
:math:`\min_{u \ge 0} \|E u - f\|` with :math:`E = (G^T; h^T)`, :math:`f = (0, 1)`; with its residual
:math:`r = E u - f`, :math:`x = -r_{1 \dots n} / r_{n+1}` (Lawson and Hanson 1974, chapter 23).
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from imitor.types import Array

_SLACK = 1e-4
"""How much of a separation may be left undone for one unit of motion, where limits forbid it."""


def smallest_motion(wish: Array, A: Array, b: Array, low: Array, high: Array, C: Array, c: Array) -> Array:
    """Return x nearest to a wish with A x >= b, low <= x <= high and, as well as these allow, C x = c.

    The box is kept exactly; where it does not let all of A x >= b be reached, the rest is spread over the rows.

    Args:
        wish: What x would be without constraints, shape (n,).
        A, b: Inequalities, shapes (m, n) and (m,).
        low, high: Box, shapes (n,), with low <= high.
        C, c: What shall stay, shapes (k, n) and (k,).
    """
    n, m = len(wish), len(b)
    H = np.eye(n) + 1e6 * C.T @ C
    L = np.linalg.cholesky(H)
    centre = np.linalg.solve(H, wish + 1e6 * C.T @ c)
    back = np.linalg.inv(L).T  # x = centre + back z
    G = np.zeros((m + 2 * n, n + m))
    G[:m, :n], G[:m, n:] = A @ back, _SLACK * np.eye(m)
    G[m : m + n, :n], G[m + n :, :n] = back, -back
    h = np.concatenate([b - A @ centre, low - centre, centre - high])
    if not (h > 0.0).any():
        return np.clip(centre, low, high)
    E = np.vstack([G.T, h])
    f = np.zeros(n + m + 1)
    f[-1] = 1.0
    try:
        u, _ = nnls(E, f, maxiter=20 * len(h))
    except RuntimeError:  # did not converge: what is wished, within the box
        return np.clip(centre, low, high)
    r = E @ u - f
    if abs(r[-1]) < 1e-14:
        return np.clip(centre, low, high)
    x: Array = centre - back @ (r[:n] / r[-1])
    return np.clip(x, low, high)
