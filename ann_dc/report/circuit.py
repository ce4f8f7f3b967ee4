"""Report of a circuit study: the tables and files of ``ann-dc circuit``."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.table import Table
from rich.text import Text

from ann_dc import plotting
from ann_dc.backends.curves import write_curves
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.backends.spice.pdk.files import PACKAGE
from ann_dc.fidelity.circuit_study import NEAR, CircuitStudy
from ann_dc.fidelity.noise_run import noisy
from ann_dc.files import write_whole
from ann_dc.hardware.circuit.bill import bill_of
from ann_dc.hardware.circuit.cost import RESISTOR
from ann_dc.hardware.parts.conditions import NOMINAL
from ann_dc.hardware.parts.levels import Level
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.optimality.certificate import Certificate
from ann_dc.plotting.neurons import neurons
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.report.json_file import picked, write_json
from ann_dc.report.network_run import neuron_table, neuron_values
from ann_dc.report.tables import measured, named_rows, table, unit_list, verdict_text
from ann_dc.report.waveforms import overloads, waveform_dict, waveform_rows
from ann_dc.si_prefixes import counted, engineering
from ann_dc.solution.solution import certificate_of, units_of

OTHER_EQUILIBRIA, LEAKS = 10e-12, 10e6
"""Farads below which parasitic capacitance matters, and ohms above which board leakage matters."""
VOLTS = 16
"""Largest number of outputs whose volt is listed."""
KEPT = 1e-6
"""Relative constraint residual above which the report states a violation."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CircuitReport:
    """Report of the study of a circuit that a backend built.

    ``problem`` is None for a network of a file, whose circuit is compared with its ODE alone.
    """

    problem: OptimalControlProblem | None
    backend: SpiceBackend
    found: CircuitStudy

    @cached_property
    def certificate(self) -> Certificate | None:
        """Optimality certificate of the settled state; None without simulation or problem."""
        if self.found.run is None or self.problem is None:
            return None
        trajectory = self.found.run.trajectory
        return certificate_of(self.problem, trajectory.network, trajectory.final)

    @property
    def good(self) -> bool:
        """True if the circuit finds or is predicted to find the optimum, or is unassessed."""
        return self.found.within_tolerance or self.found.unknown

    @cached_property
    def units(self) -> dict[str, str]:
        """Units of measure by neuron name; a network of a file has none."""
        network = self.found.circuit.schematic.network
        return {} if self.problem is None else units_of(self.problem, network)

    def tables(self) -> list[Table]:
        """Return the tables to print."""
        behaviour = waveform_rows(self.found) if self.found.moves else self._behaviour()
        first = {self._goal: behaviour.pop(self._goal)} if self._goal in behaviour else {}
        tables = [named_rows(first | self._circuit() | behaviour | self._errors())]
        if self.problem is None and self.found.run is not None:
            tables.append(neuron_table(neuron_values(self.found.run)))
        tables += [self._budget()] if self.found.items else []
        return [*tables, self._loops()] if self.found.loops else tables

    def _circuit(self) -> dict[str, object]:
        found, level, cost = self.found, self.backend.level, self.found.cost
        written, scaling, run = found.deck, found.circuit.scaling, found.run
        parts = ", ".join(counted(count, name) for name, count in written.parts.items())
        power = f"; {engineering(cost.power, 'W', 3)}"
        if math.isfinite(cost.energy):
            power += f", {engineering(cost.energy, 'J', 3)} a solve"
        return {
            **self._subject(),
            "level": f"{level.name}{self._parts()}{self._drawn_with()}",
            **self._conditions(),
            "parts": parts + (power if cost.power > 0 else ""),
            **self._preconditioner(),
            "values": self._values(),
            "1 V =": self._a_volt(),
            "scaling": f"{scaling.full_scale:g} V full scale, "
            f"{engineering(written.timing.unit, 's', 3)} a unit time constant, op amps "
            f"{scaling.bandwidth_margin:.3g} times as fast as the network; tightest node in "
            f"the ODE's run {scaling.tightest} at {scaling.used(scaling.tightest):.0%}"
            + (f", in the circuit's {run.fullest}" if run and run.fullest else ""),
        }

    def _subject(self) -> dict[str, object]:
        """Return the rows of the problem and its units, or of the network."""
        if self.problem is None:
            return {"network": self.found.circuit.schematic.network.title}
        return {"problem": self.problem, "units": unit_list(self.problem)}

    def _parts(self) -> str:
        """Return the limits of its op amps and multipliers; empty for ideal parts."""
        level = self.backend.level
        return f" ({level.datasheet})" if level.models != "ideal" else ""

    def _a_volt(self) -> str:
        """Return the value of 1 V at the output of every control, or of the first neurons."""
        reported, scales = [], self.found.circuit.control_scales
        for name, scale in [*scales.items()][:VOLTS]:
            unit = self.units.get(name, "").removeprefix("1")
            offset = f" from {scale.offset:.4g}, as its errors are" * bool(scale.offset)
            reported.append(f"{name}: {scale.factor:.4g} {unit}".rstrip() + offset)
        more = f", and {len(scales) - VOLTS} more (--json)" if len(scales) > VOLTS else ""
        return ", ".join(reported) + more

    def _conditions(self) -> dict[str, object]:
        """Return the operating conditions if they differ from the nominal ones."""
        level = self.backend.level
        stands = level.conditions
        if stands == NOMINAL:
            return {}
        drifts = level.datasheet.tolerances
        known = drifts is not None and (drifts.resistor_drift or drifts.offset_drift)
        still = "" if known or level.transistors else "; no drift of its tolerances is known"
        process = f", process {stands.process}" if level.transistors else ""
        return {
            "conditions": f"{stands.temperature:g} C, supplies {stands.supply:g} of nominal"
            f"{process}{still}"
        }

    def _preconditioner(self) -> dict[str, object]:
        """Return the preconditioner with the demand on its wires, or why that is unknown."""
        kind = self.found.circuit.schematic.network.preconditioner.kind
        others = " (default of circuits; ann-dc solve selects among all preconditioners)"
        is_default = kind is PreconditionerKind.DIAGONAL and self.problem is not None
        rows: dict[str, object] = {"preconditioner": kind.value + others * is_default}
        if self.found.undemanded:
            return rows | {"wires": f"demand unknown: {self.found.undemanded}"}
        return rows if self.found.demand is None else rows | {"wires": self.found.demand}

    def _values(self) -> str:
        """Return the ranges of resistors and capacitors."""
        ohms, farads = self.found.circuit.ranges
        ohms = self.backend.series.nearest(np.array(ohms))
        strays = f" (below {engineering(OTHER_EQUILIBRIA, 'F', 3)} strays count)" * bool(
            farads[0] < OTHER_EQUILIBRIA
        )
        leaks = f" (above {engineering(LEAKS, 'ohm', 3)} boards leak)" * bool(ohms[1] > LEAKS)
        least, most = (engineering(value, "ohm", 3) for value in ohms)
        farads = self.backend.series.capacitors.nearest(np.array(farads))
        small, large = (engineering(value, "F", 3) for value in farads)
        resistors = f"R {least} to {most}{leaks}, " if RESISTOR in self.found.deck.parts else ""
        with_limits = (
            bool(self.found.circuit.schematic.limited) and RESISTOR in self.found.deck.parts
        )
        beside = "; those of rails: --bom" * with_limits
        return f"{resistors}C {small} to {large}{strays}{beside}"

    def _behaviour(self) -> dict[str, object]:
        run, terms = self.found.run, self.found.terms
        if run is None:
            return {"simulated": "no", "predicted": self._predicted(), **self._verdict()}
        micros = 1e6 * run.settling_time(), 1e6 * run.settling_error
        return {
            "settled": verdict_text(
                not run.unsettled,
                run.unsettled or f"{terms} within 0.1 % after {measured(*micros)} us",
            ),
            f"error of {terms}": f"{run.control_error:.2e} of {self.found.size}, against the ODE",
            "trajectory": f"normalised mean square error {run.mean_square_error:.1e}, against "
            "the ODE",
            "predicted": self._predicted(),
            **self._difference(),
            **self._objective(),
            "overload": overloads(run),
            **self._verdict(),
        }

    def _objective(self) -> dict[str, object]:
        """Return the row of the objective; a network without a problem has none."""
        certificate = self.certificate
        if certificate is None or self.problem is None:
            return {}
        return {
            "objective": f"{certificate.objective:.8g} {self.problem.cost_unit}".rstrip()
            + f", KKT residual {certificate.kkt_residual:.1e}"
            + f" (constraint violation {certificate.constraint_residual:.1e}: it may be below the "
            "optimum's)" * bool(certificate.constraint_residual > KEPT),
        }

    def _difference(self) -> dict[str, object]:
        """Return the row that compares ngspice with the prediction, if there is one."""
        found = self.found
        if not math.isfinite(found.final_difference) or found.run is None:
            return {}
        text = (
            f"final {found.terms} of ngspice and prediction differ by {found.final_difference:.1e} "
            f"of {found.size}"
        )
        predicted = found.prediction.settling_time if found.prediction else math.nan
        measured_time = found.run.settling_time()
        if math.isfinite(predicted) and math.isfinite(measured_time) and predicted > 0:
            text += f", settling times by {abs(measured_time / predicted - 1):.1%}"
        return {"difference": text}

    def _verdict(self) -> dict[str, object]:
        """Return the row of the verdict, with the reason if the optimum is not found.

        The verdict determines the exit code.
        """
        why = self.found.shortcoming
        if self.found.unknown:
            return {self._goal: Text("unknown: neither simulated nor predicted", "yellow")}
        reported = "are predicted to be" if self.found.run is None else "are"
        noise = "with their noise" if math.isfinite(self.found.noise) else "noise not computed"
        parts = parts_in_words(self.backend)
        near = f"the {self.found.terms} {reported} within {NEAR:.0%}, {noise}, of {parts}"
        return {self._goal: verdict_text(not why, why or near)}

    @property
    def _goal(self) -> str:
        """Name of the row with the verdict."""
        return f"within 1 % of {'equilibrium' if self.problem is None else 'optimum'}"

    def _drawn_with(self) -> str:
        if self.backend.seed is None:
            return ""
        alone = "; transistors by their models in ngspice alone, and predicted without errors"
        return f"; {parts_in_words(self.backend)}" + alone * (self.backend.level.models == PACKAGE)

    def _predicted(self) -> str:
        found = self.found.prediction
        if found is None:
            return f"nothing: {self.found.unpredicted}"
        pole = f"{found.spectrum.abscissa:+.3g} per unit time constant"
        if not found.stable:
            return f"oscillates: a pole of {pole}"
        if found.other_equilibrium:
            return f"not that it gets to its settled point: {found.other_equilibrium}"
        when = f"settling not computed: {found.unknown}"
        if math.isfinite(found.settling_time):
            when = f"within 0.1 % after {found.settling_time * 1e6:.4g} us"
        return f"error {found.control_error:.2e}, {when}, slowest pole {pole}"

    def _errors(self) -> dict[str, object]:
        found, rows = self.found, {}
        if math.isfinite(found.noise):
            kelvin = self.backend.level.conditions.kelvin
            rows["noise"] = f"{found.noise:.1e} rms of {found.size}, at {kelvin:.0f} K"
        if self.backend.series.mantissas:
            rounding, series = found.series_rounding, self.backend.series
            rows["resistors"] = (
                f"{series.name}: off by up to {rounding['resistor']:.2%}, the same in every cell; "
                f"capacitors of {series.capacitors.name}: {rounding['capacitor']:.2%}"
            )
        if found.unlooped:
            rows["loops"] = f"not told: {found.unlooped}"
        if len(found.samples):
            rows |= {"drawn circuits": self._drawn(), **assumed(self.backend.level)}
        return rows

    def _drawn(self) -> str:
        samples = self.found.samples
        near = samples[np.isfinite(samples)]
        if not len(near):
            return f"none of {len(samples)} settles near the optimum"
        median, most = np.quantile(near, [0.5, 0.95])
        within = (noisy(near, self.found.noise) < NEAR).sum()
        return (
            f"error of {self.found.terms} {median:.2e} median, {most:.2e} for 95 % of "
            f"{len(samples)} (predicted); {within} of {len(samples)} within {NEAR:.0%}, "
            "noise counted"
            + f"; {len(samples) - len(near)} settle elsewhere"
            * (len(near) < len(samples))
        )

    def _budget(self) -> Table:
        shown = table("part", "what", "assumed", "error of controls", "share", dense=True)
        shown.title = (
            "what costs most (standard deviations, one part in all cells): error of the control "
            "that suffers most from it, share in the variance of the circuit's worst control"
        )
        for item in self.found.items:
            volts = item.parameter.kind.unit == "V"
            size = f"{item.size * 1e3:.3g} mV" if volts else f"{item.size:.2%}"
            what = item.parameter.name, item.parameter.meaning, size
            shown.add_row(*what, f"{item.error:.2e}", f"{item.share:.1%}")
        return shown

    def _loops(self) -> Table:
        shown = table("op amp", "cell", "phase margin", "crossover kHz", dense=True)
        shown.title = "loops with the smallest phase margins, each broken at its op amp's input"
        if self.found.prediction is not None and not self.found.prediction.stable:
            shown.title += "; the circuit oscillates: they do not show that it is stable"
        for loop in self.found.loops:
            figures = f"{loop.phase_margin:.0f} deg", f"{loop.crossover * 1e-3:.4g}"
            shown.add_row(loop.node, str(loop.stage), *figures)
        return shown

    def as_dict(self) -> dict:
        """Return the content of the JSON file."""
        found, level = self.found, self.backend.level
        network = found.circuit.schematic.network
        named = (
            {"network": network.title} if self.problem is None else {"problem": self.problem.name}
        )
        return {
            **named,
            "level": level.name,
            "parameters": level.parameters,
            "seed": self.backend.seed,
            "resistors": self.backend.series.name,
            "parts": found.deck.parts,
            "power": found.cost.power,
            "energy": found.cost.energy,
            "full_scale": found.circuit.scaling.full_scale,
            "seconds_per_unit": found.deck.timing.unit,
            "bandwidth_margin": found.circuit.scaling.bandwidth_margin,
            "preconditioner": found.circuit.schematic.network.preconditioner.kind.name.lower(),
            "demand": None if found.demand is None else asdict(found.demand),
            "undemanded": found.undemanded,
            **(waveform_dict(found) if found.moves else self._measured()),
            "noise": found.noise,
            "volt": {name: scale._asdict() for name, scale in found.circuit.control_scales.items()},
            **picked(found, "within_tolerance", "shortcoming"),
            "samples": found.samples,
            "loops": [asdict(loop) for loop in found.loops],
            "unlooped": found.unlooped,
            "budget": [item.as_dict() for item in found.items],
        }

    def _prediction(self) -> dict | None:
        reported = ("control_error", "settling_time", "stable", "other_equilibrium", "unknown")
        return None if self.found.prediction is None else picked(self.found.prediction, *reported)

    def _measured(self) -> dict:
        run, predicted = self.found.run, {"predicted": self._prediction()}
        if run is None:
            return {"settled": None, **predicted}
        certified = ("objective", "kkt_residual") if self.certificate else ()
        return {
            "settled": not run.unsettled,
            "settling_time": run.settling_time(),
            **picked(run, "settling_error", "control_error", "mean_square_error"),
            **picked(self.certificate, *certified),
            "overloads": [str(overload) for overload in run.overloads],
            **predicted,
            **picked(self.found, "final_difference"),
        }

    def write(
        self,
        *,
        deck: Path | None = None,
        bom: Path | None = None,
        figures: Path | None = None,
        trajectory: Path | None = None,
        json_file: Path | None = None,
    ) -> list[Path]:
        """Write the requested files and return their paths."""
        written = []
        if deck is not None:
            write_whole(deck, self.found.deck.text.encode())
        if bom is not None:
            parts = self.found.circuit, self.backend.level, self.backend.series
            write_whole(bom, bill_of(*parts).encode())
        if figures is not None and self.found.run is not None:
            written.append(plotting.save(self._figure(self.found.run), figures / "circuit.png"))
        if trajectory is not None and self.found.run is not None:
            labelled = replace(self.found.run.trajectory, units=self.units)
            write_curves(replace(self.found.run, trajectory=labelled), trajectory)
        if json_file is not None:
            write_json(json_file, self.as_dict())
        return written + [file for file in (deck, bom, trajectory, json_file) if file is not None]

    def _figure(self, run: CircuitRun) -> Figure:
        """Return the figure of the simulation: every neuron of a network of a file."""
        if self.problem is not None:
            return plotting.circuit(run, self.problem)
        reached = "completed" if self.found.moves else run.unsettled or "settled"
        return neurons(run, f"circuit, {self.backend.level.name}: {reached}")


def assumed(level: Level) -> dict[str, str]:
    """Return a row with the assumed tolerances if the level does not state any.

    >>> from ann_dc.hardware.parts import macro, presets
    >>> assumed(macro()).keys(), assumed(presets.get("opa192_ad734")).keys()
    (dict_keys(['assumed']), dict_keys([]))
    """
    return {} if level.datasheet.tolerances is not None else {"assumed": str(level.tolerances)}


def parts_in_words(backend: SpiceBackend) -> str:
    """Return a description of the parts of a backend's circuits.

    >>> from ann_dc.hardware.parts import E96
    >>> parts_in_words(SpiceBackend()), parts_in_words(SpiceBackend(seed=3, series=E96))
    ('nominal parts', 'parts drawn with seed 3, resistors of E96')
    """
    seed, series = backend.seed, backend.series
    parts = "nominal parts" if seed is None else f"parts drawn with seed {seed}"
    return parts + f", resistors of {series.name}" * bool(series.mantissas)
