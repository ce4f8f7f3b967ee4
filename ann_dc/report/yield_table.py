"""Report of a circuit yield: fraction, closest circuit and simulated samples."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from rich.table import Table
from rich.text import Text

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.fidelity.boards.yields import CircuitYield, Spot
from ann_dc.report.circuit import assumed
from ann_dc.report.corner_table import told
from ann_dc.report.tables import named_rows, table


@dataclass(frozen=True, kw_only=True, eq=False)
class YieldTable:
    """Report of a circuit yield.

    Attributes
    ----------
    backend : SpiceBackend
        Backend that defines the tolerances.
    """

    yielded: CircuitYield
    backend: SpiceBackend

    @property
    def good(self) -> bool:
        """True if a circuit meets the specification and all ngspice samples agree."""
        return self.yielded.found.passed > 0 and all(spot.agreed for spot in self.yielded.spots)

    def tables(self) -> list[Table]:
        """Return the tables to print."""
        found = self.yielded
        stable = found.errors[np.isfinite(found.errors)]
        rows = {"spec": found.spec, "yield": f"{found.found}, 95 % confidence, by emulation"}
        rows |= drawn_from(self.backend)
        if len(stable):
            median, most = np.quantile(stable, [0.5, 0.95])
            rows["error of controls"] = f"{median:.2e} median, {most:.2e} for 95 % of those stable"
        rows["noise"] = noise_told(found.noise)
        rows["do not settle"] = f"{len(found.errors) - len(stable)} of {len(found.errors)}"
        if untimed := [why for why in found.unknown if why]:
            rows["settle at a time"] = f"not known of {len(untimed)}, which count as lost: " + (
                "; ".join(dict.fromkeys(untimed))
            )
        if found.found.passed == 0:
            rows["closest"] = self._closest()
        return [named_rows(rows), *([self._spots()] if found.spots else [])]

    def _closest(self) -> str:
        found = self.yielded
        if found.closest is None:
            return "none of the circuits settles near the optimum"
        error, time = found.errors[found.closest], found.settling_times[found.closest]
        after = f" after {time * 1e6:.4g} us" if np.isfinite(time) else ""
        return f"no circuit keeps the spec; seed {found.seeds[found.closest]}: {error:.2%}{after}"

    def _spots(self) -> Table:
        timed = "settling_time" in self.yielded.spec.limits
        times = ("0.1 % after", "in ngspice") if timed else ()
        columns = "seed", "error", "in ngspice", *times, "keeps the spec", ""
        shown = table(*(f"{name}  " for name in columns), dense=True)
        shown.title = "drawn circuits that ngspice ran as well: predicted, and what it found"
        for spot in self.yielded.spots:
            both = spot.predicted_time, spot.measured_time
            shown.add_row(
                str(spot.seed),
                told(spot.predicted, "{:.2e}"),
                told(spot.measured, "{:.2e}"),
                *(told(time * 1e6, "{:.4g} us") for time in both[: len(times)]),
                " / ".join("yes" if kept else "no" for kept in spot.kept),
                self._agreement(spot),
            )
        return shown

    def _agreement(self, spot: Spot) -> Text:
        if not spot.agreed:
            return Text("disagree", "red")
        same = spot.kept[0] == spot.kept[1]
        return Text("agree", "green") if same else Text("at its limit", "yellow")

    def as_dict(self) -> dict:
        """Return the content of the JSON file."""
        found = self.yielded
        low, high = found.found.interval
        return {
            "yield": {
                "spec": str(found.spec),
                "passed": found.found.passed,
                "samples": found.found.count,
                "share": found.found.share,
                "interval": [low, high],
                "errors": found.errors.tolist(),
                "noise": found.noise,
                "settling_times": found.settling_times.tolist(),
                "unknown": list(found.unknown),
                "closest": found.closest,
                "spots": [asdict(spot) for spot in found.spots],
            }
        }


def noise_told(noise: float) -> str:
    """Return the description of the noise that a verdict includes."""
    if np.isnan(noise):
        return "not computed, and not counted"
    return f"{noise:.1e} of the largest control rms, counted with every error"


def drawn_from(backend: SpiceBackend) -> dict[str, str]:
    """Return rows of the common properties of drawn circuits and assumed tolerances."""
    series = backend.series
    if not series.mantissas:
        return assumed(backend.level)
    bought = f"{series.name}, capacitors of {series.capacitors.name}, with their tolerances on top"
    return {"resistors": bought} | assumed(backend.level)
