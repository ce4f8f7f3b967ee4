r"""What lies at a virtual ground beside resistors: a capacitance, a bias current, and clamps.

With x the output of a part, h the charge of its capacitor over C, A what its inputs bring, e the
voltage of its virtual ground, C_in the capacitance from there to ground and kappa = C_in / C,

.. math::
    h &= x - (1 + \kappa)\, e &&\text{(integrator: a capacitive divider, and no more states)} \\
    \frac{R_f C_{in}}{T}\, \dot e &= x - h - A - (1 + \Gamma + \kappa)\, e
        &&\text{(PI cell; adder and inverter with } h = \kappa = 0) ,

h counting what has come through the inputs, part of which lies in C_in. A bias current I out of the
ground adds R I to A, R being R_f or the resistor of an integrator's input of weight one. The two
grounds of a differential op amp it moves alike, and no output.

Of an integrator with n rails a share n s of C lies in clamps, C_1 = s C in each. Those that are off
are followers, loaded by R_1, behind a resistor of r + 1 / (2 pi GBW C_1), r being the output
resistance of op amps. They bring f, which lags:

.. math::
    (1 + \kappa)\, e = x + n s\, (f - x) - h, \qquad
    \tau\, \dot f = x - f, \quad T\, \tau = \frac{2 + r / R_1}{2 \pi\, GBW} + r\, C_1 .

One that conducts keeps x where it is, which is what the limits of h are for. Its op amp, of gain
A0, has to give the drop of a diode, by 1 / A0 of which the limits are wider, and what the current
that would charge C drops across R_2 and r; to that it gives way by

.. math:: x = h + \Big(\frac{50}{2 \pi\, GBW} + r C\Big) \frac{rate\, A}{T A_0} .

It holds x beside its rail, by its offset and what its bias current makes of R_1. With d_1 at the
lower rail l, d_2 at the upper one u, the capacitor holds another h, and all else is the same:

.. math:: x = h + \frac{d_1 (u - h) + d_2 (h - l)}{u - l} , \qquad d = -I R_1 - v_{os} .
"""

from __future__ import annotations

import numpy as np

from ann_dc.hardware.circuit.circuit import (
    CLAMP_DROP,
    CLAMP_LAG,
    CLAMP_REFERENCE,
    CLAMP_SHARE,
)
from ann_dc.hardware.circuit.parameters import CLAMP_OFFSETS, Quantity
from ann_dc.hardware.emulation.assembly import AmplifierNodes, Assembly, Origin
from ann_dc.hardware.schematic.elements import Integrator, PICell
from ann_dc.network.cell import ONE, Limiter

FAST = 30.0
"""A pole inside an op amp's loop that many times faster than it is left out."""


def farads_over(assembly: Assembly, part: Integrator | PICell) -> np.ndarray:
    """kappa (N,): the capacitance of a ground over the part's capacitor and its open switch.

    Parameters
    ----------
    assembly : Assembly
    part : Integrator or PICell
    """
    off, parasitics = (
        assembly.deviation(part.name, Quantity.CAPACITOR),
        assembly.datasheet.parasitics,
    )
    own = np.where(part.present, assembly.circuit.capacitors[part.name], np.inf) * (1 + off)
    return parasitics.ground / (own + parasitics.switch_capacitance)


def lag_of(assembly: Assembly, ohms: np.ndarray, conductance: np.ndarray) -> np.ndarray | None:
    """R_f C_in / T (N,) of a ground; None where its capacitance does not count.

    Parameters
    ----------
    assembly : Assembly
    ohms : (N,) array
        The feedback resistor.
    conductance : (N,) array
        What the ground itself weighs, in conductances of the feedback resistor.
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
    """Add what outputs, capacitor and inputs make of a ground: a sum, or a neuron with a lag.

    Parameters
    ----------
    assembly : Assembly
    nodes : AmplifierNodes
        Of the op amp.
    name : str
        Of the node.
    conductance, ohms : (N,) array
        As `lag_of` takes them.
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
    """Add what a bias current brings, to where the inputs of a part end.

    Parameters
    ----------
    assembly : Assembly
    nodes : AmplifierNodes
        Of the op amp.
    target : str
        Node that the inputs end at.
    ohms : float or (N,) array
        R: volts at the output, or what an integrator makes of them, per ampere.
    """
    amperes = assembly.datasheet.parasitics.bias_current
    if amperes and not assembly.schematic.differential:
        assembly.sum(nodes.bias)  # a wire of its own: an input may be constant, too
        assembly.connect(ONE, nodes.bias, amperes * assembly.circuit.value_of(nodes.part))
        assembly.connect(nodes.bias, target, ohms)


def add_clamps(assembly: Assembly, part: Integrator) -> float:
    """Add what the clamps of an integrator follow its output with, to where that ends: f.

    Parameters
    ----------
    assembly : Assembly
    part : Integrator

    Returns
    -------
    float
        n s: the share of the capacitor that is in them; nothing is added where there is none.
    """
    nodes, circuit, sheet = AmplifierNodes(part.name), assembly.circuit, assembly.datasheet
    share = CLAMP_SHARE * int(np.isfinite(circuit.rails(part)).sum())
    if share:
        farads = CLAMP_SHARE * np.where(part.present, circuit.capacitors[part.name], 0.0)
        lag = (2 + sheet.rout * sheet.gbw / CLAMP_REFERENCE) / assembly.omega
        tau = lag + sheet.rout * farads / assembly.scaling.time
        assembly.neuron(nodes.clamps, tau, Origin(part.name))
        assembly.connect(nodes.output, nodes.clamps, 1.0)
        assembly.connect(nodes.clamps, nodes.clamps, -1.0)
        assembly.leave_out(nodes.clamps, np.flatnonzero(~part.present).tolist())
    return share


def add_shifts(assembly: Assembly, part: Integrator) -> tuple[str, ...]:
    """Add how far its clamps put an integrator beside its rails, by their offsets; their nodes.

    Parameters
    ----------
    assembly : Assembly
    part : Integrator

    Returns
    -------
    tuple of str
        Nodes, of which its output is the sum, and what its capacitor holds.
    """
    nodes, circuit, sheet = AmplifierNodes(part.name), assembly.circuit, assembly.datasheet
    rails, volt, found = circuit.rails(part), circuit.value_of(part.name), []
    reference = sheet.parasitics.bias_current * CLAMP_REFERENCE / sheet.gbw
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
            found.append(name)
    return tuple(found)


def given_way(assembly: Assembly, part: Integrator, limiter: Limiter) -> Limiter:
    """Add how far clamps that conduct give way, by what an integrator's inputs bring together.

    Parameters
    ----------
    assembly : Assembly
    part : Integrator
    limiter : Limiter
        Of its rails.

    Returns
    -------
    Limiter
        Of its capacitor, which gives way to the drop of a diode.
    """
    nodes, circuit, sheet = AmplifierNodes(part.name), assembly.circuit, assembly.datasheet
    assembly.sum(nodes.summed)
    assembly.connect(nodes.summed, nodes.held, 1.0)
    farads = np.where(part.present, circuit.capacitors[part.name], 0.0)
    lag = CLAMP_LAG / assembly.omega + sheet.rout * farads / assembly.scaling.time
    way = lag / part.tau / sheet.a0
    assembly.connect(nodes.summed, nodes.ground, -way / (1 + farads_over(assembly, part)))
    drop = abs(circuit.value_of(part.name)) * CLAMP_DROP / sheet.a0
    return Limiter(low=limiter.low - drop, high=limiter.high + drop)
