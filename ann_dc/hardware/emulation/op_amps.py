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
amp is at rest, which stops at the limits: e = x - h + o - x / A0. The module `clamps` adds the
clamps of limits, and capacitance and bias current of a virtual ground. A second pole is y' =
omega_2 (x - y), with y the output. Behind an output resistance r with load conductance G, A0 and
Omega are 1 + r G times smaller. In a PI cell the resistor R_f drives the capacitor, whose voltage
moves:

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

An integrating capacitor C with insulation tau_l = R C is in parallel with an open reset switch of
capacitance C_s and resistance R_s towards the preset h_0. With the charging current i, its voltage
h obeys

.. math:: (C + C_s)\, \dot h = i - \frac{C}{\tau_l} h - \frac{h - h_0}{R_s} ,

and starts q / (C + C_s) above h_0 if the opening switch leaves a charge q. In a differential
circuit both switches leave equal charges, which have no effect.

The diode behind the op amp slows a rectifying multiplier neuron down, because its drop grows with
its current. For a volt at the far end, x, the op amp moves by

.. math:: 1 + \frac{V_T}{x} \approx 1 + \frac{V_T}{x + V_T / 2} ,

so x follows at the pace p = (x + V_T / 2) / (x + 3 V_T / 2) of an op amp without a diode. On the
other side of the knee no part has to follow, and p quickly reaches 1. Meanwhile the diode of the
virtual ground is a junction of capacitance C_j, whose current R_f must also supply:

.. math:: \Big(1 + \frac{R_f C_j\, \Omega}{T\, (1 + \Gamma)}\Big) \dot x
          = p\, \Omega\, (o - e - x / A_0) .

In a transient p is a node. At rest p moves no equilibrium, and Newton's method is more robust
without p, with net inputs that are linear on either side of the knee. `paced_at` gives the modes at
rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from ann_dc.hardware.circuit.circuit import JUNCTION, SEEPING, THERMAL, Circuit, Quantity
from ann_dc.hardware.circuit.scaling import to_ground
from ann_dc.hardware.emulation.assembly import (
    Coupling,
    Piece,
    State,
    Weight,
    couplings,
    weighted_sum,
)
from ann_dc.hardware.emulation.built_circuit import BuiltCircuit
from ann_dc.hardware.emulation.clamps import (
    bias_current,
    clamps_at,
    farads_over,
    ground,
    has_second_pole,
    lag_of,
)
from ann_dc.hardware.emulation.emulation import AT_KNEE, STEEP
from ann_dc.hardware.emulation.nodes import AmplifierNodes, Origin
from ann_dc.hardware.parts.parasitics import Parasitics
from ann_dc.hardware.schematic.elements import (
    UNLIMITED,
    Adder,
    Amplifier,
    GridNode,
    Integrator,
    PICell,
    Wire,
)
from ann_dc.hardware.schematic.preconditioner_wiring import OWN
from ann_dc.network.cell import ONE, Function, Limiter, Product, Sum
from ann_dc.network.network import Network


def _capacitor(
    built: BuiltCircuit,
    part: Integrator | PICell,
    weights: Mapping[str, Weight],
    tau: np.ndarray,
    limiter: Limiter = UNLIMITED,
) -> Iterator[Piece]:
    """Yield tau h' = the sum of weighted nodes, within limits, minus leakage.

    ``tau`` (N,) is the time constant of the nominal capacitor alone.
    """
    nodes, circuit = AmplifierNodes(part.name), built.circuit
    parasitics, name = built.datasheet.parasitics, part.name
    off = built.deviation(name, Quantity.CAPACITOR)
    origin = Origin(part.dual if isinstance(part, PICell) else name)
    farads = np.where(part.present, circuit.capacitors[name], np.inf)
    total = 1 + off + parasitics.switch_capacitance / farads
    yield State(nodes.held, tau * total, origin, limiter)
    yield from couplings(nodes.held, weights)
    rate = built.scaling.time * tau  # of one per second
    insulator = rate * (1 + off) / parasitics.capacitor_leakage
    insulator = insulator * circuit.own_capacitors(name) / farads
    switch = rate / (farads * parasitics.switch_leakage)
    if (insulator + switch).any():
        preset = switch * circuit.presets[name] * circuit.value_of(name)
        yield from weighted_sum(nodes.leak, {nodes.held: -(insulator + switch), ONE: preset})
        yield Coupling(nodes.leak, nodes.held, 1.0)


