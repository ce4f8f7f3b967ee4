r"""Cell of the network: neurons, blocks, and the weights that connect them.

A neuron has a state and obeys

.. math:: \tau\, \dot x = \sum_{e \to x} w_e\, s_e ,

where the sum runs over the connections that end at the neuron, w_e is the synapse weight of a
connection and s_e the value of its source. Blocks have no state: a `Sum` adds its inputs like a
neuron, a `Product` is a multiplier, a `Function` a function generator.

Sources are in the same cell or, for connections, in another one at a fixed distance: the cell is a
cloning template. The wiring of a problem reaches the next cell only; the emulation of a circuit
with a preconditioner has wires beyond neighbours.

Validation of a cell before network construction; every error names the node.

A name belongs to one node, a time constant is positive, a weight is finite and fits the cell array.
Blocks are in topological order: all nodes that a block reads precede the block.
"""

from __future__ import annotations

import enum
import math
import warnings
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ann_dc.errors import NetworkError, RangeWarning, UnknownNameError
from ann_dc.network.duals import ONE as ONE, InequalityDual, ObjectiveDual, PIDual, wire_name
from ann_dc.network.ends import FixedNeuron, Omitted
from ann_dc.network.functions import function_block
from ann_dc.scale import IDENTITY, Scale
from ann_dc.summaries import summarised


class Template(enum.IntEnum):
    """Location of a connection's source relative to the cell of its target.

    ``PREVIOUS`` is the cell to the left, ``SELF`` the cell of the target, ``NEXT`` the cell to the
    right; the value is the offset in stages.

    References
    ----------
    .. [1] L. O. Chua, L. Yang, Cellular neural networks: theory, IEEE Transactions on Circuits and
       Systems 35, 1988, 1257-1272.
    """

    PREVIOUS = -1
    SELF = 0
    NEXT = 1


class Role(enum.Enum):
    """Role of a neuron in an optimisation network.

    A ``PRIMAL`` neuron descends the Lagrangian, a ``DUAL`` neuron ascends it. Neurons that measure
    and compare objectives, and neurons of manually wired networks, have the role ``STATE``.
    """

    PRIMAL = "primal"
    DUAL = "dual"
    STATE = "state"


@dataclass(frozen=True, kw_only=True, eq=False)
class Limiter:
    """Saturation limits of a neuron state (a diode has one of them).

    Attributes
    ----------
    low, high : float
        Limits in network units; infinite if absent.
    """

    low: float = -np.inf
    high: float = np.inf


@dataclass(frozen=True, kw_only=True, eq=False)
class Neuron:
    """Integrator neuron, tau x' = sum of the incoming signals.

    Attributes
    ----------
    name : str
        ``population.component``, for instance ``mu.phi``.
    role : Role
        Part in the optimisation; ``STATE`` for a network wired by hand.
    tau : float or (N,) array
        Time constant in units of network time; positive.
    limiter : Limiter
        Saturation limits; none by default.
    scale : Scale
        Conversion of the state to a value in the user's units.
    shared : bool
        True for a single neuron of the whole network, located in the last cell. Every cell reads
        its state over a bus; contributions of the cells are summed on another bus.
    """

    name: str
    tau: float | np.ndarray = 1.0
    role: Role = Role.STATE
    limiter: Limiter = Limiter()
    scale: Scale = IDENTITY
    shared: bool = False

    @property
    def population(self) -> str:
        """Part of the name before the dot (q, u, t, mu, beta)."""
        return self.name.partition(".")[0]

    @property
    def component(self) -> str:
        """Part of the name after the dot, in the user's terms."""
        return self.name.partition(".")[2]


@dataclass(frozen=True, kw_only=True, eq=False)
class Sum:
    """Summing amplifier, y = sum w s, with its inputs in the cell's connections."""

    name: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Product:
    """Four-quadrant multiplier of two nodes of its cell, y = a b.

    Attributes
    ----------
    name : str
        Name of the node y.
    a, b : str
        Names of the factors: neurons, inputs or earlier blocks.
    """

    name: str
    a: str
    b: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Function:
    """Function generator on one node of its cell, y = g(x).

    ``function`` is the name of the `FunctionBlock` g, ``x`` that of a neuron, an input or an
    earlier block.
    """

    name: str
    function: str
    x: str


