r"""Rules of a neuron, a block and a state, for any array library: rails, domains, residuals.

The moves v of a network are the projection of M d on what its rails allow, in the norm of M^{-1}:

.. math:: v = \arg\min_{v \in T(x)} \tfrac12 v' M^{-1} v - d'v, \qquad
    T(x) = \{v: v_i \ge 0 \ \text{if}\ x_i \le low_i,\ v_i \le 0 \ \text{if}\ x_i \ge high_i\}

with d the drives as they arrive. In other words v = M (d + lambda). The current lambda_i of an
ideal diode from the node of a neuron to ground is nonzero only at a rail, never negative at a low
rail, never positive at a high one, and zero if the neuron moves.

1. A neuron with a diagonal row of M does not move if its own drive points outward: `pushes_out`.
2. A neuron that the metric couples to others is judged by its move (`pushes_out`) while it is free
   and by its current (`lets_go`) while it is held, never by its drive: neighbours may pull it off
   the rail against its own drive, or hold it there. `ann_dc.evaluation` finds who is held.
3. Whatever the metric, all moves are zero only if every drive is zero or points outward at a rail.
   So residuals, certificates and `rests` read drives that are cut by their own signs.

The elementwise rules work on numbers and on arrays alike, so that NumPy, torch and compiled loops
share them; `residuals` takes its library as an argument, and the loops have a copy of their own
(`ann_dc.evaluation.loops.residuals`).

Projection of the moves of a network on what its rails allow, in the norm of M^{-1}.

.. math:: v = \arg\min_{v \in T(x)} \tfrac12 v' M^{-1} v - d'v = M (d + \lambda)

with d the drives, T(x) the moves that lead past no rail, and lambda the currents of ideal diodes
at the rails. The set of held neurons is found by pivoting: a held neuron whose diode would have to
pull lets go, one that moves outward is held. The matrix M is positive definite, so the result is
unique and any first set leads to it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ann_dc.evaluation.tape import DUAL, POSITION, PRIMAL, STATE
from ann_dc.network.functions import Library
from ann_dc.network.preconditioners.base import Clamp

RAN, SETTLED, LOST = 0, 1, 2
"""How a piece of a recurrence ended."""
OVERFLOW = 1e100
"""Residual of a recurrence that is lost."""
FLOOR = 1e-4
"""Smallest size of duals to which a residual is related. In network units the largest curvature of
the cost along a control is one, so that a gradient of `FLOOR` times a tolerance of 1e-6 moves that
control by 1e-10 of its scale. The multipliers of a controller that has arrived vanish; rounding
leaves a gradient of 1e-14 there."""
SMALLEST_POSITION = 0.1
"""Smallest size of positions to which a residual is related: in their own scales states lie near
one, and a problem whose states stay where they are has none at all."""
RESTING = 0.01
"""Smallest size of values to which an error is related, over their largest magnitude on their way:
what ends below it rests at zero, where a share of the value itself says nothing."""
BLOCKS, PIVOTS = 10, 1000
"""Pivots of a projection that exchange all neurons that are held or free wrongly; after so many
only the last of them is exchanged, which ends for certain. Pivots at most, for numbers that are
rounded."""
ROUNDING = 1e-13
"""Current with the wrong sign that is taken for zero, relative to the largest drive or current of
the held neurons."""
NEAR = 1e-2
"""Largest error of the controls with their noise, over their size (`size_of`), at which a circuit
counts as accurate."""


def size_of(end: np.ndarray, reach: float) -> float:
    """Return the size to which errors of settled values are related.

    Values of controls are in network units, so that magnitudes count from the offsets of their
    scales, and errors do not depend on where the user's zero is.

    Parameters
    ----------
    end : array
        Settled values.
    reach : float
        Largest magnitude on their way, from the start to the end. If it is zero, one stands for
        it: the scale of the values.

    Returns
    -------
    float
        The largest magnitude at the end, at least `RESTING` of the reach.

    Examples
    --------
    >>> size_of(np.array([2.0, -3.0]), 10.0), size_of(np.array([1e-9]), 6.0)
    (3.0, 0.06)
    """
    largest = float(np.abs(end).max(initial=0.0))
    return max(largest, RESTING * (float(reach) or 1.0))


def size_in_words(end: np.ndarray, reach: float, offsets: str = "") -> str:
    """Return the size of settled controls, `size_of`, in words.

    Parameters
    ----------
    end : array
        Settled controls.
    reach : float
        Largest magnitude on their way.
    offsets : str
        Offsets of their scales, from which magnitudes count; empty if all are zero.

    Examples
    --------
    >>> size_in_words(np.array([2.0, -3.0]), 10.0)
    'the largest one'
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
            else ("the largest one")
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


def pushes_out(state, move, low, high):
    """Whether a move would take a state past the rail (``low``, ``high``) at which it stands."""
    return ((state <= low) & (move < 0.0)) | ((state >= high) & (move > 0.0))


