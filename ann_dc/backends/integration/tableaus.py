"""Coefficients of explicit Runge-Kutta pairs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Tableau:
    """Butcher tableau with its error estimate.

    The last slope is that at the new point (FSAL).

    References
    ----------
    .. [1] E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 1993.
    """

    a: np.ndarray  # coefficients (S, S) of the stages, below the diagonal
    b: np.ndarray  # weights (S,) of the step
    error: np.ndarray  # weights (S + 1,) of the error estimate; the last is that of the new slope
    third: np.ndarray  # weights (S + 1,) of the estimate of order three in DOP853, else zero
    exponent: float  # -1 divided by one more than the order of the estimate
    extra: np.ndarray
    """Extra stages (E, S + 1 + E) of the continuous extension, after the new slope."""
    between: np.ndarray
    """Coefficients (D, S + 1 + E) of theta, theta^2, ... of every slope's weight in the continuous
    extension: ``x + h sum_j b_j(theta) K_j`` is the state at a fraction theta of the step.
    """

    def __repr__(self) -> str:
        return f"<Tableau of {len(self.b)} stages>"

    @cached_property
    def rows(self) -> Rows:
        """Tableau in the form read by loops."""
        return Rows.of(self)


class Extension(NamedTuple):
    """Continuous extension without zeros: rows of the extra stages, then of the state."""

    starts: np.ndarray  # beginning of every row, (E + 2,)
    which: np.ndarray  # slope of every entry, (entries,)
    weights: np.ndarray  # weights (entries,); the last row depends on the position in the step
    powers: np.ndarray  # coefficients (entries of the last row, D) of the weights of the last row

    @classmethod
    def of(cls, tableau: Tableau) -> Extension:
        """Return the continuous extension of a tableau."""
        used = np.abs(tableau.between).max(axis=0)
        starts, which, weights = _without_zeros([*tableau.extra, used])
        return cls(starts, which, weights, tableau.between[:, used > 0].T.copy())


class Rows(NamedTuple):
    """Tableau without its zeros, in the form read by loops.

    The rows are one for every stage but the first, one for the step, and one for each estimate.
    """

    starts: np.ndarray  # beginning of every row, (S + 3,)
    which: np.ndarray  # slope of every entry, (entries,)
    weights: np.ndarray  # weights (entries,)
    exponent: float  # exponent of the tableau
    extension: Extension  # continuous extension, for states between the ends of a step

    @property
    def slopes(self) -> int:
        """Number of slopes: of the step, of extra stages and of a state inside the step."""
        return len(self.starts) - 3 + len(self.extension.starts)

    @classmethod
    def of(cls, tableau: Tableau) -> Rows:
        """Return the rows of a tableau."""
        table = [*tableau.a[1:], tableau.b, tableau.error, tableau.third]
        return cls(*_without_zeros(table), tableau.exponent, Extension.of(tableau))


def _without_zeros(table: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the beginnings of the rows, and the columns and values of all entries."""
    which = [np.flatnonzero(row) for row in table]
    starts = np.cumsum([0, *map(len, which)])
    weights = np.concatenate([row[at] for row, at in zip(table, which)])
    return starts, np.concatenate(which), weights


def _below_the_diagonal(*rows: list[float]) -> np.ndarray:
    """Return the matrix (S, S) from the nonzero parts of all rows but the first."""
    table = np.zeros((len(rows) + 1, len(rows) + 1))
    for stage, row in enumerate(rows, 1):
        table[stage, :stage] = row
    return table


