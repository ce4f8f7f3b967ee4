"""Explicit Runge-Kutta pairs as tables of numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.integrate import DOP853 as SCIPY_DOP853


class Tableau(NamedTuple):
    """A Butcher tableau with its error estimate; the slope at the new point is the last one (FSAL).

    References
    ----------
    .. [1] E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 1993.
    """

    a: np.ndarray
    """(S, S): below the diagonal, the stages."""
    b: np.ndarray
    """(S,): the step."""
    error: np.ndarray
    """(S + 1,): the estimate, the last of the new slope."""
    third: np.ndarray
    """(S + 1,): that of order three which DOP853 weighs in; zero where there is none."""
    exponent: float
    """-1 over one more than the order of the estimate."""


class Rows(NamedTuple):
    """A tableau without its zeros, as loops read it.

    There is a row for every stage but the first, one for the step and one for each estimate.
    """

    starts: np.ndarray
    """(S + 3,): where every row begins."""
    which: np.ndarray
    """(entries,): slope of every entry."""
    weights: np.ndarray
    """(entries,)."""
    exponent: float
    """That of the tableau."""

    @classmethod
    def of(cls, tableau: Tableau) -> Rows:
        """The rows of a tableau."""
        table = [*tableau.a[1:], tableau.b, tableau.error, tableau.third]
        which = [np.flatnonzero(row) for row in table]
        return cls(
            starts=np.cumsum([0, *map(len, which)]),
            which=np.concatenate(which),
            weights=np.concatenate([row[at] for row, at in zip(table, which)]),
            exponent=tableau.exponent,
        )


DOP853_TABLEAU = Tableau(
    a=np.ascontiguousarray(SCIPY_DOP853.A[:12, :12]),
    b=np.ascontiguousarray(SCIPY_DOP853.B),
    error=np.ascontiguousarray(SCIPY_DOP853.E5),
    third=np.ascontiguousarray(SCIPY_DOP853.E3),
    exponent=-1.0 / 8.0,
)
"""Dormand and Prince, of order eight, with the coefficients that SciPy has."""

TSIT5_TABLEAU = Tableau(
    a=np.array(
        [
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            [0.161, 0.0, 0.0, 0.0, 0.0, 0.0],
            [-0.008480655492356989, 0.335480655492357, 0.0, 0.0, 0.0, 0.0],
            [2.8971530571054935, -6.359448489975075, 4.3622954328695815, 0.0, 0.0, 0.0],
            [5.325864828439257, -11.748883564062828, 7.4955393428898365, -0.09249506636175525,
             0.0, 0.0],
            [5.86145544294642, -12.92096931784711, 8.159367898576159, -0.071584973281401,
             -0.028269050394068383, 0.0],
        ]
    ),
    b=np.array(
        [0.09646076681806523, 0.01, 0.4798896504144996, 1.379008574103742, -3.290069515436081,
         2.324710524099774]
    ),
    error=np.array(
        [-0.00178001105222577714, -0.0008164344596567469, 0.007880878010261995,
         -0.1447110071732629, 0.5823571654525552, -0.45808210592918697, 0.015151515151515152]
    ),
    third=np.zeros(7),
    exponent=-1.0 / 5.0,
)  # fmt: skip
"""Tsitouras, of order five: few slopes to keep, so that many networks fit a cache.

References
----------
.. [1] C. Tsitouras, Runge-Kutta pairs of order 5(4) satisfying only the first column simplifying
   assumption, Computers & Mathematics with Applications 62, 2011, 770-775.
"""
