r"""Resistors and capacitors of a scaled schematic.

With S the units of the nodes, T seconds per unit of network time, and a source at polarity sigma,
the current that a wire of weight w sends into the virtual ground of a part at polarity p has the
sign of p sigma w. A part inverts, so the source is taken with the sign that makes this negative:

.. math::
    \frac{1}{R_j C} = \frac{rate\,|w_j|\,S_j}{S\,T}
    \;\text{(integrator)}, \qquad
    \frac{R_f}{R_j} = \frac{\rho\,|w_j|\,S_j}{S}, \; R_f C = \frac{\rho\,T}{rate}
    \;\text{(PI cell)}, \qquad
    \frac{R_f}{R_j} = \frac{|w_j|\,S_j}{S}
    \;\text{(adder)} .

The largest current of a part goes through `SMALLEST_RESISTOR`; that fixes the capacitor of an
integrator and the feedback resistor of the others, the same in every cell. The feedback resistor of
a diode neuron is not smaller than that, because the one that holds its output at zero while it is
off, `HOLD` of that, has to be much smaller.

Every number of a circuit that can be off, and what it is called.

A parameter is a quantity of a part: the third input resistor of ``m.phi``, the offset of ``q.x``.
Its name, ``r_m_phi_2`` or ``vos_q_x``, is spelled here and nowhere else; netlist, emulation, bill,
noise and error budget ask for the quantity of a part.
"""

from __future__ import annotations

import enum
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain

import numpy as np

from ann_dc.errors import NetworkError, require_positive
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
from ann_dc.hardware.schematic.metric_wiring import metric_values
from ann_dc.hardware.schematic.schematic import Schematic
from ann_dc.network.cell import ONE, Limiter
from ann_dc.scale import IDENTITY, Scale
from ann_dc.validation.values import such_as


class Quantity(enum.Enum):
    """What a number is at its part: the letters of its name, and its kind.

    Resistors of an amplifier are those of its wires, its feedback and its inverter; offsets those
    of its op amp, of its inverter, and of the clamps of its rails. A multiplier has offsets at its
    inputs x and y and at its output z, a function generator at its output y.
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
        """How names of such parameters begin."""
        return self.value[0]

    @property
    def kind(self) -> Kind:
        """Which tolerance it has."""
        return self.value[1]

    def named(self, alias: str, wire: int | None = None) -> str:
        """Name of this quantity of the part of that alias; an input is told by its wire.

        Parameters
        ----------
        alias : str
            What a netlist calls the part.
        wire : int, optional
            Which of the part's wires an input resistor ends.

        Returns
        -------
        str

        Examples
        --------
        >>> Quantity.INPUT.named("m_phi", 2), Quantity.OFFSET.named("q_x")
        ('r_m_phi_2', 'vos_q_x')
        """
        plain = f"{self.letters}_{alias}"
        return plain if wire is None else f"{plain}_{wire}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Parameter:
    """A number of a cell.

    Attributes
    ----------
    part : str
        The part it belongs to.
    alias : str
        What a netlist calls that part.
    quantity : Quantity
        What it is at the part.
    wire : int or None
        Which of the part's wires an input resistor ends; None for other quantities.
    present : (N,) array of bool
        In which cells there is one.
    owner : str
        What has it, in words: what a bill lists for an offset or a gain.
    meaning : str
        What it is, in words.
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
        """In the netlist and in deviations, for instance ``r_m_phi_2`` or ``vos_q_x``."""
        return self.quantity.named(self.alias, self.wire)

    @property
    def kind(self) -> Kind:
        """Which tolerance it has."""
        return self.quantity.kind


@dataclass(frozen=True)
class _Entry:
    """A quantity of a part before it is known in which cells the part is."""

    quantity: Quantity
    meaning: str
    owner: str = ""
    wire: int | None = None
    present: np.ndarray | bool = True


