r"""Clamps of saturation limits: ideal at rest, op amps and diodes in transients.

A fraction n s of C of an integrator with n limits is located in clamps, C_1 = s C in each. At rest,
inactive clamps are followers, loaded by R_1, behind a resistor of r + 1 / (2 pi GBW C_1), with r
the output resistance of op amps. They supply f, which lags. With the symbols of virtual grounds:

.. math::
    (1 + \kappa)\, e = x + n s\, (f - x) - h, \qquad
    \tau\, \dot f = x - f, \quad T\, \tau = \frac{2 + r / R_1}{2 \pi\, GBW} + r\, C_1 .

A conducting clamp fixes x, which the limits of h represent. Its op amp, of gain A0, has to supply
the drop of a diode and the drop across R_2 and r of the current that would charge C. The diode drop
widens the limits by 1 / A0 of its value; the current drop moves x by

.. math:: x = h + \Big(\frac{50}{2 \pi\, GBW} + r C\Big) \frac{rate\, A}{T A_0} .

The clamp fixes x near its limit, displaced by its offset and by the drop of its bias current across
R_1. With d_1 at the lower limit l and d_2 at the upper limit u, the capacitor stores another h, and
all else is unchanged:

.. math:: x = h + \frac{d_1 (u - h) + d_2 (h - l)}{u - l} , \qquad d = -I R_1 - v_{os} .

In a transient a clamp is between these states for some time. Its op amp has to move, and the drop
of its two idle diodes decreases as x approaches the limit. This makes C larger by a factor of 1 + s
V_D / (u - x), with V_D = 2 V_T. In a transient, the clamp of an upper limit is modelled in detail,
with y the end of C_1:

.. math::
    (1 + \kappa)\, e &= (1 - n s)\, x + s \textstyle\sum y - h, \qquad
        \Big(\frac{1}{2 \pi\, GBW} + r C_1\Big) \dot y = o - y \\
    \Big(1 + \frac{r}{R_1}\Big) \dot o &= 2 \pi\, GBW\, \Big(x - d - v - \frac{o}{A_0}\Big) , \quad
        v = u - V_D\, \omega\!\Big(\frac{u - o}{V_D} + \ln \frac{R_1 I_s}{V_D}\Big) \\
    C\, \dot h &= i - \frac{V_T}{R_2 + r}\,
        \omega\!\Big(\frac{o}{V_T} + \ln \frac{(R_2 + r) I_s}{V_T}\Big) , \qquad
        \omega + \ln \omega = z ,

with o within the op amp's swing and slew rate. The omega functions are the diodes' laws, solved for
their currents. A clamp that cannot supply the required current lets x exceed its limit. The blocks
compute one step of Newton's method for omega from ln(1 + e^z), accurate to 1.5 %. V_T is that of 27
degrees.

A virtual ground also has a capacitance and a bias current. Let x be the output of a part, h the
charge of its capacitor over C, and A the contribution of its inputs. The virtual ground has the
voltage e and the capacitance C_in to ground, with kappa = C_in / C. Then

.. math::
    h &= x - (1 + \kappa)\, e &&\text{(integrator: a capacitive divider, and no more states)} \\
    \frac{R_f C_{in}}{T}\, \dot e &= x - h - A - (1 + \Gamma + \kappa)\, e
        &&\text{(PI cell; adder and inverter with } h = \kappa = 0) ,

where h counts the charge from the inputs, part of which is in C_in. A bias current I out of the
ground adds R I to A, with R being R_f or the resistor of an integrator's input of weight one. It
moves the two grounds of a differential op amp equally, and no output.

The op amp of an idle clamp at an upper limit u follows the output x, two diode drops below. One
drop is not sufficient, because near the limit idle diodes carry little current and the clamping
diode leaks:

.. math:: o = x - V_D \ln\Big(1 + \frac{u - x}{R_1 I_s}\Big) , \qquad
    \frac{do}{dx} = 1 + \frac{V_D}{u - x + R_1 I_s} , \quad V_D = 2 V_T .

A fraction s of the integrator's capacitor is charged with o, so near a limit this part is larger by
the factor do/dx.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ann_dc.hardware.circuit.circuit import (
    CLAMP_DROP,
    CLAMP_LAG,
    CLAMP_OFFSETS,
    CLAMP_REFERENCE,
    CLAMP_RESTING,
    CLAMP_SATURATION,
    CLAMP_SHARE,
    THERMAL,
    Circuit,
    Quantity,
)
from ann_dc.hardware.emulation.assembly import (
    Coupling,
    Piece,
    State,
    Weight,
    couplings,
    weighted_sum,
)
from ann_dc.hardware.emulation.built_circuit import BuiltCircuit
from ann_dc.hardware.emulation.diode_knee import bent_rectifier
from ann_dc.hardware.emulation.emulation import Emulation, slower_network
from ann_dc.hardware.emulation.nodes import AmplifierNodes, ClampNodes, Origin
from ann_dc.hardware.parts.board_models import op_amp_output_swing
from ann_dc.hardware.parts.datasheet import Datasheet
from ann_dc.hardware.schematic.elements import UNLIMITED, Integrator, PICell
from ann_dc.network.cell import ONE, Function, Limiter, Product, Sum
from ann_dc.network.network import Network

BESIDE = 1e-4
"""Distance in volts from a limit at which reset leaves an output that starts at the limit.

