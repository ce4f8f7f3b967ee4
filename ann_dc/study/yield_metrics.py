"""Yield of a study: settled rows within a spec, and the draws that they come from."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ann_dc.study.records import OUTCOME, SEED
from ann_dc.study.settings import family_of, is_drawn
from ann_dc.yields import Limit, Yield, within

SETTLED = "settled"


def good_rows(columns: Mapping[str, np.ndarray], spec: Mapping[str, Limit]) -> np.ndarray:
    """Tell which rows settled and keep every limit of a spec.

    Parameters
    ----------
    columns : mapping of str to (rows,) array
        The outcome, and the metrics of the spec.
    spec : mapping of metric to Limit

    Returns
    -------
    (rows,) array of bool

    Examples
    --------
    >>> columns = {"outcome": np.array(["settled", "diverged"]), "control_error": np.zeros(2)}
    >>> good_rows(columns, {"control_error": 0.02}).tolist()
    [True, False]
    """
    return (columns[OUTCOME] == SETTLED) & (within(columns, spec) if spec else True)


def yield_of(columns: Mapping[str, np.ndarray], spec: Mapping[str, Limit]) -> Yield:
    """The share of rows within a spec.

    Every row counts: one that failed is a chip that does not work.

    Parameters
    ----------
    columns : mapping of str to (rows,) array
    spec : mapping of metric to Limit

    Returns
    -------
    Yield
    """
    passed = good_rows(columns, spec)
    return Yield(passed=int(passed.sum()), count=len(passed), draws=draws_of(columns))


def draws_of(columns: Mapping[str, np.ndarray]) -> int | None:
    """Return the number of independent draws that rows come from; None without seeds.

    All settings share the seeds of their samples, so rows of one seed are one draw. Rows of several
    seeds that are equal in all settings, and in which nothing is drawn, are no draw.

    Parameters
    ----------
    columns : mapping of str to (rows,) array
        Seeds and settings; others are not read.

    Examples
    --------
    >>> columns = {"seed": np.array([5, 6, 5, 6]), "defect.mismatch": np.array([0, 0, 0.1, 0.1])}
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
