r"""Clamps of saturation limits: ideal at rest, op amps and diodes in transients.

A fraction n s of C of an integrator with n limits is located in clamps, C_1 = s C in each. At rest,
inactive clamps are followers, loaded by R_1, behind a resistor of r + 1 / (2 pi GBW C_1), with r
the output resistance of op amps. They supply f, which lags. With the symbols of `grounds`:

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

Capacitance and bias current at a virtual ground, in addition to resistors.

Let x be the output of a part, h the charge of its capacitor over C, and A the contribution of its
inputs. The virtual ground has the voltage e and the capacitance C_in to ground, with kappa = C_in /
C. Then

.. math::
    h &= x - (1 + \kappa)\, e &&\text{(integrator: a capacitive divider, and no more states)} \\
    \frac{R_f C_{in}}{T}\, \dot e &= x - h - A - (1 + \Gamma + \kappa)\, e
        &&\text{(PI cell; adder and inverter with } h = \kappa = 0) ,

where h counts the charge from the inputs, part of which is in C_in. A bias current I out of the
ground adds R I to A, with R being R_f or the resistor of an integrator's input of weight one. It
moves the two grounds of a differential op amp equally, and no output.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from ann_dc.hardware.circuit.circuit import (
    CLAMP_DROP,
    CLAMP_LAG,
    CLAMP_OFFSETS,
    CLAMP_REFERENCE,
    CLAMP_SATURATION,
    CLAMP_SHARE,
    THERMAL,
    Quantity,
)
from ann_dc.hardware.emulation.assembly import Assembly
from ann_dc.hardware.emulation.diode_knee import bent_rectifier
from ann_dc.hardware.emulation.idle_clamps import Clamp, clamps_of
from ann_dc.hardware.emulation.nodes import AmplifierNodes, Origin
from ann_dc.hardware.parts.board_models import op_amp_rails
from ann_dc.hardware.schematic.elements import UNLIMITED, Integrator, PICell
from ann_dc.network.cell import ONE, Function, Limiter

FAST = 30.0
"""Ratio of a pole in an op amp's loop to its bandwidth above which the pole is omitted."""


def farads_over(assembly: Assembly, part: Integrator | PICell) -> np.ndarray:
    """Return kappa (N,): ground capacitance over the capacitor plus its open switch."""
    off, parasitics = (
        assembly.deviation(part.name, Quantity.CAPACITOR),
        assembly.datasheet.parasitics,
    )
    own = np.where(part.present, assembly.circuit.capacitors[part.name], np.inf) * (1 + off)
    return parasitics.ground / (own + parasitics.switch_capacitance)


def lag_of(assembly: Assembly, ohms: np.ndarray, conductance: np.ndarray) -> np.ndarray | None:
    """Return R_f C_in / T (N,) of a ground, or None if its capacitance is negligible.

    ``ohms`` (N,) is the feedback resistor, and ``conductance`` (N,) is the weight of the ground in
    conductances of that resistor.
    """
    lag = ohms * assembly.datasheet.parasitics.ground / assembly.scaling.time
    return lag if (assembly.omega * lag / conductance).max() * FAST > 1 else None


def add_ground(
    assembly: Assembly,
    nodes: AmplifierNodes,
    name: str,
    conductance: np.ndarray,
    ohms: np.ndarray,
) -> None:
    """Add a virtual ground of output, capacitor and inputs: a sum or a lagging neuron.

    The ground is called ``name``; ``conductance`` and ``ohms`` (N,) are those of `lag_of`.
    """
    lag = lag_of(assembly, ohms, conductance)
    part = assembly.schematic.by_name[nodes.part]
    holds = isinstance(part, PICell) and not nodes.inverter
    sources = {nodes.output: 1.0, **({nodes.held: -1.0} if holds else {}), nodes.summed: -1.0}
    if lag is None:
        assembly.sum(name)
    else:
        assembly.neuron(name, lag, Origin(nodes.part, 0.0))
        assembly.connect(name, name, -conductance)
    for source, weight in sources.items():
        assembly.connect(source, name, weight / conductance if lag is None else weight)


def add_bias(
    assembly: Assembly, nodes: AmplifierNodes, target: str, ohms: float | np.ndarray
) -> None:
    """Add the effect of a bias current at the node ``target`` of a part's inputs.

    ``ohms`` is R: volts at the output per ampere, or for an integrator its rate.
    """
    amperes = assembly.datasheet.parasitics.bias_current
    if amperes and not assembly.schematic.differential:
        assembly.sum(nodes.bias)  # a wire of its own: an input may be constant, too
        assembly.connect(ONE, nodes.bias, amperes * assembly.circuit.value_of(nodes.part))
        assembly.connect(nodes.bias, target, ohms)


