"""Report of the two-level algorithm: settling and its prediction."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.console import Group
from rich.text import Text

from ann_dc.backends.status import Outcome
from ann_dc.problem.step_length import mean_length
from ann_dc.report.json_file import picked
from ann_dc.report.tables import headline, indented, named_rows, unit_list
from ann_dc.si_prefixes import counted
from ann_dc.two_level.coordination import Coordination, Undesigned

LEVELS = {
    "gradient": "gradient (17)",
    "newton": "newton: a banded linear system in every outer iteration",
    "oracle": "oracle (33): lambda = |B/A| / 2, from the solution",
    "closed": "closed: the stage equations solved by Newton steps, (30) corrected",
    "iterated": "iterated: forward Euler (16) until the stages converge",
    "linearised": "linearised stages at the coordinator's variables",
}
"""Descriptions of the upper and lower levels."""


def coordination_report(found: Coordination | Undesigned) -> Group | Text:
    """Return the report that ``ann-dc coordinate`` prints: result, iterations, checks, settings."""
    if isinstance(found, Undesigned):
        return Text(found.message, "red")
    certificate = found.certificate
    rows = named_rows(
        {
            "objective": f"{certificate.objective:.10g} {found.problem.cost_unit}".rstrip(),
            "outer iterations": _needed(found),
            **_predicted(found),
            "inner steps": _inner(found),
            "status": found.message,
            "KKT residual": f"{certificate.kkt_residual:.1e}, relative, in natural scales",
            "Theta (19)": _theta(found),
            "Theorem IV.1": _following(found),
            "Theorem IV.2": found.hypothesis,
            "problem": found.problem,
            "units": unit_list(found.problem),
            "coordinator": LEVELS[found.coordinator] + _gains(found),
            "lower level": LEVELS[found.lower],
        }
    )
    verdict = f"{'' if found.certified else 'not '}certified: {found.verdict}"
    return Group(headline(found.problem.name, verdict, found.certified), indented(rows))


def _gains(found: Coordination) -> str:
    gains = found.gains
    if gains is None:
        return ""
    return f", lambda_t = {gains.lambda_t:.4g}, lambda_beta = {gains.lambda_beta:.4g}"


def _needed(found: Coordination) -> str:
    rounds, tolerance = found.run.rounds, f"{found.tolerance:g}"
    if found.needed is None:
        return f"{rounds}, and the residual is not below {tolerance}"
    return f"{found.needed} until the residual stays below {tolerance} ({rounds} in all)"


def _predicted(found: Coordination) -> dict[str, str]:
    if found.gains is None:
        return {}
    count = "no end" if found.predicted is None else f"{found.predicted:.0f}"
    radius = f"spectral radius {found.gains.radius:.4g} at the solution"
    return {"predicted": f"{count}, from the {radius}"}


def _following(found: Coordination) -> str:
    distances, bound = found.run.distances, found.following
    if distances is None or not found.run.inner.any():
        return str(bound)
    errors = {"e_v": distances.v, "e_mu": distances.mu, "e_t, e_beta": distances.reported}
    ends = [f"|{name}| from {e[0, 0]:.3g} to {e[-1, 0]:.1e}" for name, e in errors.items()]
    v, mu = _ratios(found)
    return f"{bound}; {', '.join(ends)}; largest ratios {v:.3g} and {mu:.3g}"


def _ratios(found: Coordination) -> tuple[float, float]:
    """Return the largest ratios |e_v| and |e_mu| over |e_t, e_beta| of the run.

    The ratios are the measured rates of Theorem IV.1.
    """
    distances = found.run.distances
    if distances is None:
        return np.nan, np.nan
    with np.errstate(all="ignore"):  # 0/0 at the solution
        v, mu = (np.nanmax(e / distances.reported) for e in (distances.v, distances.mu))
    return float(v), float(mu)


def _inner(found: Coordination) -> str:
    each = found.run.inner
    if not each.any():
        return "none"
    return f"{each.sum()} in all, {each.max()} at most in an outer iteration"


def _theta(found: Coordination) -> str:
    how = f"rose in {found.rises}" if found.rises else "fell in all"
    note = ": a solution that differs from that of the design" if found.elsewhere else ""
    ends = f"from {found.theta[0]:.3g} to {found.theta[-1]:.3g}"
    return f"{how} of {counted(found.run.rounds, 'outer iterations')}, {ends}{note}"


def as_dict(found: Coordination | Undesigned) -> dict[str, Any]:
    """Return plain data for JSON."""
    if isinstance(found, Undesigned):
        return {
            "problem": found.problem.name,
            "status": "design_not_settled",
            "message": found.message,
            "settled": False,
            "certified": False,
        }
    certificate, gains, hypothesis = found.certificate, found.gains, found.hypothesis
    states = np.array([found.values[str(s)] for s in found.problem.states])
    return {
        "problem": found.problem.name,
        "coordinator": found.coordinator,
        "lower_level": found.lower,
        "status": found.outcome.name.lower(),
        "message": found.message,
        "settled": found.outcome is Outcome.SETTLED,
        **picked(found, "certified", "verdict"),
        **picked(certificate, "objective", "kkt_residual"),
        "second_order": certificate.second_order if certificate.first_order else None,
        **picked(certificate, "newton_step", "rollout_error"),
        "theorem_IV_1_rates": [found.following.v, found.following.mu],
        "theorem_IV_1_largest_ratios": _ratios(found),
        "theorem_IV_2_holds": hypothesis.holds,
        "theorem_IV_2_fails_at": hypothesis.failing,
        "theorem_IV_2": str(hypothesis),
        "lambda_t": None if gains is None else gains.lambda_t,
        "lambda_beta": None if gains is None else gains.lambda_beta,
        "spectral_radius": None if gains is None else gains.radius,
        "tolerance": found.tolerance,
        "outer_iterations": found.needed,
        "outer_iterations_in_all": found.run.rounds,
        "predicted_outer_iterations": found.predicted,
        "inner_steps": int(found.run.inner.sum()),
        "theta_fell_monotonically": found.rises == 0,
        "theta": found.theta,
        "residuals": found.run.residuals[:, 0],
        "dt": mean_length(found.problem.dt, states),
        "units": {**found.problem.units, "time": found.problem.time_unit},
        "values": found.values,
    }
