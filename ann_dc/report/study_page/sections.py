"""Rows of the tables on a page, and the text of values.

A row has one value per column. The page template right-aligns numbers and escapes texts.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, TypeAlias

import numpy as np

from ann_dc.report.statistics import PREDICTED, Findings
from ann_dc.report.study_columns import Column
from ann_dc.report.study_page.figure import percent
from ann_dc.study.records import OUTCOME, VERSIONS

SHOWN = 6
"""Number of settings in a list of cases."""
PRINTED = 25
"""Number of printed records of the table."""
PRINTED_COLUMNS = 8
TOGETHER = "all listed settings together"
"""Label of a yield of records with different values of listed settings."""
LISTED = 12
"""Largest number of items shown of a list."""

Row: TypeAlias = tuple[object, ...]
"""Values of one row of a table."""


def number(value: float) -> str:
    """Return a number with sensible digits; empty for nan.

    Examples
    --------
    >>> number(0.00123456), number(1234567.0), number(10_000), number(float("nan"))
    ('0.001235', '1.235e+06', '10,000', '')
    """
    if value != value:
        return ""
    if isinstance(value, int):
        return f"{value:,}"
    return f"{value:.0f}" if abs(value) < 1e5 and value == int(value) else f"{value:.4g}"


def plain(value: Any) -> str:
    """Return plain data as text; a long list is visibly truncated.

    Examples
    --------
    >>> plain([True, None, 0.5]), plain([0] * 13)[-14:]
    ('true, none, 0.5', '... and 1 more')
    """
    if isinstance(value, (list, tuple)):
        rest = len(value) - LISTED
        items = [*map(_short, value[:LISTED]), *([f"... and {rest} more"] if rest > 0 else [])]
        return ", ".join(items)
    return _short(value)


def _short(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.10g}"
    return "none" if value is None else str(value)


def value_range(column: Column) -> Row:
    """Return the number of distinct values of a varied column, the first and the last one."""
    kind = str if column.numbers is None else float
    return len(column.distinct), *map(kind, column.distinct[[0, -1]])


def measured(metric: Column) -> Row:
    """Return the number of values, and the lowest, the median and the highest one.

    The median occurs; two clusters have no value between them.
    """
    if metric.codes is not None:
        counts = np.bincount(metric.codes, minlength=len(metric.words))
        some = [*zip(metric.words, counts / max(1, counts.sum()))][:4]
        shares = ", ".join(f"{word or 'none'} {percent(share)}" for word, share in some)
        return int(counts.sum()), "", shares, ""
    if not len(metric.values):
        return 0, "", "", ""
    ends = np.quantile(metric.values, (0, 0.5, 1), method="inverted_cdf")
    return len(metric.values), *map(float, ends)


def medians(found: Findings) -> Iterator[str]:
    """Yield the medians of the first metrics."""
    for metric in found.metrics[:3]:
        if len(metric.values) and not metric.name.startswith(PREDICTED):
            median = float(np.quantile(metric.values, 0.5, method="inverted_cdf"))
            yield f"median {metric.name} {number(median)} {metric.unit}".rstrip()


def yields(found: Findings) -> Iterator[Row]:
    """Yield the yields with their intervals: of every listed value, then of all records."""
    values = found.yields_by_value
    pooled = f", {TOGETHER}" if values else ""
    for name, one in [*values, *((name + pooled, one) for name, one in found.yields)]:
        interval = " to ".join(percent(end, 2) for end in one.interval)
        ends = "none: no random settings" if one.draws == 0 else interval
        yield name, one.passed, one.count, percent(one.share, 2), ends


def predictions(found: Findings) -> Iterator[Row]:
    """Yield the errors of predictions."""
    for pair in found.predictions:
        off = pair.errors
        if len(off):
            ends = np.quantile(off, (0.5, 0.95, 1.0))
            yield pair.measured.name, len(off), *(percent(end, 2) for end in ends)


def exponents(found: Findings) -> Iterator[Row]:
    """Yield the fitted power laws."""
    for metric, setting, law in found.exponents:
        interval = f"{law.low:.3f} to {law.high:.3f}"
        name = f"{metric.name} ~ {setting.name}^p"
        yield name, f"{law.value:.3f}", interval, f"{law.r_squared:.3f}", law.points


def points(found: Findings) -> Iterator[tuple[str, Row, list[Row]]]:
    """Yield title, head and rows of the slowest and worst cases, with the command of each."""
    for title, column, rows in found.outliers:
        columns = [column, *[one for one in found.varied if one is not column][:SHOWN]]
        head = ("point", *(one.label for one in columns), "repeated by")
        yield title, head, [(*_record(found, row, columns), found.repeating(row)) for row in rows]


def _record(found: Findings, row: int, columns: Iterable[Column]) -> Row:
    return str(found.points[row]), *(column.cell(row) for column in columns)


def printed(found: Findings) -> tuple[Row, list[Row]]:
    """Return head and rows of the first records with the important columns, for printing."""
    outcome = [found.columns[OUTCOME]] if OUTCOME in found.columns else []
    room = PRINTED_COLUMNS - len(outcome)
    metrics = found.metrics[: room // 2]
    columns = [*found.varied[: room - len(metrics)], *metrics, *outcome]
    count = min(PRINTED, len(found))
    head = ("point", *(column.label for column in columns))
    return head, [_record(found, row, columns) for row in range(count)]


def versions(found: Findings) -> Iterator[Row]:
    """Yield the software versions of the cases."""
    column = found.columns.get(VERSIONS)
    if column is not None and column.codes is not None:
        counts = np.bincount(column.codes, minlength=len(column.words))
        yield from ((int(count), _versions(word)) for word, count in zip(column.words, counts))


def _versions(text: str) -> str:
    try:
        reported = json.loads(text)
    except ValueError:
        return text
    if not isinstance(reported, Mapping):
        return text
    return ", ".join(f"{name} {version}" for name, version in reported.items())
