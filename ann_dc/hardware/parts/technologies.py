"""What a cell is built of: op amps with resistors, differential ones, transconductors, capacitors.

A technology is a record. What it means is told by its interpreters: the emulation reads it as the
equations of a network, the netlist as cards. Every technology computes with the same circuit: a
transconductor is 1/R, a switched capacitor h T C_f / (R C) per period.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, TypeAlias, TypeVar

import numpy as np

from ann_dc.errors import NetworkError, require_positive
from ann_dc.hardware.parts.datasheet import Kind
from ann_dc.network.preconditioners import base as contract
from ann_dc.validation.checked import checked

FEED_FORWARD = tuple(kind for kind in contract.Kind if kind is not contract.Kind.GRID)
"""Metrics that are sums without a loop."""


@dataclass(frozen=True, kw_only=True)
class OpAmps:
    """Op amps with resistors at a virtual ground; an inverter where the other sign is needed.

    Attributes
    ----------
    differential : bool
        Whether every signal is there with both signs.
    clocked : bool
        Whether it computes in periods of a clock.
    resettable : bool
        Whether capacitors and reset switches of its cells can be those of a board.
    without : tuple of Kind
        Errors of parts that its cells do not have.
    metrics : tuple of metrics.Kind
        Kinds of metric that it can build.
    """

    differential: ClassVar[bool] = False
    clocked: ClassVar[bool] = False
    resettable: ClassVar[bool] = True
    without: ClassVar[tuple[Kind, ...]] = ()
    metrics: ClassVar[tuple[contract.Kind, ...]] = tuple(contract.Kind)


@dataclass(frozen=True, kw_only=True)
class DifferentialPairs:
    """Fully differential op amps: two summing nodes and outputs, twice the R and C, no inverter.

    Attributes
    ----------
    differential, clocked, resettable, without, metrics
        As of `OpAmps`: no grid.
    """

    differential: ClassVar[bool] = True
    clocked: ClassVar[bool] = False
    resettable: ClassVar[bool] = True
    without: ClassVar[tuple[Kind, ...]] = ()
    metrics: ClassVar[tuple[contract.Kind, ...]] = FEED_FORWARD


@checked
@dataclass(frozen=True, kw_only=True)
class OtaC:
    """Transconductors into one node a neuron; equal and opposite weights share one pair.

    Attributes
    ----------
    linear_range : float
        Volts of the tanh, over full scale.
    differential, clocked, resettable, without, metrics
        As of `OpAmps`: transconductors have no offset, and no adders that a metric could be.
    """

    linear_range: float = 30.0

    differential: ClassVar[bool] = True
    clocked: ClassVar[bool] = False
    resettable: ClassVar[bool] = False
    without: ClassVar[tuple[Kind, ...]] = (Kind.OFFSET,)
    metrics: ClassVar[tuple[contract.Kind, ...]] = (contract.Kind.TIME_CONSTANTS,)


@checked
@dataclass(frozen=True, kw_only=True)
class SwitchedCapacitors:
    """Parasitic-insensitive switched-capacitor branches: forward Euler, one step a period.

    Attributes
    ----------
    step : float
        Network time of a period.
    clock : float
        Hz.
    unit_capacitor : float
        Feedback capacitor of every neuron in farads.
    on_resistance : float
        Of a switch, in ohms.
    overlap : float
        Capacitance from clock to signal at every switch terminal, in farads: charge injection.
    differential, clocked, resettable, without, metrics
        As of `OpAmps`: time constants only.

    Raises
    ------
    NetworkError
        If a number is not positive, or the overlap negative.
    """

    step: float
    clock: float = 1e6
    unit_capacitor: float = 1e-12
    on_resistance: float = 1e3
    overlap: float = 0.0

    differential: ClassVar[bool] = True
    clocked: ClassVar[bool] = True
    resettable: ClassVar[bool] = False
    without: ClassVar[tuple[Kind, ...]] = ()
    metrics: ClassVar[tuple[contract.Kind, ...]] = (contract.Kind.TIME_CONSTANTS,)

    def __post_init__(self) -> None:
        require_positive(
            step=self.step,
            clock=self.clock,
            unit_capacitor=self.unit_capacitor,
            on_resistance=self.on_resistance,
        )
        if not 0 <= self.overlap < np.inf:
            raise NetworkError(f"overlap: expected a capacitance in farads, got {self.overlap!r}")


Technology: TypeAlias = OpAmps | DifferentialPairs | OtaC | SwitchedCapacitors
"""What a level is built of."""

OP_AMPS = OpAmps()
DIFFERENTIAL_PAIRS = DifferentialPairs()

COMMON = 0.9
"""Two weights share a pair when the smaller one is at least that share of the larger."""

Node = TypeVar("Node")


def paired(
    weights: list[tuple[str, Node, float]],
) -> Iterator[tuple[str, tuple[Node, ...], float]]:
    """Name, source or two of them, and weight of every transconductor.

    What two weights of opposite sign have in common goes to one pair, positive source first; the
    rest of the larger one is a transconductor of its own.

    Parameters
    ----------
    weights : list of (name, source, float)
        Name of every wire, what it comes from, and its weight.

    Yields
    ------
    name : str
    sources : tuple of one source or two
    weight : float
        Of one source with its sign, of two without.

    Examples
    --------
    >>> list(paired([("w0", "x", 2.0), ("w1", "y", -2.0), ("w2", "z", 0.5)]))
    [('w1', ('x', 'y'), 2.0), ('w2', ('z',), 0.5)]
    """
    waiting: list[tuple[str, Node, float]] = []
    for name, node, gm in sorted(weights, key=lambda weight: -abs(weight[2])):
        match = next((w for w in waiting if w[2] * gm < 0 and abs(gm) > COMMON * abs(w[2])), None)
        if match is None:
            waiting.append((name, node, gm))
            continue
        waiting.remove(match)
        rest = match[2] + gm
        if abs(rest) > 1e-9 * abs(gm):
            waiting.append((match[0], match[1], rest))
        yield name, (node, match[1]) if gm > 0 else (match[1], node), abs(gm)
    yield from ((name, (node,), gm) for name, node, gm in waiting)
