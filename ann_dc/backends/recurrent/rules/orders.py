r"""In which order the neurons of a step move: all at once, duals after primals, stage by stage.

Each order is a map x -> x + h m(x, h); the orders differ in m alone, so that step rules and
acceleration work with every one of them. On tensors they are in `layers.moves`, in generated code
in `backends.lanes.orders`.
"""

from __future__ import annotations

from dataclasses import dataclass

from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.network.network import Network
from ann_dc.validation.values import such_as

NAMES = "simultaneous", "two-phase", "stage by stage"


@such_as("ann_dc.TWO_PHASE")
@dataclass(frozen=True)
class Order:
    """An update order: which move m(x, h) leads from a state x to x + h m.

    Attributes
    ----------
    name : str
        As the command line has it.

    Raises
    ------
    UnknownNameError
        If it is none of the three that there are.

    Examples
    --------
    >>> import ann_dc
    >>> Order("two-phase") == ann_dc.TWO_PHASE
    True
    """

    name: str

    def __post_init__(self) -> None:
        if self.name not in NAMES:
            raise UnknownNameError.of("order", self.name, NAMES)

    def __repr__(self) -> str:
        return self.name


SIMULTANEOUS = Order("simultaneous")
"""All neurons move at once: (16), (17) and forward Euler."""

TWO_PHASE = Order("two-phase")
"""Primal neurons in phase 1, dual neurons in phase 2 on the new residual. Equal to the simultaneous
recurrence with rho + h/tau_dual, on duals that are one step late."""

STAGE_BY_STAGE = Order("stage by stage")
"""One cell serves the stages in turn and reads what was written before it (Gauss-Seidel) and
moves with its own drive; the metric takes what was said during the sweep and answers at its end."""

ORDERS = {order.name: order for order in (SIMULTANEOUS, TWO_PHASE, STAGE_BY_STAGE)}
"""Every order by its name, for the command line."""


def check_order(order: Order, network: Network) -> None:
    """Refuse to go stage by stage through a row whose cells share a neuron.

    Raises
    ------
    NetworkError
    """
    if order == STAGE_BY_STAGE and len(network.shared):
        name = network.cell.neurons[network.shared[0]].name
        raise NetworkError(
            f"order: {name} is shared by all cells and moves with what all of them send, which "
            "stage by stage is not there; take SIMULTANEOUS or TWO_PHASE"
        )
