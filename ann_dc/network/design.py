"""Design: from a wired network to a frozen one, whose constants are R*C values.

1. First run with scheduled gains, to a settled point (`first_run`).
2. Freeze: the closed form once more at that point, for each way of wiring the coordinators (none
   among them) and a few penalties. The smallest ratio of the spectrum wins, provided that a
   rehearsal with constant gains settles from the start.
3. Optional refinement of the closed form's factors by Nelder-Mead on the log ratio.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize

from ann_dc.errors import DesignError, UnknownNameError
from ann_dc.network.compiled import SETTLED
from ann_dc.network.first_run import FirstRun, first_run
from ann_dc.network.gains import (
    WITH_COORDINATORS,
    WITHOUT_COORDINATORS,
    Gains,
    Recipe,
    apply_gains,
    closed_form,
    tape_with,
)
from ann_dc.network.kernel import Kernel
from ann_dc.network.linearisation import Linearisation
from ann_dc.network.network import Network
from ann_dc.network.pyramid import Hats
from ann_dc.network.spectrum import Spectrum, penalty_threshold, spectrum

if TYPE_CHECKING:
    from ann_dc.problem.declaration import OptimalControlProblem

RECIPES = (
    WITH_COORDINATORS,
    replace(WITH_COORDINATORS, hats=Hats.COUPLED),
    WITHOUT_COORDINATORS,
)
"""The wirings among which the freeze chooses; the first one is used in the first run."""

REHEARSAL_STEP = 0.2
"""Step of the rehearsal, as a share of the largest that is stable at the settled point."""

REHEARSAL_TOLERANCE = 1e-4
"""KKT residual at which a rehearsal has shown that the start lies in the basin."""

LONGEST_REHEARSAL = 200_000
"""Steps after which a rehearsal is given up."""

LARGEST_FACTOR = 1024.0
"""How far from the first run's penalty the freeze may go, either way."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """One way to freeze a network."""

    recipe: Recipe
    boost: float
    spectrum: Spectrum

    @property
    def ratio(self) -> float:
        """Of the spectrum at the settled point; infinite when it repels."""
        return self.spectrum.ratio

    def __str__(self) -> str:
        hats = (
            "no coordinators"
            if self.recipe.hats is None
            else (f"{self.recipe.hats.name.lower()} coordinators")
        )
        return f"{hats}, penalty x {self.boost:g}: ratio {self.ratio:.3g}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Design:
    """What was designed, and why.

    Attributes
    ----------
    network : Network
        The frozen network: constant rho, time constants, coordinators; it starts where the given
        one started.
    gains : Gains
    first : FirstRun
        How the settled point was found; the gains belong to its last state even if it did not
        settle.
    best : Candidate
        The wiring, the factors and the penalty that won, with the spectrum at the settled point.
    candidates : tuple of Candidate
        Everything that was compared.
    rho_star : float
        The penalty above which H + rho A'A is positive definite (network units).
    """

    network: Network
    gains: Gains
    first: FirstRun
    best: Candidate
    candidates: tuple[Candidate, ...]
    rho_star: float

    @property
    def state(self) -> np.ndarray:
        """The point (n,) that the first run settled to."""
        return self.first.state

    @property
    def settled(self) -> bool:
        """Whether the first run settled."""
        return self.first.settled

    @property
    def spectrum(self) -> Spectrum:
        """Of the frozen network at the settled point."""
        return self.best.spectrum

    def predicted_settling(self, tolerance: float = 1e-6) -> float:
        """ln(1/tolerance) / |abscissa|: network time that the slowest mode needs."""
        abscissa = self.spectrum.abscissa
        return float(np.log(1 / tolerance) / -abscissa) if abscissa < 0 else float("inf")

    def __str__(self) -> str:
        duals = {
            d.neuron: self.gains.rho[self.network.neuron_index[d.neuron]]
            for d in self.network.cell.duals
        }
        predicted = self.predicted_settling()
        return "\n".join(
            [
                f"first run      {'settled' if self.first.settled else 'did not settle'} in "
                f"{self.first.steps} recurrent steps",
                f"frozen with    {self.best}",
                f"rho            {min(duals.values()):.3g} .. {max(duals.values()):.3g} "
                f"(rho* = {self.rho_star:.3g})",
                f"spectrum       radius {self.spectrum.radius:.3g}, "
                f"abscissa {self.spectrum.abscissa:.3g}",
                f"predicted      settling to 1e-6 in {predicted:.3g} units of network time, "
                f"{predicted * self.spectrum.radius:.0f} fastest time constants",
            ]
        )


