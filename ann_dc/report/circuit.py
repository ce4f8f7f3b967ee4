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
from ann_dc.report.tables import (
    compared_rows,
    headline,
    indented,
    measured,
    named_rows,
    table,
    unit_list,
)
from ann_dc.report.waveforms import (
    NEAR_TEXT,
    overloads,
    waveform_dict,
    waveform_errors,
    waveform_rows,
)
from ann_dc.si_prefixes import counted, engineering
from ann_dc.solution.solution import certificate_of, units_of

OTHER_EQUILIBRIA, LEAKS = 10e-12, 10e6
"""Farads below which parasitic capacitance matters, and ohms above which board leakage matters."""
VOLTS = 16
"""Largest number of outputs whose volt is listed."""
EXACT = "exact (no tolerance known): they do not contribute to the spread of settling times"
"""Remark on capacitors of parts that have other tolerances."""
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

    def tables(self) -> list[Table | Text]:
        """Return the headline and the tables to print: result, errors, checks, settings."""
        found = self.found
        errors = waveform_errors(found) if found.moves else self._compared()
        rows = waveform_rows(found) if found.moves else self._checks()
        rows |= self._errors() | self._settings()
        width = max(map(len, (*errors, *rows)))
        errors = {name: row for name, row in errors.items() if set(row[:2]) != {"-"}}
        both = compared_rows(("ngspice", "predicted"), errors, width)
        shown = [self._headline(), indented(both), indented(named_rows(rows, width))]
        if self.problem is None and found.run is not None:
            shown.append(neuron_table(neuron_values(found.run)))
        shown += [self._budget()] if found.items else []
        return [*shown, self._loops()] if found.loops else shown

    def _headline(self) -> Text:
        """Return the result in one line; it determines the exit code."""
        found, network = self.found, self.found.circuit.schematic.network
        name = network.title if self.problem is None else self.problem.name
        source = f"({'predicted' if found.run is None else 'ngspice'}, {self._conditions_of()})"
        goal = f"within {NEAR_TEXT} of the {self._goal} {found.terms} {source}"
        if found.unknown:
            result = "neither simulated nor predicted"
        elif found.moves:
            result = "not simulated" if found.run is None else f"completed {source}"
        else:
            result = f"not {goal}: {found.shortcoming}" if found.shortcoming else goal
        return headline(f"{name} on {self.backend.level.name}", result, self.good)

    @property
    def _goal(self) -> str:
        return "settled" if self.problem is None else "optimal"

    def _conditions_of(self) -> str:
        """Return the parts of the circuit and the errors that the result excludes."""
        is_counted = self.found.moves or math.isfinite(self.found.noise)
        return parts_in_words(self.backend) + ("" if is_counted else ", noise not computed")

    def _settings(self) -> dict[str, object]:
        found, level, cost = self.found, self.backend.level, self.found.cost
        written, scaling, run = found.deck, found.circuit.scaling, found.run
        parts = ", ".join(counted(count, name) for name, count in written.parts.items())
        power = f"; {engineering(cost.power - cost.loads, 'W', 3)} quiescent"
        power += f" + {engineering(cost.loads, 'W', 3)} loads" * bool(cost.loads)
        if math.isfinite(cost.energy):
            power += f", {engineering(cost.energy, 'J', 3)} per solution"
        return {
            "parts": parts + (power if cost.power > 0 else ""),
            "values": self._values(),
            "level": f"{level.name}{self._parts()}{self._drawn_with()}",
            **self._conditions(),
            **self._preconditioner(),
            "scaling": f"1 V = {self._a_volt()}; full scale {scaling.full_scale:g} V; "
            f"largest swing {scaling.used(scaling.tightest):.0%} of full scale in the ODE "
            f"({scaling.tightest})"
            + (f", {run.fullest} in the circuit" if run and run.fullest else ""),
            "time scale": f"unit time constant {engineering(written.timing.unit, 's', 3)}, "
            f"bandwidth margin {scaling.bandwidth_margin:.3g} (op amps relative to the fastest "
            "mode)",
            **self._subject(),
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
            offset = f" from {scale.offset:.4g}" * bool(scale.offset)
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
        """Return the preconditioner with its wire requirements, or why those are unknown."""
        kind = self.found.circuit.schematic.network.preconditioner.kind
        others = " (default of circuits; ann-dc solve selects among all preconditioners)"
        is_default = kind is PreconditionerKind.DIAGONAL and self.problem is not None
        rows: dict[str, object] = {"network": f"{kind.value} preconditioner{others * is_default}"}
        if self.found.undemanded:
            return rows | {"wires": f"requirements not computed: {self.found.undemanded}"}
        return rows if self.found.demand is None else rows | {"wires": self.found.demand}

    def _values(self) -> str:
        """Return the ranges of resistors and capacitors."""
        ohms, farads = self.found.circuit.ranges
        ohms = self.backend.series.nearest(np.array(ohms))
        strays = (
            f" (parasitic capacitance matters below {engineering(OTHER_EQUILIBRIA, 'F', 3)})"
            * bool(farads[0] < OTHER_EQUILIBRIA)
        )
        leaks = f" (board leakage matters above {engineering(LEAKS, 'ohm', 3)})" * bool(
            ohms[1] > LEAKS
        )
        least, most = (engineering(value, "ohm", 3) for value in ohms)
        farads = self.backend.series.capacitors.nearest(np.array(farads))
        small, large = (engineering(value, "F", 3) for value in farads)
        resistors = f"R {least} to {most}{leaks}, " if RESISTOR in self.found.deck.parts else ""
        with_limits = (
            bool(self.found.circuit.schematic.limited) and RESISTOR in self.found.deck.parts
        )
        clamps = "; clamps: --bom" * with_limits
        return f"{resistors}C {small} to {large}{strays}{clamps}"

    def _compared(self) -> dict[str, tuple[str, str, str]]:
        """Return the figures of ngspice and of the prediction, with their references."""
        found, run, size = self.found, self.found.run, f"relative to {self.found.size}"
        measured_error = measured_time = spread = "-"
        if run is not None:
            measured_error, spread = f"{run.control_error:.2e}", f"{run.mean_square_error:.1e}"
            measured_time = "not settled" if run.unsettled else _microseconds(run)
        prediction = found.prediction
        error = time = pole = "-"
        if prediction is not None:
            pole = f"{prediction.spectrum.abscissa:+.3g}"
            if prediction.stable and not prediction.other_equilibrium:
                error = f"{prediction.control_error:.2e}"
                if math.isfinite(prediction.settling_time):
                    time = f"{1e6 * prediction.settling_time:.4g} us"
        rows = {
            f"{found.terms.removesuffix('s')} error": (measured_error, error, size),
            "settling time": (measured_time, time, f"to 0.1 % of the {found.terms}"),
            "trajectory error": (spread, "-", "normalised mean square, against the ODE"),
            "slowest pole": ("-", pole, "per unit time constant"),
        }
        if math.isfinite(found.noise):
            kelvin = self.backend.level.conditions.kelvin
            rows["noise (rms)"] = ("-", f"{found.noise:.1e}", f"{size}, at {kelvin:.0f} K")
        return rows

    def _checks(self) -> dict[str, object]:
        run = self.found.run
        return {
            **self._prediction_note(),
            **self._difference(),
            **self._objective(),
            **({} if run is None else {"overload": overloads(run)}),
        }

    def _objective(self) -> dict[str, object]:
        """Return the row of the objective; a network without a problem has none."""
        certificate = self.certificate
        if certificate is None or self.problem is None:
            return {}
        return {
            "objective": f"{certificate.objective:.8g} {self.problem.cost_unit}".rstrip()
            + f", KKT residual {certificate.kkt_residual:.1e}"
            + f" (constraint violation {certificate.constraint_residual:.1e}: the objective may "
            "be below the optimum)" * bool(certificate.constraint_residual > KEPT),
        }

    def _difference(self) -> dict[str, object]:
        """Return the row that compares ngspice with the prediction, if there is one."""
        found = self.found
        if not math.isfinite(found.final_difference) or found.run is None:
            return {}
        text = (
            f"{found.final_difference:.1e} between the final {found.terms} of ngspice and "
            f"prediction, relative to {found.size}"
        )
        predicted = found.prediction.settling_time if found.prediction else math.nan
        measured_time = found.run.settling_time()
        if math.isfinite(predicted) and math.isfinite(measured_time) and predicted > 0:
            text += f"; {abs(measured_time / predicted - 1):.1%} between the settling times"
        return {"difference": text}

    def _drawn_with(self) -> str:
        if self.backend.seed is None:
            return ""
        alone = "; errors of transistors are drawn by their models in ngspice and not predicted"
        return f"; {parts_in_words(self.backend)}" + alone * (self.backend.level.models == PACKAGE)

    def _prediction_note(self) -> dict[str, object]:
        """Return the row of a prediction that lacks the error or the settling time."""
        found = self.found.prediction
        if found is None:
            return {"prediction": f"not available: {self.found.unpredicted}"}
        if not found.stable:
            return {"prediction": "oscillates: the slowest pole is unstable"}
        if found.other_equilibrium:
            return {"prediction": f"another equilibrium: {found.other_equilibrium}"}
        if not math.isfinite(found.settling_time):
            return {"prediction": f"settling time not computed: {found.unknown}"}
        return {}

    def _errors(self) -> dict[str, object]:
        found, rows = self.found, {}
        if self.backend.series.mantissas:
            rounding, series = found.series_rounding, self.backend.series
            rows["resistors"] = (
                f"{series.name}: rounding errors up to {rounding['resistor']:.2%}, equal in all "
                f"cells; capacitors of {series.capacitors.name}: {rounding['capacitor']:.2%}"
            )
        if found.unlooped:
            rows["loop gains"] = f"not computed: {found.unlooped}"
        if len(found.samples):
            rows |= {"drawn circuits": self._drawn()}
        if found.items or len(found.samples):
            rows |= assumed(self.backend.level)
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
            f"{len(samples)} (predicted); {within} of {len(samples)} within {NEAR:.0%}, noise "
            "included"
            + f"; {len(samples) - len(near)} settle at another equilibrium"
            * (len(near) < len(samples))
        )

    def _budget(self) -> Table:
        shown = table("part", "quantity", "deviation", "control error", "variance", dense=True)
        shown.title = (
            "error budget (standard deviation of one part in all cells): error of the most "
            "affected control, fraction of the variance of the circuit's worst control"
        )
        totals = sorted(self.found.budget_shares.items(), key=lambda total: -total[1])
        by_kind = ", ".join(f"{kind.parts} {share:.1%}" for kind, share in totals)
        shown.caption = f"variance of all parts by kind: {by_kind}"
        for item in self.found.items:
            volts = item.parameter.kind.unit == "V"
            size = f"{item.size * 1e3:.3g} mV" if volts else f"{item.size:.2%}"
            what = item.parameter.name, item.parameter.meaning, size
            shown.add_row(*what, f"{item.error:.2e}", f"{item.share:.1%}")
        return shown

    def _loops(self) -> Table:
        shown = table("op amp", "cell", "phase margin (deg)", "crossover (kHz)", dense=True)
        shown.title = "smallest phase margins (each loop is opened at the input of its op amp)"
        if self.found.prediction is not None and not self.found.prediction.stable:
            shown.title += "; the circuit oscillates: phase margins do not imply stability"
        for loop in self.found.loops:
            figures = f"{loop.phase_margin:.0f}", f"{loop.crossover * 1e-3:.4g}"
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
            "budget_shares": {k.value: share for k, share in found.budget_shares.items()},
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


