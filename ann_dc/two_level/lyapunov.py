r"""Theta, A and B of the paper's convergence proof, (19) and (21), corrected.

With e the distance of the coordination variables t and beta from their solution, and d what drives
them (-H for t, +R for beta, where H = grad_t L and R = grad_beta L),

.. math::
    \Theta = \tfrac12 \sum e^T e, \qquad A = \tfrac12 \sum d^T d, \qquad B = \sum e^T d ,

a step t, beta += lambda d changes Theta by A lambda^2 + B lambda exactly. It falls for
0 < lambda < -B/A, and for no lambda at all where B >= 0. The printed (20) gives both errors a
minus, the printed (21) leaves lambda inside A and B, and (33) takes -B/A for |B/A|.
"""

from __future__ import annotations

from typing import Any, NamedTuple


class Lyapunov(NamedTuple):
    """Theta, A and B; numbers, arrays or tensors."""

    theta: Any
    A: Any
    B: Any

    @property
    def bound(self) -> Any:
        """-B/A: Theta falls for 0 < lambda < bound, if that is positive. Paper (33), corrected."""
        return -self.B / self.A


def lyapunov_of(error: Any, drive: Any) -> Lyapunov:
    """Theta, A and B from the errors and drives of t and beta, summed over the first axis.

    Examples
    --------
    >>> import numpy as np
    >>> lyapunov_of(np.array([2.0]), np.array([-1.0]))  # doctest: +NORMALIZE_WHITESPACE
    Lyapunov(theta=np.float64(2.0), A=np.float64(0.5), B=np.float64(-2.0))
    >>> lyapunov_of(np.array([2.0]), np.array([-1.0])).bound  # lambda = 4 leads to -2, no closer
    np.float64(4.0)

    References
    ----------
    Paper equations (18)-(21), (33), corrected.
    """
    return Lyapunov(
        0.5 * (error * error).sum(0), 0.5 * (drive * drive).sum(0), (error * drive).sum(0)
    )
