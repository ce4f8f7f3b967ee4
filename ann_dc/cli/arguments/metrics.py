"""What kind of metric is built: --metric, from words to kinds."""

from __future__ import annotations

from typing import Annotated

import typer

from ann_dc.cli.arguments.lookup import named

TIME_CONSTANTS = "time-constants"
"""The word for no metric beyond time constants."""

MetricOption = Annotated[
    str,
    typer.Option(
        "--metric",
        metavar="NAME",
        help="Which neurons move with the drives of others: time-constants, pyramid, "
        "coupled-pyramid, tree, grid.",
    ),
]


def metric_of(word: str):
    """The kind of metric that a word names.

    >>> metric_of("Tree").name
    'TREE'

    Raises
    ------
    UnknownNameError
        With the kinds that there are.
    """
    from ann_dc.network.metrics import Kind

    return named("--metric", word, {kind.name.lower().replace("_", "-"): kind for kind in Kind})
