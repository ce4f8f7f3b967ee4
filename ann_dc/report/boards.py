"""Reports of analyses of one circuit: PVT corners, converters, yield and trimming."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
from rich.table import Table
from rich.text import Text

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.fidelity.boards.corners import Corner
from ann_dc.fidelity.boards.interface import InterfaceCost
from ann_dc.fidelity.boards.trimming import DRAWN, Trimming
from ann_dc.fidelity.boards.yields import CircuitYield, Spot
from ann_dc.fidelity.circuit_study import NEAR
from ann_dc.fidelity.noise_run import noisy
from ann_dc.hardware.parts.datasheet import Kind
from ann_dc.report.circuit import assumed, parts_in_words
from ann_dc.report.json_file import picked, write_json
from ann_dc.report.tables import named_rows, table, verdict_text


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardReport:
    """Results of all requested analyses of a circuit.

    ``subject`` has the name of the problem, or the title of a network without one.
    """

    subject: Mapping[str, str]
    backend: SpiceBackend
    answers: Sequence[CornerTable | YieldTable | TrimTable | InterfaceTable]

    @property
    def good(self) -> bool:
        """True if every result is good."""
        return all(answer.good for answer in self.answers)

    def tables(self) -> list[Table]:
        """Return the tables to print."""
        return [shown for answer in self.answers for shown in answer.tables()]

    def as_dict(self) -> dict:
        """Return the content of the JSON file."""
        backend = self.backend
        found = {
            **self.subject,
            "level": backend.level.name,
            "seed": backend.seed,
            "resistors": backend.series.name,
        }
        for answer in self.answers:
            found |= answer.as_dict()
        return found

    def write(self, *, json_file: Path | None = None) -> list[Path]:
        """Write the JSON file and return its path in a list."""
        if json_file is None:
            return []
        write_json(json_file, self.as_dict())
        return [json_file]


WIDE = 3
"""Standard deviations of the worst control that the largest circuit error rarely exceeds."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CornerTable:
    """Report of a circuit at several operating conditions."""

    corners: Sequence[Corner]
    backend: SpiceBackend

    @property
    def good(self) -> bool:
        """True if the circuit settles near the optimum at all operating conditions."""
        return all(corner.within_tolerance for corner in self.corners)

    def tables(self) -> list[Table]:
        """Return the tables to print."""
        columns = "C", "supply", "process", "error", "settling", "settles", "clips", "spread"
        shown = table(*(f"{name}  " for name in (*columns, "noise")), dense=True)
        shown.title = (
            f"{self.backend.level.name} parts: control error relative to the largest control, "
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
            return "the drift of these parts is unknown: tolerances do not depend on temperature"
        return "resistors and offsets of op amps drift; the drift of multipliers is unknown"

    def _doubt(self) -> str:
        """Return the effect of tolerances on the verdict."""
        if all(math.isnan(corner.spread) for corner in self.corners):
            level = self.backend.level
            drawn = level.emulated and not level.transistors
            return "the spread is unknown" + "; --yield draws circuits" * drawn
        if self.backend.seed is not None:
            return ""
        wide = [
            c
            for c in self.corners
            if c.within_tolerance and c.control_error + WIDE * c.spread > NEAR
        ]
        if not wide:
            return ""
        parts = parts_in_words(self.backend)
        return (
            f"at {len(wide)} of {len(self.corners)} corners {parts} are within {NEAR:.0%}, and "
            f"{WIDE} spreads exceed it: --yield draws circuits"
        )

    def as_dict(self) -> dict:
        """Return the content of the JSON file."""
        return {
            "corners": [
                asdict(corner) | {"within_tolerance": corner.within_tolerance}
                for corner in self.corners
            ]
        }


def _figures(corner: Corner) -> tuple[float, str, str, str, Text, Text, str, str]:
    """Return the displayed values of a corner except the supply, which rarely matters."""
    return (
        corner.conditions.temperature,
        corner.conditions.process,
        _reported(corner.control_error, "{:.2e}"),
        _us(corner.settling_time),
        Text("yes" if corner.stable else "no", "green" if corner.stable else "red"),
        Text("yes" if corner.clipped else "no", "red" if corner.clipped else ""),
        _reported(corner.spread, "{:.2e}"),
        _reported(corner.noise, "{:.1e}"),
    )


def _reported(value: float, form: str) -> str:
    """Format a number; return a dash if it is not finite."""
    return form.format(value) if math.isfinite(value) else "-"


@dataclass(frozen=True, kw_only=True, eq=False)
class InterfaceTable:
    """Report of the cost of an interface."""

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
                f"{chosen.dac_bits} bits: control error {cost.input_error:.2e} with these "
                f"inputs, {cost.worst_input_error:.2e} at most with nearby inputs"
            )
        if chosen.adc_bits is not None:
            rows["controls"] = f"{chosen.adc_bits} bits: {cost.output_error:.2e} at most"
        if chosen.dac_bits is not None and chosen.adc_bits is not None:
            rows["both"] = f"{cost.error:.2e} relative to the controls with these inputs, as read"
        rows["parts included"] = verdict_text(self.good, self._verdict())
        rows["solution"] = (
            f"{_us(cost.settling_time)} settling and {_us(chosen.seconds)} conversion: "
            f"{_us(cost.solve_time)}"
        )
        rows["cold start"] = (
            f"by emulation {cost.other_equilibrium}; saturation of parts is not emulated: "
            "preset the integrators, or simulate in ngspice"
            if cost.other_equilibrium
            else f"within settling {_us(cost.cold_settling_time)} after discharge by the reset "
            "switches, without preset sources"
            if math.isfinite(cost.cold_settling_time)
            else "does not settle: preset the integrators"
        )
        return [named_rows(rows)]

    def _verdict(self) -> str:
        cost = self.cost
        if math.isnan(cost.circuit_error):
            return "the circuit oscillates"
        if math.isnan(cost.settling_time):
            return "the circuit does not reach its equilibrium"
        return (
            f"{cost.total_error:.2e} at most, nearby inputs included; {cost.circuit_error:.2e} "
            f"from the circuit, with {parts_in_words(self.backend)}"
            + f"; noise of {cost.noise:.1e} rms in addition"
            * math.isfinite(cost.noise)
        )

    def as_dict(self) -> dict:
        """Return the content of the JSON file."""
        return {"interface": asdict(self.cost) | picked(self.cost, "total_error", "solve_time")}