def released(
    network: Network,
    circuit: Circuit,
    parasitics: Parasitics,
    off: Mapping[str, np.ndarray],
    x: np.ndarray,
) -> np.ndarray:
    """Return the state (n,) after the reset switches have opened.

    It includes the switch charge.

    ``network`` is that of the emulation, ``off`` maps parameter names to capacitor deviations (N,),
    and ``x`` (n,) is the state with closed switches.
    """
    if parasitics.switch_charge == 0 or circuit.schematic.differential:
        return x
    values = network.unpack(x)
    for name, farads in circuit.capacitors.items():
        deviation = off.get(circuit.parameter_name(name, Quantity.CAPACITOR), 0.0)
        total = farads * (1 + deviation) + parasitics.switch_capacitance
        row = network.neuron_index[AmplifierNodes(name).held]
        volts = np.divide(
            parasitics.switch_charge, total, out=np.zeros_like(total), where=total > 0
        )
        values[row] += volts * circuit.value_of(name)
    return network.pack(values)


def _pace(built: BuiltCircuit, op_amp: AmplifierNodes, neuron: str) -> Iterator[Piece]:
    """Yield the pace of the diode behind an op amp, from its net inputs to its pole ``neuron``.

    The net inputs add up at the node ``drop_free``.
    """
    thermal = THERMAL * abs(built.circuit.value_of(op_amp.part))
    away, above, inverse = (f"{name}.{op_amp.pace}" for name in ("away", "above", "inverse"))
    yield from weighted_sum(away, {op_amp.output: -1.0})
    yield Function(name=op_amp.beyond, function="rectify", x=away)
    weights = {op_amp.part: 1 / thermal, op_amp.beyond: STEEP / thermal, ONE: AT_KNEE}
    yield from weighted_sum(above, weights)
    yield Function(name=inverse, function="reciprocal", x=above)
    yield from weighted_sum(op_amp.pace, {ONE: 1.0, inverse: -1.0})
    yield Sum(name=op_amp.drop_free)
    yield Product(name=op_amp.paced, a=op_amp.drop_free, b=op_amp.pace)
    yield Coupling(op_amp.paced, neuron, 1.0)


def _slowed(built: BuiltCircuit, part: PICell, ohms: np.ndarray) -> np.ndarray:
    """Return the slowdown (N,) of a rectifying neuron by the junction: 1 on a chip.

    ``ohms`` (N,) is the parallel resistance of the feedback resistor and the inputs.
    """
    farads = 0.0 if built.level.transistors else JUNCTION
    return 1 + ohms * farads / built.scaling.time / built.outputs.lag(part.name)


def amplifier(built: BuiltCircuit, part: Amplifier) -> Iterator[Piece]:
    """Return the pieces of an integrator, a PI cell or an adder."""
    if isinstance(part, Adder):
        return _adder(built, part)
    if isinstance(part, PICell):
        return _diode_cell(built, part) if part.rectified else _pi_cell(built, part)
    return _integrator(built, part)


def inverter(built: BuiltCircuit, name: str) -> Iterator[Piece]:
    """Yield the pieces of the inverter of part ``name``: an adder with a wire of weight -1."""
    nodes = AmplifierNodes(name, inverter=True)
    weight = -(1 + built.deviation(name, Quantity.INVERTER))
    yield Sum(name=nodes.summed)
    slopes = (built.slope(-1.0, name, Quantity.INVERTER),)
    yield Coupling(name, nodes.summed, weight, slopes=slopes)
    yield from _amplify(built, nodes, -weight, -weight * built.circuit.inverter)


