r"""Rules for neurons, blocks and states: saturation limits, domains, residuals.

The derivatives v of a network are the projection of M d on the saturation limits, in the norm of
M^{-1}:

.. math:: v = \arg\min_{v \in T(x)} \tfrac12 v' M^{-1} v - d'v, \qquad
    T(x) = \{v: v_i \ge 0 \ \text{if}\ x_i \le low_i,\ v_i \le 0 \ \text{if}\ x_i \ge high_i\}

where d are the uncut net inputs. Equivalently, v = M (d + lambda). The current lambda_i of an ideal
diode from the node of a neuron to ground is nonzero only at a limit. The current is never negative
at a low limit, never positive at a high limit, and zero if the neuron moves.

1. A neuron with a diagonal row of M does not move if its net input points outward (`pushes_out`).
2. A neuron that the preconditioner couples to others is judged by its derivative (`pushes_out`)
   while free and by its current (`lets_go`) while held, never by its net input. Neighbours may pull
   the neuron off the limit against its net input, or hold it there. `ann_dc.evaluation` determines
   the held neurons.
3. For any preconditioner, all derivatives are zero only if every net input is zero or points
   outward at a limit. Residuals, certificates and `is_saturated` therefore read net inputs cut by
   their signs.

The elementwise rules accept numbers and arrays; NumPy, torch and compiled loops use them.
`residuals` takes its array library as an argument. The loops have a separate copy
(`ann_dc.evaluation.loops.residuals`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ann_dc.network.functions import Library
from ann_dc.network.preconditioners.base import Clamp

STATE, PRIMAL, POSITION, DUAL = 0, 1, 2, 3
RAN, SETTLED, LOST = 0, 1, 2
"""Outcome of a piece of a recurrence."""
OVERFLOW = 1e100
"""Residual of a recurrence that has diverged."""
FLOOR = 1e-4
"""Smallest dual magnitude to which a residual is related.

In network units the largest curvature of the cost along a control is one. A gradient of `FLOOR`
times a tolerance of 1e-6 therefore moves that control by 1e-10 of its scale. The multipliers of a
controller at its target vanish; rounding leaves a gradient of 1e-14 there.
"""
SMALLEST_POSITION = 0.1
"""Smallest position magnitude to which a residual is related: scaled states are near one, and a
problem whose states do not change has no magnitude.
"""
RESTING = 0.01
"""Smallest magnitude to which an error is related, over the largest magnitude of the trajectory.
Smaller settled values count as zero, where a relative error is meaningless.
"""
BLOCKS, PIVOTS = 10, 1000
"""Number of projection pivots that exchange all wrongly held or free neurons, and largest number of
pivots (for rounded numbers). Pivots after the first `BLOCKS` exchange only the last wrong neuron,
which guarantees termination.
"""
ROUNDING = 1e-13
"""Magnitude of a current of the wrong sign that counts as zero, relative to the largest net input
or current of the held neurons.
"""
NEAR = 1e-2
"""Largest error of the controls including noise, over their size (`size_of`), of an accurate
circuit.
"""


def size_of(end: np.ndarray, reach: float) -> float:
    """Return the magnitude to which errors of settled values are related.

    Controls are in network units: magnitudes count from the scale offsets, so errors do not depend
    on the user's zero. The result is the largest magnitude of the settled values, at least
    `RESTING` of the reach. The reach is the largest magnitude along the trajectory, start and end
    included. A zero reach is replaced by one, the scale of the values.

    Examples
    --------
    >>> size_of(np.array([2.0, -3.0]), 10.0), size_of(np.array([1e-9]), 6.0)
    (3.0, 0.06)
    """
    largest = float(np.abs(end).max(initial=0.0))
    return max(largest, RESTING * (float(reach) or 1.0))


def size_in_words(end: np.ndarray, reach: float, offsets: str = "") -> str:
    """Return a description of the reference magnitude `size_of`.

    The reach is the largest magnitude along the trajectory. ``offsets`` lists the scale offsets
    from which magnitudes count; empty if all are zero.

    Examples
    --------
    >>> size_in_words(np.array([2.0, -3.0]), 10.0)
    'the largest control'
    >>> size_in_words(np.array([1e-9]), 6.0)
    '1% of the largest magnitude of the controls on their way (they settle near zero)'
    >>> size_in_words(np.array([0.0]), 0.0)
    '1% of the scale of the controls (they stay at zero)'
    >>> size_in_words(np.array([0.0]), 0.0, "u.P 5 kW")
    '1% of the scale of the controls (they stay at their offset: u.P 5 kW)'
    >>> size_in_words(np.array([2.0]), 2.0, "u.P 5 kW")
    'the largest distance of a control from its offset (u.P 5 kW)'
    """
    if size_of(end, reach) <= np.abs(end).max(initial=0.0):
        return (
            f"the largest distance of a control from its offset ({offsets})"
            if offsets
            else ("the largest control")
        )
    if reach:
        what = (
            "distance of the controls from their offset"
            if offsets
            else ("magnitude of the controls")
        )
        near = f"it: {offsets}" if offsets else "zero"
        return f"{RESTING:.0%} of the largest {what} on their way (they settle near {near})"
    at = f"their offset: {offsets}" if offsets else "zero"
    return f"{RESTING:.0%} of the scale of the controls (they stay at {at})"


def pushes_out(state, derivative, low, high):
    """Return True if a move leads past the limit at which the state is."""
    return ((state <= low) & (derivative < 0.0)) | ((state >= high) & (derivative > 0.0))


def lets_go(state, current, low, high, slack):
    """Return True if the diode at a limit would have to pull to hold a neuron.

    A neuron between its limits is released. A neuron with both limits at the same place never is.
    """
    return ((state > low) | (current < -slack)) & ((state < high) | (current > slack))


def is_saturated(state, drive, low, high):
    """Return True if a neuron is at a limit and its net input points outward."""
    return ((state <= low) | (state >= high)) & (drive == 0.0)


def is_defined(argument, low, high, side):
    """Return True if an argument is in an open domain and on its side of a pole.

    A ``side`` of 0 means that the block has no pole.
    """
    return (low < argument) & (argument < high) & ((side == 0.0) | (argument * side > 0.0))


class RoleRows(NamedTuple):
    """Neuron rows by role, as index arrays of an array library."""

    duals: Any
    """Rows of duals (ascent)."""
    primal: Any
    """Rows of primal neurons (descent), positions included."""
    positions: Any
    """Rows of q and t of the state chains."""
    states: Any
    """Rows of neurons that belong to no optimisation."""

    @classmethod
    def of(cls, roles: np.ndarray) -> RoleRows:
        """Return the rows of the tape's roles as NumPy arrays."""
        return cls(
            duals=np.flatnonzero(roles == DUAL),
            primal=np.flatnonzero((roles == PRIMAL) | (roles == POSITION)),
            positions=np.flatnonzero(roles == POSITION),
            states=np.flatnonzero(roles == STATE),
        )


