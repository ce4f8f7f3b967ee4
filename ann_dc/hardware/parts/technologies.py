"""Technologies of a cell: op amps, differential pairs, OTA-C, switched capacitors.

A technology is a record that two modules interpret: the emulation as equations of a network, the
netlist as cards. Every technology realises the same circuit: a transconductor is 1/R, a switched
capacitor h T C_f / (R C) per period.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, TypeAlias, TypeVar

import numpy as np

from ann_dc.errors import NetworkError, require_positive
from ann_dc.hardware.parts.datasheet import Kind
from ann_dc.network.preconditioners import base as contract
from ann_dc.validation import checked

FEED_FORWARD = tuple(
    kind
    for kind in contract.PreconditionerKind
    if kind is not contract.PreconditionerKind.RESISTIVE_GRID
)
"""Preconditioners that are sums without a loop."""

DIAGONAL = (contract.PreconditionerKind.DIAGONAL,)


class _Technology:
    """Properties of a technology, those of op amps by default.

    Attributes
    ----------
    differential : bool
        True if every signal exists with both signs.
    clocked : bool
        True if the circuit operates in clock periods.
    has_resistors : bool
        True if cells are op amps with resistors, and capacitors and reset switches of a board.
    op_amp_outputs : int
        Outputs of an op amp, over which its offset is divided.
    without : tuple of Kind
        Part errors that the cells do not have.
    preconditioners : tuple of PreconditionerKind
        Preconditioner kinds that the cells can realise.
    """

    differential: ClassVar[bool] = False
    clocked: ClassVar[bool] = False
    has_resistors: ClassVar[bool] = True
    op_amp_outputs: ClassVar[int] = 1
    without: ClassVar[tuple[Kind, ...]] = ()
    preconditioners: ClassVar[tuple[contract.PreconditionerKind, ...]] = tuple(
        contract.PreconditionerKind
    )


@dataclass(frozen=True, kw_only=True)
class OpAmps(_Technology):
    """Op amps with resistors at a virtual ground, and inverters for the opposite sign."""


@dataclass(frozen=True, kw_only=True)
class DifferentialPairs(_Technology):
    """Fully differential op amps: two summing nodes and outputs, no inverters.

    Every R and C exists twice. Resistive grids are not supported.
    """

    differential: ClassVar[bool] = True
    op_amp_outputs: ClassVar[int] = 2
    preconditioners: ClassVar[tuple[contract.PreconditionerKind, ...]] = FEED_FORWARD


@checked
@dataclass(frozen=True, kw_only=True)
class OtaC(_Technology):
    """Transconductors into one node per neuron; opposite equal weights use one pair.

    Transconductors have no offset, and no adders that could realise a preconditioner.

    Attributes
    ----------
    linear_range : float
        Voltage scale of the tanh relative to full scale.
    """

    linear_range: float = 30.0

    differential: ClassVar[bool] = True
    has_resistors: ClassVar[bool] = False
    without: ClassVar[tuple[Kind, ...]] = (Kind.OFFSET,)
    preconditioners: ClassVar[tuple[contract.PreconditionerKind, ...]] = DIAGONAL


@checked
@dataclass(frozen=True, kw_only=True)
class SwitchedCapacitors(_Technology):
    """Parasitic-insensitive switched capacitors: forward Euler, one step per period.

    Only diagonal preconditioners are supported. Raises `NetworkError` if a number is not positive
    or the overlap is negative.

    Attributes
    ----------
    step : float
        Network time of a period.
    clock : float
        Clock frequency in Hz.
    unit_capacitor : float
        Feedback capacitor of every neuron in farads.
    on_resistance : float
        Resistance of a closed switch in ohms.
    overlap : float
        Capacitance from clock to signal at every switch terminal in farads, the cause of charge
        injection.
    """

    step: float
    clock: float = 1e6
    unit_capacitor: float = 1e-12
    on_resistance: float = 1e3
    overlap: float = 0.0

    differential: ClassVar[bool] = True
    clocked: ClassVar[bool] = True
    has_resistors: ClassVar[bool] = False
    preconditioners: ClassVar[tuple[contract.PreconditionerKind, ...]] = DIAGONAL

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
"""Technology of a model level."""

OP_AMPS = OpAmps()
DIFFERENTIAL_PAIRS = DifferentialPairs()

COMMON = 0.9
"""Smallest ratio of two weights that use a common pair."""

Node = TypeVar("Node")


def paired(
    weights: list[tuple[str, Node, float]],
) -> Iterator[tuple[str, tuple[Node, ...], float]]:
    """Yield name, one or two sources, and weight of every transconductor.

    The common part of two weights of opposite sign goes to one pair, positive source first. The
    remainder of the larger weight is a separate transconductor. The weight of one source is signed;
    that of two sources is not. ``weights`` lists name, source and weight of every wire.
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
