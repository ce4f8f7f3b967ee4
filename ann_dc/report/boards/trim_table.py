"""Trimming in words: the steps, what remains after each, and whether it is enough."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from rich.table import Table

from ann_dc.fidelity.boards.trimming import Trimming
from ann_dc.report.tables import named_rows, table, verdict_text

SHOWN = 40
"""Steps that are printed; the JSON file has all."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrimTable:
    """A trimming procedure.

    Attributes
    ----------
    found : Trimming
    """

    found: Trimming

    @property
    def good(self) -> bool:
        """Whether the steps meet what was asked for."""
        return self.found.reached

    def tables(self) -> list[Table]:
        """What is printed."""
        found = self.found
        before, after = (np.nanquantile(e, found.share) for e in (found.before, found.after))
        verdict = f"{len(found.steps)} trims bring {found.share:.0%} of circuits to "
        verdict += f"{found.remaining:.2%}; without any they stay below {found.untrimmed:.2%}"
        if not found.reached:
            verdict += f", and all trims bring {found.floor:.2%}: buy better resistors or parts"
        rows = {
            f"error<{100 * found.error:g}%": verdict_text(found.reached, verdict),
            "by emulation": f"{before:.2%} before, {after:.2%} after, of {len(found.after)} "
            "drawn circuits",
        }
        return [named_rows(rows), *([self._steps()] if found.steps else [])]

    def _steps(self) -> Table:
        shown = table("", "trim  ", "cell  ", "measure, and set to  ", "remains", dense=True)
        shown.title = "trims in this order, and the error of controls that remains after each"
        for number, step in enumerate(self.found.steps[:SHOWN], 1):
            name, left = step.parameter.name, f"{step.remaining:.2%}"
            shown.add_row(f"{number} ", f"{name} ", str(step.stage), f"{step.reading} ", left)
        if len(self.found.steps) > SHOWN:
            shown.caption = f"and {len(self.found.steps) - SHOWN} more: --json has them"
        return shown

    def as_dict(self) -> dict:
        """For the JSON file."""
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
                "floor": found.floor,
                "before": found.before.tolist(),
                "after": found.after.tolist(),
                "steps": steps,
            }
        }