def parameters_of(
    schematic: Schematic,
    alias: Mapping[str, str],
    resistors: Mapping[str, np.ndarray],
    rails: Mapping[str, tuple[float, float]],
) -> tuple[Parameter, ...]:
    """All parameters of a schematic, in the order of its parts.

    The resistors of a grid are not among them: each belongs to two nodes.

    Parameters
    ----------
    schematic : Schematic
    alias : mapping of part name to str
        What a netlist calls each part.
    resistors : mapping of part name to (wires, N) array
        Infinite where a wire has none.
    rails : mapping of part name to (float, float)
        Volts, low and high, of integrators that have any; infinite where none is.

    Returns
    -------
    tuple of Parameter
    """
    found: list[Parameter] = []
    for part in schematic.parts:
        alive = schematic.alive_at(part.name)
        wired = alive | schematic.collects(part.name)
        entries = _entries(schematic, part, resistors), _of_clamps(part, rails.get(part.name, ()))
        for entry in chain(*entries):
            present = entry.present & (alive if entry.wire is None else wired)
            if present.any():
                found.append(
                    Parameter(
                        part=part.name,
                        alias=alias[part.name],
                        quantity=entry.quantity,
                        wire=entry.wire,
                        present=present,
                        owner=entry.owner,
                        meaning=entry.meaning,
                    )
                )
    return tuple(found)


def _entries(
    schematic: Schematic, part: Part, resistors: Mapping[str, np.ndarray]
) -> Iterator[_Entry]:
    name = part.name
    if isinstance(part, Multiplier):
        yield from _of_multiplier(part)
    elif isinstance(part, Generator):
        yield from _of_generator(part)
    elif isinstance(part, GridNode):
        owner = f"{name}'s follower"
        yield _Entry(Quantity.OFFSET, f"offset of {owner}", owner)
    else:
        yield from _of_amplifier(schematic, part, resistors[name])
    if name in schematic.inverted:
        inverter = f"{name}'s inverter"
        yield _Entry(Quantity.INVERTER, f"resistors of {inverter}", inverter)
        yield _Entry(Quantity.INVERTER_OFFSET, f"offset of {inverter}", inverter)


def _of_multiplier(part: Multiplier) -> Iterator[_Entry]:
    name, owner = part.name, f"multiplier {part.name}"
    yield _Entry(Quantity.GAIN, f"gain of the {owner}", owner)
    yield _Entry(Quantity.OFFSET_X, f"offset of {name} at {part.a}", owner)
    yield _Entry(Quantity.OFFSET_Y, f"offset of {name} at {part.b}", owner)
    yield _Entry(Quantity.OFFSET_Z, f"offset of {name} at its output", owner)


def _of_generator(part: Generator) -> Iterator[_Entry]:
    name, owner = part.name, f"function generator {part.name}"
    yield _Entry(Quantity.GAIN, f"gain of the {owner}", owner)
    yield _Entry(Quantity.OFFSET_Y, f"offset of {name} at its output", owner)


def _of_amplifier(schematic: Schematic, part: Amplifier, resistors: np.ndarray) -> Iterator[_Entry]:
    name, owner = part.name, f"{part.name}'s op amp"
    for number, wire in enumerate(part.wires):
        meaning = f"resistor from {wire.source} to {name}"
        present = np.isfinite(resistors[number]) & schematic.fed_at(wire)
        yield _Entry(Quantity.INPUT, meaning, owner, number, present)
    if isinstance(part, (PICell, Adder)):
        yield _Entry(Quantity.FEEDBACK, f"feedback resistor of {name}", owner)
    if not isinstance(part, Adder):
        yield _Entry(Quantity.CAPACITOR, f"capacitor of {name}", owner)
    yield _Entry(Quantity.OFFSET, f"offset of {owner}", owner)


