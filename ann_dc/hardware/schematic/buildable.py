"""Checks that a model level can build a preconditioner kind and a resistor series."""

from __future__ import annotations

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts.e_series import Series
from ann_dc.hardware.parts.levels import Level
from ann_dc.network.preconditioners import base as contract
from ann_dc.validation import checked


@checked
def check_preconditioner(kind: contract.PreconditionerKind, level: Level) -> None:
    """Raise `NetworkError` if a level cannot build a preconditioner kind.

    The message lists the kinds that it can build.
    """
    if kind not in level.preconditioners:
        known = ", ".join(known.value for known in level.preconditioners)
        raise NetworkError(
            f"preconditioner: {level.name} circuits cannot build a {kind.value}; design the "
            f"network with one of: {known}; or take a level of op amps with their poles"
        )


@checked
def check_series(series: Series, level: Level) -> None:
    """Raise `NetworkError` for resistors of a series at a level without resistors."""
    if series.mantissas and not level.technology.has_resistors:
        raise NetworkError(
            f"series {series.name}: {level.name} circuits compute without resistors; take exact"
        )
