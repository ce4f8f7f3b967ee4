"""What is said of the two-level algorithm: settled or not, how soon, and was that to be expected.

Outer iterations are counted as settling is everywhere: until the KKT residual stays below the
tolerance. The run itself goes on to a share of it, so that its end can be certified.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.text import Text

from ann_dc.backends.status import Outcome
from ann_dc.report.tables import named_rows, verdict_text

if TYPE_CHECKING:
    from rich.table import Table

    from ann_dc.optimality.certificate import Certificate
    from ann_dc.problem.declaration import OptimalControlProblem
    from ann_dc.two_level.layer import TwoLevelRun
    from ann_dc.two_level.theorem import Hypothesis
    from ann_dc.two_level.upper_gains import UpperGains

LEVELS = {
    "gradient": "gradient (17)",
    "newton": "newton: a banded linear system in every outer iteration",
    "oracle": "oracle (33): lambda = |B/A| / 2, from the solution",
    "closed": "closed: the stage equations solved by Newton steps, (30) corrected",
    "iterated": "iterated: forward Euler (16) until the stages stand still",
    "linearised": "linearised stages, which follow the coordinator",
}
"""Upper and lower levels, as a person reads them."""
ROUNDING = 1e-9
"""A rise of Theta below this share of it is none."""
ELSEWHERE = 1e-6
"""A run that settles with more than this share of its first Theta settled to another solution."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Coordination:
    """A run of the two-level algorithm, and what was known before it.

    Attributes
    ----------
    problem : OptimalControlProblem
    coordinator, lower : str
        Names of the two levels.
    hypothesis : Hypothesis
        Of Theorem IV.2, at the designed solution.
    gains : UpperGains or None
        Of a coordinator that has them.
    run : TwoLevelRun
        Of one sample, with Theta.
    tolerance : float
        On the KKT residual, for counting; the run's own is a share of it.
    certificate : Certificate
        Of its last state.
    values : dict of str to list
        States and controls over the stages.
    """

    problem: OptimalControlProblem
    coordinator: str
    lower: str
    hypothesis: Hypothesis
    gains: UpperGains | None
    run: TwoLevelRun
    tolerance: float
    certificate: Certificate
    values: dict[str, list[float]]

    @property
    def rounds(self) -> int:
        """Outer iterations done."""
        return len(self.run.gains)

    @property
    def residual(self) -> float:
        """Relative KKT residual at the end, as the network sees it."""
        return float(self.run.residuals[-1, 0])

    @property
    def outcome(self) -> Outcome:
        """How the run ended."""
        if self.run.settled[0]:
            return Outcome.SETTLED
        return Outcome.NOT_SETTLED if np.isfinite(self.residual) else Outcome.DIVERGED

    @property
    def message(self) -> str:
        """How the run ended, in a sentence."""
        if self.outcome is Outcome.DIVERGED:
            return f"diverged: the numbers overflowed in outer iteration {self.rounds}"
        verb = "settled" if self.outcome is Outcome.SETTLED else "not settled"
        return f"{verb} after {self.rounds} outer iterations: KKT residual {self.residual:.1e}"

    @property
    def needed(self) -> int | None:
        """Outer iterations after which the residual stays below the tolerance; None if never."""
        count = int(replace(self.run, tolerance=self.tolerance).outer_iterations[0])
        return None if count < 0 else count

    @property
    def predicted(self) -> float | None:
        """What the gains let expect of `needed`; None without gains, or where they repel."""
        expected = np.inf if self.gains is None else self.gains.predicted(self.tolerance)
        return float(expected) if np.isfinite(expected) else None

    @property
    def theta(self) -> np.ndarray:
        """(J + 1,) Theta before every outer iteration, and at the end."""
        lyapunov = self.run.lyapunov
        return np.array([]) if lyapunov is None else lyapunov.theta[:, 0]

    @property
    def rises(self) -> int:
        """Outer iterations in which Theta did not fall."""
        with np.errstate(all="ignore"):  # a run that diverged
            return int((~(self.theta[1:] <= self.theta[:-1] * (1 + ROUNDING))).sum())

    @property
    def certified(self) -> bool:
        """Whether the run settled to an optimum, of both orders."""
        return self.outcome is Outcome.SETTLED and self.certificate.certified

    @property
    def verdict(self) -> str:
        """Why the end point is certified, or why not."""
        if self.outcome is not Outcome.SETTLED:
            return "the two levels did not settle"
        return self.certificate.reason

    def shown(self) -> Table:
        """Everything that `coordinate` prints."""
        proof = self.certificate
        return named_rows(
            {
                "problem": self.problem,
                "coordinator": LEVELS[self.coordinator] + self._gains,
                "lower level": LEVELS[self.lower],
                "Theorem IV.2": self.hypothesis,
                "status": self.message,
                "certified": verdict_text(self.certified, self.verdict),
                "objective": f"{proof.objective:.10g}",
                "KKT residual": f"{proof.kkt_residual:.1e} in the problem's units",
                "outer iterations": self._needed,
                **self._predicted,
                "inner steps": self._inner,
                "Theta (19)": self._theta,
            }
        )

    @property
    def _gains(self) -> str:
        gains = self.gains
        if gains is None:
            return ""
        return f", lambda_t = {gains.lambda_t:.4g}, lambda_beta = {gains.lambda_beta:.4g}"

    @property
    def _needed(self) -> str:
        if self.needed is None:
            return f"{self.rounds}, and the residual is not below {self.tolerance:g}"
        below = f"until the residual stays below {self.tolerance:g}"
        return f"{self.needed} {below} ({self.rounds} in all)"

    @property
    def _predicted(self) -> dict[str, str]:
        if self.gains is None:
            return {}
        count = "no end" if self.predicted is None else f"{self.predicted:.0f}"
        radius = f"spectral radius {self.gains.radius:.4g} at the solution"
        return {"predicted": f"{count}, from the {radius}"}

    @property
    def _inner(self) -> str:
        each = self.run.inner
        if not each.any():
            return "none"
        return f"{each.sum()} in all, {each.max()} at most in an outer iteration"

    @property
    def _theta(self) -> str:
        how = f"rose in {self.rises}" if self.rises else "fell in all"
        first, last = self.theta[0], self.theta[-1]
        elsewhere = self.run.settled[0] and last > ELSEWHERE * first
        note = ": another solution than the design's" if elsewhere else ""
        ends = f"from {first:.3g} to {last:.3g}"
        return f"{how} of {self.rounds} outer iterations, {ends}{note}"

    def as_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        proof, gains, hypothesis = self.certificate, self.gains, self.hypothesis
        return {
            "problem": self.problem.name,
            "coordinator": self.coordinator,
            "lower_level": self.lower,
            "status": self.outcome.name.lower(),
            "message": self.message,
            "settled": self.outcome is Outcome.SETTLED,
            "certified": self.certified,
            "verdict": self.verdict,
            "objective": proof.objective,
            "kkt_residual": proof.kkt_residual,
            "second_order": proof.second_order,
            "newton_step": proof.newton_step,
            "rollout_error": proof.rollout_error,
            "theorem_IV_2_holds": hypothesis.holds,
            "theorem_IV_2_fails_at": list(hypothesis.failing),
            "theorem_IV_2": str(hypothesis),
            "lambda_t": None if gains is None else gains.lambda_t,
            "lambda_beta": None if gains is None else gains.lambda_beta,
            "spectral_radius": None if gains is None else gains.radius,
            "tolerance": self.tolerance,
            "outer_iterations": self.needed,
            "outer_iterations_in_all": self.rounds,
            "predicted_outer_iterations": self.predicted,
            "inner_steps": int(self.run.inner.sum()),
            "theta_fell_monotonically": self.rises == 0,
            "theta": self.theta.tolist(),
            "residuals": self.run.residuals[:, 0].tolist(),
            "dt": self.problem.dt,
            "values": self.values,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Undesigned:
    """No run: the design found no solution, at which the theorem and the gains are looked at.

    Attributes
    ----------
    problem : OptimalControlProblem
    steps : int
        How long it looked.
    """

    problem: OptimalControlProblem
    steps: int
    certified = False

    @property
    def message(self) -> str:
        """What is missing, in a sentence."""
        return (
            f"{self.problem.name}: the design did not settle in {self.steps} steps, so there is no "
            "solution at which to check Theorem IV.2 and to choose gains; check that the target is "
            "within reach"
        )

    def shown(self) -> Text:
        """Everything that `coordinate` prints."""
        return Text(self.message, "red")

    def as_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "problem": self.problem.name,
            "status": "design_not_settled",
            "message": self.message,
            "settled": False,
            "certified": False,
        }
