"""Explicit Runge-Kutta pairs as tables of numbers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Tableau:
    """A Butcher tableau with its error estimate; the slope at the new point is the last one (FSAL).

    Attributes
    ----------
    a : (S, S) array
        Below the diagonal, the stages.
    b : (S,) array
        The step.
    error : (S + 1,) array
        The estimate, the last of the new slope.
    third : (S + 1,) array
        That of order three which DOP853 weighs in; zero where there is none.
    exponent : float
        -1 over one more than the order of the estimate.

    References
    ----------
    .. [1] E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 1993.
    """

    a: np.ndarray
    b: np.ndarray
    error: np.ndarray
    third: np.ndarray
    exponent: float

    def __repr__(self) -> str:
        return f"<Tableau of {len(self.b)} stages>"

    @cached_property
    def rows(self) -> Rows:
        """The tableau as loops read it."""
        return Rows.of(self)


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


def _below_the_diagonal(*rows: list[float]) -> np.ndarray:
    """(S, S): the rows of all stages but the first, as far as they are not zero."""
    table = np.zeros((len(rows) + 1, len(rows) + 1))
    for stage, row in enumerate(rows, 1):
        table[stage, :stage] = row
    return table


DOP853_TABLEAU = Tableau(
    a=_below_the_diagonal(
        [0.05260015195876773],
        [0.0197250569845379, 0.0591751709536137],
        [0.02958758547680685, 0.0, 0.08876275643042054],
        [0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792],
        [0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242],
        [0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125],
        [0.03709200011850479, 0.0, 0.0, 0.17038392571223998, 0.10726203044637328,
         -0.015319437748624402, 0.008273789163814023],
        [0.6241109587160757, 0.0, 0.0, -3.3608926294469414, -0.868219346841726, 27.59209969944671,
         20.154067550477894, -43.48988418106996],
        [0.47766253643826434, 0.0, 0.0, -2.4881146199716677, -0.590290826836843,
         21.230051448181193, 15.279233632882423, -33.28821096898486, -0.020331201708508627],
        [-0.9371424300859873, 0.0, 0.0, 5.186372428844064, 1.0914373489967295, -8.149787010746927,
         -18.52006565999696, 22.739487099350505, 2.4936055526796523, -3.0467644718982196],
        [2.273310147516538, 0.0, 0.0, -10.53449546673725, -2.0008720582248625, -17.9589318631188,
         27.94888452941996, -2.8589982771350235, -8.87285693353063, 12.360567175794303,
         0.6433927460157636],
    ),
    b=np.array(
        [0.054293734116568765, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003,
         -5.801203960010585, 0.3111643669578199, -0.1521609496625161, 0.20136540080403034,
         0.04471061572777259]
    ),
    error=np.array(
        [0.01312004499419488, 0.0, 0.0, 0.0, 0.0, -1.2251564463762044, -0.4957589496572502,
         1.6643771824549864, -0.35032884874997366, 0.3341791187130175, 0.08192320648511571,
         -0.022355307863886294, 0.0]
    ),
    third=np.array(
        [-0.18980075407240762, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003,
         -5.801203960010585, -0.4226823213237919, -0.1521609496625161, 0.20136540080403034,
         0.02265179219836082, 0.0]
    ),
    exponent=-1.0 / 8.0,
)  # fmt: skip
"""Dormand and Prince, of order eight: the coefficients of DOP853 [1]_, as SciPy has them.

References
----------
.. [1] E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 1993.
"""

TSIT5_TABLEAU = Tableau(
    a=_below_the_diagonal(
        [0.161],
        [-0.008480655492356989, 0.335480655492357],
        [2.8971530571054935, -6.359448489975075, 4.3622954328695815],
        [5.325864828439257, -11.748883564062828, 7.4955393428898365, -0.09249506636175525],
        [5.86145544294642, -12.92096931784711, 8.159367898576159, -0.071584973281401,
         -0.028269050394068383],
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
