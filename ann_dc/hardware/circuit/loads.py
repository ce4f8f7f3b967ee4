"""Loads of the op amps of a circuit: resistors from outputs to virtual grounds.

Op amps of clamps drive the resistors in series with the references of their limits. Loads reduce
the gain and the bandwidth of op amps, and the output of multipliers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.circuit import CLAMP_REFERENCE, HOLD, Circuit
from ann_dc.hardware.circuit.scaling import built_range
from ann_dc.hardware.parts.generator_curves import Curves, Polynomial
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.elements import (
    Adder,
    Generator,
    GridNode,
    Integrator,
    Multiplier,
    Part,
    PICell,
    Wire,
)
from ann_dc.hardware.schematic.preconditioner_wiring import OWN
from ann_dc.validation import State, checked


@dataclass(frozen=True, kw_only=True)
class Load:
    """Heaviest load of a circuit: that of a part in a cell, or of the inverter behind the part.

    ``amperes`` is the current at the largest voltage of the probe run, with all virtual grounds at
    zero. For moving op amps, capacitors are discharged.
    """

    part: str
    inverter: bool
    stage: int
    amperes: float

    def __str__(self) -> str:
        what = "the inverter of " if self.inverter else ""
        return f"{what}{self.part} of cell {self.stage}"


@checked
def loads_of(circuit: Circuit) -> dict[tuple[str, bool], np.ndarray]:
    """Return the static load conductance of op amps, multipliers and generators.

    Keys are (part name, True for the inverter behind the part), values (N,) arrays in siemens. They
    include the resistors into readers of the output and the feedback that carries current at rest.
    """
    schematic = circuit.schematic
    stages = schematic.network.stages
    found: dict[tuple[str, bool], np.ndarray] = {}
    for part in schematic.parts:
        found.setdefault((part.name, False), np.zeros(stages))
        if isinstance(part, (Multiplier, Generator)):
            continue
        found[part.name, False] += _feedback(circuit, part)
        if part.name in schematic.inverted:
            found[part.name, False] += 1 / circuit.inverter
            found[part.name, True] = np.full(stages, 1 / circuit.inverter)
    for name, inverter, stage, siemens in _read(circuit):
        if (name, inverter) in found:
            found[name, inverter][stage] += siemens
    return found


def drawn_of(circuit: Circuit, gain_rule: Curves | None) -> dict[str, np.ndarray]:
    """Return the number (N,) of multiplier inputs that draw current from each part.

    Rectifying neurons have none, because current mirrors supply the currents at their outputs. With
    the fitting method ``gain_rule`` for function generators, the multipliers of polynomial
    generators are included.
    """
    schematic, scaling = circuit.schematic, circuit.scaling
    found: dict[str, np.ndarray] = {}
    for part in schematic.parts:
        inputs: list[str] = []
        if isinstance(part, Multiplier):
            inputs = [part.a, part.b]
        elif isinstance(part, Generator) and isinstance(gain_rule, Polynomial):
            fitted = gain_rule.fit(part.function, *built_range(part, scaling))
            inputs = [part.x] * fitted.inputs
        for name in map(schematic.carrier, inputs):
            if name in schematic.diode_neurons:
                continue
            count = found.setdefault(name, np.zeros(schematic.network.stages))
            for stage in np.flatnonzero(schematic.alive_at(part.name)).tolist():
                count[schematic.cell_of(name, stage)] += 1
    return found


@checked
def load_power(circuit: Circuit, level: Level, x: State) -> float:
    """Return a lower bound in watts on the supply power of static op-amp loads.

    The output swings are taken as supply voltages, and ``x`` (n,) is the settled state of the ideal
    network. The power is zero for transistor op amps, which supply their loads from their quiescent
    current, and for parts without output swing.
    """
    if level.transistors or not np.isfinite(level.datasheet.output_swing):
        return 0.0
    network, scaling = circuit.schematic.network, circuit.scaling
    values = evaluator(network).values(x)[..., 1:-1]
    amperes = 0.0
    for (name, _), siemens in loads_of(circuit).items():
        if name in network.node_index:  # others are of a preconditioner, whose nodes rest at zero
            volts = np.abs(scaling.volts(name, values[network.node_index[name]]))
            amperes += float((siemens * volts)[circuit.schematic.alive_at(name)].sum())
    siemens = level.datasheet.gbw / CLAMP_REFERENCE
    for part in circuit.schematic.limited:
        own = values[network.node_index[part.name]]
        amperes += siemens * _volts_to_rails(circuit, part, own)
    return amperes * level.datasheet.output_swing


@checked
def heaviest(circuit: Circuit) -> Load:
    """Return the load of the op amp with the largest output current."""
    peaks, schematic = circuit.scaling.peaks, circuit.schematic
    best = Load(part="", inverter=False, stage=0, amperes=0.0)
    for (name, inverter), siemens in loads_of(circuit).items():
        if isinstance(schematic.by_name[name], (Multiplier, Generator)):
            continue
        volts = circuit.scaling.volts(name, peaks[name].value) if name in peaks else 0.0
        moving = 0.0 if inverter else moving_load(circuit, name)
        amperes = np.where(schematic.alive_at(name), (siemens + moving) * volts, 0.0)
        if amperes.max() > best.amperes:
            stage = int(amperes.argmax())
            best = Load(part=name, inverter=inverter, stage=stage, amperes=float(amperes[stage]))
    return best


def moving_load(circuit: Circuit, name: str) -> float:
    """Return the feedback load (siemens) of a PI cell, active only while it moves."""
    holds = isinstance(circuit.schematic.by_name[name], PICell)
    return 1 / circuit.feedback[name] if holds else 0.0


def _volts_to_rails(circuit: Circuit, part: Integrator, values: np.ndarray) -> float:
    """Return the volts from an integrator's output to its limits, summed over cells."""
    volts = circuit.schematic.polarity[part.name] * circuit.scaling.volts(part.name, values)
    rails = [rail for rail in circuit.limits(part) if np.isfinite(rail)]
    return sum(float(np.abs(rail - volts)[part.present].sum()) for rail in rails)


