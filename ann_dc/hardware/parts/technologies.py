"""What a cell is built of: op amps with resistors, differential ones, transconductors, capacitors.

A technology writes the cards of one amplifying part (integrator, PI cell, adder); multipliers and
function generators are the same for all. Every technology computes with the same components: a
transconductor is 1/R, a switched capacitor h T C_f / (R C) per period.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ann_dc.backends.spice.netlist.cell_text import CellText, number
from ann_dc.backends.spice.netlist.op_amps import KINDS, feedback
from ann_dc.backends.spice.netlist.timing import RELEASE, Timing, reset_card
from ann_dc.errors import NetworkError, require_positive
from ann_dc.hardware.circuit.circuit import Components
from ann_dc.hardware.circuit.deviations import Deviations
from ann_dc.hardware.circuit.elements import Adder, Integrator, PICell
from ann_dc.hardware.emulation.emulation import Emulation, emulate
from ann_dc.hardware.emulation.transconductors import emulate_transconductors, paired
from ann_dc.hardware.parts.datasheet import Hardware, Kind

if TYPE_CHECKING:
    from ann_dc.backends.spice.netlist.deck import Writer


class Technology(Protocol):
    """What a level is built of."""

    @property
    def differential(self) -> bool:
        """Whether every signal is there with both signs."""
        ...

    def emulate(self, made: Components, hardware: Hardware, deviations: Deviations) -> Emulation:
        """The circuit as a network again.

        Raises
        ------
        NetworkError
            If it has none.
        """
        ...

    @property
    def clocked(self) -> bool:
        """Whether it computes in periods of a clock."""
        ...

    @property
    def both_signs(self) -> bool:
        """Whether amplifiers and multipliers have a second, negative output of their own."""
        ...

    @property
    def without(self) -> tuple[Kind, ...]:
        """Errors of parts that its cells do not have."""
        ...

    @property
    def cells(self) -> tuple[str, ...]:
        """Files of ``circuits/cells``."""
        ...

    @property
    def models(self) -> tuple[str, ...]:
        """Files of ``circuits/models/<level>``."""
        ...

    def amplifier(self, writer: Writer, text: CellText, part, stage: int) -> None:
        """Cards of an integrator, PI cell or adder."""
        ...

    def timing(self, time_scale: float, duration: float, points: int) -> Timing:
        """When what happens, for a run of ``duration`` network time."""
        ...

    def control(self, timing: Timing) -> list[str]:
        """Cards of reset and clocks."""
        ...


class _Continuous:
    """Timing of circuits without a clock."""

    clocked = False
    both_signs = False
    without: tuple[Kind, ...] = ()
    models = ("opamp", "mul4q", "func")

    def emulate(self, made: Components, hardware: Hardware, deviations: Deviations) -> Emulation:
        """Op amps with their poles; see `ann_dc.hardware.emulation.emulation`."""
        return emulate(made, hardware, deviations)

    def timing(self, time_scale: float, duration: float, points: int) -> Timing:
        """Reset for a thousandth of a unit of network time, then run."""
        release = RELEASE * time_scale
        span = duration * time_scale
        return Timing(release=release, end=release + span, step=span / points, unit=time_scale)

    def control(self, timing: Timing) -> list[str]:
        """Reset switches open at ``release``."""
        return [reset_card(timing.release)]


@dataclass(frozen=True)
class OpAmps(_Continuous):
    """Op amps with resistors at a virtual ground; an inverter where the other sign is needed."""

    differential = False
    cells = ("integ", "pi_cell", "sum", "inv")

    def amplifier(self, writer: Writer, text: CellText, part, stage: int) -> None:
        """Resistors into a summing node, and the op amp with its feedback."""
        alias = writer.alias[part.name]
        summing = f"@s__{alias}"
        for name, source, ohms in writer.resistors(part, stage):
            value = text.value(name, ohms)
            nodes = source, summing
            text.card(name.replace("r_", "R_", 1), nodes, value, {}, counts_as="resistor")
        out = writer.own(part.name, stage)
        nodes = (summing, out) if isinstance(part, Adder) else (summing, out, "rst")
        text.card(f"X_{alias}", nodes, KINDS[type(part)], feedback(writer, text, part, stage))


@dataclass(frozen=True)
class DifferentialPairs(OpAmps):
    """Fully differential op amps: two summing nodes and outputs, twice the R and C, no inverter."""

    differential = True
    both_signs = True
    cells = ("integ_fd", "pi_cell_fd", "sum_fd", "mul4q_fd")
    models = ("opamp_fd", "mul4q", "func")

    def amplifier(self, writer: Writer, text: CellText, part, stage: int) -> None:
        """Each resistor twice, the second one from the other sign to the other summing node."""
        alias = writer.alias[part.name]
        grounds = f"@sp__{alias}", f"@sn__{alias}"
        for name, source, ohms in writer.resistors(part, stage):
            value = text.value(name, ohms)
            for half, summing, given in zip("pn", grounds, (source, writer.opposite(source))):
                nodes = given, summing
                text.card(f"R{half}_{name[2:]}", nodes, value, {}, counts_as="resistor")
        out = writer.own(part.name, stage)
        ends = (out, writer.opposite(out), *(() if isinstance(part, Adder) else ("rst",)))
        kind = KINDS[type(part)] + "_fd"
        text.card(f"X_{alias}", (*grounds, *ends), kind, feedback(writer, text, part, stage))


@dataclass(frozen=True)
class OtaC(_Continuous):
    """Transconductors into one node a neuron; equal and opposite weights share one pair.

    Attributes
    ----------
    linear_range : float
        Volts of the tanh, over full scale.
    """

    linear_range: float = 30.0
    differential = True
    without = (Kind.OFFSET,)
    cells = ("ota", "ota_diff", "ota_node", "ota_pi", "ota_sum")
    models = ("mul4q", "func")

    def emulate(self, made: Components, hardware: Hardware, deviations: Deviations) -> Emulation:
        """Transconductors with their curvature; see `ann_dc.hardware.emulation.transconductors`."""
        return emulate_transconductors(made, hardware, deviations, linear_range=self.linear_range)

    def amplifier(self, writer: Writer, text: CellText, part, stage: int) -> None:
        """One transconductor a weight, or one for two weights that only differ in sign."""
        alias, made = writer.alias[part.name], writer.made
        out = writer.own(part.name, stage)
        range_ = number(self.linear_range * writer.scaling.full_scale)
        weights = [
            (name, writer.plain(source), -writer.sign(source) / ohms)
            for name, source, ohms in writer.resistors(part, stage)
        ]
        for name, nodes, gm in paired(weights):
            given = {"gm": text.value(name.replace("r_", "gm_", 1), gm), "vl": range_}
            kind = "ota" if len(nodes) == 1 else "ota_diff"
            text.card(f"Xw_{name[2:]}", (*nodes, out), kind, given)
        total = sum(abs(gm) for _, _, gm in weights)
        loads = feedback(writer, text, part, stage, offset=False)
        if np.isfinite(writer.level.hardware.a0):
            ohms = writer.level.hardware.a0 / max(total, 1e-300)
            loads["ro"] = text.value(f"ro_{alias}", ohms)
        kind = {Integrator: "ota_node", PICell: "ota_pi", Adder: "ota_sum"}[type(part)]
        nodes = (out,) if part.name not in made.capacitors else (out, "rst")
        text.card(f"X_{alias}", nodes, kind, loads)


@dataclass(frozen=True, kw_only=True)
class SwitchedCapacitors:
    """Parasitic-insensitive switched-capacitor branches: forward Euler, one step a period.

    Attributes
    ----------
    step : float
        Network time of a period.
    clock : float
        Hz.
    unit_capacitor : float
        Feedback capacitor of every neuron in farads.
    on_resistance : float
        Of a switch, in ohms.
    overlap : float
        Capacitance from clock to signal at every switch terminal, in farads: charge injection.
    """

    step: float
    clock: float = 1e6
    unit_capacitor: float = 1e-12
    on_resistance: float = 1e3
    overlap: float = 0.0

    differential = True
    clocked = True
    both_signs = False
    without = ()
    cells = ("sc_integ", "sum", "sc_branch", "sc_static", "clk2")
    models = ("opamp", "mul4q", "func")

    def __post_init__(self) -> None:
        require_positive(
            step=self.step,
            clock=self.clock,
            unit_capacitor=self.unit_capacitor,
            on_resistance=self.on_resistance,
        )
        if not 0 <= self.overlap < np.inf:
            raise NetworkError(f"overlap: expected a capacitance in farads, got {self.overlap!r}")

    def amplifier(self, writer: Writer, text: CellText, part, stage: int) -> None:
        """A branch a weight, into an op amp with the unit capacitor across it."""
        alias, made = writer.alias[part.name], writer.made
        if isinstance(part, Adder):
            OP_AMPS.amplifier(writer, text, part, stage)
            return
        summing, out = f"@s__{alias}", writer.own(part.name, stage)
        unit = self.unit_capacitor
        per_period = self.step * writer.scaling.time
        for name, source, ohms in writer.resistors(part, stage):
            plain = writer.opposite(source)  # a branch does not invert, a static capacitor does
            ratio = per_period / (ohms * made.capacitors[part.name][stage])
            sampled = {
                "c": text.value(name.replace("r_", "cs_", 1), ratio * unit),
                "ron": number(self.on_resistance),
                "cov": number(self.overlap),
            }
            nodes = (plain, summing, "p1", "p2")
            text.card(f"Xw_{name[2:]}", nodes, "sc_branch", sampled)
            if isinstance(part, PICell):
                static = unit * writer.off(f"rf_{alias}", stage, made.feedback[part.name]) / ohms
                given = {"c": text.value(name.replace("r_", "cp_", 1), static)}
                text.card(f"Xp_{name[2:]}", (source, summing), "sc_static", given)
        start = float(made.presets[part.name][stage])
        if isinstance(part, PICell):
            start = writer.start_volts(part.name, stage)
        given = {
            "c": writer.value(text, f"c_{alias}", stage, unit),
            "v0": text.value(f"v0_{alias}", start),
            "vos": writer.value(text, f"vos_{alias}", stage),
        }
        text.card(f"X_{alias}", (summing, out, "rst"), "sc_integ", given)

    def emulate(self, made: Components, hardware: Hardware, deviations: Deviations) -> Emulation:
        """Not there: a clocked circuit is the recurrent layer, with errors of 13 / A0."""
        raise NetworkError(
            "emulation: a switched-capacitor circuit is no network in continuous time; run the "
            "recurrent layer with the same step"
        )

    def timing(self, time_scale: float, duration: float, points: int) -> Timing:
        """Reset opens in the first sampling phase; the state is read at the end of each period."""
        period = 1 / self.clock
        cycles = max(int(np.ceil(duration / self.step - 1e-9)), 1)
        samples = np.concatenate([[0.45 * period], (1 + np.arange(cycles)) * period])
        return Timing(
            release=0.25 * period,
            end=(cycles + 0.01) * period,
            step=period / 10,
            unit=period / self.step,
            samples=samples,
        )

    def control(self, timing: Timing) -> list[str]:
        """Two-phase clock and reset."""
        period = 1 / self.clock
        times = f"t={number(period)} gap={number(0.04 * period)} tr={number(0.01 * period)}"
        return [f"X_clock p1 p2 clk2 {times}", reset_card(timing.release)]


OP_AMPS = OpAmps()
DIFFERENTIAL_PAIRS = DifferentialPairs()
