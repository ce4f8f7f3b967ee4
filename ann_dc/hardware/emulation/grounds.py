r"""What lies at a virtual ground beside resistors: a capacitance, and a bias current.

With x the output of a part, h the charge of its capacitor over C, A what its inputs bring, e the
voltage of its virtual ground, C_in the capacitance from there to ground and kappa = C_in / C,

.. math::
    h &= x - (1 + \kappa)\, e &&\text{(integrator: a capacitive divider, and no more states)} \\
    \frac{R_f C_{in}}{T}\, \dot e &= x - h - A - (1 + \Gamma + \kappa)\, e
        &&\text{(PI cell; adder and inverter with } h = \kappa = 0) ,

h counting what has come through the inputs, part of which lies in C_in. A bias current I out of the
ground adds R I to A, R being R_f or the resistor of an integrator's input of weight one. The two
grounds of a differential op amp it moves alike, and no output.
"""

from __future__ import annotations

import numpy as np

from ann_dc.hardware.circuit.parameters import Quantity
from ann_dc.hardware.emulation.assembly import Assembly
from ann_dc.hardware.emulation.nodes import AmplifierNodes, Origin
from ann_dc.hardware.schematic.elements import Integrator, PICell
from ann_dc.network.cell import ONE

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