def _feedback(circuit: Circuit, part: Part) -> float:
    """Return the resistive feedback and ground load of an output in siemens."""
    held = 1 / (HOLD * circuit.inverter) if part.name in circuit.schematic.diode_neurons else 0.0
    return held + (1 / circuit.feedback[part.name] if isinstance(part, Adder) else 0.0)


def _read(circuit: Circuit) -> Iterator[tuple[str, bool, int, float]]:
    """Yield part, inverter flag, stage and siemens of every resistor from an op amp."""
    schematic = circuit.schematic
    for part in schematic.parts:
        if isinstance(part, (Multiplier, Generator)):
            continue
        for number, wire in enumerate(part.wires):
            grid = isinstance(part, GridNode)
            if grid and not wire.source.startswith(OWN):
                continue
            for stage, ohms in enumerate(circuit.resistors[part.name][number]):
                if np.isfinite(ohms):
                    yield from _ends(circuit, part, wire, stage, ohms)


def _ends(
    circuit: Circuit, part: Part, wire: Wire, stage: int, ohms: float
) -> Iterator[tuple[str, bool, int, float]]:
    """Yield the output at the source of a resistor; for a grid, both outputs."""
    schematic = circuit.schematic
    source = schematic.carrier(wire.source)
    where = schematic.cell_of(source, stage + wire.offset)
    given = source not in schematic.polarity or (source, where) in schematic.pins
    if given or not 0 <= where < schematic.network.stages:
        return
    if isinstance(part, GridNode):
        yield from ((source, inverter, where, 1 / ohms) for inverter in (False, True))
        return
    sign = int(schematic.reading(part, wire)[stage])
    inverted = sign != schematic.polarity[source] and not schematic.differential
    yield source, inverted, where, 1 / ohms


class Outputs:
    """Outputs of the parts of a circuit under load.

    If ``inverter`` is true, methods refer to the inverter behind a part. ``omega`` is the
    gain-bandwidth product of the op amps, in radians per unit of network time.
    """

    def __init__(self, circuit: Circuit, level: Level) -> None:
        sheet = level.datasheet
        self.circuit, self.datasheet, self.law = circuit, sheet, sheet.multiplier_law
        self.omega = 2 * math.pi * sheet.gbw * circuit.scaling.time
        loaded = sheet.rout or sheet.stage_resistance or self.law.output_resistance
        self._loads = loads_of(circuit) if loaded else {}
        self._drawn = drawn_of(circuit, level.functions) if self.law.input_current else {}
        self._none = np.zeros(circuit.schematic.network.stages)

    def gain(self, part: str, inverter: bool = False) -> np.ndarray:
        """Return the open-loop gain (N,) of an op amp into its static load."""
        return self.datasheet.a0 / (1 + self._ohms * self._load(part, inverter))

    def lag(self, part: str, inverter: bool = False) -> np.ndarray:
        """Return 1 / Omega (N,), with Omega reduced by the dynamic load of an op amp."""
        more = 0.0 if inverter else moving_load(self.circuit, part)
        return (1 + self.datasheet.rout * (self._load(part, inverter) + more)) / self.omega

    def offset(self, part: str, inverter: bool = False) -> np.ndarray:
        """Return the offset (N,) at an op amp's input in volts.

        It includes the effect of multiplier input currents at the output; multipliers read the part
        and not its inverter.
        """
        drawn = self._none if inverter else self._amperes(part)
        return self.datasheet.systematic_offset - self._ohms * drawn / self.datasheet.a0

    def passed(self, part: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the load factor and the added volts of a multiplier's output, each (N,).

        The factor is the fraction of the output that remains under load.
        """
        ohms = self.law.output_resistance
        return 1 / (1 + ohms * self._load(part, False)), -ohms * self._amperes(part)

    @property
    def _ohms(self) -> float:
        return self.datasheet.rout + self.datasheet.stage_resistance

    def _load(self, part: str, inverter: bool) -> np.ndarray:
        return self._loads.get((part, inverter), self._none)

    def _amperes(self, part: str) -> np.ndarray:
        return self.law.input_current * self._drawn.get(part, self._none)
