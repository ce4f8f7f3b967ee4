"""How a run ended, in one sentence: the same words from every backend."""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.backends.integration.methods import Method
from ann_dc.network.cell import Role
from ann_dc.network.network import Network

OVERFLOW = 1e9
"""Magnitude of a state, relative to the largest at the start, that counts as divergence."""
UNMET = 1e-3
"""Constraint residual at the end of a run from which on the target may be out of reach."""

STEADY = 0.1
"""How far the growth of a multiplier in two quarters of a run may differ, as a share of it."""
LEAST_GROWTH = 0.02
"""Growth in a quarter of a run, over the largest multiplier, from which on it is told."""
LONGER_STEPS = "take an implicit method: method=ann_dc.ode.RADAU or --method Radau"
"""Advice where the fastest modes limit the steps of an explicit method."""
DAMPING = "damp it: lower the weights of its neurons' connections to themselves"
"""Advice for a limit cycle, which no method and no start ends."""
FINER = (
    "take the compiled method: method=ann_dc.ode.COMPILED or --method compiled; if the network is "
    "stiff, tighter tolerances: method.tighter()"
)
"""Advice where the error of an implicit method keeps the residual from falling."""
NOISE = 10.0
"""Residual that the error of an implicit method may cause, over its relative tolerance."""
CROSSINGS, SWINGS = 4, 0.1
"""A limit cycle: crossings of the middle in the last steps; width relative to the largest state."""
NAMED = 4
"""Multipliers that a sentence names: those of inequalities first."""


class Outcome(enum.Enum):
    """How a run ended; the value is the sentence that a user reads."""

    SETTLED = "settled: the KKT residual stays below tolerance"
    NOT_SETTLED = "not settled within the time given"
    DIVERGED = "diverged"
    LEFT_DOMAIN = "left the domain of a function block"
    STALLED = "stalled: the KKT residual fell no further"
    STOPPED = "stopped before its end"
    FOUND = "the optimum is known, but no network was seen to settle there"
    INFEASIBLE = "infeasible: no controls reach the target"
    UNBOUNDED = "unbounded: the cost has no minimum"


@dataclass(frozen=True, kw_only=True, eq=False)
class Status:
    """How a run ended, where and when.

    Attributes
    ----------
    outcome : Outcome
    message : str
        The whole sentence, with names and numbers.
    neuron : str or None
        The neuron (or block) that diverged or left its domain.
    time : float
        Network time at which the run ended.

    Examples
    --------
    >>> from ann_dc.backends import not_settled
    >>> print(not_settled((1e-5, 2e-3), 40.0, "900 steps were done"))
    not settled after 40 unit time constants: KKT residual 2.0e-03 when 900 steps were done
    """

    outcome: Outcome
    message: str
    neuron: str | None
    time: float

    @property
    def settled(self) -> bool:
        """Whether the run settled."""
        return self.outcome is Outcome.SETTLED

    def __str__(self) -> str:
        return self.message


def settled(residual: float, now: float) -> Status:
    """The residual fell on to a share of the tolerance.

    Parameters
    ----------
    residual : float
        Relative KKT residual at the end.
    now : float
        Network time.

    Examples
    --------
    >>> from ann_dc.backends import settled
    >>> str(settled(4e-9, 500.0))
    'settled after 500 unit time constants: KKT residual 4.0e-09'
    """
    message = f"settled after {now:.4g} unit time constants: KKT residual {residual:.1e}"
    return Status(outcome=Outcome.SETTLED, message=message, neuron=None, time=now)


def diverged(network: Network, x: np.ndarray, now: float, note: str | None = None) -> Status:
    """The largest component of a state (n,), or the first that is no number, is to blame.

    Parameters
    ----------
    network : Network
    x : (n,) array
        State vector at the end, in network units.
    now : float
        Network time.
    note : str, optional
        What else is known, for instance a solver's message.
    """
    worst = int(np.argmax(np.where(np.isfinite(x), np.abs(x), np.inf)))
    name = network.label(worst)
    message = f"diverged after {now:.4g} unit time constants: neuron {name} reached {x[worst]:.3g}"
    message += f" ({note})" if note else ""
    return Status(outcome=Outcome.DIVERGED, message=message, neuron=name, time=now)


def left_domain(network: Network, block: int, stage: int, now: float) -> Status:
    """A function block, by its place in the cell, is outside its domain.

    Parameters
    ----------
    network : Network
    block : int
        Place in ``network.cell.blocks``.
    stage : int
        The cell, from 0.
    now : float
        Network time.
    """
    name = network.cell.blocks[block].name
    penalty = ", or with more penalty" if network.cell.duals else ""
    message = (
        f"left the domain of {name} in cell {stage} after {now:.4g} unit time constants; start "
        f"closer to the solution{penalty}"
    )
    where = f"{name} [{stage}]"
    return Status(outcome=Outcome.LEFT_DOMAIN, message=message, neuron=where, time=now)


def elsewhere(network: Network) -> str:
    """Return advice for a network that gets no further, whatever runs it.

    Parameters
    ----------
    network : Network
        Only one with PI duals can be designed.

    Examples
    --------
    >>> import ann_dc
    >>> elsewhere(ann_dc.synthesize(ann_dc.plants.car()))
    'start elsewhere, or design a network for these inputs'
    """
    return "start elsewhere" + ", or design a network for these inputs" * bool(network.cell.duals)


