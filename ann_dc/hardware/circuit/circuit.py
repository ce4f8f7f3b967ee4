r"""Resistors and capacitors of a scaled schematic.

Let S be the units of the nodes, T the seconds per unit of network time, and sigma the polarity of a
source. The current of a wire of weight w into the virtual ground of a part at polarity p has the
sign of p sigma w. A part inverts, so the source is taken with the sign that makes this product
negative:

.. math::
    \frac{1}{R_j C} = \frac{rate\,|w_j|\,S_j}{S\,T}
    \;\text{(integrator)}, \qquad
    \frac{R_f}{R_j} = \frac{\rho\,|w_j|\,S_j}{S}, \; R_f C = \frac{\rho\,T}{rate}
    \;\text{(PI cell)}, \qquad
    \frac{R_f}{R_j} = \frac{|w_j|\,S_j}{S}
    \;\text{(adder)} .

The largest current of a part flows through `SMALLEST_RESISTOR`. This determines the capacitor of an
integrator and the feedback resistor of the other parts, equal in all cells. The feedback resistor
of a rectifying multiplier neuron is at least `SMALLEST_RESISTOR`. The resistor that pulls the
neuron's output to zero while inactive is `HOLD` of that value and has to be much smaller than the
feedback resistor.
"""

from __future__ import annotations

import enum
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from ann_dc.dataclass_pickling import Record
from ann_dc.errors import NetworkError, require_positive, such_as
from ann_dc.hardware.circuit.scaling import Scaling, values_of_grid
from ann_dc.hardware.parts.datasheet import SMALLEST_RESISTOR, Kind
from ann_dc.hardware.schematic.elements import (
    Adder,
    Amplifier,
    Generator,
    GridNode,
    Integrator,
    Multiplier,
    Part,
    PICell,
)
from ann_dc.hardware.schematic.preconditioner_wiring import preconditioner_values
from ann_dc.hardware.schematic.schematic import Schematic
from ann_dc.network.cell import ONE, Limiter
from ann_dc.scale import IDENTITY, Scale
from ann_dc.summaries import summarised


class Quantity(enum.Enum):
    """Quantity of a part: name prefix and tolerance kind of a parameter.

    Resistors of an amplifier are those of its wires, its feedback and its inverter. Offsets are
    those of its op amp, of its inverter, and of the clamps of its limits. A multiplier has offsets
    at its inputs x and y and at its output z, a function generator at its output y.
    """

    INPUT = "r", Kind.RESISTOR
    FEEDBACK = "rf", Kind.RESISTOR
    CAPACITOR = "c", Kind.CAPACITOR
    OFFSET = "vos", Kind.OFFSET
    LOW_OFFSET = "vos_lo", Kind.OFFSET
    HIGH_OFFSET = "vos_hi", Kind.OFFSET
    INVERTER = "e_n", Kind.RESISTOR
    INVERTER_OFFSET = "vos_n", Kind.OFFSET
    GAIN = "ge", Kind.GAIN
    OFFSET_X = "ox", Kind.PRODUCT_OFFSET
    OFFSET_Y = "oy", Kind.PRODUCT_OFFSET
    OFFSET_Z = "oz", Kind.PRODUCT_OFFSET

    @property
    def letters(self) -> str:
        """Prefix of parameter names."""
        return self.value[0]

    @property
    def kind(self) -> Kind:
        """Kind of tolerance."""
        return self.value[1]

    def named(self, alias: str, wire: int | None = None) -> str:
        """Return the parameter name for a part, and for the wire of an input resistor."""
        plain = f"{self.letters}_{alias}"
        return plain if wire is None else f"{plain}_{wire}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Parameter:
    """Parameter of a cell.

    ``wire`` is the index of the wire of an input resistor, None for other quantities. ``present``
    (N,) is True for the cells that have the parameter. The bill of materials lists the ``owner``, a
    description of the component, for an offset or a gain.
    """

    part: str
    alias: str
    quantity: Quantity
    wire: int | None = None
    present: np.ndarray
    owner: str
    meaning: str

    @property
    def name(self) -> str:
        """Name in netlist and deviations, for example ``r_m_phi_2`` or ``vos_q_x``."""
        return self.quantity.named(self.alias, self.wire)

    @property
    def kind(self) -> Kind:
        """Kind of tolerance."""
        return self.quantity.kind


def _parameters(circuit: Circuit) -> Iterator[Parameter]:
    """Yield all parameters in the order of the parts.

    Resistors of a resistive grid are excluded, because each belongs to two nodes.
    """
    schematic = circuit.schematic
    for part in schematic.parts:
        alive, alias = schematic.alive_at(part.name), circuit.alias[part.name]
        if isinstance(part, Amplifier):
            yield from _of_wires(circuit, part, alive | schematic.collects(part.name))
        for quantity, owner, meaning in _described(circuit, part) if alive.any() else ():
            yield Parameter(
                part=part.name,
                alias=alias,
                quantity=quantity,
                present=alive,
                owner=owner,
                meaning=meaning,
            )


