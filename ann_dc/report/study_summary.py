"""Terminal summary of a study: outcomes, metrics, yield and available settings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from rich.table import Table as Shown

from ann_dc.report.json_file import picked
from ann_dc.report.tables import table
from ann_dc.si_prefixes import counted
from ann_dc.study.metrics import Metric
from ann_dc.study.settings import FAMILIES, WORDS, Subject
from ann_dc.study.study import Study
from ann_dc.study.table import Table

QUANTILES = (5, 50, 95)
MOST = 20
"""Largest number of setting values with one line each."""


def summary(study: Study, found: Table) -> list[Shown | str]:
    """Return outcomes, medians with their spread, and the yield as printable objects."""
    shown: list[Shown | str] = [f"{study.title}: {len(found)} of {counted(len(study), 'points')}"]
    if not len(found):
        return [*shown, "no records yet"]
    outcomes = table("outcome", "points", "fraction")
    for outcome, count in found.outcomes.items():
        outcomes.add_row(outcome, str(count), f"{count / len(found):.1%}")
    shown.append(outcomes)
    measured = table("metric", "unit", *(f"{share} %" for share in QUANTILES), "nan")
    for metric in study.metrics:
        values = found[metric.name]
        finite = values[np.isfinite(values)]
        reported = 3 * ["-"]
        if finite.size:  # values that occur: no median between two clusters
            ends = np.percentile(finite, QUANTILES, method="inverted_cdf")
            reported = [f"{value:.4g}" for value in ends]
        measured.add_row(metric.name, metric.unit, *reported, str(len(values) - finite.size))
    shown.append(measured)
    if study.spec:
        shown += _yields(study, found)
    return shown


def _yields(study: Study, found: Table) -> list[Shown | str]:
    """Return the yield of every value of each listed setting, then of all records."""
    shown: list[Shown | str] = []
    for name, values in study.plan.listed.items():
        if 1 < len(values) <= MOST and len(values) < len(found):
            parts = table(name, "yield (95 % interval)")
            for value, part in found.by(name).items():
                parts.add_row(str(value), str(part.yield_of()))
            shown.append(parts)
    pooled = ", all listed settings together" if shown else ""
    return [*shown, f"yield{pooled}: {found.yield_of()}"]


def summary_dict(study: Study, found: Table) -> dict[str, Any]:
    """Return the same figures as plain data for JSON; quantiles by percentage."""
    metrics = {}
    for metric in study.metrics:
        values = found[metric.name]
        finite = values[np.isfinite(values)]
        ends = np.percentile(finite, QUANTILES, method="inverted_cdf") if finite.size else ()
        metrics[metric.name] = {
            "unit": metric.unit,
            "quantiles": dict(zip(QUANTILES, ends)),
            "nan": len(values) - finite.size,
        }
    content = {
        "study": study.title,
        "cases": len(study),
        "records": len(found),
        "complete": found.is_complete,
        "outcomes": found.outcomes,
        "metrics": metrics,
    }
    if study.spec:
        reached = found.yield_of()
        content["yield"] = picked(reached, "share", "passed", "count", "low", "high")
    return content


def settings_dict(subject: Subject, metrics: Mapping[str, Metric]) -> dict[str, Any]:
    """Return the settings of a subject and the metrics as plain data for JSON."""
    return {
        "settings": {word: list(family.names(subject)) for word, family in FAMILIES.items()},
        "metrics": {each.name: picked(each, "unit", "definition") for each in metrics.values()},
    }


def settings_table(subject: Subject, metrics: Mapping[str, Metric]) -> list[Shown]:
    """Return tables of the settings of a subject and of the metrics."""
    settings = table("setting", "description", "names")
    for word, family in FAMILIES.items():
        names = [
            f"{name} ({', '.join(WORDS[whole])})" if (whole := f"{word}.{name}") in WORDS else name
            for name in family.names(subject)
        ]
        description = f"{family.description}: {family.effect.value}"
        settings.add_row(f"{word}.", description, ", ".join(names))
    measured = table("metric", "unit", "definition")
    for metric in metrics.values():
        measured.add_row(metric.name, metric.unit, metric.definition)
    return [settings, measured]
