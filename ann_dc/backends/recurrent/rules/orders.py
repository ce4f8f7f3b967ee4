"""Update orders of a step: simultaneous, duals after primals, stage by stage.

The orders correspond to Jacobi, primal-then-dual and Gauss-Seidel updates. Each order is a map x ->
x + h m(x, h). The orders differ in m alone, so that step rules and acceleration work with all of
them. They are implemented on tensors in `layers.moves`, and in generated code in
`backends.lanes.orders`.
"""

from __future__ import annotations

from dataclasses import dataclass

from ann_dc.errors import NetworkError, UnknownNameError, such_as
from ann_dc.network.network import Network

NAMES = "simultaneous", "two-phase", "stage by stage"


@such_as("ann_dc.TWO_PHASE")
@dataclass(frozen=True)
class Order:
    """Update order: the move m(x, h) that leads from a state x to x + h m.

    Attributes
    ----------
    name : str
        Name of the order on the command line.

    Raises
    ------
    UnknownNameError
        If the name is not one of the three orders.

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
"""Simultaneous order: all neurons move at once, (16), (17) and forward Euler."""

TWO_PHASE = Order("two-phase")
"""Two-phase order: primal neurons first, then dual neurons on the new residual.

Equal to the simultaneous recurrence with rho + h/tau_dual, on duals that are one step late.
"""

STAGE_BY_STAGE = Order("stage by stage")
"""Stage-by-stage order (Gauss-Seidel): one cell serves the stages in turn, reads the values written
before, and moves with its drive. The preconditioner is applied at the end to the drives of the
sweep.
"""

ORDERS = {
    order.name.replace(" ", "-"): order for order in (SIMULTANEOUS, TWO_PHASE, STAGE_BY_STAGE)
}
"""Orders by the words of the command line and of study files."""


def check_order(order: Order, network: Network) -> None:
    """Raise `NetworkError` for stage-by-stage order with a neuron common to cells."""
    if order == STAGE_BY_STAGE and len(network.shared):
        name = network.cell.neurons[network.shared[0]].name
        raise NetworkError(
            f"order: {name} is shared by all cells and moves with what all of them send, which "
            "stage by stage is not there; take SIMULTANEOUS or TWO_PHASE"
        )
