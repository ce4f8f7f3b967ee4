"""Which neurons belong to which level: q, u and mu to the stages, t and beta to the coordinator."""

from __future__ import annotations

from dataclasses import astuple
from typing import NamedTuple

import numpy as np

from ann_dc.backends.recurrent.layers import torch
from ann_dc.errors import NetworkError, ProblemError
from ann_dc.network.network import COORDINATION, Network
from ann_dc.problem.declaration import OptimalControlProblem

STAGE = ("q", "u", "mu")
"""Populations of the lower level."""


class Rows(NamedTuple):
    """Rows of a state (P, N, B), each (rows,)."""

    lower: torch.Tensor
    """Of q, u and mu."""
    v: torch.Tensor
    """Of q and u: v_k of the paper."""
    mu: torch.Tensor
    """Of mu."""
    t: torch.Tensor
    """Of t."""
    beta: torch.Tensor
    """Of beta."""
    chain: torch.Tensor
    """Of q and t, whose moves a Newton step bounds."""

    def to(self, device: torch.device) -> Rows:
        """The same rows on another device."""
        return Rows(*(rows.to(device) for rows in self))


def check_problem(problem: OptimalControlProblem) -> None:
    """A ProblemError where a problem has inequalities, bounds or objectives.

    No level has their neurons.
    """
    names = map(str, (*problem.constraints, *problem.terminal_constraints, *problem.bounds))
    if problem.objectives:
        raise ProblemError(
            f"two levels: {problem.name} has the objectives {', '.join(problem.objective_names)}, "
            "of which the algorithm knows nothing; ann_dc.solve(problem) does"
        )
    if told := ", ".join(names):
        raise ProblemError(
            f"two levels: {problem.name} has inequalities or bounds ({told}), of which the "
            "algorithm knows nothing; ann_dc.solve(problem) does"
        )


def rows_of(network: Network) -> Rows:
    """Rows of the two levels of a network.

    Raises
    ------
    NetworkError
        If one of the populations is missing: this is no network of a problem. Or if there are
        others, or rails: it is one of a problem with inequalities.

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
    others = [n.name for n in network.cell.neurons if n.population not in (*STAGE, *COORDINATION)]
    others += [n.name for n in network.cell.neurons if np.isfinite(astuple(n.limiter)).any()]
    if others:
        raise NetworkError(
            f"two levels: {network.title} has {', '.join(others)} for inequalities or rails, of "
            "which the algorithm knows nothing; settle the network as a whole, as solve does"
        )

    def rows(*populations: str) -> torch.Tensor:
        return torch.tensor([row for row, name in enumerate(of) if name in populations])

    return Rows(
        lower=rows(*STAGE),
        v=rows("q", "u"),
        mu=rows("mu"),
        t=rows("t"),
        beta=rows("beta"),
        chain=rows("q", "t"),
    )
