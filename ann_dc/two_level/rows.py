"""Which neurons belong to which level: q, u and mu to the stages, t and beta to the coordinator."""

from __future__ import annotations

from dataclasses import astuple
from typing import NamedTuple

import numpy as np

from ann_dc.errors import NetworkError, ProblemError
from ann_dc.network.network import COORDINATION, Network
from ann_dc.problem.declaration import OptimalControlProblem

STAGE = ("q", "u", "mu")
"""Populations of the lower level."""


class Rows(NamedTuple):
    """Places of a state vector, each (n,) booleans."""

    lower: np.ndarray
    """Of q, u and mu."""
    v: np.ndarray
    """Of q and u: v_k of the paper."""
    mu: np.ndarray
    """Of mu."""
    t: np.ndarray
    """Of t."""
    beta: np.ndarray
    """Of beta."""
    chain: np.ndarray
    """Of q and t, whose moves a Newton step bounds."""


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
    """Places of the two levels of a network in its state vector.

    Raises
    ------
    NetworkError
        If one of the populations is missing: this is no network of a problem. Or if there are
        others, or rails: it is one of a problem with inequalities.

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.synthesize(ann_dc.plants.double_integrator(N=3))
    >>> int(rows_of(network).mu.sum())  # two states, three stages
    6
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

    of_population = network.of_population
    return Rows(
        lower=of_population(*STAGE),
        v=of_population("q", "u"),
        mu=of_population("mu"),
        t=of_population("t"),
        beta=of_population("beta"),
        chain=of_population("q", "t"),
    )