def _of_clamps(part: Part, rails: Iterable[float]) -> Iterator[_Entry]:
    for quantity, word, volts in zip(CLAMP_OFFSETS, ("lower", "upper"), rails):
        if np.isfinite(volts):
            owner = f"{part.name}'s {word} clamp"
            yield _Entry(quantity, f"offset of {owner}", owner)


CLAMP_OFFSETS = Quantity.LOW_OFFSET, Quantity.HIGH_OFFSET
"""Of the clamps of an integrator's rails, in volts; the lower one first."""

RESERVED = ("src", "gnd", "null", "rst", "p1", "p2", "s", "sp", "sn")
"""Names that a netlist needs for itself."""

LONGEST = 200
"""Letters of a name at most."""


def aliases(names: Iterable[str]) -> dict[str, str]:
    """Names that a netlist can carry: lower case, unique, without a double underscore.

    Parameters
    ----------
    names : iterable of str
        Of parts, neurons and inputs.

    Returns
    -------
    dict of str to str

    Raises
    ------
    NetworkError
        If a name has unprintable letters or is too long.

    Examples
    --------
    >>> aliases(["q.x", "Q X", "a*b"])
    {'q.x': 'q_x', 'Q X': 'q_x_v2', 'a*b': 'a_x_b'}
    """
    found: dict[str, str] = {}
    taken = set(RESERVED)
    for name in names:
        if not name.isprintable() or len(name) > LONGEST:
            raise NetworkError(f"circuit: {name!r} is no name that a netlist can carry")
        plain = re.sub(r"[^a-z0-9]+", "_", name.lower().replace("*", "_x_")).strip("_") or "node"
        plain = plain[:40].strip("_") if plain[0].isalpha() else f"n_{plain[:40]}".strip("_")
        alias, number = plain, 2
        while not taken.isdisjoint({alias, f"n_{alias}"}):  # vos_n_x is that of x's inverter
            alias, number = f"{plain}_v{number}", number + 1
        taken |= {alias, f"n_{alias}"}
        found[name] = alias
    return found


HOLD = 0.1
"""Resistor from the output of a diode neuron to ground, over the smallest one of the others."""

CROSSING = 1.1
"""Volts that the op amp of a diode neuron moves between its diodes: neither conducts meanwhile."""

SEEPING = 1e-4
"""What a diode passes before it conducts, over what it passes then: its knee has no corner."""

THERMAL = 0.02585
"""kT / q in volts at 27 degrees, where diodes are those of netlists."""

JUNCTION = 0.07e-12
"""Farads of a diode of 0.1 pF at rest, 1 V in reverse: from an op amp's output to its ground."""

CLAMP_SHARE = 0.2
"""What lies in each clamp of an integrator with rails, as a share of its capacitor."""

CLAMP_LAG, CLAMP_REFERENCE = 50.0, 20e9
"""Of a clamp of op amps: the resistor of its diode times the integrator's capacitor and 2 pi GBW,
and the one before its reference times GBW; as ``circuits/models/macro/clamp.lib`` has them."""

CLAMP_DROP, CLAMP_SATURATION, CLAMP_RESTING = 0.6, 1e-14, 2
"""Volts across the diode of one that conducts, the saturation current of its diodes, and how many
of them it rests beside the output while it is off."""


