r"""One cell of the network: neurons, blocks, and the numbers that connect them.

A neuron holds state and obeys

.. math:: \tau\, \dot x = \sum_{e \to x} w_e\, s_e ,

where the sum runs over the connections that end at it, w_e is the synapse weight of a connection
and s_e the value of its source. Blocks hold no state: a `Sum` adds what arrives as a neuron does,
a `Product` is a multiplier, a `Function` a function generator. Sources may sit in the same cell
or, for connections, in another one at a fixed distance: the cell is a cloning template. What a
problem is wired into reaches the next cell and no further; the emulation of a circuit with a metric
has wires beyond neighbours.

What a cell has to be before a network is made of it; every refusal names the node.

A name belongs to one node, a time constant is positive, a weight is finite and fits the row, and
blocks stand in topological order: what a block reads is there before it.
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
from ann_dc.network.duals import ONE as ONE, DiodeDual, ObjectiveDual, PIDual, wire_name
from ann_dc.network.ends import Absent, Pin
from ann_dc.network.functions import function_block
from ann_dc.scale import IDENTITY, Scale


class Template(enum.IntEnum):
    """Where the source of a connection sits, relative to the cell of its target.

    ``PREVIOUS`` is the cell to the left, ``SELF`` the target's own, ``NEXT`` the one to the right;
    the value is the offset in stages.

    References
    ----------
    .. [1] L. O. Chua, L. Yang, Cellular neural networks: theory, IEEE Transactions on Circuits and
       Systems 35, 1988, 1257-1272.
    """

    PREVIOUS = -1
    SELF = 0
    NEXT = 1


class Role(enum.Enum):
    """What a neuron does in an optimisation network; hand-wired networks use ``STATE``.

    A ``PRIMAL`` neuron descends the Lagrangian, a ``DUAL`` neuron ascends it; what measures and
    compares objectives is a ``STATE``.
    """

    PRIMAL = "primal"
    DUAL = "dual"
    STATE = "state"


@dataclass(frozen=True, kw_only=True, eq=False)
class Limiter:
    """Rails of a neuron: its state stops at ``low`` and ``high`` (a diode has one of them).

    Attributes
    ----------
    low, high : float
        In network units; infinite where there is no rail.
    """

    low: float = -np.inf
    high: float = np.inf


@dataclass(frozen=True, kw_only=True, eq=False)
class Neuron:
    """An integrator, tau x' = sum of what arrives.

    Attributes
    ----------
    name : str
        ``population.component``, for instance ``mu.phi``.
    tau : float or (N,) array
        Time constant in units of network time; positive.
    role : Role
        What the neuron does in an optimisation network.
    limiter : Limiter
        Its rails; none by default.
    scale : Scale
        How its state stands for a value of the user's.
    shared : bool
        Whether there is one for the whole row, in its last cell: every cell reads it over a bus,
        and what the cells send to it adds up on another.
    """

    name: str
    tau: float | np.ndarray = 1.0
    role: Role = Role.STATE
    limiter: Limiter = Limiter()
    scale: Scale = IDENTITY
    shared: bool = False

    @property
    def population(self) -> str:
        """The part of the name before the dot (q, u, t, mu, beta)."""
        return self.name.partition(".")[0]

    @property
    def component(self) -> str:
        """The part of the name after the dot, in the user's own words."""
        return self.name.partition(".")[2]


@dataclass(frozen=True, kw_only=True, eq=False)
class Sum:
    """A summing amplifier, y = sum w s; what it adds is in the cell's connections.

    Attributes
    ----------
    name : str
    """

    name: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Product:
    """A four-quadrant multiplier of two nodes of its own cell, y = a b.

    Attributes
    ----------
    name : str
    a, b : str
        Names of the factors: neurons, inputs or earlier blocks.
    """

    name: str
    a: str
    b: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Function:
    """A function generator on one node of its own cell, y = g(x).

    Attributes
    ----------
    name : str
    function : str
        Which g: the name of a `FunctionBlock`.
    x : str
        Name of its argument: a neuron, an input or an earlier block.
    """

    name: str
    function: str
    x: str


Block = Sum | Product | Function