def _of_wires(circuit: Circuit, part: Amplifier, wired: np.ndarray) -> Iterator[Parameter]:
    for number, wire in enumerate(part.wires):
        resistors = circuit.resistors[part.name][number]
        present = np.isfinite(resistors) & circuit.schematic.fed_at(wire) & wired
        if present.any():
            yield Parameter(
                part=part.name,
                alias=circuit.alias[part.name],
                quantity=Quantity.INPUT,
                wire=number,
                present=present,
                owner=f"{part.name}'s op amp",
                meaning=f"resistor from {wire.source} to {part.name}",
            )


def _described(circuit: Circuit, part: Part) -> Iterator[tuple[Quantity, str, str]]:
    """Yield the quantities of a part without its wires, each with its owner and its meaning."""
    name = part.name
    if isinstance(part, Multiplier):
        owner = f"multiplier {name}"
        yield Quantity.GAIN, owner, f"gain of the {owner}"
        yield Quantity.OFFSET_X, owner, f"offset of {name} at {part.a}"
        yield Quantity.OFFSET_Y, owner, f"offset of {name} at {part.b}"
        yield Quantity.OFFSET_Z, owner, f"offset of {name} at its output"
    elif isinstance(part, Generator):
        owner = f"function generator {name}"
        yield Quantity.GAIN, owner, f"gain of the {owner}"
        yield Quantity.OFFSET_Y, owner, f"offset of {name} at its output"
    else:
        owner = f"{name}'s follower" if isinstance(part, GridNode) else f"{name}'s op amp"
        if isinstance(part, (PICell, Adder)):
            yield Quantity.FEEDBACK, owner, f"feedback resistor of {name}"
        if isinstance(part, (PICell, Integrator)):
            yield Quantity.CAPACITOR, owner, f"capacitor of {name}"
        yield Quantity.OFFSET, owner, f"offset of {owner}"
    if name in circuit.schematic.inverted:
        inverter = f"{name}'s inverter"
        yield Quantity.INVERTER, inverter, f"resistors of {inverter}"
        yield Quantity.INVERTER_OFFSET, inverter, f"offset of {inverter}"
    rails = circuit.limits(part) if isinstance(part, Integrator) and part.with_limits else ()
    for quantity, word, volts in zip(CLAMP_OFFSETS, ("lower", "upper"), rails):
        if np.isfinite(volts):
            yield quantity, f"{name}'s {word} clamp", f"offset of {name}'s {word} clamp"


CLAMP_OFFSETS = Quantity.LOW_OFFSET, Quantity.HIGH_OFFSET
"""Offsets of the clamps of an integrator's limits in volts, the lower clamp first."""

HOLD = 0.1
"""Resistor from a rectifying neuron's output to ground, relative to the smallest other one."""

CROSSING = 1.1
"""Voltage that a rectifying neuron's op amp crosses between its diodes, which both block."""

SEEPING = 1e-4
"""Current of a diode before conduction relative to that during conduction (diode knee)."""

THERMAL = 0.02585
"""kT / q in volts at 27 degrees, the temperature of the diodes in netlists."""

JUNCTION = 0.07e-12
"""Capacitance in farads from an op amp's output to its ground: a 0.1 pF diode at 1 V reverse."""

CLAMP_SHARE = 0.2
"""Capacitance in each clamp of a limited integrator as a fraction of its capacitor."""

CLAMP_LAG, CLAMP_REFERENCE = 50.0, 20e9
"""Resistors of an op-amp clamp, in normalised form.

The first value is the diode resistor times the integrator's capacitor and 2 pi GBW. The second is
the resistor in series with the reference times GBW. The values equal those of
``circuits/models/macro/clamp.lib``.
"""

CLAMP_DROP, CLAMP_SATURATION, CLAMP_RESTING = 0.6, 1e-14, 2
"""Diode data of a clamp: forward voltage, saturation current, number of diodes at rest.

Forward voltage in volts applies to the conducting diode. An inactive clamp rests that number of
diode drops from the output.
"""


