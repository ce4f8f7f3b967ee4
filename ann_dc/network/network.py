"""Network: an array of N equal cells with boundaries, inputs and a preconditioner.

This record is the only description of a network. The ODE, the recurrent layers, the netlist and
every export are derived from this record.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, TypeAlias

import numpy as np

from ann_dc.dataclass_pickling import Record
from ann_dc.errors import NetworkError, UnknownNameError, such_as
from ann_dc.network.cell import (
    ONE,
    Cell,
    Function,
    Neuron,
    Product,
    Role,
    Sum,
    check_cell,
    check_input_scales,
    check_places,
    check_text,
    per_stage,
    warn_outside,
)
from ann_dc.network.ends import FixedNeuron, Omitted
from ann_dc.network.preconditioners.base import (
    ArrayLayout,
    Preconditioner,
    PreconditionerKind,
    Wires,
)
from ann_dc.network.preconditioners.diagonal import Diagonal
from ann_dc.network.waveforms import Waveform
from ann_dc.scale import Scale
from ann_dc.si_prefixes import counted
from ann_dc.summaries import summarised
from ann_dc.validation import Finite, OrNan, Shape, checked

# ---- what a network is wired of, as a table of text: in one cell, and in all of them


def listing(
    title: str, cell: Cell, live: np.ndarray, wires: Wires, kind: PreconditionerKind
) -> str:
    """Return a text with the numbers of neurons, blocks, connections and wires.

    ``live`` (neurons, N) is True for neurons that are neither fixed nor omitted. Wires and kind are
    those of the preconditioner.
    """
    stages = live.shape[1]
    each_way = " each way" if wires.both_ways else ""
    rows = [
        ("neurons", len(cell.neurons), f"{int(live.sum())} live"),
        ("multipliers", cell.count(Product), cell.count(Product) * stages),
        ("function blocks", cell.count(Function), cell.count(Function) * stages),
        ("summing blocks", cell.count(Sum), cell.count(Sum) * stages),
        ("connections", len(cell.connections), len(cell.connections) * stages),
        ("preconditioner nodes", "-", f"{wires.nodes}, of the {kind.value}"),
        (
            "preconditioner wires",
            f"{wires.per_cell(stages):.0f}",
            f"{wires.count}{each_way}",
        ),
    ]
    shared = sum(neuron.shared for neuron in cell.neurons)
    if shared:
        rows.insert(1, ("shared by all cells", "-", f"{shared}, in the last cell"))
    populations = Counter(neuron.population for neuron in cell.neurons)
    functions = Counter(b.function for b in cell.blocks if isinstance(b, Function))
    head = f"{title}: {counted(stages, 'cells')} of " + ", ".join(
        f"{count} {name}" for name, count in populations.items()
    )
    table = [f"{'':22}{'per cell':>10}  in all"]
    table += [f"  {name:20}{per!s:>10}  {total}" for name, per, total in rows]
    used = ", ".join(f"{count} {name}" for name, count in sorted(functions.items()))
    return "\n".join([head, *table, *([f"  functions: {used}"] if used else [])])


# ---- the network: one cell, N of them in a row, their ends, their inputs, their preconditioner

OwnState: TypeAlias = Annotated[np.ndarray, Shape("self.size")]
States: TypeAlias = Annotated[np.ndarray, Shape("...", "self.size"), OrNan()]
NeuronValues: TypeAlias = Annotated[np.ndarray, Shape("...", "neurons", "self.stages"), OrNan()]

COORDINATION = ("t", "beta")
"""Populations of the paper's upper level."""


