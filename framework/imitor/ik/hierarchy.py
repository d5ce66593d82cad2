r"""The prioritised damped step: strict levels, gradients in the last null space.

The recursion of [pennapoubel2014] eqs. 4-6 (after [baerlocher2004]) for levels :math:`J_1 \dots J_N`

.. math::
    \dot q_{j+1} = \dot q_j + (J_{j+1} P^a_j)^+ (e_{j+1} - J_{j+1} \dot q_j), \qquad
    \dot q = \dot q_N + P^a_N g

needs no projector and no SVD. With the Cholesky factor :math:`L L^T = J J^T` of the stacked levels, the rows of
:math:`Q = L^{-1} J` are orthonormal, those of level :math:`j` span what it can move without disturbing the levels
above, and :math:`J_{j} P^a_{j-1} = L_{jj} Q_j`. So

.. math::
    z_j = L_{jj}^T (L_{jj} L_{jj}^T + \lambda_j^2 I)^{-1} \Big(e_j - \sum_{k<j} L_{jk} z_k\Big), \qquad
    \dot q = g + Q^T (z - Q g).

Two dampings with two duties: :math:`\lambda_j` bounds the step of level :math:`j` near its singularities and grows with
its error; a small one, :math:`\lambda_0`, is added to :math:`J J^T` so that directions a level can hardly control
(singular value below :math:`\lambda_0`) are left to the levels below. A lower level disturbs a higher one by at most
:math:`\lambda_0 / 2` of its own motion, along such directions only. With both at 0 this is the recursion; the tests
check it against the recursion with SVD pseudo-inverses.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg.lapack import dposv, dpotrf, dtrtrs

from imitor.types import Array


def prioritised_step(
    J: Array, e: Array, g: Array, starts: Sequence[int], damping2: Sequence[float], floor2: float | Array
) -> Array:
    """Return the joint step for stacked levels, highest first.

    Args:
        J: Stacked Jacobians, shape (m, n).
        e: Stacked errors to remove, shape (m,).
        g: Gradient step for the last null space, shape (n,).
        starts: First row of each level.
        damping2: Squared damping of each level, lambda_j^2.
        floor2: Squared damping of the projectors, lambda_0^2, of all rows or of each (m,); greater than 0.

    Returns:
        The step dq, shape (n,).
    """
    m = e.shape[0]
    if m == 0:
        return g.copy()
    gram = J @ J.T
    gram.reshape(-1)[:: m + 1] += floor2
    L, info = dpotrf(gram.T, lower=1, overwrite_a=1)
    if info != 0:  # numerically not positive definite: more damping always is
        gram = J @ J.T
        gram.reshape(-1)[:: m + 1] += floor2 + 1e-9 * (1.0 + float(np.trace(gram)))
        L, _ = dpotrf(gram.T, lower=1)
    z = np.empty(m)
    end = m
    for j, start in enumerate(starts):
        end = starts[j + 1] if j + 1 < len(starts) else m
        rest = e[start:end] - L[start:end, :start] @ z[:start] if start else e[:end]
        block = L[start:end, start:end]
        normal = block @ block.T
        normal.reshape(-1)[:: end - start + 1] += damping2[j]
        _, y, _ = dposv(normal.T, rest, lower=1, overwrite_a=1)
        np.matmul(y, block, out=z[start:end])
    along, _ = dtrtrs(L, J @ g, lower=1)
    x, _ = dtrtrs(L, z - along, lower=1, trans=1)
    step: Array = x @ J
    step += g
    return step
