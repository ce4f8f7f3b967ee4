"""Report of a run of a saved network: outcome, end values and files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from ann_dc import plotting
from ann_dc.backends.curves import RESIDUALS, write_curves
from ann_dc.backends.run import Run
from ann_dc.backends.settling import settles
from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.backends.status import Outcome
from ann_dc.network.network import Network
from ann_dc.plotting.neurons import neurons
from ann_dc.report.json_file import picked, write_json
from ann_dc.report.tables import named_rows, printable, table
from ann_dc.si_prefixes import counted, engineering

ROWS = 16
"""Largest number of neurons in the table of end values."""

MEASURES = ("end", "smallest", "largest")
"""Values of a neuron that are reported."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NetworkRunReport:
    """Report of a network's run.

    ``model`` is the model level of a circuit, or the method of the ODE.
    """

    network: Network
    run: Run | CircuitRun
    model: str
    duration: float | None

    @property
    def outcome(self) -> Outcome:
        """Outcome of the run; a circuit is settled if the ideal network is, too."""
        if isinstance(self.run, Run):
            return self.run.status.outcome
        if settles(self.run.probe) and not self.run.unsettled:
            return Outcome.SETTLED
        return Outcome.NOT_SETTLED if self.duration is None else Outcome.COMPLETED

    @property
    def good(self) -> bool:
        """True if the run settled, or completed the duration given."""
        return self.outcome in (Outcome.SETTLED, Outcome.COMPLETED)

    @property
    def words(self) -> str:
        """Outcome in words."""
        return self.outcome.name.lower().replace("_", " ")

    @property
    def end(self) -> str:
        """Network time at the end of the run."""
        return f"{self.run.trajectory.time[-1]:.6g} unit time constants"

    @property
    def status(self) -> str:
        """Sentence on the end of the run, with the remedy of one that did not settle."""
        said = str(self.run.status if isinstance(self.run, Run) else self.run)
        if self.good or self.duration is not None:
            return said
        return f"{said}; for a run of a given time add --duration T"

    @cached_property
    def settling_time(self) -> float:
        """Settling time in network time, or in seconds for a circuit; nan if there is none."""
        if isinstance(self.run, Run):
            return self.run.settling_time
        return self.run.settling_time() if self.outcome is Outcome.SETTLED else float("nan")

    @cached_property
    def values(self) -> dict[str, tuple[float, float, float]]:
        """`MEASURES` of every neuron by label, in the user's units."""
        return neuron_values(self.run)

    def tables(self) -> list[Table]:
        """Return the tables that ``ann-dc run`` prints."""
        run, left = self.run, max(len(self.values) - ROWS, 0)
        hidden = f"; {left} are not listed (--json, --trajectory)" * bool(left)
        settling = self.settling_time  # finer runs of a circuit, before its sentence
        rows: dict[str, object] = {
            "network": self.network.title,
            "neurons": f"{len(self.values)} in {counted(self.network.stages, 'cells')}{hidden}",
            "model": self.model,
            "outcome": Text(self.words, "green" if self.good else "red"),
            "status": self.status,
        }
        if isinstance(run, CircuitRun):
            rows["time"] = f"{self.end}, of {engineering(run.deck.timing.unit, 's')} each"
            rows["parts"] = ", ".join(f"{count} {kind}" for kind, count in run.deck.parts.items())
        if np.isfinite(settling):
            network_time = f"{settling:.4g} unit time constants"
            rows["settling time"] = (
                network_time if isinstance(run, Run) else engineering(settling, "s")
            )
        return [named_rows(rows), neuron_table(self.values)]

    def as_dict(self) -> dict[str, Any]:
        """Return the content of the JSON file."""
        run, circuit = self.run, {}
        if isinstance(run, CircuitRun):
            circuit = {
                "seconds_per_unit": run.deck.timing.unit,
                "bandwidth_margin": run.scaling.bandwidth_margin,
                "parts": run.deck.parts,
                **picked(run, "control_error", "mean_square_error"),
                "overloads": [str(overload) for overload in run.overloads],
            }
        return {
            "network": self.network.title,
            **picked(self, "model", "status", "duration", "settling_time"),
            "outcome": self.outcome.name.lower(),
            "time": float(run.trajectory.time[-1]),
            **circuit,
            "neurons": {label: dict(zip(MEASURES, each)) for label, each in self.values.items()},
        }

    def write(self, figures: Path | None, trajectory: Path | None, json: Path | None) -> list[Path]:
        """Write the requested files and return their paths."""
        written = []
        if figures is not None:
            title = f"{self.model}: {self.words}, {self.end}"
            written.append(plotting.save(neurons(self.run, title), figures / "run.png"))
        if trajectory is not None:
            run = self.run
            write_curves(run if isinstance(run, CircuitRun) else run.trajectory, trajectory)
        if json is not None:
            write_json(json, self.as_dict())
        return written + [file for file in (trajectory, json) if file is not None]


def neuron_values(run: Run | CircuitRun) -> dict[str, tuple[float, float, float]]:
    """Return `MEASURES` of every neuron of a run by label, in the user's units."""
    return {
        label: (float(column[-1]), float(np.nanmin(column)), float(np.nanmax(column)))
        for label, column in run.trajectory.sampled().curves.columns().items()
        if label not in ("time", *RESIDUALS)
    }


def neuron_table(values: Mapping[str, tuple[float, float, float]]) -> Table:
    """Return the table of the first `ROWS` neurons."""
    shown = table("neuron", *MEASURES, dense=True)
    for label, figures in [*values.items()][:ROWS]:
        shown.add_row(printable(label), *(f"{value:.6g}" for value in figures))
    return shown
