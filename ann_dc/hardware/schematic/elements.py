"""The elements of a schematic: what one cell is made of, before any volt or ohm is chosen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.network.cell import Limiter

UNLIMITED = Limiter()
"""Of integrators without rails."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Wire:
    """A weighted connection: weight times the source arrives.

    Attributes
    ----------
    source : str
        Name of a node.
    offset : int
        Cell of the source relative to the wire's own: -1, 0 or 1 in what a problem is wired into,
        any number of cells in a metric.
    weight : (N,) array
    """

    source: str
    offset: int
    weight: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Integrator:
    """x' = rate * sum of wires.

    Attributes
    ----------
    name : str
        Of the neuron; ``own.<neuron>`` for the own integrator of one that a metric reaches.
    wires : tuple of Wire
    rate : (N,) array
        In units of 1 / network time; zero where the neuron is pinned or absent.
    limiter : Limiter
        Its rails, in network units: there it stops, and turns back at once.
    shared : bool
        Whether there is one for the row, in the last cell, and all cells send to it: a wire's
        weight at a stage is that of the cell which sends.
    """

    name: str
    wires: tuple[Wire, ...]
    rate: np.ndarray
    limiter: Limiter = UNLIMITED
    shared: bool = False

    @property
    def railed(self) -> bool:
        """Whether it has a rail."""
        return bool(np.isfinite([self.limiter.low, self.limiter.high]).any())

    @property
    def present(self) -> np.ndarray:
        """(N,) booleans: in which cells there is one."""
        return self.rate > 0

    @property
    def tau(self) -> np.ndarray:
        """1 / rate (N,), in network time; one where there is none."""
        return 1.0 / np.where(self.present, self.rate, 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class PICell:
    """m = mu + rho c, mu' = rate c, c the sum of wires; or a diode neuron.

    That is rectified, m = max(0, mu + rho c), and where m is zero mu leaks, mu' = -rate mu / rho.
    That of a compliant row has a wire from its own output, -d m: a resistor across all of its
    feedback.

    Attributes
    ----------
    name : str
        Of m.
    dual : str
        Names mu; where it is absent, so is m.
    wires : tuple of Wire
        What c adds up.
    rate : (N,) array
        In units of 1 / network time; zero where mu is absent.
    rho : (N,) array
    rectified : bool
        Whether it is a diode neuron.
    """

    name: str
    dual: str
    wires: tuple[Wire, ...]
    rate: np.ndarray
    rho: np.ndarray
    rectified: bool = False

    @property
    def present(self) -> np.ndarray:
        """(N,) booleans: in which cells there is one."""
        return self.rate > 0

    @property
    def compliance(self) -> np.ndarray:
        """d (N,), zero where no wire comes from the own output."""
        own = [wire.weight for wire in self.wires if wire.source == self.name and not wire.offset]
        return -np.sum(own, axis=0) if own else np.zeros(len(self.rate))

    @property
    def tau(self) -> np.ndarray:
        """rho / rate (N,), in network time; one where there is none."""
        return np.where(self.present, self.rho / np.where(self.present, self.rate, 1.0), 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Adder:
    """y = sum of wires.

    Attributes
    ----------
    name : str
    wires : tuple of Wire
    present : (N,) array of bool, optional
        In which cells there is one; in all of them where nothing is given.
    """

    name: str
    wires: tuple[Wire, ...]
    present: np.ndarray | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Multiplier:
    """y = a b, with differential inputs.

    Attributes
    ----------
    name : str
    a, b : str
        Names of the factors.
    """

    name: str
    a: str
    b: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Generator:
    """y = g(x), by a function generator.

    Attributes
    ----------
    name : str
    function : str
        Which g: the name of a function block.
    x : str
        Name of the argument.
    """

    name: str
    function: str
    x: str


@dataclass(frozen=True, kw_only=True, eq=False)
class GridNode:
    """lag v' = sum of wires - v: a pair of nodes of a resistor network, v and -v, and a follower.

    Every resistor is there twice, between the nodes of equal sign where its weight is positive and
    across where it is negative, so that no inverter stands in the network.

    Attributes
    ----------
    name : str
        Of the neuron that the follower carries.
    wires : tuple of Wire
        From the integrators, and from other nodes of the network, by the names of their neurons.
    present : (N,) array of bool
        In which cells there is one.
    """

    name: str
    wires: tuple[Wire, ...]
    present: np.ndarray


Part = Integrator | PICell | Adder | GridNode | Multiplier | Generator
Amplifier = Integrator | PICell | Adder
"""Parts with wires into a virtual ground."""