def _microseconds(run: CircuitRun) -> str:
    """Return the settling time of a simulation with its significant digits."""
    return f"{measured(1e6 * run.settling_time(), 1e6 * run.settling_error)} us"


def assumed(level: Level) -> dict[str, str]:
    """Return a row with the assumed tolerances, or of exact capacitors, if there are such.

    The row of the capacitors is that of parts whose tolerances are known.

    >>> from ann_dc.hardware.parts import macro, presets
    >>> assumed(macro()).keys(), assumed(presets.get("opa192_ad734")).keys()
    (dict_keys(['assumed']), dict_keys(['capacitors']))
    """
    if level.datasheet.tolerances is None:
        return {"assumed": str(level.tolerances)}
    is_exact = not level.tolerances.capacitor and not level.transistors
    return {"capacitors": EXACT} if is_exact else {}


def parts_in_words(backend: SpiceBackend) -> str:
    """Return a description of the parts of a backend's circuits.

    >>> from ann_dc.hardware.parts import E96
    >>> parts_in_words(SpiceBackend()), parts_in_words(SpiceBackend(seed=3, series=E96))
    ('nominal parts', 'parts drawn with seed 3, resistors of E96')
    """
    seed, series = backend.seed, backend.series
    parts = "nominal parts" if seed is None else f"parts drawn with seed {seed}"
    return parts + f", resistors of {series.name}" * bool(series.mantissas)
