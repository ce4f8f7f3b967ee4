"""What a design asks of a problem at a state of its network: is there an optimum, at what cost?"""

from __future__ import annotations

import numpy as np

from ann_dc.evaluation.populations import kkt_point
from ann_dc.gain_design.choice import Cost
from ann_dc.gain_design.scheduled_run import Doubt
from ann_dc.network.network import Network
from ann_dc.optimality.certificate import certify
from ann_dc.optimality.prospects.prospect import Prospect
from ann_dc.problem.declaration import OptimalControlProblem


def path_of(network: Network, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States (n, N+1) with the end, and controls (m, N), of a state vector of a problem's network.

    Parameters
    ----------
    network : Network
    x : (n,) array
    """
    q, u, t, *_ = kkt_point(network, x)
    return np.column_stack([q, t[:, -1]]), u


def doubt_of(prospect: Prospect, network: Network) -> Doubt:
    """What is asked where the first run of a problem's network stalls.

    Parameters
    ----------
    prospect : Prospect
        Of the problem.
    network : Network
        Synthesized from it.
    """
    return lambda x: prospect.doubt(*path_of(network, x))


def cost_of(problem: OptimalControlProblem, network: Network) -> Cost:
    """What a settled point costs, the largest of several objectives where there are some.

    Parameters
    ----------
    problem : OptimalControlProblem
    network : Network
        Synthesized from it.
    """
    return lambda x: certify(problem, *kkt_point(network, x)).objective