def no_headway(
    network: Network, states: np.ndarray, steps: int, residual: float, method: Method
) -> tuple[str, str]:
    """Return the reason and the advice for a run whose residual no longer falls.

    Parameters
    ----------
    network : Network
    states : (T, n) array
        States of its last steps.
    steps : int
        Number of these steps.
    residual : float
        Smallest relative KKT residual of these steps.
    method : Method
        That took them. The tolerances of an implicit one do not fall with the residual.
    """
    why, advice = f"the last {steps} steps made it no smaller", elsewhere(network)
    if swings := swinging(network, states):
        return swings, DAMPING
    if not method.implicit:
        return why, f"if the network is stiff, {LONGER_STEPS}; else {advice}"
    if residual < NOISE * method.rtol:
        return f"{why}: {method.name} errs as much with rtol={method.rtol:g}", FINER
    return why, advice


def swinging(network: Network, states: np.ndarray) -> str:
    """Return the neuron that swings most at the end of a run, in a clause.

    Parameters
    ----------
    network : Network
    states : (T, n) array
        States of its last steps.

    Returns
    -------
    str
        Empty if none keeps swinging, or if the network has PI duals, which a design can damp.
    """
    middle, swing = 0.5 * (states.max(axis=0) + states.min(axis=0)), np.ptp(states, axis=0)
    crossings = np.diff(states > middle, axis=0).sum(axis=0)
    swing = np.where(crossings >= CROSSINGS, swing, 0.0)
    widest = int(np.argmax(swing))
    if network.cell.duals or not swing[widest] > SWINGS * np.abs(states).max():
        return ""
    return f"neuron {network.label(widest)} kept swinging by {swing[widest]:.3g}"


def stalled(residuals: tuple[float, float], now: float, why: str, advice: str) -> Status:
    """A run that gets no further.

    Parameters
    ----------
    residuals : (float, float)
        Relative constraint and stationarity residuals at its end.
    now : float
        Network time.
    why : str
        How that was seen.
    advice : str
        What the user can do about it.
    """
    message = f"stalled {_reached(residuals, now)}, and {why}; {advice}"
    return Status(outcome=Outcome.STALLED, message=message, neuron=None, time=now)


def stopped(residuals: tuple[float, float], now: float, why: str) -> Status:
    """A run that somebody ended.

    Parameters
    ----------
    residuals : (float, float)
        Relative constraint and stationarity residuals at its end.
    now : float
        Network time.
    why : str
        Who ended it, as the end of "... when".
    """
    message = f"stopped {_reached(residuals, now)} when {why}"
    return Status(outcome=Outcome.STOPPED, message=message, neuron=None, time=now)


def infeasible(why: str, now: float) -> Status:
    """A target that cannot be met.

    Parameters
    ----------
    why : str
        Which component, and what is nearest.
    now : float
        Network time.
    """
    return Status(outcome=Outcome.INFEASIBLE, message=f"infeasible: {why}", neuron=None, time=now)


def unbounded(why: str, now: float) -> Status:
    """A cost that falls without end.

    Parameters
    ----------
    why : str
        How far it was seen to fall, and what grew.
    now : float
        Network time.
    """
    return Status(outcome=Outcome.UNBOUNDED, message=f"unbounded: {why}", neuron=None, time=now)


def not_settled(residuals: tuple[float, float], now: float, why: str) -> Status:
    """A bound on the run was reached with these (constraint, stationarity) residuals.

    Parameters
    ----------
    residuals : (float, float)
        Relative constraint and stationarity residuals; the sentence says so where the first is
        above `UNMET`, since the target may be out of reach then.
    now : float
        Network time.
    why : str
        The bound, as the end of "... when".
    """
    message = f"not settled {_reached(residuals, now)} when {why}"
    if not residuals[0] < UNMET:
        message += "; its constraints are not met, so check that the target is within reach"
    return Status(outcome=Outcome.NOT_SETTLED, message=message, neuron=None, time=now)


def with_growth(
    status: Status, network: Network, curve: tuple[np.ndarray, np.ndarray], unmet: float
) -> Status:
    """A status that names the multipliers that grow, where a run could not meet its constraints.

    Where constraints contradict each other, their multipliers grow for ever along one direction:
    as much in the last quarter of the time as in the one before.

    Parameters
    ----------
    status : Status
    network : Network
    curve : (times,) and (times, n) arrays
        Network times and states of the whole run.
    unmet : float
        Relative constraint residual, the smallest of the second half of the run.

    Returns
    -------
    Status
        The same where the run has another end, or no multiplier grows steadily.
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
    rows = {diode.neuron for diode in network.cell.diodes}
    names = [network.cell.neurons[i].name for i in found]
    told = ", ".join(sorted(names, key=lambda name: name not in rows)[:NAMED])
    so_far = status.message.removesuffix(f"; {elsewhere(network)}")  # from there they would, too
    message = (
        f"{so_far}; the multipliers {told} grow steadily: if constraints contradict each other, "
        "loosen one of them, make it soft, or change the target; else a network with these gains "
        "does not settle"
    )
    return replace(status, message=message)


def _reached(residuals: tuple[float, float], now: float) -> str:
    """How far a run came."""
    return f"after {now:.4g} unit time constants: KKT residual {max(residuals):.1e}"