@dataclass(frozen=True, kw_only=True, eq=False)
class Connection:
    """A synapse: ``weight`` times the value of ``source`` arrives at ``target``.

    Attributes
    ----------
    source : str
        A neuron, a block, an input, or `ONE`.
    target : str
        A neuron or a `Sum`.
    weight : float or (N,) array
        One number for all cells, or one a stage.
    template : Template or int
        The cell in which the source sits; a number of stages where it is no neighbour.
    """

    source: str
    target: str
    weight: float | np.ndarray = 1.0
    template: int = Template.SELF

    @property
    def where(self) -> str:
        """Whose the source is: nothing, ``@previous`` or ``@next``, or ``@+3`` stages on."""
        if self.template == Template.SELF:
            return ""
        if abs(self.template) == 1:
            return f"@{Template(self.template).name.lower()}"
        return f"@{self.template:+d}"

    @property
    def name(self) -> str:
        """``target<-source``, with what `where` says of the source after it."""
        return wire_name(self.source, self.target, self.where)


@dataclass(frozen=True, kw_only=True, eq=False)
class Cell:
    """The wiring that all N stages share.

    Attributes
    ----------
    neurons : tuple of Neuron
    inputs : tuple of str
        Nodes whose value the user sets from outside.
    blocks : tuple of Block
        In topological order: a block reads neurons, inputs and earlier blocks only.
    connections : tuple of Connection
    duals : tuple of PIDual
        Which neurons are PI duals (empty in a network that is no optimiser).
    diodes : tuple of DiodeDual
        Which neurons are multipliers of inequalities.
    objectives : tuple of ObjectiveDual
        Which shared ones compare objectives, of which the largest is minimised.
    chains : tuple of (str, str)
        For each state component the neurons (q, t) of the chain t_0, q_1, t_1, ..., q_{N-1} that
        coarse coordinators span.

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
    diodes: tuple[DiodeDual, ...] = ()
    objectives: tuple[ObjectiveDual, ...] = ()
    chains: tuple[tuple[str, str], ...] = ()

    @cached_property
    def populations(self) -> dict[str, np.ndarray]:
        """Rows of the neurons of each population, by its name."""
        names = np.array([neuron.population for neuron in self.neurons])
        return {name: np.flatnonzero(names == name) for name in dict.fromkeys(names.tolist())}

    @cached_property
    def scales(self) -> np.ndarray:
        """(neurons, 2): factor and offset of each neuron's scale."""
        return np.array([neuron.scale for neuron in self.neurons]).reshape(-1, 2)

    def penalty_weights(self, penalties: Mapping[str, float]) -> dict[str, float]:
        """Weights of the connections that carry penalties, by name.

        Parameters
        ----------
        penalties : mapping of neuron name to float
            rho of every PI dual, w of every diode neuron, r of every objective.
        """
        plain = (*self.duals, *self.objectives)
        weights = {dual.path: float(penalties[dual.neuron]) for dual in plain}
        for diode in self.diodes:
            weights |= diode.weights(float(penalties[diode.neuron]))
        return weights

    def count(self, kind: type) -> int:
        """How many blocks of a kind (`Sum`, `Product`, `Function`) a cell has."""
        return sum(isinstance(block, kind) for block in self.blocks)


