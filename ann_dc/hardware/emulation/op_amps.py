r"""Op amps with resistors as neurons: finite gain, poles, slew rate, swing, offset.

Let x be the value represented by a part's output, e that of its virtual ground, and o that of its
offset voltage. The conductance of its inputs is Gamma = sum |w_j| S_j / S. A part of loaded gain A0
and gain-bandwidth product Omega (per unit of network time) is

.. math::
    \dot x &= \Omega\,(o - e - x / A_0) &&\text{(every op amp)} \\
    \dot h &= rate\,(A + \Gamma e), \quad e = x - h
        &&\text{(integrator with } A = \textstyle\sum w_j s_j) \\
    \dot h &= \frac{rate}{\rho} (A + \Gamma e), \quad e = \frac{x - h - A}{1 + \Gamma}
        &&\text{(PI cell, } A, \Gamma \text{ times } \rho) \\
    e &= \frac{x - A}{1 + \Gamma} &&\text{(adder, inverter)} .

Here h is the voltage across the capacitor. With saturation limits, h is the output at which the op
amp is at rest, which stops at the limits: e = x - h + o - x / A0. `grounds` adds capacitance and
bias current of a virtual ground, `clamps` the clamps of limits. A second pole is y' = omega_2 (x -
y), with y the output. Behind an output resistance r with load conductance G, A0 and Omega are 1 + r
G times smaller. In a PI cell the resistor R_f drives the capacitor, whose voltage moves:

.. math:: \Big(1 + r G + \frac{r}{R_f}\Big) \dot x
          = \Omega\,(o - e - x / A_0) + \frac{r}{R_f} \dot h .

The current of an integrator's capacitor drops r / R (A + Gamma e), with R the resistor of an input
of weight one. During a transient its derivative is taken from a signal that lags by 1 / Omega:

.. math:: (1 + r G)\, \dot x = \Omega\,\Big(o - e - x / A_0 - \frac{r}{R} (A + \Gamma e - a)\Big) ,
          \qquad \dot a = \Omega\,(A + \Gamma e - a) .

Shared neurons have no such term: settling times differ by at most 0.03 % (100 ohm).

A rectifying multiplier neuron is a PI cell whose op-amp output is y + D / 2. Behind a diode of drop
D / 2 the neuron output is x = max(0, y). With min(0, y + D) through another diode the op amp fixes
its virtual ground, at the noise gain of its inputs. Between the two it has to move, and a fraction
s leaks back:

.. math:: \dot y &= \Omega\,(o - e - (y + D / 2) / A_0), \quad
          e = s \min(0, y) + (1 - s) \min(0, y + D) + \frac{x - h - A}{1 + \Gamma} \\
          \dot h &= \frac{rate}{\rho} (x - h - e) .

A pair of grid nodes, v and v', with a negative resistance between them of conductance mu relative
to theirs, is

.. math:: \tau\, \dot v = \sum_j |w_j| s_j - v + \tfrac{\mu}{2} (v + v') ,

with s_j the integrator or the node of the other pair that has the sign of the weight.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from ann_dc.hardware.circuit.circuit import SEEPING, Quantity
from ann_dc.hardware.circuit.scaling import to_ground
from ann_dc.hardware.emulation.assembly import Assembly
from ann_dc.hardware.emulation.capacitors import add_capacitor
from ann_dc.hardware.emulation.clamps import (
    FAST,
    add_bias,
    add_clamps,
    add_ground,
    farads_over,
    lag_of,
)
from ann_dc.hardware.emulation.diodes import add_pace, slowed
from ann_dc.hardware.emulation.nodes import AmplifierNodes, Origin
from ann_dc.hardware.schematic.elements import (
    Adder,
    Amplifier,
    GridNode,
    Integrator,
    PICell,
    Wire,
)
from ann_dc.hardware.schematic.preconditioner_wiring import OWN
from ann_dc.network.cell import ONE, Limiter


def add_op_amp(assembly: Assembly, part: Amplifier) -> None:
    """Add an integrator, a PI cell or an adder, with its inverter, to an assembly."""
    if isinstance(part, Adder):
        _adder(assembly, part)
    elif isinstance(part, PICell):
        build = _diode_cell if part.rectified else _pi_cell
        build(assembly, part)
    else:
        _integrator(assembly, part)


def add_inverter(assembly: Assembly, name: str) -> None:
    """Add the inverter of part ``name``: an adder with a wire of weight -1."""
    schematic, nodes = assembly.schematic, AmplifierNodes(name, inverter=True)
    assembly.sum(nodes.summed)
    weight = -(1 + assembly.deviation(name, Quantity.INVERTER))
    connection = assembly.connect(name, nodes.summed, weight)
    assembly.slope(connection, -1.0, name, Quantity.INVERTER)
    _amplify(assembly, nodes, -weight, -weight * assembly.circuit.inverter)
    gone = [
        stage
        for stage in range(assembly.stages)
        if not schematic.alive(name, stage) or (name, stage) in schematic.pins
    ]
    assembly.leave_out(nodes.output, gone)
    assembly.leave_out_inside(nodes, gone)


def _integrator(assembly: Assembly, part: Integrator) -> None:
    nodes, ones = AmplifierNodes(part.name), np.ones(assembly.stages)
    assembly.sum(nodes.ground)
    divider = 1 / (1 + farads_over(assembly, part))
    at_rest = 0.0
    if part.railed and not assembly.moving:
        volt, known = assembly.circuit.value_of(part.name), assembly.outputs.offset(part.name)
        assembly.bias(nodes.ground, volt, part.name, Quantity.OFFSET, known)
        at_rest = 1 / assembly.outputs.gain(part.name)
    clamps = add_clamps(assembly, part)
    assembly.connect(nodes.output, nodes.ground, (1 - clamps.share) * divider - at_rest)
    for node, share in clamps.followers.items():
        assembly.connect(node, nodes.ground, share * divider)
    for node in (nodes.held, *clamps.shifts):
        assembly.connect(node, nodes.ground, -divider)
    gamma = assembly.conductance(part, ones)
    e = {nodes.ground: 1.0}
    if assembly.moving and assembly.datasheet.rout and clamps.into == nodes.summed:
        e = _trailed(assembly, part, gamma, 1 - clamps.share)
    _amplifier(assembly, nodes, e)
    add_capacitor(assembly, part, {nodes.ground: gamma}, part.tau, clamps.limiter)
    _inputs(assembly, part, ones, clamps.into)
    ohms = assembly.scaling.time * part.tau / assembly.circuit.capacitors[part.name]
    add_bias(assembly, nodes, clamps.into, ohms)
    assembly.leave_out_unpinned(nodes.output, part.present)
    assembly.leave_out_inside(nodes, np.flatnonzero(~part.present).tolist())


def _trailed(
    assembly: Assembly, part: Integrator, gamma: np.ndarray, share: float
) -> dict[str, float | np.ndarray]:
    """Add the delayed current of an integrator's capacitor; return the weights of e.

    The weights include the voltage drop of the current across the output resistance. A fraction
    ``share`` of the capacitor is connected to the output, the remainder to clamps.
    """
    nodes = AmplifierNodes(part.name)
    assembly.neuron(nodes.trailing, 1 / assembly.omega, Origin(part.name, 0.0))
    for source, weight in ((nodes.summed, 1.0), (nodes.ground, gamma), (nodes.trailing, -1.0)):
        assembly.connect(source, nodes.trailing, weight)
    tau = assembly.scaling.time * np.where(part.present, part.tau, 1.0)
    farads = np.where(part.present, assembly.circuit.capacitors[part.name], 0.0)
    drop = assembly.datasheet.rout * share * farads / tau
    return {nodes.ground: 1 + drop * gamma, nodes.summed: drop, nodes.trailing: -drop}


def _pi_cell(assembly: Assembly, part: PICell) -> None:
    nodes = AmplifierNodes(part.name)
    factor = 1 + assembly.deviation(part.name, Quantity.FEEDBACK)
    rho = np.where(part.present, part.rho, 0.0)
    ohms = assembly.circuit.feedback[part.name] * factor
    assembly.sum(nodes.summed)
    _inputs(assembly, part, rho * factor, nodes.summed)
    add_bias(assembly, nodes, nodes.summed, ohms)
    gamma = assembly.conductance(part, rho * factor)
    add_ground(assembly, nodes, nodes.ground, 1 + gamma + farads_over(assembly, part), ohms)
    back = _returned(assembly, part, ohms)
    _amplifier(assembly, nodes, {nodes.ground: 1.0 - back * gamma, nodes.summed: -back})
    add_capacitor(assembly, part, {nodes.summed: 1.0, nodes.ground: gamma}, part.tau * factor)
    assembly.leave_out_unpinned(nodes.output, part.present)
    assembly.leave_out_inside(nodes, np.flatnonzero(~part.present).tolist())


def _diode_cell(assembly: Assembly, part: PICell) -> None:
    nodes, op_amp = AmplifierNodes(part.name), AmplifierNodes(part.name, rectified=True)
    factor = 1 + assembly.deviation(part.name, Quantity.FEEDBACK)
    rho = np.where(part.present, part.rho, 0.0)
    ohms = assembly.circuit.feedback[part.name] * factor
    assembly.sum(nodes.summed)
    assembly.sum(nodes.ground)
    assembly.function(nodes.output, "rectify", op_amp.output)
    _inputs(assembly, part, rho * factor, nodes.summed)
    add_bias(assembly, nodes, nodes.summed, ohms)
    crossing = assembly.circuit.crossing(part)
    assembly.sum(op_amp.below)
    assembly.connect(op_amp.output, op_amp.below, -1.0)
    assembly.connect(ONE, op_amp.below, -crossing)
    assembly.function(op_amp.back, "rectify", op_amp.below)
    drop = crossing / 2 / assembly.outputs.gain(op_amp.part)
    e = {op_amp.output: SEEPING, op_amp.back: SEEPING - 1.0, ONE: drop}
    whole = 1 + assembly.conductance(part, rho * factor)
    if lag_of(assembly, ohms, whole) is None:
        share = 1 / whole
        e |= {nodes.output: share - SEEPING, nodes.held: -share, nodes.summed: -share}
    else:
        add_ground(assembly, nodes, nodes.lagging, whole, ohms)
        e |= {nodes.output: -SEEPING, nodes.lagging: 1.0}
    for source, weight in e.items():
        assembly.connect(source, nodes.ground, weight)
    _amplifier(assembly, op_amp, {nodes.ground: 1.0}, slowed(assembly, part, ohms / whole))
    weights = {nodes.output: 1.0, nodes.held: -1.0, nodes.ground: -1.0, ONE: drop}
    add_capacitor(assembly, part, weights, part.tau * factor)
    gone = np.flatnonzero(~part.present).tolist()
    assembly.leave_out(op_amp.output, gone)
    assembly.leave_out_inside(op_amp, gone)
    assembly.leave_out_inside(nodes, gone)


def _returned(assembly: Assembly, part: PICell, ohms: np.ndarray) -> np.ndarray:
    """Return r / (R_f Omega tau), the weight of a PI cell's capacitor current."""
    tau = np.where(part.present, part.tau, 1.0) * ohms / assembly.circuit.feedback[part.name]
    return assembly.datasheet.rout / (ohms * assembly.omega * tau)


