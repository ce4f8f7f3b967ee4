"""Diagnosis of slow settling: computed reasons and remedies, as text.

The numbers are those of `analysis.slowness`. Each remedy is a candidate of the design that differs
in one property (penalty, row factors, preconditioner), or the exact preconditioner in closed form.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from ann_dc.analysis.saddle import MultiplierSensitivity
from ann_dc.analysis.slowness import LIMIT, SHOWN, Cause, Mode, Slowness, slowness_of
from ann_dc.errors import DesignError, such_as
from ann_dc.gain_design.procedure import Design
from ann_dc.gain_design.trial_run import Candidate
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.si_prefixes import counted
from ann_dc.solution.solution import Solution
from ann_dc.summaries import summarised
from ann_dc.validation import checked

NEAR = 2.0
"""Factor to the limit within which no remedy is worthwhile."""

HELPS = 1.1
"""Smallest reduction factor of a stiffness ratio that counts as improvement."""

ROUNDING = 1e-9
"""Numbers below this value are shown as zero."""

ROWS_SHOWN = 6
"""Number of constraints in the table, the least reachable ones."""


@dataclass(frozen=True, kw_only=True)
class Remedy:
    """Change of a design and its effect on the stiffness ratio at the settled point.

    Attributes
    ----------
    ratio : float
        Stiffness ratio with the change.
    gain : float
        Reduction factor of the ratio; below one, the change is harmful.
    compared : bool
        True for a candidate that the design compared, False for the exact preconditioner.
    settling : float
        Fastest time constants in which the candidate settled from the start; infinite if it did not
        settle, nan if unknown.
    """

    change: str
    ratio: float
    gain: float
    compared: bool
    settling: float = float("nan")

    @property
    def helps(self) -> bool:
        """True if the improvement is significant."""
        return self.gain >= HELPS

    @property
    def outcome(self) -> str:
        """Description of the trial run from the start."""
        if self.settling < np.inf:
            return f"settles in {self.settling:.0f} tau_min"
        return "was not tested" if np.isnan(self.settling) else "does not settle, or settles later"

    def __str__(self) -> str:
        if np.isfinite(self.ratio):
            return f"{self.change:44}{self.ratio:10.3g}{self.gain:15.2g}"
        return f"{self.change:44}{'unstable':>10}{'-':>15}"


@such_as("ann_dc.diagnose(design)")
@summarised(
    lambda self: {
        "title": self.title,
        "preconditioner": self.kind.value,
        "reason": self.reason,
        "advice": self.advice,
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Diagnosis:
    """Reasons for the settling time of a design, and remedies.

    Attributes
    ----------
    title : str
        Title of the network.
    kind : PreconditionerKind
        PreconditionerKind of its preconditioner.
    components : tuple of str
        State component of every entry of ``slowness.rows``.
    remedies : tuple of Remedy
        Changes, one property each.

    Examples
    --------
    >>> from ann_dc import diagnose, design, plants
    >>> found = diagnose(design(plants.double_integrator(N=5)))
    >>> len(found.slowness.modes), found.reason != ""
    (3, True)
    >>> found.remedies[-1].ratio
    2.0
    """

    title: str
    kind: PreconditionerKind
    components: tuple[str, ...]
    slowness: Slowness
    remedies: tuple[Remedy, ...]

    @property
    def reason(self) -> str:
        """Reason for which the slowest mode is slow."""
        slowest = self.slowness.modes[0]
        if self.slowness.distance <= NEAR:
            return "none: the slowest mode is near the limit"
        row = self._row_of(slowest)
        along = f"multiplier sensitivity {slowest.sensitivity * row.penalty:.3g} along the mode"
        if slowest.cause is Cause.REACH:
            return (
                f"constraint {self._component(row)} is weakly reachable: {along}, "
                f"penalty {row.penalty:.3g}"
            )
        if slowest.cause is Cause.CURVATURE:
            return (
                f"penalty {row.penalty:.3g} of constraint {self._component(row)} is low for the "
                f"curvature: {along}"
            )
        return (
            f"the preconditioner does not couple {_listed(slowest.leading[:SHOWN])}: "
            f"{100 * slowest.dual_share:.0f} % of the energy is in multipliers"
        )

    @property
    def advice(self) -> str:
        """Advice: more penalty, other row factors, another preconditioner, or none."""
        found = self.slowness
        if found.distance <= NEAR:
            return f"none: the stiffness ratio is within a factor {NEAR:g} of the limit"
        compared = [remedy for remedy in self.remedies if remedy.compared]
        best = max(compared, key=lambda remedy: remedy.gain, default=None)
        if best is not None and best.helps:
            return (
                f"{best.change}: {best.gain:.2g} times faster near the optimum, but not "
                f"selected: from the initial guess it {best.outcome}"
            )
        preconditioner = "another preconditioner"
        if self.kind.is_stiffness:
            preconditioner = "a smaller path weight (stiffer at the start)"
        if found.ratio < HELPS * found.exact_ratio():
            return (
                f"{preconditioner} with {found.needed:.3g} times the penalties; "
                "neither is sufficient alone"
            )
        return f"{preconditioner}; then larger penalties"

    def _row_of(self, mode: Mode) -> MultiplierSensitivity:
        """Return the constraint whose multiplier has the largest part of a mode's energy."""
        shares = dict(zip(mode.names, mode.shares))
        return max(self.slowness.rows, key=lambda row: shares[row.neuron])

    def _component(self, row: MultiplierSensitivity) -> str:
        return self.components[self.slowness.rows.index(row)]

    def __str__(self) -> str:
        found = self.slowness
        slowest, stages = found.modes[0], found.modes[0].shape.shape[1]
        return "\n".join(
            [
                f"{self.title}: stiffness ratio {found.ratio:.3g}, {found.distance:.3g} times the "
                f"limit of {LIMIT:g} ({self.kind.value})",
                f"{'constraint':28}{'penalty':>16}{'sensitivity at a stage':>26}{'all stages':>18}",
                *self._row_lines(),
                f"  multiplier sensitivity: {_span(found.lowest, found.highest)} times the "
                f"penalties; threshold rho* = {_span(found.rho_star)}",
                f"slowest modes: energy by component, over {counted(stages, 'stages')}",
                *(f"  {mode}" for mode in found.modes),
                f"cause: {self.reason}",
                f"  rate {slowest.rate:.3g} = {slowest.curvature:.3g} from curvature + "
                f"{slowest.penalty:.3g} from the penalty",
                f"{'remedy':42}{'stiffness ratio':>16}{'speed-up':>13}",
                *(f"  {remedy}" for remedy in self.remedies),
                f"advice: {self.advice}",
            ]
        )

    def _row_lines(self) -> Iterator[str]:
        rows = sorted(zip(self.components, self.slowness.rows), key=lambda pair: pair[0])
        groups = [[row for _, row in group] for _, group in groupby(rows, lambda pair: pair[0])]
        groups.sort(key=lambda group: -max(row.reach for row in group))
        for group in groups[:ROWS_SHOWN]:
            stages = np.concatenate([row.at_stage for row in group])
            ends = min(row.lowest for row in group), max(row.highest for row in group)
            names = ", ".join(row.neuron for row in group)
            penalty = _span(*_ends(np.array([row.penalty for row in group])))
            yield f"  {names:26}{penalty:>16}{_span(*_ends(stages)):>26}{_span(*ends):>18}"


