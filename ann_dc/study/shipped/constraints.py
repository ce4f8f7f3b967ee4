"""What constraints cost in settling time: limits of a frozen network, tightened step by step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.study.study import Study
from ann_dc.validation.checked import checked
from ann_dc.validation.values import Count, Index

METRICS = (
    "settling_time",
    "settling_in_fastest",
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
    """How does settling depend on the number of constraints that are active?

    Gains are those of the limits that the problem is declared with; limits are inputs, so that the
    network stays the same.

    Parameters
    ----------
    subject : str, OptimalControlProblem or Network
    limits : mapping of input to sequence of float
        Inputs that constraints are written with, and what they are set to: every combination.
    ranges : mapping of input to (low, high), optional
        Further inputs, such as targets, that are drawn.
    samples : int
        Draws at every combination of limits; the same ones at each.
    seed : int

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
        over={**{f"input.{name}": [*values] for name, values in limits.items()}, **drawn},
        metrics=METRICS,
        samples=samples,
        seed=seed,
        title="settling against active constraints",
    )