def lets_go(state, current, low, high, slack):
    """Return True if the diode at a rail would have to pull to hold a neuron there.

    A neuron between its rails lets go; one with both rails in the same place never does.
    """
    return ((state > low) | (current < -slack)) & ((state < high) | (current > slack))


def rests(state, drive, low, high):
    """Whether a neuron stands at a rail (``low``, ``high``) with its drive cut off."""
    return ((state <= low) | (state >= high)) & (drive == 0.0)


def is_defined(argument, low, high, side):
    """Whether an argument lies in an open domain (``low``, ``high``) and on its side of a pole.

    A ``side`` of 0 means that there is no pole.
    """
    return (low < argument) & (argument < high) & ((side == 0.0) | (argument * side > 0.0))


class RoleRows(NamedTuple):
    """Rows of the neurons that play a role, as index arrays of one library."""

    duals: Any
    """Those that ascend."""
    primal: Any
    """Those that descend, positions among them."""
    positions: Any
    """q and t of the chains."""
    states: Any
    """Neurons that are no part of an optimisation."""

    @classmethod
    def of(cls, roles: np.ndarray) -> RoleRows:
        """The rows of a tape's roles, as NumPy arrays."""
        return cls(
            duals=np.flatnonzero(roles == DUAL),
            primal=np.flatnonzero((roles == PRIMAL) | (roles == POSITION)),
            positions=np.flatnonzero(roles == POSITION),
            states=np.flatnonzero(roles == STATE),
        )


def residuals(library: Library, rows: RoleRows, drives: Any, values: Any) -> Any:
    """The network's own residuals, relative: (constraint, stationarity) as an array (2, ...).

    max(|c| / max|q, t|) and max(|grad L| / max|mu, beta|), in network units, the sizes not below
    `SMALLEST_POSITION` and `FLOOR`. The drives are the gradients at the multipliers m = mu + rho c,
    which equal mu once the constraints hold. A network that is no optimiser has
    max|drive| / max(|x|, 1) instead. Both are infinite where any drive is not finite. The
    certificate of a solution is taken with the problem's own derivatives.

    Parameters
    ----------
    library : module
    rows : RoleRows
    drives, values : (P, N, ...) arrays of the library
        What arrives at the neurons, and their states.

    Returns
    -------
    (2, ...) array of the library
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
    """Compute the moves of a state whose coupled neurons stand at rails.

    Parameters
    ----------
    clamp : callable
        Returns the clamp of a set of held neurons, (n,) booleans; see `Metric.clamp`.
    drive : (n,) array
        Drives; those of coupled neurons are not cut at rails. Complex drives are judged by their
        real parts.
    x, low, high : (n,) arrays
        State and rails.
    coupled : (n,) array of bool
        True for neurons whose rows of the metric are not diagonal.

    Returns
    -------
    (n,) array

    References
    ----------
    .. [1] K. G. Murty, Note on a Bard-type scheme for solving the complementarity problem,
       Opsearch 11, 1974, 123-130.
    .. [2] J. J. Judice, F. M. Pires, A block principal pivoting algorithm for large-scale strictly
       monotone linear complementarity problems, Computers & Operations Research 21, 1994, 587-596.

    Examples
    --------
    A neuron at its lower rail is pushed outward, but the other one pulls it off:

    >>> from ann_dc.network.preconditioners import Grid, Row
    >>> grid = Grid(own=np.array([[[1.0, -0.5], [-0.5, 1.0]]]), following=np.zeros((0, 2, 2)))
    >>> row = Row(rates=np.ones((2, 1)), primal=np.arange(2), chains=np.zeros((0, 2), int))
    >>> low, high, coupled = np.zeros(2), np.full(2, np.inf), np.ones(2, bool)
    >>> clamp = lambda held: grid.clamp(row, held)
    >>> projected(clamp, np.array([-1.0, 4.0]), np.array([0.0, 1.0]), low, high, coupled).tolist()
    [1.3333333333333335, 4.666666666666667]
    >>> projected(clamp, np.array([-3.0, 4.0]), np.array([0.0, 1.0]), low, high, coupled).tolist()
    [0.0, 4.0]
    """
    at_rail = coupled & ((x <= low) | (x >= high))
    held = at_rail & pushes_out(x, np.real(drive), low, high)
    moves, currents = clamp(held)(drive)
    for pivot in range(PIVOTS):
        slack = ROUNDING * np.max(np.abs(drive[held]) + np.abs(currents[held]), initial=0.0)
        wrong = np.where(
            held,
            lets_go(x, np.real(currents), low, high, slack),
            at_rail & pushes_out(x, np.real(moves), low, high),
        )
        if not wrong.any():
            break
        if pivot >= BLOCKS:
            wrong[: np.flatnonzero(wrong)[-1]] = False
        held = held ^ wrong
        moves, currents = clamp(held)(drive)
    return np.where(coupled & pushes_out(x, np.real(moves), low, high), 0.0, moves)