def _alternating(b: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Return the extension of DOP853 in powers of theta: (3 + R, S + 1 + E).

    ``x + theta (F_0 + (1 - theta) (F_1 + theta (F_2 + (1 - theta) (F_3 + ...))))``: F_0 is the
    step, F_1 and F_2 match the slopes at its ends, and R rows of ``rest`` follow (Hairer, II.6).
    """
    step, first, last = np.zeros((3, rest.shape[1]))
    step[: len(b)], first[0], last[len(b)] = b, 1.0, 1.0
    terms = np.stack([step, first - step, 2 * step - last - first, *rest])
    factor, found = np.array([0.0, 1.0]), np.zeros((len(terms) + 1, rest.shape[1]))
    for number, term in enumerate(terms):
        found[: len(factor)] += np.outer(factor, term)
        factor = np.convolve(factor, [0.0, 1.0] if number % 2 else [1.0, -1.0])
    return found[1:]


_DOP853_B = np.array(
    [0.054293734116568765, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003,
     -5.801203960010585, 0.3111643669578199, -0.1521609496625161, 0.20136540080403034,
     0.04471061572777259]
)  # fmt: skip

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
    b=_DOP853_B,
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
    extra=np.array([
        [0.056167502283047954, 0.0, 0.0, 0.0, 0.0, 0.0, 0.25350021021662483, -0.2462390374708025,
         -0.12419142326381637, 0.15329179827876568, 0.00820105229563469, 0.007567897660545699,
         -0.008298, 0.0, 0.0, 0.0],
        [0.03183464816350214, 0.0, 0.0, 0.0, 0.0, 0.028300909672366776, 0.053541988307438566,
         -0.05492374857139099, 0.0, 0.0, -0.00010834732869724932, 0.0003825710908356584,
         -0.00034046500868740456, 0.1413124436746325, 0.0, 0.0],
        [-0.42889630158379194, 0.0, 0.0, 0.0, 0.0, -4.697621415361164, 7.683421196062599,
         4.06898981839711, 0.3567271874552811, 0.0, 0.0, 0.0, -0.0013990241651590145,
         2.9475147891527724, -9.15095847217987, 0.0],
    ]),
    between=_alternating(_DOP853_B, np.array([
        [-8.428938276109013, 0.0, 0.0, 0.0, 0.0, 0.5667149535193777, -3.0689499459498917,
         2.38466765651207, 2.117034582445028, -0.871391583777973, 2.2404374302607883,
         0.6315787787694688, -0.08899033645133331, 18.148505520854727, -9.194632392478356,
         -4.436036387594894],
        [10.427508642579134, 0.0, 0.0, 0.0, 0.0, 242.28349177525817, 165.20045171727028,
         -374.5467547226902, -22.113666853125306, 7.733432668472264, -30.674084731089398,
         -9.332130526430229, 15.697238121770845, -31.139403219565178, -9.35292435884448,
         35.81684148639408],
        [19.985053242002433, 0.0, 0.0, 0.0, 0.0, -387.0373087493518, -189.17813819516758,
         527.8081592054236, -11.57390253995963, 6.8812326946963, -1.0006050966910838,
         0.7777137798053443, -2.778205752353508, -60.19669523126412, 84.32040550667716,
         11.99229113618279],
        [-25.69393346270375, 0.0, 0.0, 0.0, 0.0, -154.18974869023643, -231.5293791760455,
         357.6391179106141, 93.40532418362432, -37.45832313645163, 104.0996495089623,
         29.8402934266605, -43.53345659001114, 96.32455395918828, -39.17726167561544,
         -149.72683625798564],
    ])),
)  # fmt: skip
"""Dormand and Prince, order 8, continuous extension of order 7: DOP853 [1]_, as in SciPy.

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
    extra=np.zeros((0, 7)),
    between=np.array([
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [-2.763706197274826, 0.13169999999999998, 3.9302962368947516, -12.411077166933676,
         37.50931341651104, -27.896526289197286, 1.5],
        [2.9132554618219126, -0.2234, -5.941033872131505, 30.33818863028232, -88.1789048947664,
         65.09189467479366, -4.0],
        [-1.0530884977290216, 0.1017, 2.490627285651253, -16.548102889244902, 47.37952196281928,
         -34.87065786149661, 2.5],
    ]),
)  # fmt: skip
"""Tsitouras pair of order five, with few stored slopes, so that many networks fit a cache.

The continuous extension has order 4 and needs no extra stage ([1]_, section 5).

References
----------
.. [1] C. Tsitouras, Runge-Kutta pairs of order 5(4) satisfying only the first column simplifying
   assumption, Computers & Mathematics with Applications 62, 2011, 770-775.
"""
