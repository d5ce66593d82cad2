r"""The prioritised damped step: strict levels, gradients in the last null space.

The recursion of [pennapoubel2014] eqs. 4-6 (after [baerlocher2004]) for stacked levels :math:`J = [J_1; \dots; J_N]`

.. math::
    \dot q_{j+1} = \dot q_j + (J_{j+1} P^a_j)^+ (e_{j+1} - J_{j+1} \dot q_j), \qquad
    \dot q = \dot q_N + P^a_N g

needs no projector when every level is damped, :math:`(A)^+ = A^T (A A^T + \lambda^2 I)^{-1}`: the Cholesky factor of
the one Gram matrix :math:`J J^T + \Lambda` eliminates level after level, because its Schur complement of the first
:math:`j` levels is :math:`J_{j+1} P^a_j J_{j+1}^T + \Lambda_{j+1}`. So

.. math::
    \dot q = g + J^T (J J^T + \Lambda)^{-1} (e - J g).

With :math:`\Lambda \to 0` this is the recursion; the test suite checks it against the recursion with SVD
pseudo-inverses. A damped level lets lower ones through by at most :math:`\lambda/2` of their motion, and only along
directions it can hardly control itself (singular value near :math:`\lambda`).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dposv

from imitor.types import Array


def prioritised_step(J: Array, e: Array, g: Array, damping2: Array) -> Array:
    """Return the joint step for stacked levels, highest first.

    Args:
        J: Stacked Jacobians, shape (m, n).
        e: Stacked errors to remove, shape (m,).
        g: Gradient step for the last null space, shape (n,).
        damping2: Squared damping of each row, shape (m,); greater than 0.

    Returns:
        The step dq, shape (n,).
    """
    gram = J @ J.T
    m = e.shape[0]
    diagonal = gram.reshape(-1)[:: m + 1]
    diagonal += damping2
    _, x, info = dposv(gram.T, e - J @ g, lower=1, overwrite_a=1, overwrite_b=1)
    if info != 0:  # numerically not positive definite: more damping always is
        gram = J @ J.T
        gram.reshape(-1)[:: m + 1] += damping2 + 1e-6 * (1.0 + np.trace(gram))
        _, x, _ = dposv(gram.T, e - J @ g, lower=1)
    step: Array = x @ J
    step += g
    return step
