r"""One cell of the network: neurons, blocks, and the numbers that connect them.

A neuron holds state and obeys

.. math:: \tau\, \dot x = \sum_{e \to x} w_e\, s_e ,

where the sum runs over the connections that end at it, w_e is the synapse weight of a connection
and s_e the value of its source. Blocks hold no state: a `Sum` adds what arrives as a neuron does,
a `Product` is a multiplier, a `Function` a function generator. Sources may sit in the same cell
or, for connections, in another one at a fixed distance: the cell is a cloning template. What a
problem is wired into reaches the next cell and no further; the emulation of a circuit with a metric
has wires beyond neighbours.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ann_dc.network.duals import ONE as ONE, DiodeDual, ObjectiveDual, PIDual, wire_name
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
