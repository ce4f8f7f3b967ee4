"""Status of a run: one sentence on its end, worded identically by every backend."""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ann_dc.backends.integration.methods import Method
from ann_dc.network.cell import Role
from ann_dc.network.network import Network

OVERFLOW = 1e9
"""Magnitude of a state, relative to the largest at the start, that counts as divergence."""
UNMET = 1e-3
"""Constraint residual at the end of a run above which the target may be out of reach."""

KKT = "KKT residual"
"""Name of the residual of a network that solves a problem."""
STEADY = 0.1
"""Largest relative difference of a multiplier's growth in two quarters of a run."""
LEAST_GROWTH = 0.02
"""Smallest reported growth per quarter of a run, relative to the largest multiplier."""
LONGER_STEPS = "use an implicit method: method=ann_dc.ode.RADAU or --method Radau"
"""Advice if the fastest modes limit the steps of an explicit method."""
DAMPING = "damp it: reduce the weights of the neurons' connections to themselves"
"""Advice for a limit cycle, which no method or initial guess ends."""
FINER = (
    "use the compiled method: method=ann_dc.ode.COMPILED or --method compiled; if the network is "
    "stiff, tighter tolerances: method.tighter()"
)
"""Advice if the error of an implicit method prevents the residual from falling."""
NOISE = 10.0
"""Residual that the error of an implicit method may cause, divided by its relative tolerance."""
CROSSINGS, SWINGS = 4, 0.1
"""Limit cycle: crossings of the middle in the last steps; width relative to the largest state."""
NAMED = 4
"""Number of multipliers named in a message, those of inequalities first."""


class Outcome(enum.Enum):
    """Outcome of a run; the value is the sentence shown to the user."""

    SETTLED = "settled: the KKT residual stays below the tolerance"
    COMPLETED = "completed the given duration"
    NOT_SETTLED = "not settled within the limit"
    DIVERGED = "diverged"
    LEFT_DOMAIN = "left the domain of a function block"
    STALLED = "stalled: the KKT residual no longer decreases"
    STOPPED = "stopped before its end"
    FOUND = "optimum known, but no network settled there"
    INFEASIBLE = "infeasible: no controls reach the target"
    UNBOUNDED = "unbounded: the cost has no minimum"


class Explanation(NamedTuple):
    """Meaning of an outcome, and the next step for the user; one line each."""

    meaning: str
    next_step: str


EXPLANATIONS: dict[Outcome, Explanation] = {
    Outcome.SETTLED: Explanation(
        "The relative KKT residual fell below the tolerance and stayed below it.",
        "check solution.certified; if it is False, solution.verdict states the reason",
    ),
    Outcome.COMPLETED: Explanation(
        "The run lasted for the given duration and is not settled at its end.",
        "omit --duration to run until the network settles",
    ),
    Outcome.NOT_SETTLED: Explanation(
        "The run reached its limit of steps, network time or wall-clock time.",
        "check that the target is within reach, then raise --max-settling or --max-steps",
    ),
    Outcome.DIVERGED: Explanation(
        "A state exceeded 1e9 times the largest initial one, or is not finite.",
        "use designed gains, a shorter --step, or another --initial-guess",
    ),
    Outcome.LEFT_DOMAIN: Explanation(
        "A function block received a value outside its domain.",
        "start closer to the solution",
    ),
    Outcome.STALLED: Explanation(
        "The KKT residual no longer decreases, or steps became very short.",
        "try another --initial-guess",
    ),
    Outcome.STOPPED: Explanation(
        "A time limit, Ctrl-C or the progress receiver ended the run.",
        "raise --time-limit, or use the returned state as the initial guess",
    ),
    Outcome.FOUND: Explanation(
        "The optimum is known, but no network with constant gains settled there.",
        "try another --preconditioner; ann-dc design --diagnose lists the slow modes",
    ),
    Outcome.INFEASIBLE: Explanation(
        "No controls reach the target and satisfy all constraints.",
        "change the target, add stages, widen the bounds, or make a constraint soft",
    ),
    Outcome.UNBOUNDED: Explanation(
        "The cost decreases without bound.",
        "add a cost for the variable that grows, or check the signs",
    ),
}
"""Meaning and next step of every outcome; status messages that give advice begin with it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Status:
    """Outcome of a run with its cause and time.

    Attributes
    ----------
    message : str
        Complete sentence with names and numbers.
    neuron : str or None
        Neuron (or block) that diverged or left its domain.
    time : float
        Network time at the end of the run.

    Examples
    --------
    >>> from ann_dc.backends import not_settled
    >>> print(not_settled((1e-5, 2e-3), 40.0, "900 steps"))
    not settled within 900 steps (s = 40): KKT residual 2.0e-03
    """

    outcome: Outcome
    message: str
    neuron: str | None
    time: float

    @property
    def settled(self) -> bool:
        """True if the run settled."""
        return self.outcome is Outcome.SETTLED

    def __str__(self) -> str:
        return self.message


def residual_name(network: Network) -> str:
    """Return the name of a network's residual; networks wired by hand have no KKT conditions."""
    return KKT if network.cell.duals else "residual"


