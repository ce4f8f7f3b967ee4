"""Design: from a wired network to a frozen one, whose constants are R*C values.

1. First run with scheduled gains, to a settled point (`scheduled_run`).
2. Freeze (`freeze`): the closed form once more at that point, for each way of wiring the
   coordinators (none among them) and a few penalties. The smallest ratio of the spectrum wins,
   provided that a rehearsal with constant gains settles from the start.
3. Optional refinement (`refinement`) of the closed form's factors by Nelder-Mead on the log ratio.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.analysis.second_order import penalty_threshold
from ann_dc.analysis.spectra import Spectrum
from ann_dc.errors import DesignError
from ann_dc.gain_design.freeze import RECIPES, Candidate, compare, rehearsed
from ann_dc.gain_design.gains import Gains, apply_gains
from ann_dc.gain_design.recipe import Recipe
from ann_dc.gain_design.refinement import refined
from ann_dc.gain_design.scheduled_run import LONGEST_RUN, FirstRun, first_run
from ann_dc.network.network import Network
from ann_dc.progress import Progress, silent


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

    Examples
    --------
    >>> from ann_dc import design, plants
    >>> designed = design(plants.double_integrator(N=5))
    >>> designed.settled, designed.spectrum.abscissa < 0
    (True, True)
    >>> designed.predicted_settling(1e-3) < designed.predicted_settling(1e-6)
    True
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
        """Network time that the slowest mode needs: ln(1/tolerance) / |abscissa|.

        Parameters
        ----------
        tolerance : float
            What a deviation falls to, relative to its start.

        Returns
        -------
        float
            In units of network time; infinite where the point repels.
        """
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
    network: Network,
    *,
    recipe: Recipe | None = None,
    refine: bool = False,
    limit: int = LONGEST_RUN,
    progress: Progress = silent,
) -> Design:
    """Choose rho, time constants and coordinators of a network.

    Parameters
    ----------
    network : Network
        With PI duals.
    recipe : Recipe, optional
        Fixes the closed form's factors and the coordinators; the best of `RECIPES` by default.
    refine : bool
        Nelder-Mead on the factors afterwards: seconds, and often half the settling time.
    limit : int
        Largest number of steps of the first run.
    progress : Progress
        Takes one line at a time on what is going on.

    Returns
    -------
    Design
        Whatever the outcome: a first run that does not settle says so in ``settled``.

    Raises
    ------
    DesignError
        If the network has no PI duals, or its numbers overflow.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=5))
    >>> design(network).settled
    True
    """
    if not network.cell.duals:
        raise DesignError(
            "design: this network has no PI dual neurons, so there is no rho to "
            "choose; set the time constants of its neurons by hand"
        )
    recipes = RECIPES if recipe is None else (recipe,)
    with np.errstate(all="ignore"):  # a run that overflows is data
        first = first_run(network, recipes[0], limit=limit, progress=progress)
        linear = Linearisation(network).at(first.state)
        candidates = compare(linear, first, recipes, progress)
        best = rehearsed(linear, candidates, progress)
        if refine and np.isfinite(best.ratio):
            best = refined(linear, first.state, best, progress)
            candidates = (*candidates, best)
        return _frozen(linear, first, best, candidates)


def _frozen(
    linear: Linearisation, first: FirstRun, best: Candidate, candidates: tuple[Candidate, ...]
) -> Design:
    """The network with the gains of the best candidate as its constants."""
    network, gains = linear.network, best.gains
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
