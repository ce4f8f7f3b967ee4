"""Report of converters: their error and time, and the cold start of the circuit."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from rich.table import Table

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.fidelity.boards.interface import InterfaceCost
from ann_dc.fidelity.circuit_study import NEAR
from ann_dc.fidelity.noise_run import noisy
from ann_dc.report.circuit import assumed, parts_in_words
from ann_dc.report.corner_table import told
from ann_dc.report.tables import named_rows, verdict_text


@dataclass(frozen=True, kw_only=True, eq=False)
class InterfaceTable:
    """Report of the cost of an interface.

    Attributes
    ----------
    cost : InterfaceCost
        Errors and times.
    backend : SpiceBackend
        Backend that defines the parts.
    """

    cost: InterfaceCost
    backend: SpiceBackend

    @property
    def good(self) -> bool:
        """True if the circuit settles and its controls as read are near the optimum."""
        error = noisy(self.cost.total_error, self.cost.noise)
        return error < NEAR and math.isfinite(self.cost.settling_time)

    def tables(self) -> list[Table]:
        """Return the tables to print."""
        cost, chosen = self.cost, self.cost.interface
        rows: dict[str, object] = {}
        if self.backend.seed is not None:
            rows |= assumed(self.backend.level)
        if chosen.dac_bits is not None:
            rows["inputs"] = (
                f"{chosen.dac_bits} bits: error of controls {cost.input_error:.2e} with these "
                f"inputs, {cost.worst_input_error:.2e} at most with others near them"
            )
        if chosen.adc_bits is not None:
            rows["controls"] = f"{chosen.adc_bits} bits: {cost.output_error:.2e} at most"
        if chosen.dac_bits is not None and chosen.adc_bits is not None:
            rows["both"] = (
                f"{cost.error:.2e} of the size of the controls with these inputs, as read"
            )
        rows["with the parts"] = verdict_text(self.good, self._verdict())
        rows["a solve"] = (
            f"{_us(cost.settling_time)} to settle and {_us(chosen.seconds)} to convert: "
            f"{_us(cost.solve_time)}"
        )
        rows["cold start"] = (
            f"by emulation {cost.astray}; that parts clip on the way it does not know: preset the "
            "integrators, or try it in ngspice"
            if cost.astray
            else f"within 0.1 % after {_us(cost.cold_settling_time)}: reset switches that empty "
            "capacitors are enough, no source presets them"
            if math.isfinite(cost.cold_settling_time)
            else "no settling seen: preset the integrators"
        )
        return [named_rows(rows)]

    def _verdict(self) -> str:
        cost = self.cost
        if math.isnan(cost.circuit_error):
            return "the circuit oscillates"
        if math.isnan(cost.settling_time):
            return "the circuit does not get to its settled point"
        return (
            f"{cost.total_error:.2e} at most, with inputs near these, too; "
            f"{cost.circuit_error:.2e} is the circuit's own, with {parts_in_words(self.backend)}"
            + f"; noise of {cost.noise:.1e} rms beside it"
            * math.isfinite(cost.noise)
        )

    def as_dict(self) -> dict:
        """Return the content of the JSON file."""
        cost = self.cost
        more = {
            "rounded": {name: values.tolist() for name, values in cost.rounded.items()},
            "total_error": cost.total_error,
            "solve_time": cost.solve_time,
        }
        return {"interface": asdict(cost) | more}


def _us(seconds: float) -> str:
    return told(seconds * 1e6, "{:.4g} us")
