"""Record of a run of the two-level algorithm by outer iteration.

Outer iterations are counted like settling times: until the KKT residual stays below the tolerance,
at its last exit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ann_dc.backends.status import Outcome
from ann_dc.si_prefixes import counted
from ann_dc.summaries import summarised
from ann_dc.two_level.lyapunov import Distances, Lyapunov, printed_of
from ann_dc.validation import OrNan, Shape, checked


@checked
@summarised(
    lambda self: {
        "samples": len(self.states),
        "rounds": self.rounds,
        "settled": f"{np.count_nonzero(self.settled)} of {len(self.states)}",
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class TwoLevelRun:
    """Record of J outer iterations of B samples.

    Attributes
    ----------
    states : (B, n) array
        Final states, in network units.
    residuals : (J + 1, B) array
        Relative KKT residual before every outer iteration and at the end; infinite after an
        overflow.
    gains : (J, 2, B) array
        lambda_t and lambda_beta, in network units; nan if the coordinator has no gains.
    inner : (J + 1,) integers
        Inner steps before every outer iteration.
    distances : Distances or None
        Errors of both levels, each (J + 1, B); None if the solution was not given.
    tolerance : float
        Tolerance on the relative KKT residual.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.two_level import NewtonCoordinator
    >>> network = ann_dc.synthesize(ann_dc.plants.double_integrator(N=5))
    >>> run = ann_dc.TwoLevels(network, upper=NewtonCoordinator()).run()
    >>> len(run.residuals) == run.rounds + 1, run.settled.tolist(), run.gains.shape[1:]
    (True, [True], (2, 1))
    """

    states: Annotated[np.ndarray, Shape("B", "n"), OrNan()]
    residuals: Annotated[np.ndarray, Shape("rounds", "B"), OrNan()]
    gains: Annotated[np.ndarray, Shape("...", 2, "B"), OrNan()]
    inner: Annotated[np.ndarray, Shape("rounds")]
    distances: Distances | None
    tolerance: float

    @property
    def rounds(self) -> int:
        """Number of outer iterations."""
        return len(self.gains)

    @property
    def lyapunov(self) -> Lyapunov | None:
        """Theta, A and B, each (J + 1, B); None without the solution."""
        return None if self.distances is None else self.distances.lyapunov

    @property
    def printed_lyapunov(self) -> Lyapunov | None:
        """Theta, A and B, each (J, B), as printed in (20) and (21), including the gains."""
        if self.distances is None:
            return None
        t, beta = (Lyapunov(*(part[:-1] for part in of)) for of in self.distances[2:])
        return printed_of(t, beta, (self.gains[:, 0], self.gains[:, 1]))

    @property
    def outer_iterations(self) -> np.ndarray:
        """Outer iterations (B,) until the residual stays below the tolerance, or -1."""
        above = ~(self.residuals < self.tolerance)
        last = len(above) - 1 - above[::-1].argmax(axis=0)
        count = np.where(above.any(axis=0), last + 1, 0)
        return np.where(above[-1], -1, count)

    @property
    def settled(self) -> np.ndarray:
        """Mask (B,) of the samples that settled."""
        return self.outer_iterations >= 0

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """Outcome of each sample."""
        return tuple(map(_outcome, self.settled, self.residuals[-1]))

    @checked
    def message(self, sample: int) -> str:
        """Return a description of the outcome of a sample in one sentence."""
        outcome = self.outcomes[sample]
        if outcome is Outcome.DIVERGED:
            return f"diverged: the numbers overflowed in outer iteration {self.rounds}"
        verb = "settled" if outcome is Outcome.SETTLED else "not settled"
        residual = self.residuals[-1, sample]
        return (
            f"{verb} after {counted(self.rounds, 'outer iterations')}: KKT residual {residual:.1e}"
        )


def _outcome(settled: bool, residual: float) -> Outcome:
    if settled:
        return Outcome.SETTLED
    return Outcome.NOT_SETTLED if np.isfinite(residual) else Outcome.DIVERGED
