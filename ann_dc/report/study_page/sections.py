"""Sections of a page as text and tables: declaration, results and outliers."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator, Sequence

import numpy as np

from ann_dc.report.failure_causes import causes, slowest, worst
from ann_dc.report.fractions import Limit, limits, settled, within, yield_of
from ann_dc.report.growth_exponents import Growth, exponents
from ann_dc.report.statistics import Findings
from ann_dc.report.study_columns import Column
from ann_dc.report.study_page.distributions import errors, predictions
from ann_dc.report.study_page.markup import Markup, element, joined, number, percent, plain, table
from ann_dc.study.records import FAILED, LOST, TIMED_OUT, VERSIONS

STANDING_OUT = 8
"""Number of cases listed as slowest, or as worst for a metric."""
SHOWN = 6
"""Number of settings in a list of cases."""
WORST_FOR = 6
"""Number of metrics with a list of worst cases."""
PRINTED = 25
"""Number of printed records of the table."""
PRINTED_COLUMNS = 8


def section(name: str, title: str, *content: object) -> Markup:
    """Return a section with heading; empty without content.

    The menu links to `name`.
    """
    inside = joined(content)
    return element("section", element("h2", title), inside, id=name) if inside else Markup("")


def asked(found: Findings) -> Markup:
    """Return the declaration: subject, settings, metrics, specification and seed.

    Varied and fixed settings are listed separately.
    """
    identity = found.identity
    rest = {
        "points": f"{len(found):,}",
        "subject": plain(identity.get("subject")),
        "design": plain(identity.get("design")),
        "fixed": plain(identity.get("fixed") or "nothing beside the subject"),
        "spec": ", ".join(str(limit) for limit in limits(found)) or "none",
        "seed": plain(identity.get("seed")),
    }
    pairs = [piece for name, value in rest.items()
             for piece in (element("dt", name), element("dd", value))]  # fmt: skip
    over = identity.get("vary") or {}
    settings = [_asked_of(column, over.get(column.name)) for column in found.varied]
    metrics = [_measured(metric) for metric in found.metrics]
    return joined([
        element("dl", *pairs, class_="facts"),
        element("h3", "Varied"),
        table(("setting", "unit", "meaning", "asked", "values", "lowest", "highest"), settings),
        element("h3", "Measured"),
        table(
            ("metric", "unit", "definition", "points with it", "lowest", "median", "highest"),
            metrics,
        ),
    ])  # fmt: skip


def _asked_of(column: Column, over: object) -> tuple[object, ...]:
    return (column.name, column.unit, column.says, "" if over is None else plain(over),
            *_range(column))  # fmt: skip


def _measured(metric: Column) -> tuple[object, ...]:
    told = (metric.name, metric.unit, metric.says)
    if metric.codes is not None:
        counts = np.bincount(metric.codes, minlength=len(metric.words))
        some = zip(metric.words, counts / max(1, counts.sum()))
        shares = ", ".join(f"{word or 'none'} {percent(share)}" for word, share in [*some][:4])
        return (*told, int(counts.sum()), "", shares, "")
    if not len(metric.values):
        return (*told, 0, "", "", "")
    ends = (float(end) for end in np.quantile(metric.values, (0, 0.5, 1), method="inverted_cdf"))
    return (*told, len(metric.values), *ends)


def _range(column: Column) -> tuple[object, ...]:
    count = len(column.distinct)
    if column.numbers is None:
        words = [str(word) for word in column.distinct]
        return count, words[0] if words else "", words[-1] if len(words) > 1 else ""
    ends = (float(column.distinct[0]), float(column.distinct[-1])) if count else ("", "")
    return count, *ends


def summary(found: Findings) -> Markup:
    """Return the results: outcomes by cause, yield, predictions and exponents."""
    return joined([
        element("p", *_headline(found), class_="headline"),
        element("h3", "Outcomes by cause"),
        _outcomes(found),
        *_yields(found),
        *_predictions(found),
        *_exponents(found),
    ])  # fmt: skip


def _headline(found: Findings) -> Iterator[object]:
    if not len(found):
        yield "No point has finished yet."
        return
    most = causes(found)[0]
    yield element("b", f"{len(found):,}")
    yield f" points; most frequent end: {most.outcome} ({percent(most.points / len(found))})"
    if limits(found):
        yield "; yield "
        yield element("b", str(yield_of(found, within(found))))
    middle = [
        f"median {metric.name} {number(_median(metric))} {metric.unit}".rstrip()
        for metric in found.metrics[:3]
        if len(metric.values) and not metric.name.startswith("predicted_")
    ]
    yield "".join(f"; {words}" for words in middle) + "."


def _median(metric: Column) -> float:
    """Return a median that occurs; two clusters have no case between them."""
    return float(np.quantile(metric.values, 0.5, method="inverted_cdf"))


def _outcomes(found: Findings) -> Markup:
    listed = causes(found)
    rows = [
        (
            cause.outcome, cause.points, _bar(cause.points / len(found)),
            _command(found, cause.row), cause.message,
        )
        for cause in listed
    ]  # fmt: skip
    without = sum(cause.points for cause in listed if cause.outcome in (FAILED, TIMED_OUT, LOST))
    again = element(
        "p", f"{without:,} points have no result; run them again with ",
        element("code", f"ann-dc study FILE.toml --out {shlex.quote(found.place)} --retry"), ".",
    )  # fmt: skip
    head = ("outcome", "points", "share", "an example, and what repeats it", "what it says")
    return joined([table(head, rows, class_="causes"), again if without else None])


def _bar(share: float) -> Markup:
    bar = element("span", "", class_="bar", style=f"width:{100 * share:.2f}%")
    return element("span", bar, element("span", percent(share)), class_="share")


def _command(found: Findings, row: int) -> Markup:
    return element("code", found.repeating(row), class_="command")


def _yields(found: Findings) -> Iterator[Markup]:
    spec = limits(found)
    if not spec:
        return
    done = settled(found)
    items = [(f"settled, {limit}", done & limit.met) for limit in spec]
    together = [("all of it", within(found))] if len(spec) > 1 else []
    rows = []
    for name, met in (("settled", done), *items, *together):
        one = yield_of(found, met)
        low, high = one.interval
        ends = (
            f"{percent(low, 2)} to {percent(high, 2)}" if one.draws != 0 else "none: nothing drawn"
        )
        rows.append((name, one.passed, one.count, percent(one.share, 2), ends))
    yield element("h3", "Yield")
    yield table(("spec", "within", "of", "yield", "95 % interval (Clopper-Pearson)"), rows)
    yield element(
        "p",
        "Every point counts: what failed, did not settle or has no value is not within the spec. "
        "Points of one seed are one draw of the interval.",
        class_="note",
    )


def _predictions(found: Findings) -> Iterator[Markup]:
    rows = []
    for measured, predicted in predictions(found):
        off = errors(measured, predicted)
        if len(off):
            ends = [percent(value, 2) for value in np.quantile(off, (0.5, 0.95, 1.0))]
            rows.append((measured.name, len(off), *ends))
    if rows:
        yield element("h3", "Predicted beside measured")
        yield table(("metric", "points", "median error", "95 % of errors below", "largest"), rows)


def _exponents(found: Findings) -> Iterator[Markup]:
    fitted: list[Growth] = exponents(found)
    if not fitted:
        return
    rows = [
        (
            f"{one.metric.name} ~ {one.setting.name}^p", f"{law.value:.3f}",
            f"{law.low:.3f} to {law.high:.3f}", f"{law.told:.3f}", law.points,
        )
        for one in fitted
        if (law := one.exponent)
    ]  # fmt: skip
    yield element("h3", "Exponents")
    yield table(("law", "p", "95 % interval", "R\N{SUPERSCRIPT TWO}", "points"), rows)
    says = "Lines of least squares through logarithms; what else varies counts as scatter."
    yield element("p", says, class_="note")


def standing_out(found: Findings) -> Markup:
    """Return the slowest and worst cases with the commands that repeat them."""
    parts: list[Markup] = []
    seconds = found.seconds
    rows = slowest(found, STANDING_OUT)
    if seconds is not None and len(seconds.distinct) > 1:
        parts += [element("h3", "Slowest"), _points(found, seconds, rows)]
    spec = limits(found)
    ruled = {limit.column.name for limit in spec}
    metrics: list[Limit | Column] = [*spec, *(m for m in found.metrics if m.name not in ruled)]
    for about in metrics[:WORST_FOR]:
        rows = worst(about, STANDING_OUT)
        column = about.column if isinstance(about, Limit) else about
        title = f"Furthest out of, or nearest to, {about}" if isinstance(about, Limit) else (
            f"Largest {column.name}"
        )  # fmt: skip
        if len(rows) and len(column.distinct) > 1:
            parts += [element("h3", title), _points(found, column, rows)]
    again = element("p", "A point is repeated by ", element("code", f"{found.command} --point N"))
    return joined([*parts, element("div", again, class_="paper")] if parts else [])


def _points(found: Findings, column: Column, rows: Sequence[int] | np.ndarray) -> Markup:
    settings = [setting for setting in found.varied if setting is not column][:SHOWN]
    head = ("point", column.label, *(setting.label for setting in settings), "repeated by")
    return table(
        head,
        (
            (
                str(found.points[row]), _cell(column, row),
                *(_cell(setting, row) for setting in settings), _command(found, row),
            )
            for row in rows
        ),
        class_="points",
    )  # fmt: skip


def _cell(column: Column, row: int) -> object:
    if column.numbers is not None:
        return float(column.numbers[row])
    assert column.codes is not None
    return column.words[column.codes[row]]


def printed(found: Findings) -> Markup:
    """Return the first records with the important columns, for printing."""
    outcome = [found.columns[name] for name in ("outcome",) if name in found.columns]
    room = PRINTED_COLUMNS - len(outcome)
    metrics = found.metrics[: room // 2]
    columns = [*found.varied[: room - len(metrics)], *metrics, *outcome]
    count = min(PRINTED, len(found))
    rows = ((str(found.points[row]), *(_cell(c, row) for c in columns)) for row in range(count))
    says = (
        f"The first {count} of {len(found):,} rows, {1 + len(columns)} of "
        f"{len(found.columns)} columns; the others are in the file itself."
    )
    head = ("point", *(column.label for column in columns))
    return element("div", element("p", says, class_="note"), table(head, rows), class_="paper")


def versions(found: Findings, written_by: str) -> Markup:
    """Return the software versions of the cases and of the page."""
    column = found.columns.get(VERSIONS)
    rows: list[tuple[object, object]] = []
    if column is not None and column.codes is not None:
        counts = np.bincount(column.codes, minlength=len(column.words))
        rows = [(int(count), _versions(word)) for word, count in zip(column.words, counts)]
    layout = found.identity.get("version")
    return joined([
        table(("points", "run with"), rows) if rows else None,
        element("p", f"Layout of the study: {layout}. Page written by {written_by}.",
                class_="note"),
    ])  # fmt: skip


def _versions(text: str) -> object:
    try:
        told = json.loads(text)
    except ValueError:
        return text
    if not isinstance(told, dict):
        return text
    return ", ".join(f"{name} {version}" for name, version in told.items())
