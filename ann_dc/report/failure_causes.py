"""Outcomes of cases by cause, and outliers: slowest and worst cases."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from ann_dc.report.fractions import Limit
from ann_dc.report.statistics import Findings
from ann_dc.report.study_columns import Column
from ann_dc.study.records import MESSAGE, OUTCOME

MOST = 14
"""Largest number of distinguished causes."""
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


class Cause(NamedTuple):
    """Cases with the same cause.

    Attributes
    ----------
    points : int
        Number of cases.
    row : int
        Record of an example.
    message : str
        Message of the example.
    """

    outcome: str
    points: int
    row: int
    message: str


def causes(findings: Findings) -> list[Cause]:
    """Return the outcomes by cause, most frequent first.

    Messages that differ only in numbers have one cause. Causes beyond the first ones are merged
    into one with their count.
    """
    count = len(findings)
    outcomes, messages = (
        findings.frame[name].astype(object).fillna("").astype(str).to_numpy(dtype=object)
        if name in findings.frame.columns
        else np.full(count, "", object)
        for name in (OUTCOME, MESSAGE)
    )
    rows: dict[tuple[str, str], list[int]] = {}
    for row, (outcome, message) in enumerate(zip(outcomes, messages)):
        rows.setdefault((outcome, _NUMBER.sub("#", message)), []).append(row)
    ordered = sorted(rows.items(), key=lambda item: -len(item[1]))
    found = [
        Cause(outcome, len(where), where[0], messages[where[0]])
        for (outcome, _), where in ordered[:MOST]
    ]
    rest = [where for _, where in ordered[MOST:]]
    if rest:
        outcome = f"{len(rest)} further causes"
        example = rest[0][0]
        found.append(Cause(outcome, sum(map(len, rest)), example, messages[example]))
    return found


def slowest(findings: Findings, most: int) -> np.ndarray:
    """Return the records of the slowest cases, slowest first."""
    column = findings.seconds
    return np.zeros(0, int) if column is None else _largest(column.numbers, most)


def worst(about: Limit | Column, most: int) -> np.ndarray:
    """Return the records farthest outside a limit or with the largest values.

    The worst record is first.
    """
    return _largest(about.beyond if isinstance(about, Limit) else about.numbers, most)


def _largest(values: np.ndarray | None, most: int) -> np.ndarray:
    if values is None:
        return np.zeros(0, int)
    known = np.flatnonzero(~np.isnan(values))  # what is infinite is worst
    return known[np.argsort(-values[known], kind="stable")[:most]]
