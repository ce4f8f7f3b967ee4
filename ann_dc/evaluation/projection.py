r"""Projection of the moves of a network on what its rails allow, in the norm of M^{-1}.

.. math:: v = \arg\min_{v \in T(x)} \tfrac12 v' M^{-1} v - d'v = M (d + \lambda)

with d the drives, T(x) the moves that lead past no rail, and lambda the currents of ideal diodes
at the rails. The set of held neurons is found by pivoting: a held neuron whose diode would have to
pull lets go, one that moves outward is held. The matrix M is positive definite, so the result is
unique and any first set leads to it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ann_dc.evaluation.rules import BLOCKS, PIVOTS, ROUNDING, lets_go, pushes_out
from ann_dc.network.preconditioners.base import Clamp


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
