"""Table of PVT corners: one row per operating condition."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import groupby

from rich.table import Table
from rich.text import Text

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.fidelity.boards.corners import Corner
from ann_dc.fidelity.circuit_study import NEAR
from ann_dc.report.circuit import assumed, parts_in_words
from ann_dc.report.tables import table

WIDE = 3
"""Standard deviations of the worst control that the largest circuit error rarely exceeds."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CornerTable:
    """Report of a circuit at several operating conditions.

    Attributes
    ----------
    backend : SpiceBackend
        Backend that defines the parts.
    """

    corners: Sequence[Corner]
    backend: SpiceBackend

    @property
    def good(self) -> bool:
        """True if the circuit settles near the optimum at all operating conditions."""
        return all(corner.near for corner in self.corners)

    def tables(self) -> list[Table]:
        """Return the tables to print."""
        columns = (
            "C",
            "supply",
            "process",
            "error",
            "0.1 % after",
            "settles",
            "clips",
            "spread",
            "noise",
        )
        shown = table(*(f"{name}  " for name in columns), dense=True)
        shown.title = (
            f"{self.backend.level.name} parts: error of the controls over the largest one, "
            f"of {parts_in_words(self.backend)}, its standard deviation by tolerances (spread), "
            "and rms noise"
        )
        for (celsius, process, *figures), same in groupby(self.corners, _figures):
            supplies = ", ".join(f"{corner.conditions.supply:g}" for corner in same)
            shown.add_row(f"{celsius:g}", supplies, process, *figures)
        remarks = {corner.remark: None for corner in self.corners if corner.remark}
        assumes = "; ".join(f"{n}: {said}" for n, said in assumed(self.backend.level).items())
        for said in (self._drift(), self._doubt(), assumes):
            if said:
                remarks[said] = None
        shown.caption = "; ".join(remarks) or None
        return [shown]

    def _drift(self) -> str:
        """Return the effect of temperature on the spread; empty for one temperature."""
        spreads = {corner.spread for corner in self.corners if math.isfinite(corner.spread)}
        if not spreads or len({c.conditions.temperature for c in self.corners}) == 1:
            return ""
        if len(spreads) == 1:
            return "no drift of these parts is known: temperature changes no tolerance"
        return "resistors and offsets of op amps drift; of multipliers no drift is known"

    def _doubt(self) -> str:
        """Return the effect of tolerances on the verdict."""
        if all(math.isnan(corner.spread) for corner in self.corners):
            level = self.backend.level
            drawn = level.emulated and not level.transistors
            return "no spread is known" + "; --yield draws circuits" * drawn
        if self.backend.seed is not None:
            return ""
        wide = [c for c in self.corners if c.near and c.control_error + WIDE * c.spread > NEAR]
        if not wide:
            return ""
        parts = parts_in_words(self.backend)
        return (
            f"at {len(wide)} of {len(self.corners)} corners {parts} are within {NEAR:.0%}, and "
            f"{WIDE} spreads on top are not: --yield draws circuits"
        )

    def as_dict(self) -> dict:
        """Return the content of the JSON file."""
        return {"corners": [asdict(corner) | {"near": corner.near} for corner in self.corners]}


def _figures(corner: Corner) -> tuple[float, str, str, str, Text, Text, str, str]:
    """Return the displayed values of a corner except the supply, which rarely matters."""
    return (
        corner.conditions.temperature,
        corner.conditions.process,
        told(corner.control_error, "{:.2e}"),
        told(corner.settling_time * 1e6, "{:.4g} us"),
        Text("yes" if corner.stable else "no", "green" if corner.stable else "red"),
        Text("yes" if corner.clipped else "no", "red" if corner.clipped else ""),
        told(corner.spread, "{:.2e}"),
        told(corner.noise, "{:.1e}"),
    )


def told(value: float, form: str) -> str:
    """Format a number; return a dash if it is not finite.

    >>> told(0.25, "{:.1%}"), told(math.nan, "{:g}")
    ('25.0%', '-')
    """
    return form.format(value) if math.isfinite(value) else "-"
