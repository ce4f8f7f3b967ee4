"""Number of steps of a recurrence against update order and step length.

The orders are all neurons at once (Jacobi), primal-then-dual, and stage by stage (Gauss-Seidel).
Steps are adaptive or fixed. The study determines the fewest steps and the largest step that
settles.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.step_rules import ORDERS
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.study.realisation import Realisation
from ann_dc.study.settings import subject_of
from ann_dc.study.study import Study

SHARES = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 1.0, 1.05, 1.1, 1.2, 1.35, 1.5)
"""Fixed steps relative to the largest stable step."""
MEASURED = ("settling_steps", "settling_time")


class Steps(NamedTuple):
    """Studies of the same samples with adaptive and with fixed steps.

    Attributes
    ----------
    limit : float
        Largest stable Jacobi step of the designed network, min 2a / (a^2 + b^2) over the
        eigenvalues -a +- ib at its equilibrium. Network time.
    """

    limit: float
    adaptive: Study
    fixed: Study


def settling_against_steps(
    subject: str | OptimalControlProblem,
    *,
    vary: Mapping[str, Any],
    kind: str = "multilevel",
    samples: int = 100,
    shares: Sequence[float] = SHARES,
    limit: int = 3000,
) -> Steps:
    """Declare studies of update orders and steps over the same initial guesses.

    Parameters
    ----------
    subject : str or OptimalControlProblem
        Plant name or problem.
    vary : mapping of str to pair
        Ranges of sampled settings, such as ``{"input.q_d.x": (4, 6)}``. Random initial guesses and
        targets are equal in all studies.
    kind : str
        Preconditioner kind, a value of 'design.kind'. Default "multilevel" (additive multilevel).
    samples : int
        Number of samples. Default 100.
    shares : sequence of float
        Fixed steps relative to the largest stable step of the designed network. Default: `SHARES`.
    limit : int
        Largest number of steps. Default 3000.

    Returns
    -------
    Steps
        Metrics: steps and network time to settle. With adaptive steps also the largest stable step
        at the final state.

    Raises
    ------
    StudyError
        If the design does not settle.

    Examples
    --------
    >>> studies = settling_against_steps("car", vary={"input.q_d.x": (4, 6)}, samples=10)
    >>> len(studies.adaptive), len(studies.fixed) // len(SHARES)
    (30, 30)
    """
    designed = Realisation(subject_of(subject)).designed({"design.kind": kind})
    longest = spectrum(designed.network, designed.settled).largest_step

    def study(steps: Sequence[float | str], words: str, *further: str) -> Study:
        return Study(
            subject=subject,
            vary={"run.order": list(ORDERS), "run.step": list(steps), **vary},
            fixed={"design.kind": kind, "run.backend": "recurrent", "run.limit": limit},
            samples=samples,
            metrics=(*MEASURED, *further),
            title=f"Update orders with {words} steps",
        )

    fixed = [share * longest for share in shares]
    adaptive = study(["adaptive"], "adaptive", "largest_step")
    return Steps(longest, adaptive, study(fixed, "fixed"))
