"""Names of the preconditioner kinds that a design may choose from."""

from __future__ import annotations

from typing import Annotated

import typer

from ann_dc.cli.arguments.lookup import named
from ann_dc.errors import DesignError
from ann_dc.network.preconditioners.base import Kind

KINDS = {kind.name.lower().replace("_", "-"): kind for kind in Kind}
"""Preconditioner kinds by name."""

KindsOption = Annotated[
    str | None,
    typer.Option(
        metavar="KIND,...",
        help=f"Metrics to choose from: {', '.join(KINDS)}.",
        show_default="what can be built",
    ),
]

MetricOption = Annotated[
    str,
    typer.Option("--metric", metavar="KIND", help=f"Metric that is built: {', '.join(KINDS)}."),
]


def metric_of(word: str) -> Kind:
    """Return the preconditioner kind of a name.

    Raises `UnknownNameError` with the valid names.

    Examples
    --------
    >>> metric_of("Tree").name
    'TREE'
    """
    return named("--metric", word, KINDS)


def kinds_of(given: str | None, default: tuple[Kind, ...]) -> tuple[Kind, ...]:
    """Return the preconditioner kinds of comma-separated names, or the default.

    Raises `UnknownNameError` with the valid names, and `DesignError` for an empty list.

    Examples
    --------
    >>> [kind.name for kind in kinds_of("pyramid, time-constants", ())]
    ['PYRAMID', 'TIME_CONSTANTS']
    """
    if given is None:
        return default
    words = [word.strip() for word in given.split(",") if word.strip()]
    if not words:
        raise DesignError(f"--kinds: expected one or more of {', '.join(KINDS)}, got {given!r}")
    return tuple(named("--kinds", word, KINDS) for word in words)
