r"""Theta, A and B of the paper's convergence proof, (19) and (21), corrected.

Let e be the distance of the coordination variables t and beta from their solution. Their net input
d is -H for t and +R for beta, with H = grad_t L and R = grad_beta L. Then

.. math::
    \Theta = \tfrac12 \sum e^T e, \qquad A = \tfrac12 \sum d^T d, \qquad B = \sum e^T d ,

and a step t, beta += lambda d changes Theta by exactly A lambda^2 + B lambda. Theta decreases for 0
< lambda < -B/A, and for no lambda if B >= 0.

The printed (20) gives both errors a minus sign, the printed (21) has lambda inside A and B, and
(33) uses |B/A| for -B/A. The definitions as printed, De_t = -lambda H and De_beta = -lambda R, are
implemented by `printed_of`:

.. math::
    A_{printed} = 2 \lambda^2 A, \qquad B_{printed} = \lambda (B_t - B_\beta) ,

so that the printed (33) defines lambda by a quotient that contains lambda.
"""

from __future__ import annotations

from typing import Any, NamedTuple


class Lyapunov(NamedTuple):
    """Theta, A and B as numbers or arrays.

    A step of lambda along the net inputs d changes Theta by lambda B + lambda^2 A.

    Attributes
    ----------
    theta : float or array
        Half of the squared errors of t and beta, (19).
    A : float or array
        Half of the squared net inputs of t and beta, (21).
    B : float or array
        Errors times net inputs, (21); negative if the net inputs point to the solution.

    References
    ----------
    Paper equations (18)-(21), corrected.
    """

    theta: Any
    A: Any
    B: Any

    @property
    def bound(self) -> Any:
        """Bound -B/A of lambda, paper (33), corrected.

        Theta decreases for 0 < lambda < bound, if the bound is positive.
        """
        return -self.B / self.A


def lyapunov_of(error: Any, drive: Any) -> Lyapunov:
    """Return Theta, A and B from errors and net inputs, summed over the first axis.

    Parameters
    ----------
    error : (K, ...) array
        Distances of t and beta from the solution, in network units.
    drive : (K, ...) array
        Net inputs of t and beta.

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


class Distances(NamedTuple):
    """Errors (18) of both levels, summed over the stages; numbers or arrays.

    Attributes
    ----------
    v, mu : float or array
        Norms of e_v (q and u together) and of e_mu, in network units.
    t, beta : Lyapunov
        Theta, A and B of t alone and of beta alone.

    References
    ----------
    Paper equations (18), (19) and Theorem IV.1.
    """

    v: Any
    mu: Any
    t: Lyapunov
    beta: Lyapunov

    @property
    def lyapunov(self) -> Lyapunov:
        """Theta, A and B of t and beta together."""
        return Lyapunov(*(a + b for a, b in zip(self.t, self.beta)))

    @property
    def told(self) -> Any:
        """Norm of e_t and e_beta together, the errors of the coordination variables."""
        return (2 * self.lyapunov.theta) ** 0.5


def printed_of(t: Lyapunov, beta: Lyapunov, gain: Any) -> Lyapunov:
    """Return Theta, A and B as (20) and (21) define them in print.

    Parameters
    ----------
    t, beta : Lyapunov
        Corrected quantities of t alone and of beta alone.
    gain : float or array
        Gain lambda; a pair if t and beta have different gains.

    Examples
    --------
    One t and one beta, each one unit from its solution and led there, lambda = 1/2:

    >>> one = Lyapunov(theta=0.5, A=0.5, B=-1.0)
    >>> printed_of(one, one, 0.5)  # (20) drives beta away, and A lambda^2 + B lambda is no change
    Lyapunov(theta=1.0, A=0.5, B=0.0)

    References
    ----------
    Paper equations (19)-(21), as printed.
    """
    of_t, of_beta = gain if isinstance(gain, tuple) else (gain, gain)
    return Lyapunov(
        theta=t.theta + beta.theta,
        A=2 * (of_t**2 * t.A + of_beta**2 * beta.A),
        B=of_t * t.B - of_beta * beta.B,
    )