def _integrator(built: BuiltCircuit, part: Integrator) -> Iterator[Piece]:
    nodes, ones = AmplifierNodes(part.name), np.ones(built.stages)
    yield Sum(name=nodes.ground)
    divider = 1 / (1 + farads_over(built, part))
    at_rest = 0.0
    if part.with_limits and not built.moving:
        volt, known = built.circuit.value_of(part.name), built.outputs.offset(part.name)
        yield built.bias(nodes.ground, volt, part.name, Quantity.OFFSET, known)
        at_rest = 1 / built.outputs.gain(part.name)
    clamps = clamps_at(built, part)
    yield from clamps.pieces
    yield Coupling(nodes.output, nodes.ground, (1 - clamps.share) * divider - at_rest)
    for node, share in clamps.followers.items():
        yield Coupling(node, nodes.ground, share * divider)
    for node in (nodes.held, *clamps.shifts):
        yield Coupling(node, nodes.ground, -divider)
    gamma = built.conductance(part, ones)
    e: dict[str, Weight] = {nodes.ground: 1.0}
    if built.moving and built.datasheet.rout and clamps.into == nodes.summed:
        yield State(nodes.trailing, 1 / built.omega, Origin(part.name, 0.0))
        trailed = {nodes.summed: 1.0, nodes.ground: gamma, nodes.trailing: -1.0}
        yield from couplings(nodes.trailing, trailed)
        drop = _drop(built, part, 1 - clamps.share)
        e = {nodes.ground: 1 + drop * gamma, nodes.summed: drop, nodes.trailing: -drop}
    yield from _amplifier(built, nodes, e)
    yield from _capacitor(built, part, {nodes.ground: gamma}, part.tau, clamps.limiter)
    yield from _inputs(built, part, ones, clamps.into)
    ohms = built.scaling.time * part.tau / built.circuit.capacitors[part.name]
    yield from bias_current(built, nodes, clamps.into, ohms)


def _drop(built: BuiltCircuit, part: Integrator, share: float) -> np.ndarray:
    """Return r / R (N,), the drop of the current of an integrator's capacitor.

    A fraction ``share`` of the capacitor is connected to the output, the remainder to clamps.
    """
    tau = built.scaling.time * np.where(part.present, part.tau, 1.0)
    farads = np.where(part.present, built.circuit.capacitors[part.name], 0.0)
    return built.datasheet.rout * share * farads / tau


def _pi_cell(built: BuiltCircuit, part: PICell) -> Iterator[Piece]:
    nodes = AmplifierNodes(part.name)
    rho, factor, ohms = _feedback(built, part)
    yield Sum(name=nodes.summed)
    yield from _inputs(built, part, rho, nodes.summed)
    yield from bias_current(built, nodes, nodes.summed, ohms)
    gamma = built.conductance(part, rho)
    yield from ground(built, nodes, nodes.ground, 1 + gamma + farads_over(built, part), ohms)
    tau = np.where(part.present, part.tau, 1.0) * ohms / built.circuit.feedback[part.name]
    back = built.datasheet.rout / (ohms * built.omega * tau)  # of the capacitor's current
    yield from _amplifier(built, nodes, {nodes.ground: 1.0 - back * gamma, nodes.summed: -back})
    weights = {nodes.summed: 1.0, nodes.ground: gamma}
    yield from _capacitor(built, part, weights, part.tau * factor)


def _diode_cell(built: BuiltCircuit, part: PICell) -> Iterator[Piece]:
    nodes, op_amp = AmplifierNodes(part.name), AmplifierNodes(part.name, rectified=True)
    rho, factor, ohms = _feedback(built, part)
    yield Sum(name=nodes.summed)
    yield Sum(name=nodes.ground)
    yield Function(name=nodes.output, function="rectify", x=op_amp.output)
    yield from _inputs(built, part, rho, nodes.summed)
    yield from bias_current(built, nodes, nodes.summed, ohms)
    crossing = built.circuit.crossing(part)
    yield from weighted_sum(op_amp.below, {op_amp.output: -1.0, ONE: -crossing})
    yield Function(name=op_amp.back, function="rectify", x=op_amp.below)
    drop = crossing / 2 / built.outputs.gain(op_amp.part)
    e = {op_amp.output: SEEPING, op_amp.back: SEEPING - 1.0, ONE: drop}
    whole = 1 + built.conductance(part, rho)
    if lag_of(built, ohms, whole) is None:
        share = 1 / whole
        e |= {nodes.output: share - SEEPING, nodes.held: -share, nodes.summed: -share}
    else:
        yield from ground(built, nodes, nodes.lagging, whole, ohms)
        e |= {nodes.output: -SEEPING, nodes.lagging: 1.0}
    yield from couplings(nodes.ground, e)
    slower = _slowed(built, part, ohms / whole)
    yield from _amplifier(built, op_amp, {nodes.ground: 1.0}, slower)
    weights = {nodes.output: 1.0, nodes.held: -1.0, nodes.ground: -1.0, ONE: drop}
    yield from _capacitor(built, part, weights, part.tau * factor)