@checked
def diagnose(source: Design | Solution) -> Diagnosis:
    """Diagnose the settling time of a design and list remedies.

    Parameters
    ----------
    source : Design or Solution
        Design, or a solution with designed gains.

    Returns
    -------
    Diagnosis
        Reasons, and remedies with their effects.

    Raises
    ------
    DesignError
        If the gain-scheduled run of the design did not settle, or the gains of the solution were
        given manually.
    NetworkError
        If the settled point is not isolated.

    Examples
    --------
    >>> from ann_dc import diagnose, design, plants
    >>> print(diagnose(design(plants.double_integrator(N=5))))  # doctest: +ELLIPSIS
    double_integrator: stiffness ratio ... times the limit of 2...
    ...
    """
    design = source.design if isinstance(source, Solution) else source
    if design is None:
        raise DesignError(
            "diagnose: the gains of this solution were given manually, so no candidates were "
            "compared; design its network, or use ann_dc.analysis.slowness_of(network, state)"
        )
    if not design.settled:
        raise DesignError(
            f"{design.network.title}: the gain-scheduled run did not settle in "
            f"{design.first.steps} steps, so the equilibrium is unknown; raise limit= or choose "
            "a nearer target"
        )
    network = design.network
    found = slowness_of(network, design.state)
    return Diagnosis(
        title=network.title,
        kind=network.preconditioner.kind,
        components=tuple(network.neuron(row.neuron).component or row.neuron for row in found.rows),
        slowness=found,
        remedies=(*_compared(design, found.ratio), *_exact(found)),
    )


def _compared(design: Design, ratio: float) -> Iterator[Remedy]:
    """Yield the best candidate of every change that the design compared."""
    best: dict[str, Candidate] = {}
    for candidate in design.candidates:
        change = _change(design, candidate)
        if change and (change not in best or candidate.ratio < best[change].ratio):
            best[change] = candidate
    order = [*_WITHIN, *(kind.value for kind in PreconditionerKind)]
    for change in sorted(best, key=order.index):
        other = best[change]
        yield Remedy(
            change=change,
            ratio=other.ratio,
            gain=ratio / other.ratio,
            compared=True,
            settling=other.settling,
        )


_WITHIN = ("larger penalty", "smaller penalty", "other row weights", "other factors")


def _change(design: Design, candidate: Candidate) -> str:
    """Return the difference of a candidate from the design; empty if there is none."""
    if candidate.gain_rule.kind is not design.best.gain_rule.kind:
        return candidate.gain_rule.kind.value
    index = design.network.neuron_index
    duals = [index[dual.neuron] for dual in design.network.cell.duals]
    factors = candidate.gains.rho[duals] / design.gains.rho[duals]
    if not np.allclose(factors, factors[0], rtol=1e-6):
        return "other row weights"
    if np.isclose(factors[0], 1.0):
        return "" if candidate.gain_rule == design.best.gain_rule else "other factors"
    return "larger penalty" if factors[0] > 1 else "smaller penalty"


def _exact(found: Slowness) -> Iterator[Remedy]:
    """Yield the exact preconditioner with the present and with the required penalties."""
    changes = {"exact preconditioner, present penalties": 1.0}
    if found.exact_ratio() > LIMIT:
        changes[f"exact preconditioner, {found.needed:.3g} times the penalties"] = found.needed
    for change, factor in changes.items():
        other = found.exact_ratio(factor)
        yield Remedy(change=change, ratio=other, gain=found.ratio / other, compared=False)


def _ends(values: np.ndarray) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def _span(*ends: float) -> str:
    """Return one number as text, or two that differ."""
    reported = [f"{0.0 if abs(value) < ROUNDING else value:.3g}" for value in ends]
    return " to ".join(dict.fromkeys(reported))


def _listed(names: tuple[str, ...]) -> str:
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last
