r"""The paper's adaptive gain (33): an oracle, because it needs the solution that is sought.

It takes lambda = \|B/A\|, with A and B of `ann_dc.two_level.lyapunov` over the drives of t and beta.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ann_dc.evaluation.compiled import CompiledEvaluator
from ann_dc.network.network import COORDINATION, Network
from ann_dc.two_level.lyapunov import lyapunov


@dataclass(frozen=True, kw_only=True, eq=False)
class OracleGain:
    """|B/A| of (21), (33) as a factor on the rates of t and beta, for ``OdeBackend(gain=...)``.

    Theorem IV.2 holds for 0 < lambda < -B/A only, and B is seldom negative; the rule is run as it
    is printed, with the absolute value.

    Parameters
    ----------
    network : Network
    settled : (n,) array
        State vector of the solution, in the network's units.
    low, high : float
        The factor is clipped to this range; |B/A| has no upper bound near the solution.

    References
    ----------
    Paper equations (20), (21), (33), corrected; switch S16.
    """

    network: Network
    settled: np.ndarray
    low: float = 1e-3
    high: float = 1e3

    @cached_property
    def _rows(self) -> np.ndarray:
        return self.network.of_population(*COORDINATION)

    @cached_property
    def _drives(self) -> Callable[[np.ndarray], np.ndarray]:
        return CompiledEvaluator(self.network).drives

    def __call__(self, x: np.ndarray) -> float:
        """The factor at a state vector (n,); ``low`` where it is not defined."""
        drive = self.network.pack(self._drives(x))[self._rows]
        error = (x - self.settled)[self._rows]
        with np.errstate(all="ignore"):  # 0/0 at the solution
            factor = abs(float(lyapunov(error, drive).bound))
        return float(np.clip(factor, self.low, self.high)) if np.isfinite(factor) else self.low
