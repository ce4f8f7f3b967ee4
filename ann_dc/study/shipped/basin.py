"""Basins of attraction of a network with fixed gains: optima by initial state."""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence

import numpy as np

from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.study.records import Value
from ann_dc.study.study import Study
from ann_dc.study.table import Table
from ann_dc.study.yield_metrics import SETTLED
from ann_dc.validation import Count, Index, checked

SPREADS = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
"""Spreads of random initial guesses around the interpolated one; a neuron is near one."""
ALIKE = 1e-3
"""Relative cost difference below which two optima count as equal."""


class End(enum.Enum):
    """Classification of the end of a run; the value is its description."""

    BEST = "best optimum met"
    OTHER = "another optimum"
    NO_OPTIMUM = "settled at no optimum"
    NOWHERE = "did not settle"


@checked
def basin(
    subject: str | OptimalControlProblem | Network,
    *,
    spreads: Sequence[float] = SPREADS,
    inputs: Mapping[str, Sequence[float]] | None = None,
    fixed: Mapping[str, Value] | None = None,
    samples: Count = 50,
    seed: Index = 0,
) -> Study:
    """Declare a study of the initial guesses and inputs that settle to an optimum.

    The network has fixed gains.

    Parameters
    ----------
    subject : str, OptimalControlProblem or Network
        Plant name, problem or network.
    spreads : sequence of float
        Standard deviations of the disturbance of each neuron's initial value, in network units.
        Default: 0.01 to 3.
    inputs : mapping of input to sequence of float, optional
        Input values, such as ``{"q_d.x": (3.0, 5.0, 7.0)}``. Every combination of initial guesses
        and targets is run.
    fixed : mapping of setting to Value, optional
        Further settings, equal in all cases.
    samples : int
        Random initial guesses at every combination. Default 50.
    seed : int
        Seed of the samples. Default 0.

    Returns
    -------
    Study
        `ends` classifies each run of its table.

    Examples
    --------
    >>> study = basin("double_integrator", spreads=[0.1, 10.0], samples=5)
    >>> {end.value for end in ends(study.run(workers=0))}
    {'best optimum met'}
    """
    maps = {f"input.{name}": [*values] for name, values in (inputs or {}).items()}
    return Study(
        subject=subject,
        vary={**maps, "start.spread": [*spreads]},
        fixed=fixed or {},
        metrics=["settling_time", "certified", "objective"],
        samples=samples,
        seed=seed,
        title="basin of attraction",
    )


@checked
def ends(table: Table) -> list[End]:
    """Classify the end of every run of a basin study.

    The best optimum is the certified one of least cost that any run with the same inputs reached.

    Parameters
    ----------
    table : Table
        Result of a study from `basin`.

    Returns
    -------
    list of End
        One per run, in the order of the table.

    Examples
    --------
    >>> import numpy as np
    >>> from ann_dc.study import Table
    >>> from ann_dc.study.shipped import ends
    >>> outcomes = np.array(["settled", "settled", "diverged"], object)
    >>> columns = {"outcome": outcomes, "certified": np.array([1.0, 1.0, 0.0])}
    >>> costs = {"objective": np.array([2.0, 3.0, np.nan])}
    >>> len(set(ends(Table(columns=columns | costs, spec={}))))
    3
    """
    names = [name for name in table.columns if name.startswith("input.")]
    given = [*zip(*(table[name] for name in names))] or [()] * len(table)
    optimal, costs = table["certified"] == 1, table["objective"]
    best: dict[tuple, float] = {}
    for where, cost in zip(given, np.where(optimal, costs, np.inf)):
        best[where] = min(cost, best.get(where, np.inf))
    settled = table["outcome"] == SETTLED
    runs = zip(given, settled.tolist(), optimal.tolist(), costs.tolist())
    return [_end(rests, is_optimal, cost, best[w]) for w, rests, is_optimal, cost in runs]


def _end(rests: bool, is_optimal: bool, cost: float, best: float) -> End:
    if not rests:
        return End.NOWHERE
    if not is_optimal:
        return End.NO_OPTIMUM
    return End.BEST if cost <= best + ALIKE * max(abs(best), 1e-9) else End.OTHER