@dataclass(frozen=True)
class Clamps:
    """Contributions of the clamps of an integrator.

    Attributes
    ----------
    into : str
        Node at which the inputs end.
    limiter : Limiter
        Limits of the capacitor.
    followers : mapping of node name to float
        Nodes that follow the output, and the fractions of the capacitor at them.
    shifts : tuple of str
        Differences between the output and the capacitor voltage.
    """

    into: str
    limiter: Limiter = UNLIMITED
    followers: Mapping[str, float] = field(default_factory=dict)
    shifts: tuple[str, ...] = ()

    @property
    def share(self) -> float:
        """Fraction n s of the capacitor in clamps."""
        return sum(self.followers.values())


def add_clamps(assembly: Assembly, part: Integrator) -> Clamps:
    """Add the clamps of an integrator's limits, if any."""
    nodes, rails = AmplifierNodes(part.name), np.isfinite(assembly.circuit.rails(part))
    into = nodes.held
    # a shared neuron reads others of its kind in the last cell only, which a sum would do in all
    if (rails.any() or assembly.moving) and not assembly.schematic.collects(part.name):
        into = nodes.summed
        assembly.sum(into)
        assembly.connect(into, nodes.held, 1.0)
    if assembly.moving:
        clamps = clamps_of(assembly.circuit, assembly.datasheet, part)
        shares = {_add_clamp(assembly, part, clamp, into): CLAMP_SHARE for clamp in clamps}
        return Clamps(into=into, followers=shares)
    if not rails.any():
        return Clamps(into=into)
    _add_follower(assembly, part)
    return Clamps(
        into=into,
        limiter=_given_way(assembly, part, into),
        followers={nodes.clamps: CLAMP_SHARE * int(rails.sum())},
        shifts=tuple(_shifts(assembly, part)),
    )


def _add_follower(assembly: Assembly, part: Integrator) -> None:
    """Add the common follower of all clamps, as if none conducted."""
    nodes, sheet = AmplifierNodes(part.name), assembly.datasheet
    lag = (2 + sheet.rout * sheet.gbw / CLAMP_REFERENCE) / assembly.omega
    assembly.neuron(nodes.clamps, lag + _share_lag(assembly, part), Origin(part.name))
    assembly.connect(nodes.output, nodes.clamps, 1.0)
    assembly.connect(nodes.clamps, nodes.clamps, -1.0)
    assembly.leave_out(nodes.clamps, np.flatnonzero(~part.present).tolist())


def _share_lag(assembly: Assembly, part: Integrator) -> np.ndarray:
    """Return r C_1 (N,) in network time."""
    return assembly.datasheet.rout * CLAMP_SHARE * _farads(assembly, part) / assembly.scaling.time


def _farads(assembly: Assembly, part: Integrator) -> np.ndarray:
    return np.where(part.present, assembly.circuit.capacitors[part.name], 0.0)


def _carrying(assembly: Assembly, part: Integrator) -> np.ndarray:
    """Return C (R_2 + r) (N,) in network time."""
    farads = assembly.datasheet.rout * _farads(assembly, part) / assembly.scaling.time
    return CLAMP_LAG / assembly.omega + farads


def _given_way(assembly: Assembly, part: Integrator, into: str) -> Limiter:
    """Add the displacement of conducting clamps; return the widened capacitor limits."""
    nodes, circuit, a0 = AmplifierNodes(part.name), assembly.circuit, assembly.datasheet.a0
    if into == nodes.summed:
        way = _carrying(assembly, part) / part.tau / a0
        assembly.connect(into, nodes.ground, -way / (1 + farads_over(assembly, part)))
    drop, limiter = abs(circuit.value_of(part.name)) * CLAMP_DROP / a0, circuit.limiter(part)
    return Limiter(low=limiter.low - drop, high=limiter.high + drop)


def _shifts(assembly: Assembly, part: Integrator) -> Iterator[str]:
    """Add the displacements from an integrator's limits by clamp offsets; yield nodes."""
    nodes, circuit = AmplifierNodes(part.name), assembly.circuit
    rails, volt = circuit.rails(part), circuit.value_of(part.name)
    reference = _reference(assembly)
    for quantity, volts, other in zip(CLAMP_OFFSETS, rails, rails[::-1]):
        if np.isfinite(volts):
            name = f"{quantity.letters}.{part.name}"
            span = volts - other  # infinite where there is no other rail
            at_zero = 1.0 if np.isinf(other) else -other / span
            assembly.sum(name)
            assembly.bias(name, -volt * at_zero, part.name, quantity, reference)
            off = assembly.deviation(part.name, quantity) + reference
            connection = assembly.connect(nodes.held, name, -off / span)
            assembly.slope(connection, -1 / span, part.name, quantity)
            yield name