The cause is the current of its inputs through a closed switch of one ohm.
"""


@dataclass(frozen=True)
class Clamp:
    """Clamp of an integrator, in network units of its output.

    ``side`` is 1 for the upper limit, -1 for the lower limit. ``thermal`` is V_T, ``idling`` V_D of
    the diodes through which the inactive clamp follows, and ``seeping`` R_1 I_s.
    """

    nodes: ClampNodes
    side: float
    rail: float
    thermal: float
    idling: float
    seeping: float

    def idle(self, x: np.ndarray) -> np.ndarray:
        """Return the op amp's equilibrium output while the integrator is within limits."""
        apart = np.maximum(self.side * (self.rail - x), self.thermal * BESIDE / THERMAL)
        return x - self.side * self.idling * np.log1p(apart / self.seeping)

    def added(self, x: np.ndarray) -> np.ndarray:
        """Return the added relative capacitance; 0 if the clamp conducts."""
        apart = self.side * (self.rail - x)
        off = apart > self.thermal * BESIDE / THERMAL
        return CLAMP_SHARE * self.idling / (np.where(off, apart, np.inf) + self.seeping)


def clamps_of(circuit: Circuit, sheet: Datasheet, part: Integrator) -> tuple[Clamp, ...]:
    """Return the moving clamps of an integrator, one per limit, the lower limit first."""
    built, value = circuit.limiter(part), circuit.value_of(part.name)
    return tuple(
        Clamp(
            nodes=ClampNodes(part.name, upper=side * value > 0),
            side=side,
            rail=rail,
            thermal=THERMAL * abs(value),
            idling=CLAMP_RESTING * THERMAL * abs(value),
            seeping=CLAMP_REFERENCE / sheet.gbw * CLAMP_SATURATION * abs(value),
        )
        for side, rail in ((-1.0, built.low), (1.0, built.high))
        if math.isfinite(rail)
    )


def rest_idle(network: Network, circuit: Circuit, sheet: Datasheet, x: np.ndarray) -> np.ndarray:
    """Return an emulation state in which all moving clamps are off.

    The given state ``x`` (n,) has outputs inside their limits.
    """
    full = network.unpack(x).copy()
    for part in circuit.schematic.limited:
        output = full[network.neuron_index[part.name]]
        beside = np.zeros_like(output)
        for clamp in clamps_of(circuit, sheet, part):
            rest = clamp.idle(output)
            beside += CLAMP_SHARE * (rest - output)
            for name in (clamp.nodes.output, clamp.nodes.share):
                full[network.neuron_index[name]] = rest
        full[network.neuron_index[AmplifierNodes(part.name).held]] = output + beside
    return network.pack(full)