@such_as("ann_dc.design(problem).network")
@checked
@summarised(
    lambda self: {
        "title": self.title,
        "neurons": self.size,
        "stages": self.stages,
        "preconditioner": self.preconditioner.kind.value,
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Network(Record):
    """Array of N equal cells.

    Parameters
    ----------
    cell : Cell
        Wiring of each cell.
    stages : int
        Number of cells N >= 1.
    inputs : mapping of str to float or (N,) array
        Value of every input of the cell, in the user's units.
    input_scales : mapping of str to Scale
        Conversion between an input's value and its node; identity by default.
    fixed, omitted : tuples of FixedNeuron and Omitted
        Boundary data of the array: fixed and omitted neurons.
    left_boundary : mapping of node name to input name
        Inputs that PREVIOUS connections of cell 0 read; zero by default.
    start : mapping of neuron name to float or (N,) array
        Initial states in network units, zero by default.
    preconditioner : Preconditioner
        Preconditioner M of dx/ds = M d(x); diagonal (time constants only) by default.
    title : str
        Title of the network.
    ranges : mapping of str to (float, float)
        Operating range of the inputs for which the network was designed, if any.
    waveforms : mapping of str to Waveform
        Inputs that change over time; ``inputs`` has their values at time zero. Runs of such a
        network need a duration.

    Raises
    ------
    NetworkError
        If the description is inconsistent; the message names the node.

    Examples
    --------
    A chain of three leaky integrators driven from the left:

    >>> from ann_dc import evaluator
    >>> from ann_dc.network import Connection, Template
    >>> chain = Network(
    ...     cell=Cell(neurons=(Neuron(name="x"),), inputs=("drive",), connections=(
    ...         Connection(source="x", target="x", weight=-1.0),
    ...         Connection(source="x", target="x", template=Template.PREVIOUS))),
    ...     stages=3, inputs={"drive": 1.0}, left_boundary={"x": "drive"})
    >>> evaluator(chain).rhs([0, 0, 0]).tolist()
    [1.0, 0.0, 0.0]
    >>> chain.label(1), chain.size
    ('x[1]', 3)
    """

    cell: Cell
    stages: int
    inputs: Mapping[str, float | np.ndarray] = field(default_factory=dict)
    input_scales: Mapping[str, Scale] = field(default_factory=dict)
    fixed: tuple[FixedNeuron, ...] = ()
    omitted: tuple[Omitted, ...] = ()
    left_boundary: Mapping[str, str] = field(default_factory=dict)
    start: Mapping[str, float | np.ndarray] = field(default_factory=dict)
    preconditioner: Preconditioner = field(default_factory=Diagonal)
    title: str = "network"
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    waveforms: Mapping[str, Waveform] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_text("title", self.title)
        check_cell(self.cell, self.stages)
        for name, one in self.waveforms.items():
            if name not in self.cell.inputs:
                raise UnknownNameError.of("waveforms: input", name, self.cell.inputs)
            per_stage(f"waveforms[{name}]", one.values[0], self.stages)
        now = {name: one.at(0.0) for name, one in self.waveforms.items()}
        given = {**self.inputs, **now}
        object.__setattr__(self, "inputs", self._stage_values("inputs", given))
        missing = set(self.cell.inputs) - set(self.inputs)
        if missing:
            raise NetworkError(f"inputs: no value for {', '.join(sorted(missing))}")
        check_input_scales(self.input_scales, self.inputs)
        scales = {name: self.input_scales.get(name, Scale()) for name in self.cell.inputs}
        object.__setattr__(self, "input_scales", scales)
        object.__setattr__(self, "start", self._stage_values("start", self.start))
        check_places(
            self.cell,
            self.stages,
            inputs=self.inputs,
            ends=(*self.fixed, *self.omitted),
            read=(*(pin.input for pin in self.fixed), *self.left_boundary.values()),
            left=self.left_boundary,
            start=self.start,
        )

    def _stage_values(self, where: str, given: Mapping) -> dict[str, np.ndarray]:
        return {n: per_stage(f"{where}[{n}]", value, self.stages) for n, value in given.items()}

    # ---- names and places -------------------------------------------------------------------

    @cached_property
    def neuron_index(self) -> dict[str, int]:
        """Row of each neuron in a state array of shape (neurons, N)."""
        return {neuron.name: i for i, neuron in enumerate(self.cell.neurons)}

    @cached_property
    def node_index(self) -> dict[str, int]:
        """Row of every node in an array (nodes, ...): neurons, inputs, constant, blocks."""
        cell = self.cell
        names = [*self.neuron_index, *cell.inputs, ONE, *(b.name for b in cell.blocks)]
        return dict(zip(names, range(len(names))))

    @cached_property
    def input_values(self) -> dict[str, np.ndarray]:
        """Values of the input nodes in network units, (N,) each."""
        return {name: self.input_scale(name).network(given) for name, given in self.inputs.items()}

    @checked
    def input_scale(self, name: str) -> Scale:
        """Return an input's scale between value and node, or raise an `UnknownNameError`."""
        if name not in self.input_scales:
            raise UnknownNameError.of("input", name, self.cell.inputs)
        return self.input_scales[name]

    @cached_property
    def live(self) -> np.ndarray:
        """Booleans (neurons, N): False if fixed, omitted or shared and in another cell."""
        live = np.ones((len(self.cell.neurons), self.stages), bool)
        for end in (*self.fixed, *self.omitted):
            live[self.neuron_index[end.neuron], end.stage] = False
        live[self.shared, :-1] = False
        return live

    @cached_property
    def shared(self) -> np.ndarray:
        """Rows (S,) of the shared neurons, which are located in the last cell."""
        return np.flatnonzero([n.shared for n in self.cell.neurons])

    @cached_property
    def places(self) -> np.ndarray:
        """Pairs (neuron, stage) of every component of the state vector, by stage, (n, 2)."""
        return np.argwhere(self.live.T)[:, ::-1].copy()

    @cached_property
    def state_index(self) -> np.ndarray:
        """Component of the state vector, (neurons, N) integers; -1 if fixed or omitted."""
        state_index = -np.ones(self.live.shape, np.int64)
        state_index[self.places[:, 0], self.places[:, 1]] = np.arange(self.size)
        state_index[self.shared] = state_index[self.shared, -1:]  # of every cell the same one
        return state_index

    def of_population(self, *names: str) -> np.ndarray:
        """Return (n,) booleans: True for state components of the given populations."""
        inside = [neuron.population in names for neuron in self.cell.neurons]
        return np.array(inside)[self.places[:, 0]]

    @property
    def chain_rows(self) -> np.ndarray:
        """Rows of the (q, t) neurons of every chain, (C, 2) integers."""
        rows = [[*map(self.neuron_index.get, chain)] for chain in self.cell.chains]
        return np.array(rows, np.int64).reshape(-1, 2)

    @property
    def chain_live(self) -> np.ndarray:
        """Booleans (C, 2N): True for chain positions q_0, t_0, q_1, ... that are live."""
        return self.live[self.chain_rows].transpose(0, 2, 1).reshape(len(self.cell.chains), -1)

    @property
    def size(self) -> int:
        """Number of live neurons in the array, without nodes of the preconditioner."""
        return int(self.live.sum())

    @checked
    def neuron(self, name: str) -> Neuron:
        """Return the neuron of a name.

        Parameters
        ----------
        name : str
            ``population.component``.

        Returns
        -------
        Neuron

        Raises
        ------
        UnknownNameError
            If the neuron is unknown; the message lists the existing ones.
        """
        if name not in self.neuron_index:
            raise UnknownNameError.of("neuron", name, self.neuron_index)
        return self.cell.neurons[self.neuron_index[name]]

    @checked
    def label(self, component: int) -> str:
        """Return the name of one state component, for instance ``mu[3].phi``."""
        neuron, stage = self.places[component]
        name = self.cell.neurons[neuron]
        suffix = f".{name.component}" if name.component else ""
        return f"{name.population}[{stage}]{suffix}"

    @cached_property
    def layout(self) -> ArrayLayout:
        """Layout of the cell array, the input of the preconditioner."""
        tau = [np.broadcast_to(np.asarray(n.tau, float), self.stages) for n in self.cell.neurons]
        return ArrayLayout(
            rates=np.where(self.live, 1.0 / np.array(tau).reshape(self.live.shape), 0.0),
            primal=np.flatnonzero([n.role is Role.PRIMAL for n in self.cell.neurons]),
            chains=self.chain_rows,
        )

    # ---- states ------------------------------------------------------------------------------

    @checked
    def pack(self, values: NeuronValues) -> np.ndarray:
        """Return state vectors of the live neurons from the values of all neurons.

        Parameters
        ----------
        values : (..., neurons, N) array
            Values of all neurons.

        Returns
        -------
        (..., n) array
        """
        return np.ascontiguousarray(np.asarray(values)[..., self.places[:, 0], self.places[:, 1]])

    @checked
    def unpack(self, x: States) -> np.ndarray:
        """Return the values of all neurons from state vectors.

        Fixed neurons have the values of their inputs, omitted ones are zero, shared ones are equal
        in all cells.

        Parameters
        ----------
        x : (..., n) array
            State vectors.

        Returns
        -------
        (..., neurons, N) array
        """
        x = np.asarray(x)
        values = np.zeros((*x.shape[:-1], *self.live.shape), x.dtype)
        for pin in self.fixed:
            given = self.input_values[pin.input][pin.stage]
            values[..., self.neuron_index[pin.neuron], pin.stage] = given
        values[..., self.places[:, 0], self.places[:, 1]] = x
        values[..., self.shared, :] = values[..., self.shared, -1:]
        return values

    @checked
    def user_units(self, x: States) -> np.ndarray:
        """Return state vectors in the user's units.

        Parameters
        ----------
        x : (..., n) array
            State vectors, in network units.

        Returns
        -------
        (..., n) array
        """
        factor, offset = self.cell.scales[self.places[:, 0]].T
        return offset + factor * np.asarray(x)

    @cached_property
    def start_state(self) -> np.ndarray:
        """State vector (n,) of the initial values."""
        values = np.zeros(self.live.shape)
        for name, value in self.start.items():
            values[self.neuron_index[name]] = value
        return self.pack(values)

    # ---- other networks ----------------------------------------------------------------------

    @checked
    def with_inputs(self, values: Mapping[str, float | np.ndarray | Waveform]) -> Network:
        """Return the network with other values of some inputs and unchanged wiring.

        Parameters
        ----------
        values : mapping of str to float, (N,) array or Waveform
            Values by input name, for instance ``{"q_d.x": 3.0}``, constant or over time.

        Returns
        -------
        Network
            Network whose `inputs` are the values at time zero, and whose `waveforms` are the inputs
            over time.

        Raises
        ------
        UnknownNameError
            If the cell has no such input; the message lists the existing ones.
        NetworkError
            If a value is not finite, or is neither one number nor N of them.

        Examples
        --------
        >>> from ann_dc import plants, synthesize
        >>> moved = synthesize(plants.double_integrator(N=2)).with_inputs({"q_d.x": 3.0})
        >>> moved.inputs["q_d.x"].tolist()
        [3.0, 3.0]

        An input over time, here a step at network time 10:

        >>> from ann_dc import Waveform
        >>> step = Waveform(times=[0.0, 10.0], values=[1.0, 3.0], hold="previous")
        >>> driven = moved.with_inputs({"q_d.x": step})
        >>> driven.inputs["q_d.x"].tolist(), [*driven.waveforms]
        ([1.0, 1.0], ['q_d.x'])
        """
        for name in values:
            self.input_scale(name)  # an error where there is none
        now = {n: v.at(0.0) if isinstance(v, Waveform) else v for n, v in values.items()}
        every = {n: v.values if isinstance(v, Waveform) else v for n, v in values.items()}
        warn_outside(self.ranges, every)
        kept = {name: one for name, one in self.waveforms.items() if name not in values}
        driven = {name: one for name, one in values.items() if isinstance(one, Waveform)}
        return replace(self, inputs={**self.inputs, **now}, waveforms={**kept, **driven})

    @checked
    def at_time(self, time: Finite) -> Network:
        """Return the network with the constant inputs of a network time.

        Batches, layers, the two-level algorithm and most exports take constant inputs only.

        Parameters
        ----------
        time : float
            Network time at which inputs that change over time are read.

        Returns
        -------
        Network
            Network without inputs over time; the same object if it has none.

        Raises
        ------
        NetworkError
            If the time is not a finite number.

        Examples
        --------
        >>> from ann_dc import Waveform, plants, synthesize
        >>> ramp = Waveform(times=[0.0, 10.0], values=[1.0, 3.0])
        >>> network = synthesize(plants.double_integrator(N=2)).with_inputs({"q_d.x": ramp})
        >>> network.at_time(5.0).inputs["q_d.x"].tolist()
        [2.0, 2.0]
        """
        if not self.waveforms:
            return self
        values = {name: one.at(time) for name, one in self.waveforms.items()}
        return replace(self, inputs={**self.inputs, **values}, waveforms={})

    @checked
    def with_start(self, x: OwnState) -> Network:
        """Return the network with the state vector ``x`` (n,) as initial state."""
        values = self.unpack(np.asarray(x, float))
        return replace(self, start={name: values[i] for name, i in self.neuron_index.items()})

    # ---- summary -----------------------------------------------------------------------------

    def __str__(self) -> str:
        wires = self.preconditioner.wires(self.layout)
        return listing(self.title, self.cell, self.live, wires, self.preconditioner.kind)