@such_as("ann_dc.SpiceBackend().prepare(network)[0]")
@summarised(
    lambda self: {
        "network": self.schematic.network.title,
        "parameters": len(self.parameters),
        "parts": len(self.schematic.parts),
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Circuit(Record):
    """Schematic with component values in volts, seconds, ohms and farads.

    An absent component has infinite ohms.

    Attributes
    ----------
    resistors : mapping of part name to (wires, N) array
        Ohms in the order of the part's wires.
    feedback : mapping of part name to float
        R_f of PI cells and adders in ohms.
    capacitors : mapping of part name to (N,) array
        Farads.
    presets : mapping of part name to (N,) array
        Initial volts across the integrating capacitor, with the sign of the output.
    inverter : float
        Both resistors of every inverter in ohms.
    conductances : mapping of part name to (N,) array
        Siemens at the nodes of a resistive grid; zero for an absent node.
    lag : float
        Ratio of capacitance to conductance of a grid node, in units of network time.
    """

    schematic: Schematic
    scaling: Scaling
    resistors: Mapping[str, np.ndarray]
    feedback: Mapping[str, float]
    capacitors: Mapping[str, np.ndarray]
    presets: Mapping[str, np.ndarray]
    inverter: float
    conductances: Mapping[str, np.ndarray] = field(default_factory=dict)
    lag: float = 0.0

    @cached_property
    def alias(self) -> dict[str, str]:
        """Netlist names of parts, neurons and inputs; see `aliases`.

        Raises `NetworkError` if a name has unprintable characters or is too long.
        """
        return aliases([*self.schematic.polarity, *self.schematic.network.cell.inputs, ONE])

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters that can deviate, in the order of the parts."""
        return tuple(_parameters(self))

    def parameter_name(self, part: str, quantity: Quantity, wire: int | None = None) -> str:
        """Return the parameter name of a quantity of a part.

        The quantity may be absent in all cells. ``wire`` is the index of the wire of an input
        resistor.
        """
        return quantity.named(self.alias[part], wire)

    def slower(self, times: float) -> Circuit:
        """Return the circuit with capacitors, time and margin multiplied by ``times``."""
        return replace(
            self,
            scaling=self.scaling.slower(times),
            capacitors={name: farads * times for name, farads in self.capacitors.items()},
        )

    def value_of(self, name: str) -> float:
        """Return the value of one volt at the output of part ``name``, in network units."""
        return self.schematic.polarity[name] * self.scaling.unit[name] / self.scaling.full_scale

    def scale_of(self, name: str) -> Scale:
        """Return the scale from the voltage of a part to the user's value of its node."""
        network = self.schematic.network
        own = network.neuron(name).scale if name in network.neuron_index else IDENTITY
        return Scale(own.factor * self.value_of(name), own.offset)

    @property
    def control_scales(self) -> dict[str, Scale]:
        """Scales from output voltages to the user's values of all controls, by neuron.

        A network without controls has those of all neurons.
        """
        neurons = self.schematic.network.cell.neurons
        names = [neuron.name for neuron in neurons if neuron.population == "u"]
        names = names or [neuron.name for neuron in neurons]
        return {name: self.scale_of(name) for name in names if name in self.schematic.polarity}

    def limiter(self, part: Integrator) -> Limiter:
        """Return the limits of an integrator within full scale, in network units."""
        low, high, unit = part.limiter.low, part.limiter.high, self.scaling.unit[part.name]
        return Limiter(
            low=low if abs(low) <= unit else -np.inf, high=high if abs(high) <= unit else np.inf
        )

    def limits(self, part: Integrator) -> tuple[float, float]:
        """Return the output limits of an integrator in volts, infinite if absent."""
        built, sign = self.limiter(part), self.schematic.polarity[part.name]
        ends = (built.low, built.high)
        low, high = sorted(sign * self.scaling.volts(part.name, end) for end in ends)
        return low, high

    def crossing(self, part: PICell) -> float:
        """Return `CROSSING` in network units of a rectifying neuron's output."""
        return abs(self.value_of(part.name)) * CROSSING

    def own_capacitors(self, name: str) -> np.ndarray:
        """Return the capacitor (N,) of a part in farads, without the clamp capacitance."""
        part, farads = self.schematic.by_name[name], self.capacitors[name]
        if not (isinstance(part, Integrator) and part.with_limits):
            return farads
        return farads * (1 - CLAMP_SHARE * np.isfinite(self.limits(part)).sum())

    @property
    def ranges(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Ranges (smallest, largest) of resistors in ohms and of capacitors in farads."""
        ohms = np.concatenate(
            [*(r[np.isfinite(r)] for r in self.resistors.values()), [*self.feedback.values()]]
        )
        live = [c[(c > 0) & np.isfinite(c)] for c in self.capacitors.values()]
        farads = np.concatenate(live) if live else np.zeros(0)
        return _range(ohms), _range(farads)


def _range(values: np.ndarray) -> tuple[float, float]:
    return float(values.min(initial=np.inf)), float(values.max(initial=0.0))


def circuit_of(
    schematic: Schematic,
    scaling: Scaling,
    *,
    smallest: float = SMALLEST_RESISTOR,
    lag: float = 0.0,
) -> Circuit:
    """Return the circuit of a schematic, with ohms and farads of every part.

    The smallest resistor at a virtual ground or in a resistive grid is ``smallest`` ohms. ``lag``
    is the ratio of capacitance to conductance of a grid node, in units of network time. Raises
    `NetworkError` if a grid has no positive lag.
    """
    values = {
        part.name: _values(part, schematic.network.stages, scaling, smallest)
        for part in schematic.parts
        if isinstance(part, Amplifier)
    }
    nodes = [part for part in schematic.parts if isinstance(part, GridNode)]
    if nodes:
        require_positive(lag=lag)
    grid_resistors, conductances = values_of_grid(nodes, scaling, smallest)
    return Circuit(
        schematic=schematic,
        scaling=scaling,
        resistors={name: ohms for name, (ohms, _, _) in values.items()} | grid_resistors,
        feedback={name: ohms for name, (_, ohms, _) in values.items() if ohms is not None},
        capacitors={name: farads for name, (*_, farads) in values.items() if farads is not None},
        presets=_presets(schematic, scaling),
        inverter=smallest,
        conductances=conductances,
        lag=lag,
    )


Values: TypeAlias = tuple[np.ndarray, float | None, np.ndarray | None]
"""Ohms (wires, N), feedback ohms and farads (N,) of an amplifier."""


def _values(part: Amplifier, stages: int, scaling: Scaling, smallest: float) -> Values:
    units, T = scaling.unit, scaling.time
    gain = np.array(
        [np.abs(w.weight) * units[w.source] / units[part.name] for w in part.wires]
    ).reshape(len(part.wires), stages)
    if isinstance(part, Integrator):
        slope = gain * (part.rate.max() if part.shared else part.rate) / T  # per second
        farads = 1.0 / (_largest(slope) * smallest)
        return _over(1.0, slope * farads), None, np.full(stages, farads)
    if isinstance(part, Adder):
        feedback = smallest * _largest(gain)
        return _over(feedback, gain), feedback, None
    gain = gain * part.rho * (part.rate > 0)
    feedback = smallest * max(_largest(gain), float(part.rectified))
    rate = np.where(part.rate > 0, part.rate, np.inf)
    return _over(feedback, gain), feedback, part.rho * T / (rate * feedback)


def _largest(values: np.ndarray) -> float:
    return float(values.max(initial=0.0)) or 1.0


def _over(numerator: float, values: np.ndarray) -> np.ndarray:
    return np.divide(numerator, values, out=np.full(values.shape, np.inf), where=values > 0)


def _presets(schematic: Schematic, scaling: Scaling) -> dict[str, np.ndarray]:
    network = schematic.network
    start = network.unpack(network.start_state)
    integrals = preconditioner_values(network, network.start_state[None])
    presets = {}
    for part in schematic.parts:
        if isinstance(part, PICell):
            values = start[network.neuron_index[part.dual]]
        elif not isinstance(part, Integrator):
            continue
        elif part.name in integrals:
            values = integrals[part.name][0]
        else:
            values = start[network.neuron_index[part.name]]
        presets[part.name] = schematic.polarity[part.name] * scaling.volts(part.name, values)
    return presets


RESERVED = ("src", "gnd", "null", "rst", "p1", "p2", "s", "sp", "sn")
"""Names that are reserved by the netlist."""

LONGEST = 200
"""Maximum length of a name in characters."""


def aliases(names: Iterable[str]) -> dict[str, str]:
    """Return netlist names of parts, neurons and inputs: lower case, unique, without "__".

    Raises `NetworkError` if a name has unprintable characters or is too long.

    >>> aliases(["q.x", "Q X", "a*b"])
    {'q.x': 'q_x', 'Q X': 'q_x_v2', 'a*b': 'a_x_b'}
    """
    found: dict[str, str] = {}
    taken = set(RESERVED)
    for name in names:
        if not name.isprintable() or len(name) > LONGEST:
            raise NetworkError(f"circuit: {name!r} cannot be written into a netlist")
        plain = re.sub(r"[^a-z0-9]+", "_", name.lower().replace("*", "_x_")).strip("_") or "node"
        plain = plain[:40].strip("_") if plain[0].isalpha() else f"n_{plain[:40]}".strip("_")
        alias, number = plain, 2
        while not taken.isdisjoint({alias, f"n_{alias}"}):  # vos_n_x is that of x's inverter
            alias, number = f"{plain}_v{number}", number + 1
        taken |= {alias, f"n_{alias}"}
        found[name] = alias
    return found