def settled(residual: float, now: float, name: str = KKT) -> Status:
    """Return the status of a run that settled at network time ``now``.

    The relative KKT residual at the end is a fraction of the tolerance.

    Examples
    --------
    >>> from ann_dc.backends import settled
    >>> str(settled(4e-9, 500.0))
    'settled after 500 unit time constants: KKT residual 4.0e-09'
    """
    message = f"settled after {now:.4g} unit time constants: {name} {residual:.1e}"
    return Status(outcome=Outcome.SETTLED, message=message, neuron=None, time=now)


def completed(residuals: tuple[float, float], now: float, name: str = KKT) -> Status:
    """Return the status of a run of a given duration that is not settled at its end.

    Examples
    --------
    >>> str(completed((0.0, 0.3), 25.0))
    'completed after 25 unit time constants, the given duration: KKT residual 3.0e-01'
    """
    message = f"completed after {now:.6g} unit time constants, the given duration: {name}"
    message = f"{message} {max(residuals):.1e}"
    return Status(outcome=Outcome.COMPLETED, message=message, neuron=None, time=now)


def diverged(network: Network, x: np.ndarray, now: float, note: str | None = None) -> Status:
    """Return the status of a run that diverged at network time ``now``.

    The message names the largest component of the final state (n,), or the first that is not
    finite, and a note.
    """
    worst = int(np.argmax(np.where(np.isfinite(x), np.abs(x), np.inf)))
    name = network.label(worst)
    message = f"diverged after {now:.4g} unit time constants: neuron {name} reached {x[worst]:.3g}"
    message += f" ({note})" if note else ""
    return Status(outcome=Outcome.DIVERGED, message=message, neuron=name, time=now)


def left_domain(network: Network, block: int, stage: int, now: float) -> Status:
    """Return the status of a run in which a block left its domain in a stage from 0."""
    name = network.cell.blocks[block].name
    penalty = ", or use larger penalties" if network.cell.duals else ""
    message = (
        f"left the domain of {name} in cell {stage} after {now:.4g} unit time constants; "
        f"{EXPLANATIONS[Outcome.LEFT_DOMAIN].next_step}{penalty}"
    )
    where = f"{name} [{stage}]"
    return Status(outcome=Outcome.LEFT_DOMAIN, message=message, neuron=where, time=now)


def elsewhere(network: Network) -> str:
    """Return advice for a network without further headway on any backend.

    Only a network with PI duals can be designed.

    Examples
    --------
    >>> import ann_dc
    >>> elsewhere(ann_dc.synthesize(ann_dc.plants.car()))
    'try another --initial-guess, or design a network for these inputs'
    """
    design = ", or design a network for these inputs" * bool(network.cell.duals)
    return EXPLANATIONS[Outcome.STALLED].next_step + design


def no_headway(
    network: Network, states: np.ndarray, steps: int, residual: float, method: Method
) -> tuple[str, str]:
    """Return the reason and the advice for a run whose residual no longer falls.

    The states (T, n) are those of the last ``steps``, and ``residual`` is their smallest. The
    tolerances of an implicit method do not fall with the residual.
    """
    why, advice = f"the last {steps} steps did not reduce it", elsewhere(network)
    if swings := swinging(network, states):
        return swings, DAMPING
    if not method.implicit:
        return why, f"if the network is stiff, {LONGER_STEPS}; else {advice}"
    if residual < NOISE * method.rtol:
        return f"{why}: it equals the error of {method.name} with rtol={method.rtol:g}", FINER
    return why, advice


