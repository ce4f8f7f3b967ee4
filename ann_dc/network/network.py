"""The network: one cell, N of them in a row, their ends, their inputs, their metric.

This record is the only description of a network that there is: the ODE, the recurrent layers,
the netlist and every export are read off it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.network.cell import ONE, Cell, Function, Neuron, Product, Role, Sum
from ann_dc.network.checks import check_cell, per_stage
from ann_dc.network.ends import Absent, Pin
from ann_dc.network.metrics.contract import Metric, Row
from ann_dc.network.metrics.time_constants import TimeConstants

COORDINATION = ("t", "beta")
"""The populations of the paper's upper level."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Network:
    """N equal cells in a row.

    Parameters
    ----------
    cell : Cell
    stages : int
        N >= 1.
    inputs : mapping of str to float or (N,) array
        A value for every input of the cell.
    pins, absent : tuples of Pin and Absent
        The ends of the row, as data.
    left : mapping of node name to input name
        What a PREVIOUS connection of cell 0 reads (nothing given: zero).
    start : mapping of neuron name to float or (N,) array
        Initial states, zero where nothing is given.
    metric : Metric
        How drives become moves; time constants alone by default.
    title : str

    Raises
    ------
    NetworkError
        If the description contradicts itself; the message names the node.

    Examples
    --------
    A chain of three leaky integrators driven from the left:

    >>> from ann_dc import evaluator
    >>> from ann_dc.network import Connection, Template
    >>> chain = Network(
    ...     cell=Cell(neurons=(Neuron(name="x"),), inputs=("drive",), connections=(
    ...         Connection(source="x", target="x", weight=-1.0),
    ...         Connection(source="x", target="x", template=Template.PREVIOUS))),
    ...     stages=3, inputs={"drive": 1.0}, left={"x": "drive"})
    >>> evaluator(chain).rhs([0, 0, 0]).tolist()
    [1.0, 0.0, 0.0]
    >>> chain.label(1), chain.size
    ('x[1]', 3)
    """

    cell: Cell
    stages: int
    inputs: Mapping[str, float | np.ndarray] = field(default_factory=dict)
    pins: tuple[Pin, ...] = ()
    absent: tuple[Absent, ...] = ()
    left: Mapping[str, str] = field(default_factory=dict)
    start: Mapping[str, float | np.ndarray] = field(default_factory=dict)
    metric: Metric = field(default_factory=TimeConstants)
    title: str = "network"

    def __post_init__(self) -> None:
        if self.stages < 1:
            raise NetworkError(f"stages: expected N >= 1, got {self.stages!r}")
        check_cell(self.cell, self.stages)
        names = {neuron.name for neuron in self.cell.neurons}
        object.__setattr__(self, "inputs", self._stage_values("inputs", self.inputs))
        missing = set(self.cell.inputs) - set(self.inputs)
        if missing:
            raise NetworkError(f"inputs: no value for {', '.join(sorted(missing))}")
        object.__setattr__(self, "start", self._stage_values("start", self.start))
        self._check_places(names)

    def _check_places(self, neurons: set[str]) -> None:
        cell = self.cell
        nodes = neurons | set(cell.inputs) | {block.name for block in cell.blocks}
        foreign = set(self.inputs) - set(cell.inputs)
        if foreign:
            raise NetworkError(f"inputs: the cell has no input {', '.join(sorted(foreign))}")
        for end in (*self.pins, *self.absent):
            if end.neuron not in neurons or not 0 <= end.stage < self.stages:
                raise NetworkError(f"{end}: no such neuron or stage")
        for source in (*(pin.input for pin in self.pins), *self.left.values()):
            if source not in cell.inputs:
                raise NetworkError(f"pins, left: {source!r} is not an input of the cell")
        self._check_names(neurons, nodes)

    def _check_names(self, neurons: set[str], nodes: set[str]) -> None:
        cell = self.cell
        for where, names, known in (
            ("left: node", self.left, nodes),
            ("start: neuron", self.start, neurons),
            ("chains: neuron", [name for chain in cell.chains for name in chain], neurons),
            ("duals: neuron", [dual.neuron for dual in cell.duals], neurons),
            ("duals: node", [n for d in cell.duals for n in (d.residual, d.multiplier)], nodes),
        ):
            for name in names:
                if name not in known:
                    raise UnknownNameError.of(where, name, sorted(known))

    def _stage_values(self, where: str, given: Mapping) -> dict[str, np.ndarray]:
        return {
            name: per_stage(f"{where}[{name}]", value, self.stages) for name, value in given.items()
        }

    # ---- names and places -------------------------------------------------------------------

    @cached_property
    def neuron_index(self) -> dict[str, int]:
        """Row of each neuron in a state array of shape (neurons, N)."""
        return {neuron.name: i for i, neuron in enumerate(self.cell.neurons)}

    @cached_property
    def node_index(self) -> dict[str, int]:
        """Row of every node in an array (nodes, ...): neurons, inputs, the constant one, blocks."""
        cell = self.cell
        names = [*self.neuron_index, *cell.inputs, ONE, *(b.name for b in cell.blocks)]
        return {name: row for row, name in enumerate(names)}

    @cached_property
    def live(self) -> np.ndarray:
        """(neurons, N) booleans: False where a neuron is pinned or absent."""
        live = np.ones((len(self.cell.neurons), self.stages), bool)
        for end in (*self.pins, *self.absent):
            live[self.neuron_index[end.neuron], end.stage] = False
        return live

    @cached_property
    def places(self) -> np.ndarray:
        """(n, 2) integers: (neuron, stage) of every component of the state vector, by stage."""
        stage, neuron = np.nonzero(self.live.T)
        return np.column_stack([neuron, stage])

    @cached_property
    def state_index(self) -> np.ndarray:
        """(neurons, N) integers: component of the state vector, -1 where pinned or absent."""
        state_index = -np.ones(self.live.shape, np.int64)
        state_index[self.places[:, 0], self.places[:, 1]] = np.arange(self.size)
        return state_index

    def of_population(self, *names: str) -> np.ndarray:
        """(n,) booleans: which components of the state vector belong to these populations."""
        inside = np.array([neuron.population in names for neuron in self.cell.neurons])
        return inside[self.places[:, 0]]

    @property
    def chain_rows(self) -> np.ndarray:
        """(C, 2) integers: rows of the (q, t) neurons of every chain."""
        rows = [[self.neuron_index[q], self.neuron_index[t]] for q, t in self.cell.chains]
        return np.array(rows, np.int64).reshape(-1, 2)

    @property
    def chain_live(self) -> np.ndarray:
        """(C, 2N) booleans: which positions q_0, t_0, q_1, ... of the chains are live neurons."""
        return self.live[self.chain_rows].transpose(0, 2, 1).reshape(len(self.cell.chains), -1)

    @property
    def size(self) -> int:
        """Number of live neurons in the row (nodes of the metric not counted)."""
        return int(self.live.sum())

    def neuron(self, name: str) -> Neuron:
        """The neuron of that name.

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
            If there is no such neuron; the message lists those that there are.
        """
        if name not in self.neuron_index:
            raise UnknownNameError.of("neuron", name, self.neuron_index)
        return self.cell.neurons[self.neuron_index[name]]

    def label(self, component: int) -> str:
        """Name of one component of the state vector, for instance ``mu[3].phi``."""
        neuron, stage = self.places[component]
        name = self.cell.neurons[neuron]
        suffix = f".{name.component}" if name.component else ""
        return f"{name.population}[{stage}]{suffix}"

    @cached_property
    def row(self) -> Row:
        """What the metric has to know of the network."""
        tau = [np.broadcast_to(np.asarray(n.tau, float), self.stages) for n in self.cell.neurons]
        roles = [neuron.role for neuron in self.cell.neurons]
        return Row(
            rates=np.where(self.live, 1.0 / np.array(tau).reshape(self.live.shape), 0.0),
            primal=np.flatnonzero([role is Role.PRIMAL for role in roles]),
            chains=self.chain_rows,
        )

    # ---- states ------------------------------------------------------------------------------

    def pack(self, values: np.ndarray) -> np.ndarray:
        """State vectors of the live neurons from the values of all.

        Parameters
        ----------
        values : (..., neurons, N) array

        Returns
        -------
        (..., n) array
        """
        return np.ascontiguousarray(np.asarray(values)[..., self.places[:, 0], self.places[:, 1]])

    def unpack(self, x: np.ndarray) -> np.ndarray:
        """Values of all neurons, pinned ones at their inputs and absent ones at zero.

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
        for pin in self.pins:
            given: Any = self.inputs[pin.input]
            values[..., self.neuron_index[pin.neuron], pin.stage] = given[pin.stage]
        values[..., self.places[:, 0], self.places[:, 1]] = x
        return values

    def user_units(self, x: np.ndarray) -> np.ndarray:
        """State vectors with every neuron's value in the user's units.

        Parameters
        ----------
        x : (..., n) array
            State vectors, in network units.

        Returns
        -------
        (..., n) array
        """
        units = np.array([neuron.unit for neuron in self.cell.neurons])
        return np.asarray(x) * units[self.places[:, 0]]

    @cached_property
    def start_state(self) -> np.ndarray:
        """State vector (n,) of the initial values."""
        values = np.zeros(self.live.shape)
        for name, value in self.start.items():
            values[self.neuron_index[name]] = value
        return self.pack(values)

    # ---- other networks ----------------------------------------------------------------------

    def with_inputs(self, values: Mapping[str, float | np.ndarray]) -> Network:
        """Same wiring, other values of some inputs, for instance ``{"q_d.x": 3.0}``.

        Parameters
        ----------
        values : mapping of str to float or (N,) array
            By the name of the input.

        Returns
        -------
        Network

        Raises
        ------
        UnknownNameError
            If the cell has no such input; the message lists those that it has.
        NetworkError
            If a value is not finite, or is neither one number nor N of them.

        Examples
        --------
        >>> from ann_dc import plants, synthesize
        >>> moved = synthesize(plants.double_integrator(N=2)).with_inputs({"q_d.x": 3.0})
        >>> moved.inputs["q_d.x"].tolist()
        [3.0, 3.0]
        """
        for name in values:
            if name not in self.cell.inputs:
                raise UnknownNameError.of("input", name, self.cell.inputs)
        return replace(self, inputs={**self.inputs, **values})

    def with_start(self, x: np.ndarray) -> Network:
        """Same network, started from a state vector ``x`` (n,)."""
        values = self.unpack(np.asarray(x, float))
        return replace(self, start={name: values[i] for name, i in self.neuron_index.items()})

    # ---- summary -----------------------------------------------------------------------------

    def __str__(self) -> str:
        cell, stages = self.cell, self.stages
        wires, kind = self.metric.wires(self.row), self.metric.kind.value
        each_way = " each way" if wires.both_ways else ""
        rows = [
            ("neurons", len(cell.neurons), f"{self.size} live"),
            ("multipliers", cell.count(Product), cell.count(Product) * stages),
            ("function blocks", cell.count(Function), cell.count(Function) * stages),
            ("summing blocks", cell.count(Sum), cell.count(Sum) * stages),
            ("connections", len(cell.connections), len(cell.connections) * stages),
            ("nodes of the metric", "-", f"{wires.nodes}, of the {kind}"),
            ("wires of the metric", f"{wires.per_cell(stages):.0f}", f"{wires.count}{each_way}"),
        ]
        populations = Counter(neuron.population for neuron in cell.neurons)
        functions = Counter(b.function for b in cell.blocks if isinstance(b, Function))
        head = f"{self.title}: {stages} cells of " + ", ".join(
            f"{count} {name}" for name, count in populations.items()
        )
        table = [f"{'':22}{'per cell':>10}  in all"]
        table += [f"  {name:20}{per!s:>10}  {total}" for name, per, total in rows]
        used = ", ".join(f"{count} {name}" for name, count in sorted(functions.items()))
        return "\n".join([head, *table, *([f"  functions: {used}"] if used else [])])