def beside_limits(emulation: Emulation, sheet: Datasheet, x: np.ndarray) -> Emulation:
    """Return an emulation with the capacitors enlarged by idle clamps at a state.

    The given emulation treats clamps as ideal limiters, and ``x`` (n,) is a state of the ideal
    network. The emulation is returned unchanged if the circuit has no clamps.
    """
    circuit, network = emulation.circuit, emulation.network
    ideal, larger = circuit.schematic.network, dict[str, np.ndarray]()
    values = ideal.unpack(x)
    for part in circuit.schematic.limited:
        output = values[ideal.neuron_index[part.name]]
        added = [clamp.added(output) for clamp in clamps_of(circuit, sheet, part)]
        larger[AmplifierNodes(part.name).held] = 1 + np.sum(added, axis=0)
    return replace(emulation, network=slower_network(network, larger)) if larger else emulation


FAST = 30.0
"""Ratio of a pole in an op amp's loop to its bandwidth above which the pole is omitted."""


def has_second_pole(sheet: Datasheet) -> bool:
    """Return True if the second pole of the op amps is not negligible."""
    return sheet.parasitics.second_pole < FAST * sheet.gbw


def farads_over(built: BuiltCircuit, part: Integrator | PICell) -> np.ndarray:
    """Return kappa (N,): ground capacitance over the capacitor plus its open switch."""
    off, parasitics = built.deviation(part.name, Quantity.CAPACITOR), built.datasheet.parasitics
    own = np.where(part.present, built.circuit.capacitors[part.name], np.inf) * (1 + off)
    return parasitics.ground / (own + parasitics.switch_capacitance)


def lag_of(built: BuiltCircuit, ohms: np.ndarray, conductance: np.ndarray) -> np.ndarray | None:
    """Return R_f C_in / T (N,) of a ground, or None if its capacitance is negligible.

    ``ohms`` (N,) is the feedback resistor, and ``conductance`` (N,) is the weight of the ground in
    conductances of that resistor.
    """
    lag = ohms * built.datasheet.parasitics.ground / built.scaling.time
    return lag if (built.omega * lag / conductance).max() * FAST > 1 else None


def ground(
    built: BuiltCircuit,
    nodes: AmplifierNodes,
    name: str,
    conductance: np.ndarray,
    ohms: np.ndarray,
) -> Iterator[Piece]:
    """Yield a virtual ground of output, capacitor and inputs: a sum or a lagging neuron.

    The ground is called ``name``; ``conductance`` and ``ohms`` (N,) are those of `lag_of`.
    """
    lag = lag_of(built, ohms, conductance)
    part = built.schematic.by_name[nodes.part]
    holds = isinstance(part, PICell) and not nodes.inverter
    sources = {nodes.output: 1.0, **({nodes.held: -1.0} if holds else {}), nodes.summed: -1.0}
    if lag is None:
        shares = {source: weight / conductance for source, weight in sources.items()}
        yield from weighted_sum(name, shares)
    else:
        yield State(name, lag, Origin(nodes.part, 0.0))
        yield from couplings(name, {name: -conductance, **sources})


def bias_current(
    built: BuiltCircuit, nodes: AmplifierNodes, target: str, ohms: Weight
) -> Iterator[Piece]:
    """Yield the effect of a bias current at the node ``target`` of a part's inputs.

    ``ohms`` is R: volts at the output per ampere, or for an integrator its rate.
    """
    amperes = built.datasheet.parasitics.bias_current
    if amperes and not built.schematic.differential:  # a node of its own: inputs may be constant
        value = amperes * built.circuit.value_of(nodes.part)
        yield from weighted_sum(nodes.bias, {ONE: value})
        yield Coupling(nodes.bias, target, ohms)


@dataclass(frozen=True)
class Clamps:
    """Contributions of the clamps of an integrator.

    The inputs of the integrator end at the node ``into``, and ``limiter`` has the limits of the
    capacitor. ``followers`` are nodes that follow the output, with the fractions of the capacitor
    at them, and ``shifts`` nodes of the differences between the output and the capacitor voltage.
    """

    pieces: tuple[Piece, ...]
    into: str
    limiter: Limiter = UNLIMITED
    followers: Mapping[str, float] = field(default_factory=dict)
    shifts: tuple[str, ...] = ()

    @property
    def share(self) -> float:
        """Fraction n s of the capacitor in clamps."""
        return sum(self.followers.values())