Block = Sum | Product | Function


@dataclass(frozen=True, kw_only=True, eq=False)
class Connection:
    """Synapse that transmits ``weight`` times the value of ``source`` to ``target``.

    Attributes
    ----------
    source : str
        A neuron, a block, an input, or `ONE`.
    target : str
        A neuron or a `Sum`.
    weight : float or (N,) array
        One number for all cells, or one per stage.
    template : Template or int
        Cell of the source; a number of stages if the cell is not a neighbour.
    """

    source: str
    target: str
    weight: float | np.ndarray = 1.0
    template: int = Template.SELF

    @property
    def where(self) -> str:
        """Location suffix of the source: empty, ``@previous``, ``@next``, or ``@+3``.

        The number is the offset in stages.
        """
        if self.template == Template.SELF:
            return ""
        if abs(self.template) == 1:
            return f"@{Template(self.template).name.lower()}"
        return f"@{self.template:+d}"

    @property
    def name(self) -> str:
        """Connection name ``target<-source``, followed by the suffix `where`."""
        return wire_name(self.source, self.target, self.where)


@summarised(
    lambda self: {
        "neurons": ", ".join(neuron.name for neuron in self.neurons),
        "blocks": len(self.blocks),
        "connections": len(self.connections),
        "inputs": ", ".join(self.inputs),
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Cell:
    """Wiring common to all N stages.

    Attributes
    ----------
    inputs : tuple of str
        Nodes whose value the user sets.
    blocks : tuple of Block
        Blocks in topological order: a block reads neurons, inputs and earlier blocks only.
    duals : tuple of PIDual
        PI multiplier neurons (empty in a network that is not an optimiser).
    inequality_duals : tuple of InequalityDual
        Multiplier neurons of inequalities.
    objectives : tuple of ObjectiveDual
        Shared neurons that compare objectives, of which the largest is minimised.
    chains : tuple of (str, str)
        Neurons (q, t) of the chain t_0, q_1, t_1, ..., q_{N-1} of each state component, on which
        the coarse grids are defined.

    Examples
    --------
    A leaky integrator with an input:

    >>> cell = Cell(neurons=(Neuron(name="x", tau=0.5),), inputs=("drive",), connections=(
    ...     Connection(source="x", target="x", weight=-1.0),
    ...     Connection(source="drive", target="x")))
    >>> [connection.name for connection in cell.connections]
    ['x<-x', 'x<-drive']
    """

    neurons: tuple[Neuron, ...]
    inputs: tuple[str, ...] = ()
    blocks: tuple[Block, ...] = ()
    connections: tuple[Connection, ...] = ()
    duals: tuple[PIDual, ...] = ()
    inequality_duals: tuple[InequalityDual, ...] = ()
    objectives: tuple[ObjectiveDual, ...] = ()
    chains: tuple[tuple[str, str], ...] = ()

    @cached_property
    def populations(self) -> dict[str, np.ndarray]:
        """Neuron rows of each population, by name."""
        names = np.array([neuron.population for neuron in self.neurons])
        return {name: np.flatnonzero(names == name) for name in dict.fromkeys(names.tolist())}

    @cached_property
    def scales(self) -> np.ndarray:
        """Factor and offset of each neuron's scale, (neurons, 2)."""
        return np.array([neuron.scale for neuron in self.neurons]).reshape(-1, 2)

    def penalty_weights(self, penalties: Mapping[str, float]) -> dict[str, float]:
        """Return the weights of penalty connections, by name.

        The penalties are, by neuron, rho of every PI multiplier neuron, w of every rectifying
        neuron and r of every objective.
        """
        plain = (*self.duals, *self.objectives)
        weights = {dual.path: float(penalties[dual.neuron]) for dual in plain}
        for diode in self.inequality_duals:
            weights |= diode.weights(float(penalties[diode.neuron]))
        return weights

    def count(self, kind: type) -> int:
        """Return the number of blocks of a type (`Sum`, `Product`, `Function`) in a cell."""
        return sum(isinstance(block, kind) for block in self.blocks)


@lru_cache(maxsize=64)
def check_cell(cell: Cell, stages: int) -> None:
    """Reject a cell that is inconsistent or does not fit the number N of stages.

    The result is cached: networks that differ only in their inputs are checked once. Raises
    `NetworkError`, or `UnknownNameError` for a function block that does not exist.
    """
    if stages < 1:
        raise NetworkError(f"stages: expected N >= 1, got {stages!r}")
    for name in _nodes(cell):
        check_text("name", name)
    _check_names(cell)
    for neuron in cell.neurons:
        _check_neuron(neuron, stages)
    _check_shared(cell)
    _check_connections(cell, stages)
    _check_order(cell)


def check_text(what: str, text: str) -> None:
    """Raise a `NetworkError` for text that files cannot store (a lone surrogate).

    The message contains the given description of the text.
    """
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise NetworkError(
            f"{what}: {text!r:.60} has a lone surrogate at {error.start}; use valid text"
        ) from error


def per_stage(name: str, value, stages: int) -> np.ndarray:
    """Return one finite number per stage, (N,) and read-only, from one number or N.

    Raises `NetworkError` with the name of the field if the value has another size or is not finite.
    """
    try:
        array = np.array(np.broadcast_to(np.asarray(value, float), (stages,)))
    except (TypeError, ValueError) as error:
        raise NetworkError(
            f"{name}: expected one number or {stages} values, one per stage, got {value!r}"
        ) from error
    if not np.isfinite(array).all():
        raise NetworkError(f"{name}: {value!r} is not finite")
    array.setflags(write=False)
    return array


def _nodes(cell: Cell) -> list[str]:
    return [ONE, *(n.name for n in cell.neurons), *cell.inputs, *(b.name for b in cell.blocks)]


def _check_names(cell: Cell) -> None:
    uses = Counter(name.lower() for name in _nodes(cell))
    repeated = [name for name, count in uses.items() if count > 1]
    if repeated:
        raise NetworkError(f"duplicate names (case is ignored): {', '.join(repeated)}")


def _check_scale(name: str, scale: Scale) -> None:
    """Raise a `NetworkError` if the scale of neuron or input ``name`` is invalid."""
    if not (np.isfinite(scale).all() and scale.factor != 0):
        raise NetworkError(f"{name}: the factor of {scale!r} must be finite and not zero")


def _check_neuron(neuron: Neuron, stages: int) -> None:
    if not (np.asarray(neuron.tau) > 0).all() or not np.isfinite(neuron.tau).all():
        raise NetworkError(f"{neuron.name}: time constant {neuron.tau!r} must be positive")
    per_stage(f"{neuron.name}.tau", neuron.tau, stages)
    _check_scale(neuron.name, neuron.scale)
    if not neuron.limiter.low < neuron.limiter.high:
        raise NetworkError(
            f"{neuron.name}: limits {neuron.limiter.low!r} .. {neuron.limiter.high!r}: "
            "expected low < high"
        )


def _check_connections(cell: Cell, stages: int) -> None:
    nodes = set(_nodes(cell))
    targets = {n.name for n in cell.neurons} | {b.name for b in cell.blocks if isinstance(b, Sum)}
    for connection in cell.connections:
        if connection.source not in nodes or connection.target not in targets:
            raise NetworkError(
                f"{connection.name}: source must be a node and target a neuron or a sum"
            )
        if not _is_number(connection.weight):
            per_stage(connection.name, connection.weight, stages)
        if not isinstance(connection.template, (int, np.integer)):
            raise NetworkError(
                f"{connection.target}<-{connection.source}: template: expected a whole number of "
                f"stages, got {connection.template!r}"
            )
    uses = Counter(connection.name for connection in cell.connections)
    repeated = [name for name, count in uses.items() if count > 1]
    if repeated:
        raise NetworkError(f"duplicate connections: {', '.join(repeated)}; add up their weights")


def _check_shared(cell: Cell) -> None:
    """Raise a `NetworkError` if a shared neuron has neighbour wires or is in a chain."""
    shared = {neuron.name for neuron in cell.neurons if neuron.shared}
    for connection in cell.connections:
        if connection.template != Template.SELF and {connection.source, connection.target} & shared:
            raise NetworkError(
                f"{connection.name}: the neuron is shared by all cells; connect it within the cell"
            )
    in_chains = shared & {name for chain in cell.chains for name in chain}
    if in_chains:
        raise NetworkError(f"chains: {', '.join(sorted(in_chains))} is shared by all cells")


def _is_number(weight: object) -> bool:
    """Return True for a finite number, which most weights are; a fast first check."""
    return type(weight) is float and math.isfinite(weight)


def _check_order(cell: Cell) -> None:
    feeds: dict[str, list[Connection]] = {}
    for connection in cell.connections:
        feeds.setdefault(connection.target, []).append(connection)
    ready = {ONE, *(n.name for n in cell.neurons), *cell.inputs}
    for block in cell.blocks:
        if isinstance(block, Product):
            needs = [block.a, block.b]
        elif isinstance(block, Function):
            function_block(block.function)
            needs = [block.x]
        else:
            needs = [c.source for c in feeds.get(block.name, ())]
        late = [name for name in needs if name not in ready]
        if late:
            raise NetworkError(
                f"{block.name} reads {', '.join(late)} before it is computed; "
                "list blocks in topological order, without loops"
            )
        ready.add(block.name)


def check_input_scales(scales: Mapping[str, Scale], inputs: Iterable[str]) -> None:
    """Raise a `NetworkError` if the scale of an input is invalid or its input unknown."""
    foreign = set(scales) - set(inputs)
    if foreign:
        raise NetworkError(f"input_scales: the cell has no input {', '.join(sorted(foreign))}")
    for name, scale in scales.items():
        _check_scale(f"input_scales[{name}]", scale)


def warn_outside(
    ranges: Mapping[str, tuple[float, float]], values: Mapping[str, float | np.ndarray]
) -> None:
    """Warn about inputs outside the ranges for which a network was designed."""
    for name in set(ranges) & set(values):
        (low, high), value = ranges[name], np.asarray(values[name], float)
        outside = value[(value < low) | (value > high)]
        if outside.size:
            warnings.warn(
                f"{name} = {outside.flat[0]:g} lies outside the range from {low:g} to {high:g} for "
                "which this network was designed; it may not settle there",
                RangeWarning,
                stacklevel=3,
            )


def check_places(
    cell: Cell,
    stages: int,
    *,
    inputs: Iterable[str],
    ends: Iterable[FixedNeuron | Omitted],
    read: Iterable[str],
    left: Iterable[str],
    start: Iterable[str],
) -> None:
    """Reject names that the cell lacks and stages that the network lacks.

    Inputs with a value are ``inputs``; those that fixed neurons and the left boundary read are
    ``read``. ``left`` has the nodes with a given value beyond the left end, ``start`` the neurons
    with a given initial state. Raises `NetworkError` or `UnknownNameError`.
    """
    neurons = {neuron.name for neuron in cell.neurons}
    nodes = neurons | set(cell.inputs) | {block.name for block in cell.blocks}
    foreign = set(inputs) - set(cell.inputs)
    if foreign:
        raise NetworkError(f"inputs: the cell has no input {', '.join(sorted(foreign))}")
    shared = {neuron.name for neuron in cell.neurons if neuron.shared}
    for end in ends:
        if end.neuron not in neurons or not 0 <= end.stage < stages:
            raise NetworkError(f"{end}: no such neuron or stage")
        if end.neuron in shared:
            raise NetworkError(f"{end}: the neuron is shared by all cells")
    for source in read:
        if source not in cell.inputs:
            raise NetworkError(f"fixed, left_boundary: {source!r} is not an input of the cell")
    _check_known(
        ("left_boundary: node", left, nodes),
        ("start: neuron", start, neurons),
        ("chains: neuron", [name for chain in cell.chains for name in chain], neurons),
        ("duals: neuron", [dual.neuron for dual in cell.duals], neurons),
        ("duals: node", [n for d in cell.duals for n in (d.residual, d.multiplier)], nodes),
        ("objectives: neuron", [name for row in cell.objectives for name in row.neurons], shared),
        ("objectives: node", [name for row in cell.objectives for name in row.nodes], nodes),
        ("inequality_duals: neuron", [diode.neuron for diode in cell.inequality_duals], neurons),
        (
            "inequality_duals: node",
            [name for diode in cell.inequality_duals for name in diode.nodes],
            nodes,
        ),
    )


def _check_known(*uses: tuple[str, Iterable[str], set[str]]) -> None:
    """Raise an error for unknown names; each use is (description, names, known names)."""
    for where, names, known in uses:
        for name in names:
            if name not in known:
                raise UnknownNameError.of(where, name, sorted(known))
