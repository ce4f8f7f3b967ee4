"""How many steps a recurrence takes, by the order of its updates and the length of its steps.

The question: all neurons at once, duals after primals or stage by stage, with steps that adapt or
with fixed ones: which settles in fewest steps, and up to which step does it settle at all?
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ann_dc.analysis.spectra import spectrum
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.study.realisation import Realisation
from ann_dc.study.settings import ORDERS, subject_of
from ann_dc.study.study import Study

SHARES = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 1.0, 1.05, 1.1, 1.2, 1.35, 1.5)
"""Fixed steps over the largest stable one."""
MEASURED = ("settling_steps", "settling_time")


class Steps(NamedTuple):
    """Studies of the same samples with both kinds of steps.

    Attributes
    ----------
    limit : float
        Largest stable step of the designed network, all neurons at once, by the spectrum at its
        settled point: min 2a / (a^2 + b^2). Network time.
    adaptive, fixed : Study
    """

    limit: float
    adaptive: Study
    fixed: Study


def settling_against_steps(
    subject: str | OptimalControlProblem,
    *,
    over: Mapping[str, Any],
    kind: str = "pyramid",
    samples: int = 100,
    shares: Sequence[float] = SHARES,
    limit: int = 3000,
) -> Steps:
    """Studies of update orders and steps, over the same random starts and targets.

    Parameters
    ----------
    subject : str or OptimalControlProblem
    over : mapping of str to pair
        Ranges of what differs from sample to sample, as in ``{"input.q_d.x": (4, 6)}``.
    kind : str
        Metric of the design, a word of 'design.kind'.
    samples : int
    shares : sequence of float
        Fixed steps over the largest stable one of the designed network.
    limit : int
        Largest number of steps.

    Returns
    -------
    Steps
        Measured: steps and network time to settle; with adaptive steps, also the largest stable one
        where the sample ended.

    Raises
    ------
    StudyError
        If the design settles nowhere.

    Examples
    --------
    >>> studies = settling_against_steps("car", over={"input.q_d.x": (4, 6)}, samples=10)
    >>> len(studies.adaptive), len(studies.fixed) // len(SHARES)
    (30, 30)
    """
    designed = Realisation(subject_of(subject)).designed({"design.kind": kind})
    longest = spectrum(designed.network, designed.settled).largest_step

    def study(steps: Sequence[float | str], words: str, *further: str) -> Study:
        return Study(
            subject=subject,
            over={"run.order": list(ORDERS), "run.step": list(steps), **over},
            fixed={"design.kind": kind, "run.backend": "recurrent", "run.limit": limit},
            samples=samples,
            metrics=(*MEASURED, *further),
            title=f"Update orders with {words} steps",
        )

    fixed = [share * longest for share in shares]
    adaptive = study(["adaptive"], "adaptive", "largest_step")
    return Steps(longest, adaptive, study(fixed, "fixed"))