def swinging(network: Network, states: np.ndarray) -> str:
    """Return a clause on the neuron that oscillates most in the last states (T, n).

    The clause is empty if no neuron oscillates, or if a design can damp the network.
    """
    middle, swing = 0.5 * (states.max(axis=0) + states.min(axis=0)), np.ptp(states, axis=0)
    crossings = np.diff(states > middle, axis=0).sum(axis=0)
    swing = np.where(crossings >= CROSSINGS, swing, 0.0)
    widest = int(np.argmax(swing))
    if network.cell.duals or not swing[widest] > SWINGS * np.abs(states).max():
        return ""
    return f"neuron {network.label(widest)} continued to oscillate by {swing[widest]:.3g}"


def stalled(
    residuals: tuple[float, float], now: float, why: str, advice: str, name: str = KKT
) -> Status:
    """Return the status of a run without further headway, with evidence and advice."""
    message = f"stalled {_reached(residuals, now, name)}, {why}; {advice}"
    return Status(outcome=Outcome.STALLED, message=message, neuron=None, time=now)


def stopped(residuals: tuple[float, float], now: float, why: str, name: str = KKT) -> Status:
    """Return the status of an interrupted run; ``why`` is the reason, as a clause."""
    next_step = EXPLANATIONS[Outcome.STOPPED].next_step
    message = f"stopped {_reached(residuals, now, name)} ({why}); {next_step}"
    return Status(outcome=Outcome.STOPPED, message=message, neuron=None, time=now)


def infeasible(why: str, now: float) -> Status:
    """Return the status of a run whose target cannot be met.

    ``why`` names the component and the nearest reachable value.
    """
    return Status(outcome=Outcome.INFEASIBLE, message=f"infeasible: {why}", neuron=None, time=now)


def unbounded(why: str, now: float) -> Status:
    """Return the status of a run whose cost decreases without bound.

    ``why`` describes how far the cost fell and which variable grew.
    """
    return Status(outcome=Outcome.UNBOUNDED, message=f"unbounded: {why}", neuron=None, time=now)


def not_settled(residuals: tuple[float, float], now: float, bound: str, name: str = KKT) -> Status:
    """Return the status of a run that reached a bound before it settled.

    The message mentions the constraint residual if it exceeds `UNMET`, since the target may be out
    of reach. ``bound`` is the number of steps or the time allowed.
    """
    message = f"not settled within {bound} (s = {now:.4g}): {name} {max(residuals):.1e}"
    if not residuals[0] < UNMET:
        next_step = EXPLANATIONS[Outcome.NOT_SETTLED].next_step
        message += f"; constraints are not satisfied: {next_step}"
    return Status(outcome=Outcome.NOT_SETTLED, message=message, neuron=None, time=now)


def with_growth(
    status: Status, network: Network, curve: tuple[np.ndarray, np.ndarray], unmet: float
) -> Status:
    """Return a status that names growing multipliers if constraints were not met.

    Multipliers of contradictory constraints grow forever along one direction: their growth in the
    last quarter of the time equals that in the quarter before. ``curve`` contains network times
    (times,) and states (times, n) of the whole run. ``unmet`` is the smallest relative constraint
    residual of its second half.
    """
    if status.outcome not in (Outcome.NOT_SETTLED, Outcome.STALLED) or not unmet >= UNMET:
        return status
    times, states = curve
    half, late, end = (
        network.unpack(states[np.searchsorted(times, share * times[-1])])
        for share in (0.5, 0.75, 1)
    )
    before, now = late - half, end - late
    dual = [n.role is Role.DUAL for n in network.cell.neurons]
    size = np.abs(end[dual]).max(initial=0.0)
    steady = (np.abs(now - before) <= STEADY * np.abs(now)) & (now * end > 0)
    gained = np.where(steady & (np.abs(now) > LEAST_GROWTH * size), np.abs(now), 0.0).max(axis=1)
    found = [i for i in np.argsort(-gained) if dual[i] and gained[i] > 0]
    if not found:
        return status
    rows = {diode.neuron for diode in network.cell.inequality_duals}
    names = [network.cell.neurons[i].name for i in found]
    reported = ", ".join(sorted(names, key=lambda name: name not in rows)[:NAMED])
    so_far = status.message.removesuffix(f"; {elsewhere(network)}")  # they would grow from there
    remedy = EXPLANATIONS[Outcome.INFEASIBLE].next_step
    message = (
        f"{so_far}; multipliers {reported} grow linearly: constraints contradict each other "
        f"({remedy}), or the network does not settle with these gains"
    )
    return replace(status, message=message)


def _reached(residuals: tuple[float, float], now: float, name: str) -> str:
    """Return a clause on the residual and time reached."""
    return f"after {now:.4g} unit time constants: {name} {max(residuals):.1e}"
