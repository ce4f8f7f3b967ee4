"""What the op amps of a circuit have to drive: resistors from their outputs to virtual grounds.

Those of clamps drive what lies before the references of their rails.

What loads do at outputs: to the gain and the pole of op amps, to what multipliers give.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.circuit import CLAMP_REFERENCE, HOLD, Circuit
from ann_dc.hardware.circuit.generators import built_range
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
from ann_dc.hardware.schematic.metric_wiring import OWN
from ann_dc.validation.checked import checked
from ann_dc.validation.values import State


@dataclass(frozen=True, kw_only=True)
class Load:
    """The heaviest load of a circuit.

    Attributes
    ----------
    part : str
        Whose op amp it is.
    inverter : bool
        Whether it is that of the inverter behind the part.
    stage : int
        Its cell, from 0.
    amperes : float
        At the largest voltage of the probe run, with all virtual grounds at zero and, for those who
        move, capacitors empty.
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
    """Conductance of what op amps, multipliers and function generators drive at rest.

    Parameters
    ----------
    circuit : Circuit

    Returns
    -------
    dict of (part name, bool) to (N,) array
        In siemens, by the part and whether the inverter behind it is meant: resistors into what
        reads its output, and its own feedback where current flows through that at rest.

    Examples
    --------
    An integrator drives the resistor of its leak, and nothing else:

    >>> from ann_dc.hardware.circuit import ProbeRun, circuit_of, scale
    >>> from ann_dc.hardware.schematic import schematic_of
    >>> from ann_dc.network import Cell, Connection, Network, Neuron
    >>> wires = [Connection(source=s, target="x", weight=w) for s, w in (("x", -1.0), ("one", 0.5))]
    >>> row = Network(stages=1, cell=Cell(neurons=(Neuron(name="x"),), connections=tuple(wires)))
    >>> probe = ProbeRun(states=np.array([[0.0], [0.5]]), times=np.array([0.0, 10.0]), radius=1.0)
    >>> circuit = circuit_of(schematic_of(row), scale(row, probe))
    >>> {name: float(1 / siemens[0]) for name, siemens in loads_of(circuit).items()}
    {('x', False): 10000.0}
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


def drawn_of(circuit: Circuit, recipe: Curves | None) -> dict[str, np.ndarray]:
    """How many inputs of multipliers draw a current from the outputs of parts.

    Diode neurons have none: what their outputs are to give comes from mirrors.

    Parameters
    ----------
    circuit : Circuit
    recipe : Curves or None
        By which its function generators are made; those of a polynomial have multipliers, too.

    Returns
    -------
    dict of part name to (N,) array
    """
    schematic, scaling = circuit.schematic, circuit.scaling
    found: dict[str, np.ndarray] = {}
    for part in schematic.parts:
        inputs: list[str] = []
        if isinstance(part, Multiplier):
            inputs = [part.a, part.b]
        elif isinstance(part, Generator) and isinstance(recipe, Polynomial):
            fitted = recipe.fit(part.function, *built_range(part, scaling))
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
    """Watts that supplies give for what op amps drive at rest: at least, with rails for supplies.

    Parameters
    ----------
    circuit : Circuit
    level : Level
        Of the circuit. Op amps of transistors let their loads have a part of what they draw
        anyway: of those it is zero, and of parts without rails.
    x : (n,) array
        Settled state of the ideal network.

    Returns
    -------
    float

    Examples
    --------
    A node of 0.83 V drives 10 kohm from 13 V:

    >>> from ann_dc.hardware.circuit import ProbeRun, circuit_of, scale
    >>> from ann_dc.hardware.parts import macro
    >>> from ann_dc.hardware.schematic import schematic_of
    >>> from ann_dc.network import Cell, Connection, Network, Neuron
    >>> wires = [Connection(source=s, target="x", weight=w) for s, w in (("x", -1.0), ("one", 0.5))]
    >>> row = Network(stages=1, cell=Cell(neurons=(Neuron(name="x"),), connections=tuple(wires)))
    >>> probe = ProbeRun(states=np.array([[0.0], [0.5]]), times=np.array([0.0, 10.0]), radius=1.0)
    >>> circuit = circuit_of(schematic_of(row), scale(row, probe))
    >>> volts = float(circuit.scaling.volts("x", 0.5))
    >>> f"{volts:.2f} V, {load_power(circuit, macro(rails=13.0), np.array([0.5])):.3e} W"
    '0.83 V, 1.083e-03 W'
    """
    if level.transistors or not np.isfinite(level.datasheet.rails):
        return 0.0
    network, scaling = circuit.schematic.network, circuit.scaling
    values = evaluator(network).values(x)[..., 1:-1]
    amperes = 0.0
    for (name, _), siemens in loads_of(circuit).items():
        if name in network.node_index:  # others are of a metric, whose nodes rest at zero
            volts = np.abs(scaling.volts(name, values[network.node_index[name]]))
            amperes += float((siemens * volts)[circuit.schematic.alive_at(name)].sum())
    siemens = level.datasheet.gbw / CLAMP_REFERENCE
    for part in circuit.schematic.parts:
        if isinstance(part, Integrator) and part.railed:
            own = values[network.node_index[part.name]]
            amperes += siemens * _volts_to_rails(circuit, part, own)
    return amperes * level.datasheet.rails


@checked
def heaviest(circuit: Circuit) -> Load:
    """The op amp that has to give the largest current.

    Parameters
    ----------
    circuit : Circuit

    Returns
    -------
    Load
    """
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
    """Siemens that the op amp of a part drives besides while it moves: the feedback of a PI cell.

    Parameters
    ----------
    circuit : Circuit
    name : str
        Of the part.
    """
    holds = isinstance(circuit.schematic.by_name[name], PICell)
    return 1 / circuit.feedback[name] if holds else 0.0


def _volts_to_rails(circuit: Circuit, part: Integrator, values: np.ndarray) -> float:
    """From an integrator's outputs to its rails, in all cells together."""
    volts = circuit.schematic.polarity[part.name] * circuit.scaling.volts(part.name, values)
    rails = [rail for rail in circuit.rails(part) if np.isfinite(rail)]
    return sum(float(np.abs(rail - volts)[part.present].sum()) for rail in rails)


