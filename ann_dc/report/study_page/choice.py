"""Selection of the figures of a page: the most informative ones, about twelve.

The informativeness of a metric over a setting is the fraction of its spread explained by the
setting. Metrics of the specification come first and computing times last. The titles of omitted
figures are listed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import combinations
from typing import NamedTuple

from ann_dc.report.statistics import PREDICTED, Findings
from ann_dc.report.study_columns import Column, strength
from ann_dc.report.study_page.figure import Figure
from ann_dc.report.study_page.over_time import over_time
from ann_dc.report.study_page.plots import (
    beside,
    distribution,
    over_numbers,
    over_two,
    over_words,
    yield_over,
)

MOST = 12
"""Number of figures of a page."""
ROOM = {"yield": 1, "vary": 5, "map": 1, "beside": 1, "time": 2, "spread": 2}
"""Number of figures of each kind, in page order. Unused places pass to other kinds."""
WORDS = 30
"""Largest number of different text values on an axis."""
MAPPED = 4
"""Number of settings whose pairs are considered for each metric."""


class Candidate(NamedTuple):
    """Candidate for a figure of a `kind` of `ROOM`; `draw` returns None for too few cases."""

    kind: str
    title: str
    worth: float
    draw: Callable[[], Figure | None]


def chosen(found: Findings) -> tuple[list[Figure], list[str]]:
    """Return the figures of a page, and the titles of the omitted ones."""
    kept: list[tuple[str, Figure]] = []
    waiting: list[Candidate] = []
    left_out: list[str] = []
    for candidate in sorted(_candidates(found), key=lambda candidate: -candidate.worth):
        if sum(kind == candidate.kind for kind, _ in kept) >= ROOM[candidate.kind]:
            waiting.append(candidate)
        elif figure := candidate.draw():
            kept.append((candidate.kind, figure))
    for candidate in waiting:
        if len(kept) >= MOST:
            left_out.append(candidate.title)
        elif figure := candidate.draw():
            kept.append((candidate.kind, figure))
    kept.sort(key=lambda pair: [*ROOM].index(pair[0]))
    return [figure for _, figure in kept], left_out


def _candidates(found: Findings) -> Iterator[Candidate]:
    metrics = [metric for metric in found.metrics if _spreads(metric)]
    for place, metric in enumerate(metrics):
        worth = (found.limit_of(metric) is not None) + 1 / (2 + place)
        draw = partial(distribution, found, metric)
        yield Candidate("spread", f"distribution of {metric.name}", worth, draw)
    for pair in found.predictions:
        title = f"{pair.predicted.name} against {pair.measured.name}"
        yield Candidate("beside", title, 3.0, partial(beside, found, pair))
    for number, figure in enumerate(over_time(found)):
        yield Candidate("time", figure.title, 1 / (1 + number), lambda figure=figure: figure)
    seconds = [] if found.seconds is None or not _spreads(found.seconds) else [found.seconds]
    yield from _yields(found)
    yield from _dependences(found, [*metrics, *seconds])


def _spreads(metric: Column) -> bool:
    return metric.numbers is not None and len(metric.distinct) > 1


def _dependences(found: Findings, metrics: list[Column]) -> Iterator[Candidate]:
    """Yield candidates for every metric over every setting.

    Yields and maps are drawn over the most informative settings.
    """
    settings = [s for s in found.varied if s.numbers is not None or len(s.words) <= WORDS]
    for place, metric in enumerate(metrics):
        matters = 1.0 if found.limit_of(metric) is not None else 0.8 / (1 + place / 4)
        matters *= 0.4 if metric is found.seconds else 1.0
        matters *= 0.1 if metric.name.startswith(PREDICTED) else 1.0
        tells = {setting: strength(setting, metric) for setting in settings}
        for setting in settings:
            over = over_words if setting.numbers is None else over_numbers
            title, draw = (
                f"{metric.name} over {setting.name}",
                partial(over, found, metric, setting),
            )
            yield Candidate("vary", title, tells[setting] * matters, draw)
        numeric = [setting for setting in settings if setting.numbers is not None]
        for across, up in combinations(sorted(numeric, key=lambda s: -tells[s])[:MAPPED], 2):
            worth = matters * (tells[across] * tells[up]) ** 0.5
            title = f"{metric.name} over {across.name} and {up.name}"
            yield Candidate("map", title, worth, partial(over_two, found, metric, across, up))


def _yields(found: Findings) -> Iterator[Candidate]:
    good = Column(name="yield", numbers=found.within.astype(float))
    if not found.limits or not _spreads(good):
        return
    for setting in found.varied:
        if setting.numbers is not None:
            draw = partial(yield_over, found, setting)
            yield Candidate("yield", f"yield over {setting.name}", strength(setting, good), draw)