def clamps_at(built: BuiltCircuit, part: Integrator) -> Clamps:
    """Return the clamps of an integrator's limits, if any."""
    nodes, circuit = AmplifierNodes(part.name), built.circuit
    volts = circuit.limits(part)
    count = int(np.isfinite(volts).sum())
    into, pieces = nodes.held, list[Piece]()
    # a shared neuron reads others of its kind in the last cell only, which a sum would do in all
    if (count or built.moving) and not built.schematic.collects(part.name):
        into = nodes.summed
        pieces += [Sum(name=into), Coupling(into, nodes.held, 1.0)]
    if built.moving:
        clamps = clamps_of(circuit, built.datasheet, part)
        for clamp in clamps:
            pieces += _moving_clamp(built, part, clamp, into)
        shares = {clamp.nodes.share: CLAMP_SHARE for clamp in clamps}
        return Clamps(tuple(pieces), into, followers=shares)
    if not count:
        return Clamps(tuple(pieces), into)
    pieces += _follower(built, part)
    if into == nodes.summed:
        way = _carrying(built, part) / part.tau / built.datasheet.a0
        pieces.append(Coupling(into, nodes.ground, -way / (1 + farads_over(built, part))))
    drop = abs(circuit.value_of(part.name)) * CLAMP_DROP / built.datasheet.a0
    limiter = circuit.limiter(part)
    limited = [q for q, rail in zip(CLAMP_OFFSETS, volts) if np.isfinite(rail)]
    for quantity in limited:
        pieces += _shift(built, part, quantity)
    return Clamps(
        tuple(pieces),
        into,
        limiter=Limiter(low=limiter.low - drop, high=limiter.high + drop),
        followers={nodes.clamps: CLAMP_SHARE * count},
        shifts=tuple(_shift_node(part, quantity) for quantity in limited),
    )


def _follower(built: BuiltCircuit, part: Integrator) -> Iterator[Piece]:
    """Yield the common follower of all clamps, as if none conducted."""
    nodes, sheet = AmplifierNodes(part.name), built.datasheet
    lag = (2 + sheet.rout * sheet.gbw / CLAMP_REFERENCE) / built.omega
    yield State(nodes.clamps, lag + _share_lag(built, part), Origin(part.name))
    yield from couplings(nodes.clamps, {nodes.output: 1.0, nodes.clamps: -1.0})


def _share_lag(built: BuiltCircuit, part: Integrator) -> np.ndarray:
    """Return r C_1 (N,) in network time."""
    return built.datasheet.rout * CLAMP_SHARE * _farads(built, part) / built.scaling.time


def _farads(built: BuiltCircuit, part: Integrator) -> np.ndarray:
    return np.where(part.present, built.circuit.capacitors[part.name], 0.0)


def _carrying(built: BuiltCircuit, part: Integrator) -> np.ndarray:
    """Return C (R_2 + r) (N,) in network time."""
    farads = built.datasheet.rout * _farads(built, part) / built.scaling.time
    return CLAMP_LAG / built.omega + farads


def _shift_node(part: Integrator, quantity: Quantity) -> str:
    return f"{quantity.letters}.{part.name}"


def _shift(built: BuiltCircuit, part: Integrator, quantity: Quantity) -> Iterator[Piece]:
    """Yield the displacement from one limit of an integrator by the offset of its clamp."""
    name, circuit = _shift_node(part, quantity), built.circuit
    low, high = circuit.limits(part)
    volts, other = (low, high) if quantity is Quantity.LOW_OFFSET else (high, low)
    span = volts - other  # infinite where there is no other rail
    at_zero = 1.0 if np.isinf(other) else -other / span
    reference = _reference(built)
    off = built.deviation(part.name, quantity) + reference
    yield Sum(name=name)
    per_volt = -circuit.value_of(part.name) * at_zero
    yield built.bias(name, per_volt, part.name, quantity, reference)
    slopes = (built.slope(-1 / span, part.name, quantity),)
    yield Coupling(AmplifierNodes(part.name).held, name, -off / span, slopes=slopes)