def _adder(assembly: Assembly, part: Adder) -> None:
    nodes, circuit = AmplifierNodes(part.name), assembly.circuit
    assembly.sum(nodes.summed)
    _inputs(assembly, part, np.ones(assembly.stages), nodes.summed)
    factor = 1 + assembly.deviation(part.name, Quantity.FEEDBACK)
    gamma = assembly.conductance(part, factor)
    _amplify(assembly, nodes, gamma, circuit.feedback[part.name] * factor)
    alive = assembly.schematic.alive_at(part.name)
    assembly.leave_out_unpinned(nodes.output, alive)
    assembly.leave_out_inside(nodes, np.flatnonzero(~alive).tolist())


def add_grid_node(assembly: Assembly, part: GridNode) -> None:
    """Add a pair of grid nodes, and the follower of the first, to an assembly."""
    nodes, twin = AmplifierNodes(part.name), AmplifierNodes(part.name, inverter=True)
    circuit, schematic = assembly.circuit, assembly.schematic
    conductance = circuit.conductances[part.name]
    missing = to_ground(conductance, circuit.resistors[part.name])
    present = np.where(part.present, conductance, 1.0)
    across = np.minimum(missing, 0.0) / present / 2  # a negative resistance between the two
    for here, there, sign in ((nodes.held, twin.held, 1.0), (twin.held, nodes.held, -1.0)):
        assembly.neuron(here, circuit.lag, Origin(part.name, sign))
        assembly.connect(here, here, across - 1.0)
        assembly.connect(there, here, across)
    for wire in part.wires:
        pair = AmplifierNodes(wire.source), AmplifierNodes(wire.source, inverter=True)
        sign = schematic.polarity[wire.source] * schematic.polarity[part.name]
        is_own, volts = wire.source.startswith(OWN), sign * wire.weight
        for seen, (a, b) in ((volts > 0, pair), (volts < 0, pair[::-1])):
            weight = np.where(seen, sign * np.abs(wire.weight), 0.0)
            if weight.any():
                first, second = (a.output, b.output) if is_own else (a.held, b.held)
                assembly.connect(first, nodes.held, weight, wire.offset)
                assembly.connect(second, twin.held, weight, wire.offset)
    _amplifier(assembly, nodes, {nodes.output: 1.0, nodes.held: -1.0})
    gone = np.flatnonzero(~part.present).tolist()
    assembly.leave_out(nodes.held, gone)
    assembly.leave_out(twin.held, gone)
    assembly.leave_out_unpinned(nodes.output, part.present)
    assembly.leave_out_inside(nodes, gone)


