"""Which neurons belong to which level: q, u and mu to the stages, t and beta to the coordinator."""

from __future__ import annotations

from typing import NamedTuple

from ann_dc.backends.recurrent.layers import torch
from ann_dc.errors import NetworkError
from ann_dc.network.network import COORDINATION, Network

STAGE = ("q", "u", "mu")
"""Populations of the lower level."""


class Rows(NamedTuple):
    """Rows of a state (P, N, B), each (rows,)."""

    lower: torch.Tensor
    """Of q, u and mu."""
    t: torch.Tensor
    """Of t."""
    beta: torch.Tensor
    """Of beta."""
    chain: torch.Tensor
    """Of q and t, whose moves a Newton step bounds."""

    def to(self, device: torch.device) -> Rows:
        """The same rows on another device."""
        return Rows(*(rows.to(device) for rows in self))


def rows_of(network: Network) -> Rows:
    """Rows of the two levels of a network.

    Raises
    ------
    NetworkError
        If one of the populations is missing: this is no network of a problem.

    Examples
    --------
    >>> import ann_dc
    >>> rows_of(ann_dc.synthesize(ann_dc.plants.double_integrator(N=3))).chain.tolist()
    [0, 1, 3, 4]
    """
    of = [neuron.population for neuron in network.cell.neurons]
    missing = [name for name in (*STAGE, *COORDINATION) if name not in of]
    if missing:
        raise NetworkError(
            f"two levels: {network.title} has no {', '.join(missing)}; the algorithm needs the "
            "network of a problem"
        )

    def rows(*populations: str) -> torch.Tensor:
        return torch.tensor([row for row, name in enumerate(of) if name in populations])

    return Rows(lower=rows(*STAGE), t=rows("t"), beta=rows("beta"), chain=rows("q", "t"))
