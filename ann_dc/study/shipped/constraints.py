"""Settling time under constraints that are tightened step by step, at fixed gains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.study.study import Study
from ann_dc.validation import Count, Index, checked

METRICS = (
    "settling_time",
    "normalised_settling_time",
    "active_rows",
    "predicted_decay_rate",
    "certified",
    "objective",
)


@checked
def tightened(
    subject: str | OptimalControlProblem | Network,
    limits: Mapping[str, Sequence[float]],
    *,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    samples: Count = 1,
    seed: Index = 0,
) -> Study:
    """Declare a study of settling against the number of active constraints.

    The gains are those of the declared limits. The limits are inputs, so the network does not
    change.

    Parameters
    ----------
    subject : str, OptimalControlProblem or Network
        Plant name, problem or network.
    limits : mapping of input to sequence of float
        Values of the inputs that occur in constraints. Every combination is run.
    ranges : mapping of input to (low, high), optional
        Further inputs, such as targets, that are sampled.
    samples : int
        Samples at every combination of limits, equal for all. Default 1.
    seed : int
        Seed of the samples. Default 0.

    Returns
    -------
    Study

    Examples
    --------
    >>> import sympy as sp
    >>> from dataclasses import replace
    >>> import ann_dc
    >>> most, problem = sp.symbols("most"), ann_dc.plants.double_integrator(N=10)
    >>> push = {"push": problem.controls[0] <= most}
    >>> limited = replace(problem, inputs={most: 100.0}, constraints=push)
    >>> study = tightened(limited, {"most": [100.0, 3.0, 2.6]})
    >>> study.run(workers=0)["active_rows"].tolist()
    [0, 5, 7]
    """
    drawn = {f"input.{name}": (*ends,) for name, ends in (ranges or {}).items()}
    return Study(
        subject=subject,
        vary={**{f"input.{name}": [*values] for name, values in limits.items()}, **drawn},
        metrics=METRICS,
        samples=samples,
        seed=seed,
        title="settling against active constraints",
    )