def _amplify(
    assembly: Assembly, nodes: AmplifierNodes, gamma: np.ndarray, ohms: np.ndarray
) -> None:
    """Add an op amp with resistive feedback: e = (x - A) / (1 + Gamma), or with a lag."""
    add_bias(assembly, nodes, nodes.summed, ohms)
    if lag_of(assembly, ohms, 1 + gamma) is None:
        e = {nodes.output: 1 / (1 + gamma), nodes.summed: -1 / (1 + gamma)}
        _amplifier(assembly, nodes, e)
    else:
        add_ground(assembly, nodes, nodes.ground, 1 + gamma, ohms)
        _amplifier(assembly, nodes, {nodes.ground: 1.0})


def _amplifier(
    assembly: Assembly,
    nodes: AmplifierNodes,
    e: Mapping[str, float | np.ndarray],
    slower: float | np.ndarray = 1.0,
) -> None:
    """Add x' = Omega (o - e - x / A0), e as node weights; ``slower`` divides Omega."""
    datasheet, volt = assembly.datasheet, assembly.circuit.value_of(nodes.part)
    outputs, op_amp = assembly.outputs, (nodes.part, nodes.inverter)
    name, a0 = _poles(assembly, nodes, slower), outputs.gain(*op_amp)
    driven = add_pace(assembly, nodes, name) if nodes.rectified and assembly.moving else name
    target, per_target = driven, 1.0
    if math.isfinite(datasheet.slew):
        target = nodes.drive
        per_target = assembly.slewing(target, driven, abs(volt))
    for source, weight in e.items():
        leak = 1 / a0 if source == name else 0.0
        assembly.connect(source, target, -(np.asarray(weight) + leak) * per_target)
    if name not in e:
        assembly.connect(name, target, -per_target / a0)
    offset = Quantity.INVERTER_OFFSET if nodes.inverter else Quantity.OFFSET
    per_volt = volt * per_target / assembly.halves
    assembly.bias(target, per_volt, nodes.part, offset, outputs.offset(*op_amp))