def _reference(built: BuiltCircuit) -> float:
    """Return the volts that a bias current drops before the reference of a clamp."""
    sheet = built.datasheet
    return sheet.parasitics.bias_current * CLAMP_REFERENCE / sheet.gbw


def _moving_clamp(
    built: BuiltCircuit, part: Integrator, clamp: Clamp, into: str
) -> Iterator[Piece]:
    """Yield a moving clamp: op amp, diodes and its part of the capacitor.

    That part of the capacitor is between the virtual ground and the node ``clamp.nodes.share``.
    """
    nodes = clamp.nodes
    yield from _comparator(built, part, clamp)
    yield from _current(built, part, clamp, into)
    lag = 1 / built.omega + _share_lag(built, part)
    yield State(nodes.share, lag, Origin(part.name))
    yield from couplings(nodes.share, {nodes.output: 1.0, nodes.share: -1.0})


def _comparator(built: BuiltCircuit, part: Integrator, clamp: Clamp) -> Iterator[Piece]:
    """Yield the op amp of a clamp, and the diode through which it follows while idle."""
    nodes, sheet, thermal = clamp.nodes, built.datasheet, clamp.idling
    value = built.circuit.value_of(part.name)
    swing = op_amp_output_swing(sheet, built.scaling.full_scale) * abs(value)
    lag = (1 + sheet.rout * sheet.gbw / CLAMP_REFERENCE) / built.omega
    yield State(nodes.output, lag, Origin(part.name), Limiter(low=-swing, high=swing))
    target, per_target, limits = built.slewing(nodes.drive, nodes.output, abs(value))
    yield from limits
    drives = {part.name: 1.0, nodes.output: -1 / sheet.a0, nodes.short: clamp.side * thermal}
    yield from couplings(target, {node: weight * per_target for node, weight in drives.items()})
    known = _reference(built) - clamp.rail / value
    yield built.bias(target, value * per_target, part.name, CLAMP_OFFSETS[nodes.upper], known)
    begins = math.log(clamp.seeping / thermal) + clamp.side * clamp.rail / thermal
    yield from _omega(nodes.short, nodes.output, -clamp.side / thermal, begins)


def _current(built: BuiltCircuit, part: Integrator, clamp: Clamp, into: str) -> Iterator[Piece]:
    """Yield the current of a clamp's other diode into the virtual ground."""
    nodes, out = clamp.nodes, clamp.side * clamp.thermal
    carrying = _carrying(built, part)
    ohms = built.scaling.time * carrying / np.where(part.present, _farads(built, part), 1.0)
    begins = np.log(ohms * CLAMP_SATURATION / THERMAL)
    yield from _omega(nodes.current, nodes.output, 1 / out, begins)
    pull = np.where(part.present, part.tau, 0.0) / carrying
    yield Coupling(nodes.current, into, -out * pull)


def _omega(name: str, source: str, weight: float, at_zero: Weight) -> Iterator[Piece]:
    """Yield omega + ln omega = z, with z = weight source + at_zero.

    The blocks compute near (1 + z - ln near) / (1 + near).
    """
    z, near, log, above, below = (f"{n}.{name}" for n in ("z", "near", "log", "above", "below"))
    inverse, times = f"inverse.{name}", f"times.{name}"
    yield from weighted_sum(z, {source: weight, ONE: at_zero})
    blocks, wires = bent_rectifier(Function(name=near, function="rectify", x=z), 1.0)
    yield from blocks
    yield from (Coupling(wire.source, wire.target, wire.weight) for wire in wires)
    yield Function(name=log, function="log", x=near)
    yield from weighted_sum(above, {ONE: 1.0, z: 1.0, log: -1.0})
    yield from weighted_sum(below, {ONE: 1.0, near: 1.0})
    yield Function(name=inverse, function="reciprocal", x=below)
    yield Product(name=times, a=near, b=above)
    yield Product(name=name, a=times, b=inverse)