def _feedback(built: BuiltCircuit, part: PICell) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rho, the factor of the feedback resistor's deviation, and R_f in ohms, each (N,)."""
    factor = 1 + built.deviation(part.name, Quantity.FEEDBACK)
    rho = np.where(part.present, part.rho, 0.0) * factor
    return rho, factor, built.circuit.feedback[part.name] * factor


def _adder(built: BuiltCircuit, part: Adder) -> Iterator[Piece]:
    nodes = AmplifierNodes(part.name)
    yield Sum(name=nodes.summed)
    yield from _inputs(built, part, np.ones(built.stages), nodes.summed)
    factor = 1 + built.deviation(part.name, Quantity.FEEDBACK)
    gamma = built.conductance(part, factor)
    yield from _amplify(built, nodes, gamma, built.circuit.feedback[part.name] * factor)


def grid_node(built: BuiltCircuit, part: GridNode) -> Iterator[Piece]:
    """Yield the pieces of a pair of grid nodes, and of the follower of the first."""
    nodes, twin = AmplifierNodes(part.name), AmplifierNodes(part.name, inverter=True)
    circuit, schematic = built.circuit, built.schematic
    conductance = circuit.conductances[part.name]
    missing = to_ground(conductance, circuit.resistors[part.name])
    present = np.where(part.present, conductance, 1.0)
    across = np.minimum(missing, 0.0) / present / 2  # a negative resistance between the two
    for here, there, sign in ((nodes.held, twin.held, 1.0), (twin.held, nodes.held, -1.0)):
        yield State(here, circuit.lag, Origin(part.name, sign))
        yield from couplings(here, {here: across - 1.0, there: across})
    for wire in part.wires:
        pair = AmplifierNodes(wire.source), AmplifierNodes(wire.source, inverter=True)
        sign = schematic.polarity[wire.source] * schematic.polarity[part.name]
        is_own, volts = wire.source.startswith(OWN), sign * wire.weight
        for seen, (a, b) in ((volts > 0, pair), (volts < 0, pair[::-1])):
            weight = np.where(seen, sign * np.abs(wire.weight), 0.0)
            if weight.any():
                first, second = (a.output, b.output) if is_own else (a.held, b.held)
                yield Coupling(first, nodes.held, weight, wire.offset)
                yield Coupling(second, twin.held, weight, wire.offset)
    yield from _amplifier(built, nodes, {nodes.output: 1.0, nodes.held: -1.0})


def _amplify(
    built: BuiltCircuit, nodes: AmplifierNodes, gamma: np.ndarray, ohms: np.ndarray
) -> Iterator[Piece]:
    """Yield an op amp with resistive feedback: e = (x - A) / (1 + Gamma), or with a lag."""
    yield from bias_current(built, nodes, nodes.summed, ohms)
    e: dict[str, Weight] = {nodes.ground: 1.0}
    if lag_of(built, ohms, 1 + gamma) is None:
        e = {nodes.output: 1 / (1 + gamma), nodes.summed: -1 / (1 + gamma)}
    else:
        yield from ground(built, nodes, nodes.ground, 1 + gamma, ohms)
    yield from _amplifier(built, nodes, e)