def _poles(assembly: Assembly, nodes: AmplifierNodes, slower: float | np.ndarray) -> str:
    """Add an op amp's pole within its swing and any second pole; return the first."""
    datasheet, name = assembly.datasheet, nodes.output
    rails = datasheet.rails * abs(assembly.circuit.value_of(nodes.part))
    origin = Origin(nodes.part, -1.0 if nodes.inverter else 1.0)
    scale, second = assembly.scale_of(name), datasheet.parasitics.second_pole
    if second < FAST * datasheet.gbw:
        tau = 1 / (2 * math.pi * second * assembly.scaling.time)
        assembly.neuron(name, tau, origin, scale=scale)
        assembly.connect(nodes.first, name, 1.0)
        assembly.connect(name, name, -1.0)
        name = nodes.first
    limiter = Limiter(low=-rails, high=rails)
    lag = assembly.outputs.lag(nodes.part, nodes.inverter) * slower
    assembly.neuron(name, lag, origin, scale=scale, limiter=limiter)
    return name


def _inputs(assembly: Assembly, part: Amplifier, scale: np.ndarray, target: str) -> None:
    """Connect a part's wires to a node; each resistor is one or two weights."""
    name, adds = part.name, isinstance(part, Adder)
    feedback = assembly.deviation(name, Quantity.FEEDBACK) if adds else 0.0
    for number, wire in enumerate(part.wires):
        off = assembly.deviation(name, Quantity.INPUT, number)
        weight = wire.weight * scale * (1 + feedback) / (1 + off)
        for source, given in _sources(assembly, part, wire, weight):
            connection = assembly.collect(source, target, given, wire.offset)
            assembly.slope(connection, -given / (1 + off), name, Quantity.INPUT, number)
            if adds:
                assembly.slope(connection, given / (1 + feedback), name, Quantity.FEEDBACK)


def _sources(
    assembly: Assembly, part: Amplifier, wire: Wire, weight: np.ndarray
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the direct and the inverted node that a wire reads, each at some stages."""
    direct = _direct(assembly, part, wire)
    inverted = AmplifierNodes(wire.source, inverter=True).output
    for source, sign, where in ((wire.source, 1.0, direct), (inverted, -1.0, ~direct)):
        if (where & (wire.weight != 0)).any():
            yield source, np.where(where, sign * weight, 0.0)


def _direct(assembly: Assembly, part: Amplifier, wire: Wire) -> np.ndarray:
    """Return a mask (N,) of the stages at which a wire reads a non-inverted output."""
    schematic, stages = assembly.schematic, assembly.stages
    polarity = schematic.polarity.get(wire.source)
    if polarity is None or schematic.differential:  # there with both signs
        return np.ones(stages, bool)
    direct = schematic.reading(part, wire) == polarity
    for stage in range(stages):
        where = stage + wire.offset
        outside = not 0 <= where < stages
        if outside or (wire.source, where) in schematic.pins:
            direct[stage] = True
    return direct
