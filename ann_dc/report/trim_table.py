"""Report of a trimming procedure: steps, remaining errors and sufficiency."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from rich.table import Table
from rich.text import Text

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.fidelity.boards.trimming import DRAWN, Trimming
from ann_dc.report.tables import named_rows, table, verdict_text
from ann_dc.report.yield_table import drawn_from, noise_told

SHOWN, BEGUN = 40, 5
"""Printed steps of a sufficient and of an insufficient procedure; the JSON file contains all."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrimTable:
    """Report of a trimming procedure.

    Attributes
    ----------
    backend : SpiceBackend
        Backend whose tolerances are trimmed.
    """

    found: Trimming
    backend: SpiceBackend

    @property
    def good(self) -> bool:
        """True if the steps bring the requested fraction of circuits to the error."""
        return self.found.reached

    def tables(self) -> list[Table]:
        """Return the tables to print."""
        found = self.found
        by_slopes = f"{found.share:.0%} of {DRAWN} circuits stay below {found.untrimmed:.2%} "
        by_slopes += f"without trims, {found.remaining:.2%} with these, {found.floor:.2%} with all "
        rows = {
            f"error<{100 * found.error:g}%": self._verdict(),
            "by slopes": f"{by_slopes}{found.places}",
            "noise": noise_told(found.noise),
            **drawn_from(self.backend),
        }
        return [named_rows(rows), *([self._steps()] if found.steps else [])]

    def _verdict(self) -> Text:
        """Return the verdict on the steps from drawn circuits."""
        found, said = self.found, self._emulated()
        if found.reached:
            return verdict_text(True, said)
        if found.kept.high >= found.share and found.kept.passed:
            return Text(f"undecided: {said}; draw more (--samples)", "yellow")
        return verdict_text(False, f"{said}: buy better resistors or parts")

    def _emulated(self) -> str:
        found = self.found
        before, after = (
            np.quantile(errors, found.share, method="inverted_cdf")
            for errors in (found.before, found.after)
        )
        number = f"{len(found.steps)} trims"
        said = f"{number} bring {found.share:.0%} of {len(found.after)} emulated circuits to "
        said += f"{_share(after)}, from {_share(before)}; {found.kept} keep it"
        lost = int(np.isinf(found.after).sum())
        said += f", {lost} do not settle" * bool(lost)
        return said

    def _steps(self) -> Table:
        shown = table("", "trim  ", "cell  ", "measure, and set to  ", "remains", dense=True)
        shown.title = "trims in this order, and the error of controls that remains by slopes"
        most = SHOWN if self.found.reached else BEGUN
        for number, step in enumerate(self.found.steps[:most], 1):
            name, left = step.parameter.name, f"{step.remaining:.2%}"
            shown.add_row(f"{number} ", f"{name} ", str(step.stage), f"{step.reading} ", left)
        if len(self.found.steps) > most:
            shown.caption = f"and {len(self.found.steps) - most} more: --json has them"
        return shown

    def as_dict(self) -> dict:
        """Return the content of the JSON file."""
        found = self.found
        steps = [
            {
                "parameter": step.parameter.name,
                "meaning": step.parameter.meaning,
                "cell": step.stage,
                **asdict(step.reading),
                "remaining": step.remaining,
            }
            for step in found.steps
        ]
        return {
            "trimming": {
                "error": found.error,
                "share": found.share,
                "reached": found.reached,
                "untrimmed": found.untrimmed,
                "remaining": found.remaining,
                "kept": found.kept.passed,
                "trims": found.places,
                "noise": found.noise,
                "floor": found.floor,
                "before": found.before.tolist(),
                "after": found.after.tolist(),
                "steps": steps,
            }
        }


def _share(error: float) -> str:
    return f"{error:.2%}" if np.isfinite(error) else "unsettled"