def _us(seconds: float) -> str:
    return _reported(seconds * 1e6, "{:.4g} us")


@dataclass(frozen=True, kw_only=True, eq=False)
class YieldTable:
    """Report of a circuit yield."""

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
        rows |= _drawn_from(self.backend)
        if len(stable):
            median, most = np.quantile(stable, [0.5, 0.95])
            rows["control error"] = (
                f"{median:.2e} median, {most:.2e} for 95 % of the stable circuits"
            )
        rows["noise"] = _noise_told(found.noise)
        rows["do not settle"] = f"{len(found.errors) - len(stable)} of {len(found.errors)}"
        if untimed := [why for why in found.unknown if why]:
            rows["settling time"] = (
                f"unknown for {len(untimed)} circuits, which count as failed: "
                + ("; ".join(dict.fromkeys(untimed)))
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
        return (
            f"no circuit meets the specification; seed {found.seeds[found.closest]}: "
            f"{error:.2%}{after}"
        )

    def _spots(self) -> Table:
        timed = "settling_time" in self.yielded.spec.limits
        times = ("settling", "in ngspice") if timed else ()
        columns = "seed", "error", "in ngspice", *times, "meets the specification", ""
        shown = table(*(f"{name}  " for name in columns), dense=True)
        shown.title = "simulated samples: predicted and ngspice"
        for spot in self.yielded.spots:
            both = spot.predicted_time, spot.measured_time
            shown.add_row(
                str(spot.seed),
                _reported(spot.predicted, "{:.2e}"),
                _reported(spot.measured, "{:.2e}"),
                *(_us(time) for time in both[: len(times)]),
                " / ".join("yes" if kept else "no" for kept in spot.kept),
                self._agreement(spot),
            )
        return shown

    def _agreement(self, spot: Spot) -> Text:
        if not spot.agreed:
            return Text("disagree", "red")
        same = spot.kept[0] == spot.kept[1]
        return Text("agree", "green") if same else Text("near the limit", "yellow")

    def as_dict(self) -> dict:
        """Return the content of the JSON file."""
        found, share = self.yielded, self.yielded.found
        return {
            "yield": {
                "spec": str(found.spec),
                "passed": share.passed,
                "samples": share.count,
                **picked(share, "share", "interval"),
                **picked(found, "errors", "noise", "settling_times", "unknown", "closest"),
                "spots": [asdict(spot) for spot in found.spots],
            }
        }


def _noise_told(noise: float) -> str:
    """Return the description of the noise that a verdict includes."""
    if np.isnan(noise):
        return "not computed, not included"
    return f"{noise:.1e} rms, relative to the largest control, included in every error"


def _drawn_from(backend: SpiceBackend) -> dict[str, str]:
    """Return rows of the common properties of drawn circuits and assumed tolerances."""
    series = backend.series
    if not series.mantissas:
        return assumed(backend.level)
    bought = (
        f"{series.name}, capacitors of {series.capacitors.name}, with their tolerances in addition"
    )
    return {"resistors": bought} | assumed(backend.level)


SHOWN, BEGUN = 40, 5
"""Printed steps of a sufficient and of an insufficient procedure; the JSON file contains all."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrimTable:
    """Report of a trimming procedure."""

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
            "linearised": f"{by_slopes}{found.places}",
            "noise": _noise_told(found.noise),
            **_drawn_from(self.backend),
        }
        return [named_rows(rows), *([self._steps()] if found.steps else [])]

    def _verdict(self) -> Text:
        """Return the verdict on the steps from drawn circuits."""
        found, said = self.found, self._emulated()
        if found.reached:
            return verdict_text(True, said)
        if found.kept.high >= found.share and found.kept.passed:
            return Text(f"undecided: {said}; draw more (--samples)", "yellow")
        series, level = self.backend.series, self.backend.level
        coarse = series.largest_error > level.tolerances.size(Kind.RESISTOR)
        means = f"{series.name} rounds by up to {series.largest_error:.1%}; use --series E96-pairs"
        advice = means if coarse else "use better resistors or parts"
        return verdict_text(False, f"{said}: {advice}")

    def _emulated(self) -> str:
        found = self.found
        before, after = (
            np.quantile(errors, found.share, method="inverted_cdf")
            for errors in (found.before, found.after)
        )
        number = f"{len(found.steps)} trims"
        said = f"{number} bring {found.share:.0%} of {len(found.after)} emulated circuits to "
        said += f"{_share(after)}, from {_share(before)}; {found.kept} meet it"
        lost = int(np.isinf(found.after).sum())
        said += f", {lost} do not settle" * bool(lost)
        return said

    def _steps(self) -> Table:
        shown = table("", "trim  ", "cell  ", "measurement and set value  ", "remains", dense=True)
        shown.title = "trims in this order, and the control error that remains linearised"
        most = SHOWN if self.found.reached else BEGUN
        for number, step in enumerate(self.found.steps[:most], 1):
            name, left = step.parameter.name, f"{step.remaining:.2%}"
            shown.add_row(f"{number} ", f"{name} ", str(step.stage), f"{step.reading} ", left)
        if len(self.found.steps) > most:
            shown.caption = f"and {len(self.found.steps) - most} more (--json)"
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
                **picked(found, "error", "share", "reached", "untrimmed", "remaining"),
                "kept": found.kept.passed,
                "trims": found.places,
                **picked(found, "noise", "floor", "before", "after"),
                "steps": steps,
            }
        }


def _share(error: float) -> str:
    return f"{error:.2%}" if np.isfinite(error) else "not settled"