def design(
    source: Network | OptimalControlProblem,
    *,
    recipe: Recipe | None = None,
    refine: bool = False,
    limit: int = 60_000,
    progress: Callable[[str], None] | None = None,
) -> Design:
    """Choose rho, time constants and coordinators of a network.

    Parameters
    ----------
    source : Network or OptimalControlProblem
        A network with PI duals; a problem is synthesized first.
    recipe : Recipe, optional
        Fixes the closed form's factors and the coordinators; the best of `RECIPES` by default.
    refine : bool
        Nelder-Mead on the factors afterwards: seconds, and often half the settling time.
    limit : int
        Largest number of steps of the first run.
    progress : callable, optional
        Told one line at a time what is going on.

    Raises
    ------
    DesignError
        If the network has no PI duals, or its numbers overflow.
    """
    network = source if isinstance(source, Network) else _synthesized(source)
    if not network.cell.duals:
        raise DesignError(
            "design: this network has no PI dual neurons, so there is no rho to "
            "choose; set the time constants of its neurons by hand"
        )
    with np.errstate(all="ignore"):  # a run that overflows is data
        return _designed(network, recipe, refine, limit, progress)


def _designed(
    network: Network, recipe: Recipe | None, refine: bool, limit: int, progress
) -> Design:
    recipes = RECIPES if recipe is None else (recipe,)
    first = first_run(network, recipes[0], limit=limit, progress=progress)
    linear = Linearisation(network).at(first.state)
    candidates = _compare(network, linear, first, recipes, progress)
    best = _rehearsed(network, linear, candidates, progress)
    if refine and np.isfinite(best.ratio):
        best = _refined(network, linear, first.state, best, progress)
        candidates = (*candidates, best)
    gains = closed_form(linear, best.recipe, best.boost)
    if not (np.isfinite(gains.rate).all() and (gains.rate > 0).all()):
        raise DesignError(
            f"{network.title}: the gains overflow; choose units in which states and controls are "
            "near 1"
        )
    return Design(
        network=apply_gains(network, gains),
        gains=gains,
        first=first,
        best=best,
        candidates=candidates,
        rho_star=penalty_threshold(network, first.state) if first.settled else float("nan"),
    )


def _synthesized(problem: OptimalControlProblem) -> Network:
    from ann_dc.network.synthesis import synthesize  # symbols, which a network does without

    return synthesize(problem)


def hand_gains(
    network: Network,
    *,
    rho: float | Mapping[str, float] = 0.0,
    tau: float | Mapping[str, float] = 1.0,
) -> Gains:
    """Gains set by hand; without arguments the paper's plain network (rho = 0, tau = 1).

    Parameters
    ----------
    network : Network
    rho, tau : float or mapping
        One number for all, or numbers by neuron (``mu.phi``) or population (``mu``); what is not
        named keeps the default.
    """
    neurons = network.cell.neurons
    known = {name for neuron in neurons for name in (neuron.name, neuron.population)}

    def expand(given: float | Mapping[str, float], default: float) -> np.ndarray:
        if not isinstance(given, Mapping):
            return np.full(len(neurons), float(given))
        for name in given:
            if name not in known:
                raise UnknownNameError.of("neuron or population", name, sorted(known))
        return np.array(
            [given.get(n.name, given.get(n.population, default)) for n in neurons], float
        )

    time = expand(tau, 1.0)
    if not (np.isfinite(time).all() and (time > 0).all()):
        raise DesignError(f"tau: time constants must be positive, got {tau!r}")
    weight = expand(rho, 0.0)
    if not (np.isfinite(weight).all() and (weight >= 0).all()):
        raise DesignError(f"rho: penalties must be zero or positive, got {rho!r}")
    is_dual = np.isin([n.name for n in neurons], [d.neuron for d in network.cell.duals])
    return Gains(
        rho=np.where(is_dual, weight, 0.0),
        rate=np.repeat(1.0 / time[:, None], network.stages, axis=1),
    )