@such_as("ann_dc.SpiceBackend().prepare(network)[0]")
@dataclass(frozen=True, kw_only=True, eq=False)
class Circuit:
    """A schematic with its volts, seconds, ohms and farads; what is not there is infinite ohms.

    Attributes
    ----------
    schematic : Schematic
        Its parts and wires.
    scaling : Scaling
        What a volt and a second stand for.
    resistors : mapping of part name to (wires, N) array
        Ohms, in the order of the part's wires.
    feedback : mapping of part name to float
        R_f of PI cells and adders, in ohms.
    capacitors : mapping of part name to (N,) array
        Farads.
    presets : mapping of part name to (N,) array
        Volts across the integrating capacitor at the start, with the sign of the output.
    inverter : float
        Both resistors of every inverter, in ohms.
    conductances : mapping of part name to (N,) array
        Of the nodes of a grid, in siemens: all that comes together in one; zero where there is
        none.
    lag : float
        Capacitance of a grid's node over its conductance, in units of network time.
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
        """Names that a netlist can carry, of every part, neuron and input; see `aliases`.

        Raises
        ------
        NetworkError
            If a name has unprintable letters or is too long.
        """
        return aliases([*self.schematic.polarity, *self.schematic.network.cell.inputs, ONE])

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All numbers that can be off, in the order of the parts."""
        parts = (p for p in self.schematic.parts if isinstance(p, Integrator) and p.railed)
        rails = {part.name: self.rails(part) for part in parts}
        return parameters_of(self.schematic, self.alias, self.resistors, rails)

    def parameter_name(self, part: str, quantity: Quantity, wire: int | None = None) -> str:
        """Name of a quantity of a part, whether or not a cell has one.

        Parameters
        ----------
        part : str
            Name of the part.
        quantity : Quantity
        wire : int, optional
            Which of its wires an input resistor ends.

        Returns
        -------
        str
        """
        return quantity.named(self.alias[part], wire)

    def slower(self, times: float) -> Circuit:
        """The same resistors with capacitors, a time and a margin that many times as large.

        Parameters
        ----------
        times : float
        """
        return replace(
            self,
            scaling=self.scaling.slower(times),
            capacitors={name: farads * times for name, farads in self.capacitors.items()},
        )

    def value_of(self, name: str) -> float:
        """The value that a volt at the output of the part ``name`` stands for, in network units."""
        return self.schematic.polarity[name] * self.scaling.unit[name] / self.scaling.full_scale

    def scale_of(self, name: str) -> Scale:
        """The user's value of a node, of a voltage at its part.

        Parameters
        ----------
        name : str
        """
        network = self.schematic.network
        own = network.neuron(name).scale if name in network.neuron_index else IDENTITY
        return Scale(own.factor * self.value_of(name), own.offset)

    @property
    def control_scales(self) -> dict[str, Scale]:
        """The user's value of every control, of a voltage at its output; by neuron."""
        neurons = self.schematic.network.cell.neurons
        names = [neuron.name for neuron in neurons if neuron.population == "u"]
        return {name: self.scale_of(name) for name in names if name in self.schematic.polarity}

    def limiter(self, part: Integrator) -> Limiter:
        """The rails of an integrator that are built: those within full scale, in network units.

        Parameters
        ----------
        part : Integrator
        """
        low, high, unit = part.limiter.low, part.limiter.high, self.scaling.unit[part.name]
        return Limiter(
            low=low if abs(low) <= unit else -np.inf, high=high if abs(high) <= unit else np.inf
        )

    def rails(self, part: Integrator) -> tuple[float, float]:
        """Volts (low, high) between which an integrator's output stays; infinite where no rail is.

        Parameters
        ----------
        part : Integrator
        """
        built, sign = self.limiter(part), self.schematic.polarity[part.name]
        ends = (built.low, built.high)
        low, high = sorted(sign * self.scaling.volts(part.name, end) for end in ends)
        return low, high

    def crossing(self, part: PICell) -> float:
        """`CROSSING` in network units of a diode neuron's output.

        Parameters
        ----------
        part : PICell
        """
        return abs(self.value_of(part.name)) * CROSSING

    def own_capacitors(self, name: str) -> np.ndarray:
        """Farads (N,) of the capacitor of the part ``name``, less what lies in clamps beside it."""
        part, farads = self.schematic.by_name[name], self.capacitors[name]
        if not (isinstance(part, Integrator) and part.railed):
            return farads
        return farads * (1 - CLAMP_SHARE * np.isfinite(self.rails(part)).sum())

    @property
    def ranges(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Smallest and largest resistor in ohms, smallest and largest capacitor in farads."""
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
    """Choose the values: ohms and farads of every part.

    Parameters
    ----------
    schematic : Schematic
    scaling : Scaling
    smallest : float
        Smallest resistor at a virtual ground or in a grid, in ohms.
    lag : float
        Capacitance of a grid's node over its conductance, in units of network time.

    Returns
    -------
    Circuit

    Raises
    ------
    NetworkError
        If a grid is to have no lag.

    Examples
    --------
    A leaky integrator with a bias; the network's time constant is 1 / (2 pi 1 MHz):

    >>> from ann_dc.hardware.circuit import ProbeRun, scale
    >>> from ann_dc.hardware.schematic import schematic_of
    >>> from ann_dc.network import Cell, Connection, Network, Neuron
    >>> wires = [Connection(source=s, target="x", weight=w) for s, w in (("x", -1.0), ("one", 0.5))]
    >>> row = Network(stages=1, cell=Cell(neurons=(Neuron(name="x"),), connections=tuple(wires)))
    >>> probe = ProbeRun(states=np.array([[0.0], [0.5]]), times=np.array([0.0, 10.0]), radius=1.0)
    >>> circuit = circuit_of(schematic_of(row), scale(row, probe))
    >>> circuit.resistors["x"].round(3).ravel().tolist(), f"{circuit.capacitors['x'][0]:.3g} F"
    ([10000.0, 12000.0], '1.59e-11 F')
    """
    values = {
        part.name: _values(part, schematic.network.stages, scaling, smallest)
        for part in schematic.parts
        if isinstance(part, (Integrator, PICell, Adder))
    }
    nodes = [part for part in schematic.parts if isinstance(part, GridNode)]
    if nodes:
        require_positive(lag=lag)
    grid = values_of_grid(nodes, scaling, smallest)
    return Circuit(
        schematic=schematic,
        scaling=scaling,
        resistors={name: found.resistors for name, found in values.items()} | grid.resistors,
        feedback={n: v.feedback for n, v in values.items() if v.feedback is not None},
        capacitors={n: v.capacitors for n, v in values.items() if v.capacitors is not None},
        presets=_presets(schematic, scaling),
        inverter=smallest,
        conductances=grid.conductances,
        lag=lag,
    )


@dataclass(frozen=True)
class _Values:
    """Ohms and farads of one amplifier: (wires, N), one number, (N,)."""

    resistors: np.ndarray
    feedback: float | None
    capacitors: np.ndarray | None


def _values(part: Amplifier, stages: int, scaling: Scaling, smallest: float) -> _Values:
    units, T = scaling.unit, scaling.time
    gain = np.array(
        [np.abs(w.weight) * units[w.source] / units[part.name] for w in part.wires]
    ).reshape(len(part.wires), stages)
    if isinstance(part, Integrator):
        slope = gain * (part.rate.max() if part.shared else part.rate) / T  # per second
        farads = 1.0 / (_largest(slope) * smallest)
        return _Values(_over(1.0, slope * farads), None, np.full(stages, farads))
    if isinstance(part, Adder):
        feedback = smallest * _largest(gain)
        return _Values(_over(feedback, gain), feedback, None)
    gain = gain * part.rho * (part.rate > 0)
    feedback = smallest * max(_largest(gain), float(part.rectified))
    rate = np.where(part.rate > 0, part.rate, np.inf)
    return _Values(_over(feedback, gain), feedback, part.rho * T / (rate * feedback))


def _largest(values: np.ndarray) -> float:
    return float(values.max(initial=0.0)) or 1.0


def _over(numerator: float, values: np.ndarray) -> np.ndarray:
    return np.divide(numerator, values, out=np.full(values.shape, np.inf), where=values > 0)


def _presets(schematic: Schematic, scaling: Scaling) -> dict[str, np.ndarray]:
    network = schematic.network
    start = network.unpack(network.start_state)
    integrals = metric_values(network, network.start_state[None])
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