def residuals(library: Library, rows: RoleRows, drives: Any, values: Any) -> Any:
    """Return the relative residuals (constraint, stationarity), shape (2, ...).

    The residuals are max(|c|) / max(|q, t|) and max(|grad L|) / max(|mu, beta|) in network units.
    The denominators are at least `SMALLEST_POSITION` and `FLOOR`. The net inputs are the gradients
    at the multipliers m = mu + rho c, which equal mu once the constraints are satisfied. A network
    that is not an optimiser has max|drive| / max(|x|, 1) instead. Both residuals are infinite if
    any net input is not finite. ``drives`` and ``values`` have shape (P, N, ...).

    The certificate of a solution uses the derivatives of the problem instead.
    """
    drive, value = library.amax(abs(drives), 1), library.amax(abs(values), 1)

    def largest(of: Any, at: Any, least: float) -> Any:
        if len(at) == 0:
            return library.full_like(of[0], least)
        return library.amax(of[at], 0).clip(min=least)

    constraint = largest(drive, rows.duals, 0.0) / largest(value, rows.positions, SMALLEST_POSITION)
    gradient = largest(drive, rows.primal, 0.0) / largest(value, rows.duals, FLOOR)
    still = largest(drive, rows.states, 0.0) / largest(value, rows.states, 1.0)
    both = library.stack([constraint, library.maximum(gradient, still)])
    finite = library.isfinite(drive).all(0) & library.isfinite(both)
    return library.where(finite, both, np.inf)


def projected(
    clamp: Callable[[np.ndarray], Clamp], drive: np.ndarray, x: np.ndarray, low: np.ndarray,
    high: np.ndarray, coupled: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Compute the derivatives (n,) of a state with coupled neurons at limits.

    Parameters
    ----------
    clamp : callable
        Returns the clamp of a mask (n,) of held neurons; see `Preconditioner.clamp`.
    drive : (n,) array
        Net inputs, uncut at limits for coupled neurons. Complex net inputs are judged by their real
        parts.
    coupled : (n,) array of bool
        True for neurons whose rows of the preconditioner are not diagonal.

    References
    ----------
    .. [1] K. G. Murty, Note on a Bard-type scheme for solving the complementarity problem,
       Opsearch 11, 1974, 123-130.
    .. [2] J. J. Judice, F. M. Pires, A block principal pivoting algorithm for large-scale strictly
       monotone linear complementarity problems, Computers & Operations Research 21, 1994, 587-596.

    Examples
    --------
    A neuron at its lower limit is pushed outward, but the other neuron pulls it off:

    >>> from ann_dc.network.preconditioners import ResistiveGrid, ArrayLayout
    >>> own = np.array([[[1.0, -0.5], [-0.5, 1.0]]])
    >>> grid = ResistiveGrid(own=own, following=np.zeros((0, 2, 2)))
    >>> row = ArrayLayout(rates=np.ones((2, 1)), primal=np.arange(2), chains=np.zeros((0, 2), int))
    >>> low, high, coupled = np.zeros(2), np.full(2, np.inf), np.ones(2, bool)
    >>> clamp = lambda held: grid.clamp(row, held)
    >>> projected(clamp, np.array([-1.0, 4.0]), np.array([0.0, 1.0]), low, high, coupled).tolist()
    [1.3333333333333335, 4.666666666666667]
    >>> projected(clamp, np.array([-3.0, 4.0]), np.array([0.0, 1.0]), low, high, coupled).tolist()
    [0.0, 4.0]
    """
    at_limit = coupled & ((x <= low) | (x >= high))
    held = at_limit & pushes_out(x, np.real(drive), low, high)
    derivatives, currents = clamp(held)(drive)
    for pivot in range(PIVOTS):
        slack = ROUNDING * np.max(np.abs(drive[held]) + np.abs(currents[held]), initial=0.0)
        wrong = np.where(
            held,
            lets_go(x, np.real(currents), low, high, slack),
            at_limit & pushes_out(x, np.real(derivatives), low, high),
        )
        if not wrong.any():
            break
        if pivot >= BLOCKS:
            wrong[: np.flatnonzero(wrong)[-1]] = False
        held = held ^ wrong
        derivatives, currents = clamp(held)(drive)
    return np.where(coupled & pushes_out(x, np.real(derivatives), low, high), 0.0, derivatives)
