r"""A circuit as a network again: op amps with their poles, multipliers with their errors.

With x the value that a part's output stands for, e that of its virtual ground, and
Gamma = sum |w_j| S_j / S the conductance of its inputs, a part of finite gain A0 and gain-bandwidth
Omega (per unit of network time), off by a voltage that stands for o, is

.. math::
    \dot x &= \Omega\,(o - e - x / A_0) &&\text{(every op amp)} \\
    \dot h &= rate\,(A + \Gamma e), \quad e = x - h
        &&\text{(integrator with } A = \textstyle\sum w_j s_j) \\
    \dot h &= \frac{rate}{\rho} (A + \Gamma e), \quad e = \frac{x - h - A}{1 + \Gamma}
        &&\text{(PI cell, } A, \Gamma \text{ times } \rho) \\
    e &= \frac{x - A}{1 + \Gamma} &&\text{(adder, inverter)} .

h is the voltage across the capacitor. All of it is neurons, sums and multipliers: the result is a
`Network`, which every backend runs, whose Jacobian is the pole model of the circuit, and in which
every resistor, offset and gain is the weight of a connection.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ann_dc.analysis.spectra import Spectrum, spectrum
from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.deviations import Deviations, checked, parameters
from ann_dc.hardware.circuit.elements import Adder, Generator, Integrator, Multiplier, PICell, Wire
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.datasheet import Datasheet
from ann_dc.network.cell import (
    ONE,
    Block,
    Cell,
    Connection,
    Function,
    Limiter,
    Neuron,
    Product,
    Sum,
    Template,
)
from ann_dc.network.ends import Absent
from ann_dc.network.network import Network

FAST = 10.0
"""A pole that many times faster than the op amps is left out."""

HELD, GROUND, SUMMED, INVERTED = "held.", "ground.", "summed.", "not."


@dataclass(frozen=True, kw_only=True, eq=False)
class Emulation:
    """The network that a circuit is.

    Attributes
    ----------
    network : Network
        Its neurons carry the names of the parts; values are in the units of the ideal network.
        ``held.<part>`` is a capacitor, ``not.<part>`` an inverter.
    circuit : Circuit
    slopes : mapping of parameter name to tuple of (connection name, (N,) array)
        How the weights of connections change with a parameter's deviation.
    """

    network: Network
    circuit: Circuit
    slopes: Mapping[str, tuple[tuple[str, np.ndarray], ...]]

    @cached_property
    def outputs(self) -> np.ndarray:
        """(m,) components of the state that stand for the ideal network's controls.

        For all of its neurons where it has no controls.
        """
        ideal = self.circuit.schematic.network
        controls = ideal.of_population("u")
        places = ideal.places[controls] if controls.any() else ideal.places
        rows = [self.network.neuron_index[ideal.cell.neurons[neuron].name] for neuron, _ in places]
        return self.network.state_index[rows, places[:, 1]]

    def controls(self, x: np.ndarray) -> np.ndarray:
        """Controls (..., m) of states of the emulation (..., n), in the units of the states."""
        return np.asarray(x)[..., self.outputs]


def emulate(
    circuit: Circuit, datasheet: Datasheet, deviations: Deviations | None = None
) -> Emulation:
    """The network of a circuit's equations.

    Parameters
    ----------
    circuit : Circuit
    datasheet : Datasheet
        Its spread is not drawn here: ``deviations`` say which part is off by how much.
    deviations : mapping of parameter name to (N,) array, optional

    Returns
    -------
    Emulation

    Raises
    ------
    NetworkError
        If the circuit has coordinators, whose resistor matrix reaches beyond neighbours.
    UnknownNameError
        If a deviation names no parameter.
    """
    if circuit.schematic.coupling is not None:
        raise NetworkError(
            "emulation: the resistor matrix of coarse coordinators reaches beyond neighbours; "
            "design the network without coordinators (recipe WITHOUT_COORDINATORS)"
        )
    return Emulator(circuit, datasheet, checked(parameters(circuit), deviations or {})).emulation()


@dataclass(eq=False)
class Emulator:
    """Writes the network of a circuit, part by part."""

    circuit: Circuit
    datasheet: Datasheet
    deviations: Mapping[str, np.ndarray]
    neurons: list[Neuron] = field(default_factory=list)
    blocks: list[Block] = field(default_factory=list)
    connections: list[Connection] = field(default_factory=list)
    slopes: dict[str, list[tuple[str, np.ndarray]]] = field(default_factory=dict)
    absent: list[Absent] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.schematic = self.circuit.schematic
        self.scaling = self.circuit.scaling
        self.ideal = self.schematic.network
        self.stages = self.ideal.stages
        self.omega = 2 * math.pi * self.datasheet.gbw * self.scaling.time

    def emulation(self) -> Emulation:
        """The whole network, started where reset switches hold the circuit."""
        for part in self.schematic.parts:
            if isinstance(part, Multiplier):
                self._multiplier(part)
            elif isinstance(part, Generator):
                self._generator(part)
            elif isinstance(part, Adder):
                self._adder(part)
            elif isinstance(part, PICell):
                self._pi_cell(part)
            else:
                self._integrator(part)
            if part.name in self.schematic.inverted:
                self._inverter(part.name)
        network = Network(
            cell=Cell(
                neurons=tuple(self.neurons),
                inputs=self.ideal.cell.inputs,
                blocks=tuple(self._ordered()),
                connections=tuple(self.connections),
            ),
            stages=self.stages,
            inputs=self.ideal.inputs,
            pins=self.ideal.pins,
            absent=tuple(self.absent),
            left=self.ideal.left,
            title=f"{self.ideal.title}, as a circuit",
        )
        slopes = {name: tuple(found) for name, found in self.slopes.items()}
        emulation = Emulation(network=network, circuit=self.circuit, slopes=slopes)
        start = emulated_state(emulation, self.ideal.start_state)
        return replace(emulation, network=network.with_start(start))

    # ---- wires -------------------------------------------------------------------------------

    def _deviation(self, name: str) -> np.ndarray:
        return self.deviations.get(name, np.zeros(self.stages))

    def _connect(self, source: str, target: str, weight, template: int = 0) -> str:
        weight = np.broadcast_to(np.asarray(weight, float), self.stages)
        connection = Connection(
            source=source, target=target, weight=weight, template=Template(template)
        )
        self.connections.append(connection)
        return connection.name

    def _slope(self, parameter: str, connection: str, slope) -> None:
        slope = np.broadcast_to(np.asarray(slope, float), self.stages)
        self.slopes.setdefault(parameter, []).append((connection, slope))

    def _bias(self, parameter: str, target: str, per_volt) -> None:
        """A voltage error: a weight of the constant one."""
        volts = self._deviation(parameter)
        self._slope(parameter, self._connect(ONE, target, volts * per_volt), per_volt)

    def _inputs(self, part, target: str, scale: np.ndarray) -> None:
        """The wires of a part into a sum; each resistor is one or two weights."""
        alias = self.schematic.alias[part.name]
        feedback = self._deviation(f"rf_{alias}") if isinstance(part, Adder) else 0.0
        for number, wire in enumerate(part.wires):
            name = f"r_{alias}_{number}"
            weight = wire.weight * scale * (1 + feedback) / (1 + self._deviation(name))
            direct = self._direct(part, wire)
            for source, sign, where in (
                (wire.source, 1.0, direct),
                (INVERTED + wire.source, -1.0, ~direct),
            ):
                if not (where & (wire.weight != 0)).any():
                    continue
                given = np.where(where, sign * weight, 0.0)
                connection = self._connect(source, target, given, wire.offset)
                self._slope(name, connection, -given / (1 + self._deviation(name)))
                if isinstance(part, Adder):
                    self._slope(f"rf_{alias}", connection, given / (1 + feedback))

    def _direct(self, part, wire: Wire) -> np.ndarray:
        """(N,) booleans: whether a wire reads the part's own output, not its inverter's."""
        polarity = self.schematic.polarity.get(wire.source)
        if polarity is None or self.schematic.differential:  # there with both signs
            return np.ones(self.stages, bool)
        direct = self.schematic.reading(part, wire) == polarity
        for stage in range(self.stages):
            where = stage + wire.offset
            outside = not 0 <= where < self.stages
            if outside or (wire.source, where) in self.schematic.pins:
                direct[stage] = True
        return direct

    def _conductance(self, part, scale: np.ndarray) -> np.ndarray:
        """Gamma (N,): what a volt at the virtual ground weighs against one at the output."""
        units = self.scaling.unit
        alias = self.schematic.alias[part.name]
        total = np.zeros(self.stages)
        for number, wire in enumerate(part.wires):
            share = np.abs(wire.weight) * units[wire.source] / units[part.name]
            total += (
                self.schematic.fed_at(wire) * share / (1 + self._deviation(f"r_{alias}_{number}"))
            )
        return total * scale

    # ---- parts -------------------------------------------------------------------------------

    def _op_amp(self, name: str, e: Mapping[str, object], offset: str, unit: float) -> None:
        """x' = Omega (o - e - x / A0), with e given as weights of nodes."""
        tau = 1 / self.omega
        rails = self.datasheet.rails * abs(unit)
        neuron = Neuron(
            name=name, tau=tau, unit=self._unit_of(name), limiter=Limiter(low=-rails, high=rails)
        )
        self.neurons.append(neuron)
        target, per_target = name, 1.0
        if math.isfinite(self.datasheet.slew):
            target, per_target = self._slewing(name, abs(unit))
        for source, weight in e.items():
            leak = 1 / self.datasheet.a0 if source == name else 0.0
            self._connect(source, target, -(np.asarray(weight) + leak) * per_target)
        if name not in e:
            self._connect(name, target, -per_target / self.datasheet.a0)
        halves = 2.0 if self.schematic.differential else 1.0  # each half sees half of the offset
        self._bias(offset, target, unit * per_target / halves)

    def _slewing(self, name: str, unit: float) -> tuple[str, float]:
        """A sum before the op amp that its slew rate limits, and what a drive of 1 weighs there."""
        largest = self.datasheet.slew * self.scaling.time / self.omega * unit
        drive = f"drive.{name}"
        self.blocks.append(Sum(name=drive))
        self._clip(drive, name, largest)
        return drive, 1 / largest

    def _clip(self, source: str, target: str, limit: float) -> None:
        """``limit`` times a source clipped to -1 .. 1: rectify(s + 1) - rectify(s - 1) - 1."""
        for sign in (1.0, -1.0):
            inner, outer = f"edge{sign:+.0f}.{target}", f"rectify{sign:+.0f}.{target}"
            self.blocks += [Sum(name=inner), Function(name=outer, function="rectify", x=inner)]
            self._connect(source, inner, 1.0)
            self._connect(ONE, inner, sign)
            self._connect(outer, target, sign * limit)
        self._connect(ONE, target, -limit)

    def _unit_of(self, name: str) -> float:
        return self.ideal.neuron(name).unit if name in self.ideal.neuron_index else 1.0

    def _volt(self, name: str) -> float:
        """The value that a volt at a part's own output stands for."""
        return self.schematic.polarity[name] * self.scaling.unit[name] / self.scaling.full_scale

    def _capacitor(self, part, name: str, e: Mapping[str, object], tau) -> None:
        """tau h' = A + Gamma e."""
        held = HELD + part.name
        alias = self.schematic.alias[part.name]
        there = part.rate > 0
        tau = np.where(there, tau, 1.0) * (1 + self._deviation(f"c_{alias}"))
        self.neurons.append(Neuron(name=held, tau=tau))
        self._connect(name, held, 1.0)
        for source, weight in e.items():
            self._connect(source, held, weight)
        for stage in np.flatnonzero(~there):
            self.absent.append(Absent(neuron=held, stage=int(stage)))
            if (part.name, int(stage)) not in self.schematic.pins:
                self.absent.append(Absent(neuron=part.name, stage=int(stage)))

    def _integrator(self, part: Integrator) -> None:
        name, summed = part.name, SUMMED + part.name
        self.blocks.append(Sum(name=summed))
        self._inputs(part, summed, np.ones(self.stages))
        gamma = self._conductance(part, np.ones(self.stages))
        e = {name: gamma, HELD + name: -gamma}
        tau = 1 / np.where(part.rate > 0, part.rate, 1.0)
        self._op_amp(
            name,
            {name: 1.0, HELD + name: -1.0},
            f"vos_{self.schematic.alias[name]}",
            self._volt(name),
        )
        self._capacitor(part, summed, e, tau)

    def _pi_cell(self, part: PICell) -> None:
        name, summed, ground = part.name, SUMMED + part.name, GROUND + part.name
        there = part.rate > 0
        alias = self.schematic.alias[name]
        rho = np.where(there, part.rho, 0.0)
        factor = 1 + self._deviation(f"rf_{alias}")
        self.blocks += [Sum(name=summed), Sum(name=ground)]
        self._inputs(part, summed, rho * factor)
        gamma = self._conductance(part, rho * factor)
        for source, sign in ((name, 1.0), (HELD + name, -1.0), (summed, -1.0)):
            self._connect(source, ground, sign / (1 + gamma))
        self._op_amp(name, {ground: 1.0}, f"vos_{alias}", self._volt(name))
        tau = np.where(there, part.rho / np.where(there, part.rate, 1.0), 1.0) * factor
        self._capacitor(part, summed, {ground: gamma}, tau)

    def _adder(self, part: Adder) -> None:
        name, summed = part.name, SUMMED + part.name
        self.blocks.append(Sum(name=summed))
        self._inputs(part, summed, np.ones(self.stages))
        factor = 1 + self._deviation(f"rf_{self.schematic.alias[name]}")
        gamma = self._conductance(part, factor)
        self._amplify(name, summed, gamma, name, self._volt(name))

    def _inverter(self, name: str) -> None:
        alias, inverter = self.schematic.alias[name], INVERTED + name
        summed = SUMMED + inverter
        self.blocks.append(Sum(name=summed))
        weight = -(1 + self._deviation(f"e_n_{alias}"))
        connection = self._connect(name, summed, weight)
        self._slope(f"e_n_{alias}", connection, -1.0)
        self._amplify(inverter, summed, -weight, f"n_{alias}", self._volt(name))
        for stage in range(self.stages):
            if not self.schematic.alive(name, stage) or (name, stage) in self.schematic.pins:
                self.absent.append(Absent(neuron=inverter, stage=stage))

    def _amplify(self, name: str, summed: str, gamma, alias: str, unit: float) -> None:
        """An op amp with resistive feedback: e = (x - A) / (1 + Gamma)."""
        alias = self.schematic.alias.get(alias, alias)
        e = {name: 1 / (1 + gamma), summed: -1 / (1 + gamma)}
        self._op_amp(name, e, f"vos_{alias}", unit)

    def _multiplier(self, part: Multiplier) -> None:
        polarity, alias = self.schematic.polarity, self.schematic.alias[part.name]
        swap = polarity.get(part.a, 1) * polarity.get(part.b, 1) * polarity[part.name] < 0
        factors = []
        for factor, error, sign in ((part.a, "ox", -1.0 if swap else 1.0), (part.b, "oy", 1.0)):
            node = f"{error}.{part.name}"
            self.blocks.append(Sum(name=node))
            self._connect(factor, node, 1.0)
            volt = self.scaling.unit[factor] / self.scaling.full_scale
            self._bias(f"{error}_{alias}", node, sign * polarity.get(factor, 1) * volt)
            factors.append(node)
        product = f"product.{part.name}"
        self.blocks.append(Product(name=product, a=factors[0], b=factors[1]))
        bandwidth = self.datasheet.multiplier_bandwidth
        self._output(part.name, product, alias, "oz", bandwidth)

    def _generator(self, part: Generator) -> None:
        alias, curve = self.schematic.alias[part.name], f"curve.{part.name}"
        self.blocks.append(Function(name=curve, function=part.function, x=part.x))
        self._output(part.name, curve, alias, "oy", self.datasheet.function_bandwidth)

    def _output(self, name: str, ideal: str, alias: str, offset: str, bandwidth: float) -> None:
        """Gain error, output offset, rails and pole of a multiplier or a function generator."""
        gain = 1 + self._deviation(f"ge_{alias}")
        volt = self._volt(name)
        rails = self.datasheet.multiplier_rails * abs(volt)
        target, per_unit = name, 1.0
        if bandwidth < FAST * self.datasheet.gbw:
            tau = 1 / (2 * math.pi * bandwidth * self.scaling.time)
            limiter = Limiter(low=-rails, high=rails)
            self.neurons.append(Neuron(name=name, tau=tau, limiter=limiter))
            self._connect(name, name, -1.0)
        elif math.isinf(rails):
            self.blocks.append(Sum(name=name))
        else:
            target, per_unit = f"free.{name}", 1 / rails
            self.blocks += [Sum(name=target), Sum(name=name)]
            self._clip(target, name, rails)
        connection = self._connect(ideal, target, gain * per_unit)
        self._slope(f"ge_{alias}", connection, per_unit)
        self._bias(f"{offset}_{alias}", target, volt * per_unit)

    def _ordered(self) -> list[Block]:
        """Blocks in topological order."""
        reads: dict[str, list[str]] = {}
        for connection in self.connections:
            reads.setdefault(connection.target, []).append(connection.source)
        by_name = {block.name: block for block in self.blocks}
        placed: dict[str, Block] = {}

        def place(name: str) -> None:
            block = by_name.get(name)
            if block is None or name in placed:
                return
            if isinstance(block, Product):
                before = [block.a, block.b]
            else:
                before = [block.x] if isinstance(block, Function) else reads.get(name, [])
            for source in before:
                place(source)
            placed[name] = block

        for name in by_name:
            place(name)
        return list(placed.values())