def _candidate(network, linear, state: np.ndarray, recipe: Recipe, boost: float) -> Candidate:
    tape = tape_with(network, closed_form(linear, recipe, boost))
    return Candidate(recipe=recipe, boost=boost, spectrum=spectrum(network, state, tape))


def _compare(
    network, linear, first: FirstRun, recipes: Iterable[Recipe], progress
) -> tuple[Candidate, ...]:
    """The ratio of every wiring at the first run's penalty, and downhill from there by octaves."""
    tried: dict[float, list[Candidate]] = {}

    def ratio(factor: float) -> float:
        if factor not in tried:
            tried[factor] = []
            for recipe in recipes:
                if progress:
                    progress(f"freeze: spectrum at {factor * first.boost:g} times the penalty")
                tried[factor].append(
                    _candidate(network, linear, first.state, recipe, factor * first.boost)
                )
        return min(c.ratio for c in tried[factor])

    factor, direction = 1.0, 2.0
    while not np.isfinite(ratio(factor)) and factor < LARGEST_FACTOR:
        factor *= 2
    if ratio(factor / 2) < ratio(factor):
        direction = 0.5
    while ratio(factor * direction) < ratio(factor) and factor * LARGEST_FACTOR > 1:
        factor *= direction
    return tuple(c for group in tried.values() for c in group)


def _rehearsed(network, linear, candidates: Iterable[Candidate], progress) -> Candidate:
    """The fastest candidate whose constant gains settle from the start; if none, the fastest."""
    ranked = sorted(candidates, key=lambda c: c.ratio)
    for number, candidate in enumerate(ranked):
        if progress:
            progress(f"freeze: rehearsal {number + 1}")
        if np.isfinite(candidate.ratio) and _settles(network, linear, candidate):
            return candidate
    return ranked[0]


def _settles(network: Network, linear: Linearisation, candidate: Candidate) -> bool:
    """Whether forward Euler with constant gains settles from the start in thrice the time due."""
    gains = closed_form(linear, candidate.recipe, candidate.boost)
    kernel = Kernel(network, tape_with(network, gains))
    step = REHEARSAL_STEP * candidate.spectrum.largest_step
    due = np.log(1 / REHEARSAL_TOLERANCE) / -candidate.spectrum.abscissa
    free = np.full(network.size, np.inf)
    _, _, outcome = kernel.recur(
        network.start_state.copy(),
        step,
        free,
        np.column_stack([-free, free]),
        int(min(3 * due / step, LONGEST_REHEARSAL)) if step > 0 else 0,
        REHEARSAL_TOLERANCE,
        kernel.domain_guard(network.start_state),
    )
    return outcome == SETTLED


def _refined(network, linear, state, best: Candidate, progress, evaluations: int = 250):
    """Nelder-Mead on the logarithms of the recipe's factors, objective log ratio."""
    fields = ["penalty", "dual", "dual_coupling", "state", "control", "target"]
    fields += [] if best.recipe.hats is None else ["coarse"]
    components = [q.partition(".")[2] for q, _ in network.cell.chains]

    def recipe_at(z: np.ndarray) -> Recipe:
        factors = np.exp(z)
        rows = dict(zip(components, factors[len(fields) :]))
        row = {
            d.neuron: float(rows[network.neuron(d.neuron).component]) for d in network.cell.duals
        }
        changed = {f: getattr(best.recipe, f) * float(v) for f, v in zip(fields, factors)}
        return replace(best.recipe, row=row, **changed)

    count = 0

    def candidate_at(z: np.ndarray) -> Candidate:
        return _candidate(network, linear, state, recipe_at(z), best.boost)

    def log_ratio(z: np.ndarray) -> float:
        nonlocal count
        count += 1
        if progress:
            progress(f"refine: evaluation {count} of {evaluations}")
        return float(np.log(min(candidate_at(z).ratio, 1e30)))

    size = len(fields) + len(components)
    simplex = np.vstack([np.zeros(size), 0.25 * np.eye(size)])
    found = minimize(
        log_ratio,
        simplex[0],
        method="Nelder-Mead",
        options={"maxfev": evaluations, "initial_simplex": simplex, "adaptive": True},
    )
    refined = candidate_at(found.x)
    improves = refined.ratio < best.ratio and _settles(network, linear, refined)
    return refined if improves else best