def _reference(assembly: Assembly) -> float:
    """Return the volts that a bias current drops before the reference of a clamp."""
    sheet = assembly.datasheet
    return sheet.parasitics.bias_current * CLAMP_REFERENCE / sheet.gbw


def _add_clamp(assembly: Assembly, part: Integrator, clamp: Clamp, into: str) -> str:
    """Add a moving clamp and return the name of the node of its part of the capacitor.

    A clamp consists of an op amp, diodes and its part of the capacitor, which ends at the virtual
    ground and at that node.
    """
    nodes = clamp.nodes
    _add_comparator(assembly, part, clamp)
    _add_current(assembly, part, clamp, into)
    lag = 1 / assembly.omega + _share_lag(assembly, part)
    assembly.neuron(nodes.share, lag, Origin(part.name))
    assembly.connect(nodes.op_amp, nodes.share, 1.0)
    assembly.connect(nodes.share, nodes.share, -1.0)
    for name in (nodes.op_amp, nodes.share):
        assembly.leave_out(name, np.flatnonzero(~part.present).tolist())
    return nodes.share


def _add_comparator(assembly: Assembly, part: Integrator, clamp: Clamp) -> None:
    """Add the op amp of a clamp, and the diode through which it follows while idle."""
    nodes, sheet, thermal = clamp.nodes, assembly.datasheet, clamp.idling
    value = assembly.circuit.value_of(part.name)
    rails = op_amp_rails(sheet, assembly.scaling.full_scale) * abs(value)
    lag = (1 + sheet.rout * sheet.gbw / CLAMP_REFERENCE) / assembly.omega
    limiter = Limiter(low=-rails, high=rails)
    assembly.neuron(nodes.op_amp, lag, Origin(part.name), limiter=limiter)
    target, per_target = nodes.op_amp, 1.0
    if math.isfinite(sheet.slew):
        target = nodes.drive
        per_target = assembly.slewing(target, nodes.op_amp, abs(value))
    drives = {part.name: 1.0, nodes.op_amp: -1 / sheet.a0, nodes.short: clamp.side * thermal}
    for source, weight in drives.items():
        assembly.connect(source, target, weight * per_target)
    known = _reference(assembly) - clamp.rail / value
    assembly.bias(target, value * per_target, part.name, CLAMP_OFFSETS[nodes.upper], known)
    begins = math.log(clamp.seeping / thermal) + clamp.side * clamp.rail / thermal
    _add_omega(assembly, nodes.short, nodes.op_amp, -clamp.side / thermal, begins)


def _add_current(assembly: Assembly, part: Integrator, clamp: Clamp, into: str) -> None:
    """Add the current of a clamp's other diode into the virtual ground."""
    nodes, out = clamp.nodes, clamp.side * clamp.thermal
    carrying = _carrying(assembly, part)
    ohms = assembly.scaling.time * carrying / np.where(part.present, _farads(assembly, part), 1.0)
    begins = np.log(ohms * CLAMP_SATURATION / THERMAL)
    _add_omega(assembly, nodes.current, nodes.op_amp, 1 / out, begins)
    pull = np.where(part.present, part.tau, 0.0) / carrying
    assembly.connect(nodes.current, into, -out * pull)


def _add_omega(
    assembly: Assembly, name: str, source: str, weight: float, at_zero: float | np.ndarray
) -> None:
    """Add omega + ln omega = z, with z = weight source + at_zero.

    The blocks compute near (1 + z - ln near) / (1 + near).
    """
    z, near, log, above, below = (f"{n}.{name}" for n in ("z", "near", "log", "above", "below"))
    inverse, times = f"inverse.{name}", f"times.{name}"
    assembly.sum(z)
    assembly.connect(source, z, weight)
    assembly.connect(ONE, z, at_zero)
    assembly.add(*bent_rectifier(Function(name=near, function="rectify", x=z), 1.0))
    assembly.function(log, "log", near)
    assembly.sum(above)
    assembly.sum(below)
    for node, sign in ((ONE, 1.0), (z, 1.0), (log, -1.0)):
        assembly.connect(node, above, sign)
    assembly.connect(ONE, below, 1.0)
    assembly.connect(near, below, 1.0)
    assembly.function(inverse, "reciprocal", below)
    assembly.product(times, near, above)
    assembly.product(name, times, inverse)
