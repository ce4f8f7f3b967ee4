"""Yield of a study: settled records within a specification, and independent draws."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ann_dc.study.records import OUTCOME, SEED
from ann_dc.study.settings import family_of, is_drawn
from ann_dc.yields import Limit, Yield, within

SETTLED = "settled"


def good_rows(columns: Mapping[str, np.ndarray], spec: Mapping[str, Limit]) -> np.ndarray:
    """Return a (rows,) mask of records that settled and satisfy every limit.

    The columns contain the outcome and the metrics of the specification.

    >>> columns = {"outcome": np.array(["settled", "diverged"]), "control_error": np.zeros(2)}
    >>> good_rows(columns, {"control_error": 0.02}).tolist()
    [True, False]
    """
    return (columns[OUTCOME] == SETTLED) & (within(columns, spec) if spec else True)


def yield_of(columns: Mapping[str, np.ndarray], spec: Mapping[str, Limit]) -> Yield:
    """Return the fraction of records within the specification.

    Every record counts; a failed case counts as a defective chip.
    """
    passed = good_rows(columns, spec)
    return Yield(passed=int(passed.sum()), count=len(passed), draws=draws_of(columns))


def draws_of(columns: Mapping[str, np.ndarray]) -> int | None:
    """Return the number of independent draws in the records; None without seeds.

    All settings use the same sample seeds, so records of one seed are one draw. Records of several
    seeds with equal settings and nothing random are not draws. Only seeds and settings are read.

    >>> columns = {"seed": np.array([5, 6, 5, 6]), "nonideal.mismatch": np.array([0, 0, 0.1, 0.1])}
    >>> draws_of(columns), draws_of({name: column[:2] for name, column in columns.items()})
    (2, 0)
    """
    if SEED not in columns:
        return None
    names = [name for name in columns if family_of(name) is not None]
    rows = [*zip(*(columns[name].tolist() for name in names))] if names else []
    drawn = {setting: is_drawn(dict(zip(names, setting))) for setting in {*rows}}
    seeds = columns[SEED].tolist()
    still = [seed for seed, setting in zip(seeds, rows) if not drawn[setting]] if rows else seeds
    places = len({*still}) > 1 and len(drawn) - sum(drawn.values()) == len(still)
    found = {seed for seed, setting in zip(seeds, rows) if drawn[setting]}
    return len(found | {*still} if places else found)