def _amplifier(
    built: BuiltCircuit,
    nodes: AmplifierNodes,
    e: Mapping[str, Weight],
    slower: Weight = 1.0,
) -> Iterator[Piece]:
    """Yield x' = Omega (o - e - x / A0), e as node weights; ``slower`` divides Omega."""
    volt, outputs = built.circuit.value_of(nodes.part), built.outputs
    a0 = outputs.gain(nodes.part, nodes.inverter)
    name = nodes.first if has_second_pole(built.datasheet) else nodes.output
    yield from _poles(built, nodes, slower)
    driven = name
    if nodes.rectified and built.moving:
        yield from _pace(built, nodes, name)
        driven = nodes.drop_free
    target, per_target, limits = built.slewing(nodes.drive, driven, abs(volt))
    yield from limits
    for source, weight in e.items():
        leak = 1 / a0 if source == name else 0.0
        yield Coupling(source, target, -(np.asarray(weight) + leak) * per_target)
    if name not in e:
        yield Coupling(name, target, -per_target / a0)
    offset = Quantity.INVERTER_OFFSET if nodes.inverter else Quantity.OFFSET
    per_volt = volt * per_target / built.level.technology.op_amp_outputs
    known = outputs.offset(nodes.part, nodes.inverter)
    yield built.bias(target, per_volt, nodes.part, offset, known)


def _poles(built: BuiltCircuit, nodes: AmplifierNodes, slower: Weight) -> Iterator[Piece]:
    """Yield an op amp's pole within its swing, after any second pole."""
    datasheet, name = built.datasheet, nodes.output
    swing = datasheet.output_swing * abs(built.circuit.value_of(nodes.part))
    origin = Origin(nodes.part, -1.0 if nodes.inverter else 1.0)
    scale = built.scale_of(name)
    if has_second_pole(datasheet):
        tau = 1 / (2 * math.pi * datasheet.parasitics.second_pole * built.scaling.time)
        yield State(name, tau, origin, scale=scale)
        yield from couplings(name, {nodes.first: 1.0, name: -1.0})
        name = nodes.first
    lag = built.outputs.lag(nodes.part, nodes.inverter) * slower
    yield State(name, lag, origin, Limiter(low=-swing, high=swing), scale)


def _inputs(
    built: BuiltCircuit, part: Amplifier, scale: np.ndarray, target: str
) -> Iterator[Piece]:
    """Yield the wires of a part into a node; each resistor is one or two weights."""
    name, adds = part.name, isinstance(part, Adder)
    feedback = built.deviation(name, Quantity.FEEDBACK) if adds else 0.0
    for number, wire in enumerate(part.wires):
        off = built.deviation(name, Quantity.INPUT, number)
        weight = wire.weight * scale * (1 + feedback) / (1 + off)
        for source, given in _sources(built, part, wire, weight):
            slopes = [built.slope(-given / (1 + off), name, Quantity.INPUT, number)]
            if adds:
                slopes.append(built.slope(given / (1 + feedback), name, Quantity.FEEDBACK))
            yield Coupling(source, target, given, wire.offset, tuple(slopes), collected=True)


def _sources(
    built: BuiltCircuit, part: Amplifier, wire: Wire, weight: np.ndarray
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the direct and the inverted node that a wire reads, each at some stages."""
    direct = _direct(built, part, wire)
    inverted = AmplifierNodes(wire.source, inverter=True).output
    for source, sign, where in ((wire.source, 1.0, direct), (inverted, -1.0, ~direct)):
        if (where & (wire.weight != 0)).any():
            yield source, np.where(where, sign * weight, 0.0)


def _direct(built: BuiltCircuit, part: Amplifier, wire: Wire) -> np.ndarray:
    """Return a mask (N,) of the stages at which a wire reads a non-inverted output."""
    schematic, stages = built.schematic, np.arange(built.stages)
    polarity = schematic.polarity.get(wire.source)
    if polarity is None or schematic.differential:  # there with both signs
        return np.ones(built.stages, bool)
    where = stages + wire.offset
    pinned = [(wire.source, stage) in schematic.pins for stage in where.tolist()]
    outside = (where < 0) | (where >= built.stages)
    return (schematic.reading(part, wire) == polarity) | outside | np.array(pinned)