@lru_cache(maxsize=64)
def check_cell(cell: Cell, stages: int) -> None:
    """Refuse a cell that contradicts itself or does not fit a row of so many stages.

    A cell that has passed is not looked at again: networks that differ in their inputs share it.

    Parameters
    ----------
    cell : Cell
    stages : int
        N.

    Raises
    ------
    NetworkError
        Less than a stage, names that are no text or are used twice, numbers that are no weights,
        time constants or rails, connections that end nowhere, blocks out of order.
    UnknownNameError
        A function block that does not exist.
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
    """Refuse what no file can hold as text: half of a letter, a lone surrogate.

    Parameters
    ----------
    what : str
        For the message.
    text : str

    Raises
    ------
    NetworkError
    """
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise NetworkError(
            f"{what}: {text!r:.60} has a lone surrogate at {error.start}; give a text"
        ) from error


def per_stage(name: str, value, stages: int) -> np.ndarray:
    """One finite number a stage, (N,) and read-only, from one number or N of them.

    Parameters
    ----------
    name : str
        The field, for the message.
    value : float or (N,) array
    stages : int
        N.

    Returns
    -------
    (N,) array

    Raises
    ------
    NetworkError
        If the value is neither one number nor N of them, or not finite.

    Examples
    --------
    >>> per_stage("tau", 2, 3).tolist()
    [2.0, 2.0, 2.0]
    """
    try:
        array = np.array(np.broadcast_to(np.asarray(value, float), (stages,)))
    except (TypeError, ValueError) as error:
        raise NetworkError(
            f"{name}: expected one number or {stages} of them, one a stage, got {value!r}"
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
        raise NetworkError(f"names used twice (case does not count): {', '.join(repeated)}")


def check_scale(name: str, scale: Scale) -> None:
    """Refuse the scale of the neuron or input ``name`` if it stands for no number.

    Raises
    ------
    NetworkError
    """
    if not (np.isfinite(scale).all() and scale.factor != 0):
        raise NetworkError(f"{name}: the factor of {scale!r} must be finite and not zero")


def _check_neuron(neuron: Neuron, stages: int) -> None:
    if not (np.asarray(neuron.tau) > 0).all() or not np.isfinite(neuron.tau).all():
        raise NetworkError(f"{neuron.name}: time constant {neuron.tau!r} must be positive")
    per_stage(f"{neuron.name}.tau", neuron.tau, stages)
    check_scale(neuron.name, neuron.scale)
    if not neuron.limiter.low < neuron.limiter.high:
        raise NetworkError(
            f"{neuron.name}: rails {neuron.limiter.low!r} .. {neuron.limiter.high!r} leave no room"
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
        raise NetworkError(f"connections given twice: {', '.join(repeated)}; add up their weights")


def _check_shared(cell: Cell) -> None:
    """What all cells share has no neighbour, and no place in a chain."""
    shared = {neuron.name for neuron in cell.neurons if neuron.shared}
    for connection in cell.connections:
        if connection.template != Template.SELF and {connection.source, connection.target} & shared:
            raise NetworkError(
                f"{connection.name}: all cells share this neuron; read it, and drive it, in the "
                "cell itself"
            )
    in_chains = shared & {name for chain in cell.chains for name in chain}
    if in_chains:
        raise NetworkError(f"chains: {', '.join(sorted(in_chains))} is shared by all cells")


def _is_number(weight: object) -> bool:
    """Whether it needs no closer look: most weights are one finite number, and cells have many."""
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
    """Refuse the scale of an input that there is not, or that stands for no number.

    Raises
    ------
    NetworkError
    """
    foreign = set(scales) - set(inputs)
    if foreign:
        raise NetworkError(f"input_scales: the cell has no input {', '.join(sorted(foreign))}")
    for name, scale in scales.items():
        check_scale(f"input_scales[{name}]", scale)


def warn_outside(
    ranges: Mapping[str, tuple[float, float]], values: Mapping[str, float | np.ndarray]
) -> None:
    """Warn of inputs that lie outside the ranges for which a network was designed."""
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
    ends: Iterable[Pin | Absent],
    read: Iterable[str],
    left: Iterable[str],
    start: Iterable[str],
) -> None:
    """Refuse names of a network that are none of its cell's, and stages that it does not have.

    Parameters
    ----------
    cell : Cell
    stages : int
        N.
    inputs : iterable of str
        That have a value.
    ends : iterable of Pin and Absent
    read : iterable of str
        Inputs that pins and the left end read.
    left : iterable of str
        Nodes whose value beyond the left end is given.
    start : iterable of str
        Neurons whose initial state is given.

    Raises
    ------
    NetworkError, UnknownNameError
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
            raise NetworkError(f"{end}: all cells share this neuron")
    for source in read:
        if source not in cell.inputs:
            raise NetworkError(f"pins, left: {source!r} is not an input of the cell")
    _check_known(
        ("left: node", left, nodes),
        ("start: neuron", start, neurons),
        ("chains: neuron", [name for chain in cell.chains for name in chain], neurons),
        ("duals: neuron", [dual.neuron for dual in cell.duals], neurons),
        ("duals: node", [n for d in cell.duals for n in (d.residual, d.multiplier)], nodes),
        ("objectives: neuron", [name for row in cell.objectives for name in row.neurons], shared),
        ("objectives: node", [name for row in cell.objectives for name in row.nodes], nodes),
        ("diodes: neuron", [diode.neuron for diode in cell.diodes], neurons),
        ("diodes: node", [name for diode in cell.diodes for name in diode.nodes], nodes),
    )


def _check_known(*uses: tuple[str, Iterable[str], set[str]]) -> None:
    """Refuse a name that is none of those known: (what it is, names, known ones) each."""
    for where, names, known in uses:
        for name in names:
            if name not in known:
                raise UnknownNameError.of(where, name, sorted(known))
