"""Names of the preconditioner kinds that a design may choose from."""

from __future__ import annotations

from typing import Annotated

import typer

from ann_dc.cli.arguments.lookup import named
from ann_dc.errors import DesignError
from ann_dc.network.preconditioners.base import PreconditionerKind

KINDS = {kind.name.lower().replace("_", "-"): kind for kind in PreconditionerKind}
"""Preconditioner kinds by name."""

KindsOption = Annotated[
    str | None,
    typer.Option(
        "--kinds",
        metavar="KIND,...",
        help=f"Preconditioners to choose from: {', '.join(KINDS)}.",
        show_default="what can be built",
    ),
]

PreconditionerOption = Annotated[
    str,
    typer.Option(
        "--metric", metavar="KIND", help=f"Preconditioner that is built: {', '.join(KINDS)}."
    ),
]


def preconditioner_of(word: str) -> PreconditionerKind:
    """Return the preconditioner kind of a name.

    Raises `UnknownNameError` with the valid names.

    Examples
    --------
    >>> preconditioner_of("Cyclic-Reduction").name
    'CYCLIC_REDUCTION'
    """
    return named("--metric", word, KINDS)


def kinds_of(
    given: str | None, default: tuple[PreconditionerKind, ...]
) -> tuple[PreconditionerKind, ...]:
    """Return the preconditioner kinds of comma-separated names, or the default.

    Raises `UnknownNameError` with the valid names, and `DesignError` for an empty list.

    Examples
    --------
    >>> [kind.name for kind in kinds_of("multilevel, diagonal", ())]
    ['MULTILEVEL', 'DIAGONAL']
    """
    if given is None:
        return default
    words = [word.strip() for word in given.split(",") if word.strip()]
    if not words:
        raise DesignError(f"--kinds: expected one or more of {', '.join(KINDS)}, got {given!r}")
    return tuple(named("--kinds", word, KINDS) for word in words)