def _feedback(circuit: Circuit, part: Part) -> float:
    """Siemens from an output to its own virtual ground, but for a capacitor, and to ground."""
    held = 1 / (HOLD * circuit.inverter) if part.name in circuit.schematic.diode_neurons else 0.0
    return held + (1 / circuit.feedback[part.name] if isinstance(part, Adder) else 0.0)


def _read(circuit: Circuit) -> Iterator[tuple[str, bool, int, float]]:
    """Part, whether its inverter, stage and siemens of every resistor from an op amp."""
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
    """The output that a resistor comes from; in a grid there is one from each of the two."""
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
    """The outputs of a circuit's parts, with what they drive.

    Parameters
    ----------
    circuit : Circuit
    level : Level
        What its parts are like.

    Attributes
    ----------
    omega : float
        Gain-bandwidth of its op amps, in radians per unit of network time.
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
        """Open-loop gain (N,) of an op amp into what it drives at rest.

        Parameters
        ----------
        part : str
        inverter : bool
            Whether the inverter behind it is meant.
        """
        return self.datasheet.a0 / (1 + self._ohms * self._load(part, inverter))

    def lag(self, part: str, inverter: bool = False) -> np.ndarray:
        """1 / Omega (N,), Omega being smaller by what an op amp drives while it moves.

        Parameters
        ----------
        part : str
        inverter : bool
            Whether the inverter behind it is meant.
        """
        more = 0.0 if inverter else moving_load(self.circuit, part)
        return (1 + self.datasheet.rout * (self._load(part, inverter) + more)) / self.omega

    def offset(self, part: str, inverter: bool = False) -> np.ndarray:
        """Volts (N,) at an op amp's input: its own, and what multipliers draw from its output.

        Parameters
        ----------
        part : str
        inverter : bool
            Whether the inverter behind it is meant: multipliers read the part itself.
        """
        drawn = self._none if inverter else self._amperes(part)
        return self.datasheet.systematic_offset - self._ohms * drawn / self.datasheet.a0

    def passed(self, part: str) -> tuple[np.ndarray, np.ndarray]:
        """Share (N,) of a multiplier's output that its load leaves, and volts (N,) added to it.

        Parameters
        ----------
        part : str
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
