"""Specification of a study applied to its records, limit by limit and as a whole."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.report.statistics import Findings
from ann_dc.report.study_columns import Column
from ann_dc.study.records import OUTCOME
from ann_dc.study.yield_metrics import SETTLED, draws_of
from ann_dc.yields import Yield, ends_of


class Limit(NamedTuple):
    """One limit of a specification.

    Attributes
    ----------
    column : Column
        Limited metric.
    low, high : float
        Limits; infinite if open.
    """

    column: Column
    low: float
    high: float

    @property
    def ends(self) -> tuple[float, ...]:
        """Finite limits."""
        return tuple(end for end in (self.low, self.high) if np.isfinite(end))

    @property
    def met(self) -> np.ndarray:
        """Mask (rows,) of records within the limits; nan is outside."""
        numbers = self.column.as_numbers
        return (numbers >= self.low) & (numbers <= self.high)

    @property
    def beyond(self) -> np.ndarray:
        """Excess (rows,) over the limit in the metric's unit.

        Negative inside; nan without a number.
        """
        numbers = self.column.as_numbers
        return np.maximum(self.low - numbers, numbers - self.high)

    def __str__(self) -> str:
        unit = f" {self.column.unit}" if self.column.unit else ""
        if not np.isfinite(self.low):
            return f"{self.column.name} \N{LESS-THAN OR EQUAL TO} {self.high:.6g}{unit}"
        if not np.isfinite(self.high):
            return f"{self.column.name} \N{GREATER-THAN OR EQUAL TO} {self.low:.6g}{unit}"
        return f"{self.column.name} in {self.low:.6g} to {self.high:.6g}{unit}"


def limits(findings: Findings) -> tuple[Limit, ...]:
    """Return the limits of the specification whose metrics were measured."""
    spec = findings.identity.get("spec") or {}
    columns = findings.columns
    return tuple(
        Limit(columns[name], *ends_of(limit)) for name, limit in spec.items() if name in columns
    )


def settled(findings: Findings) -> np.ndarray:
    """Return the mask (rows,) of settled cases."""
    outcome = findings.columns.get(OUTCOME)
    if outcome is None or outcome.codes is None:
        return np.zeros(len(findings), bool)
    return np.array([word == SETTLED for word in outcome.words], bool)[outcome.codes]


def within(findings: Findings) -> np.ndarray:
    """Return the mask (rows,) of settled cases that satisfy every limit."""
    return np.logical_and.reduce([settled(findings), *(limit.met for limit in limits(findings))])


def yield_of(findings: Findings, good: np.ndarray, among: np.ndarray | None = None) -> Yield:
    """Return the yield of good records with its confidence interval.

    By default all records count; `among` selects others by index.
    """
    frame = findings.frame if among is None else findings.frame.iloc[among]
    good = good if among is None else good[among]
    draws = draws_of({name: frame[name].to_numpy() for name in frame.columns})
    return Yield(passed=int(good.sum()), count=len(good), draws=draws)
