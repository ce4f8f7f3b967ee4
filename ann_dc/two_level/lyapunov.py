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
    """Theta (19), A and B (21), corrected, as numbers or arrays.

    ``theta`` is half of the squared errors of t and beta, ``A`` half of their squared net inputs d,
    and ``B`` the errors times the net inputs: negative if d points to the solution. A step of
    lambda along d changes Theta by lambda B + lambda^2 A.
    """

    theta: Any
    A: Any
    B: Any

    @property
    def bound(self) -> Any:
        """Bound -B/A of lambda, paper (33), corrected; Theta decreases for 0 < lambda < bound."""
        return -self.B / self.A


def lyapunov_of(error: Any, drive: Any) -> Lyapunov:
    """Return Theta, A and B from errors and net inputs (K, ...), summed over K."""
    return Lyapunov(
        0.5 * (error * error).sum(0), 0.5 * (drive * drive).sum(0), (error * drive).sum(0)
    )


class Distances(NamedTuple):
    """Errors (18) of both levels, summed over the stages; numbers or arrays.

    ``v`` and ``mu`` are the norms of e_v (q and u together) and of e_mu, in network units; ``t``
    and ``beta`` have Theta, A and B of t alone and of beta alone.
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
    def reported(self) -> Any:
        """Norm of e_t and e_beta together."""
        return (2 * self.lyapunov.theta) ** 0.5


def printed_of(t: Lyapunov, beta: Lyapunov, gain: Any) -> Lyapunov:
    """Return Theta, A and B as (20) and (21) define them in print.

    ``t`` and ``beta`` are the corrected quantities of each alone; the gain lambda is a pair if they
    have different gains.

    >>> one = Lyapunov(theta=0.5, A=0.5, B=-1.0)  # one unit from the solution and led there
    >>> printed_of(one, one, 0.5)  # (20) drives beta away, and A lambda^2 + B lambda is no change
    Lyapunov(theta=1.0, A=0.5, B=0.0)
    """
    of_t, of_beta = gain if isinstance(gain, tuple) else (gain, gain)
    return Lyapunov(
        theta=t.theta + beta.theta,
        A=2 * (of_t**2 * t.A + of_beta**2 * beta.A),
        B=of_t * t.B - of_beta * beta.B,
    )
