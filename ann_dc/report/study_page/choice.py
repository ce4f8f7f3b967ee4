"""Selection of the figures of a page: the most informative ones, about twelve.

The informativeness of a metric over a setting is the fraction of its spread explained by the
setting. Metrics of the specification come first and computing times last. The titles of omitted
figures are listed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations
from typing import NamedTuple

from ann_dc.report.fractions import limits, within
from ann_dc.report.quantile_bands import strength
from ann_dc.report.statistics import Findings
from ann_dc.report.study_columns import Column
from ann_dc.report.study_page.dependence import over_numbers, over_two, over_words, yield_over
from ann_dc.report.study_page.distributions import beside, distribution, over_time, predictions
from ann_dc.report.study_page.figure import Figure, limit_of

MOST = 12
"""Number of figures of a page."""
ROOM = {"yield": 1, "vary": 5, "map": 1, "beside": 1, "time": 2, "spread": 2}
"""Number of figures of each kind, in page order. Unused places pass to other kinds."""
WORDS = 30
"""Largest number of different text values on an axis."""
MAPPED = 4
"""Number of settings whose pairs are considered for each metric."""


class Candidate(NamedTuple):
    """Candidate for a figure.

    Attributes
    ----------
    kind : str
        Key of `ROOM`.
    draw : callable
        Function that returns the `Figure`, or None for too few cases.
    """

    kind: str
    title: str
    worth: float
    draw: Callable[[], Figure | None]


def chosen(found: Findings) -> tuple[list[Figure], list[str]]:
    """Return the figures of a page, and the titles of the omitted ones."""
    best = sorted(_candidates(found), key=lambda candidate: -candidate.worth)
    kept: list[tuple[Candidate, Figure]] = []
    waiting: list[Candidate] = []
    for candidate in best:
        of_kind = sum(other.kind == candidate.kind for other, _ in kept)
        figure = candidate.draw() if of_kind < ROOM[candidate.kind] else None
        if figure is not None:
            kept.append((candidate, figure))
        elif of_kind >= ROOM[candidate.kind]:
            waiting.append(candidate)
    left_out = []
    for candidate in waiting:
        figure = candidate.draw() if len(kept) < MOST else None
        if figure is not None:
            kept.append((candidate, figure))
        elif len(kept) >= MOST:
            left_out.append(candidate.title)
    order = list(ROOM)
    kept.sort(key=lambda pair: order.index(pair[0].kind))
    return [figure for _, figure in kept], left_out


def _candidates(found: Findings) -> Iterator[Candidate]:
    spec = limits(found)
    metrics = [metric for metric in found.metrics if _spreads(metric)]
    for place, metric in enumerate(metrics):
        limit = limit_of(metric, spec)
        worth = (limit is not None) + 1 / (2 + place)
        yield Candidate(
            "spread", f"{metric.name} by itself", worth,
            lambda metric=metric, limit=limit: distribution(metric, limit),
        )  # fmt: skip
    for measured, predicted in predictions(found):
        yield Candidate(
            "beside", f"{predicted.name} beside {measured.name}", 3.0,
            lambda measured=measured, predicted=predicted: beside(found, measured, predicted),
        )  # fmt: skip
    for number, figure in enumerate(over_time(found.curves)):
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
    spec = limits(found)
    settings = [s for s in found.varied if s.numbers is not None or len(s.words) <= WORDS]
    for place, metric in enumerate(metrics):
        limit = limit_of(metric, spec)
        matters = 1.0 if limit is not None else 0.8 / (1 + place / 4)
        matters *= 0.4 if metric is found.seconds else 1.0
        matters *= 0.1 if metric.name.startswith("predicted_") else 1.0
        tells = {setting: strength(setting, metric) for setting in settings}
        for setting in settings:
            draw = over_words if setting.numbers is None else over_numbers
            yield Candidate(
                "vary", f"{metric.name} over {setting.name}", tells[setting] * matters,
                lambda metric=metric, setting=setting, draw=draw, limit=limit: draw(
                    found, metric, setting, limit
                ),
            )  # fmt: skip
        numeric = [setting for setting in settings if setting.numbers is not None]
        for across, up in combinations(sorted(numeric, key=lambda s: -tells[s])[:MAPPED], 2):
            yield Candidate(
                "map", f"{metric.name} over {across.name} and {up.name}",
                matters * (tells[across] * tells[up]) ** 0.5,
                lambda metric=metric, across=across, up=up: over_two(
                    found, metric, across, up
                ),
            )  # fmt: skip


def _yields(found: Findings) -> Iterator[Candidate]:
    good = Column(name="yield", numbers=within(found).astype(float))
    if not limits(found) or not _spreads(good):
        return
    for setting in found.varied:
        if setting.numbers is not None:
            yield Candidate(
                "yield", f"yield over {setting.name}", strength(setting, good),
                lambda setting=setting: yield_over(found, setting),
            )  # fmt: skip