def emulated_state(emulation: Emulation, x: np.ndarray) -> np.ndarray:
    """State of the emulation in which everything is where the ideal network has it at ``x`` (n,).

    Capacitors, op amps and multipliers stand at their ideal values: where reset switches hold a
    circuit, and where Newton's method starts to look for its equilibrium.
    """
    network, schematic = emulation.network, emulation.circuit.schematic
    program = evaluator(schematic.network)
    values = program.values(np.asarray(x, float))[..., 1:-1]
    full = np.zeros(network.live.shape)
    for name, row in network.neuron_index.items():
        held, inverted = name.removeprefix(HELD), name.removeprefix(INVERTED)
        part = schematic.by_name[held if held != name else inverted]
        source = part.dual if held != name and isinstance(part, PICell) else part.name
        full[row] = values[schematic.network.node_index[source]] * (-1.0 if inverted != name else 1.0)
    return network.pack(full)


def is_emulated(circuit: Circuit, level: Level) -> bool:
    """Whether a circuit has an emulation: without coordinators, clocks, and ideal op amps."""
    return circuit.schematic.coupling is None and level.emulated


def pole_spectrum(emulation: Emulation, x: np.ndarray) -> Spectrum:
    """Eigenvalues of the pole model at a state (n,) of the ideal network, where that settles."""
    return spectrum(emulation.network, emulated_state(emulation, x))
