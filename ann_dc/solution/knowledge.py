"""Knowledge of a problem for its design: existence, place and cost of an optimum."""

from __future__ import annotations

import numpy as np

from ann_dc.evaluation.populations import kkt_point
from ann_dc.gain_design.knowledge import Knowledge
from ann_dc.network.network import Network
from ann_dc.optimality.certificate import certify
from ann_dc.optimality.existence import Prospect
from ann_dc.solution.finding import Search, path_of


def knowledge_of(prospect: Prospect, network: Network) -> Knowledge:
    """Return the knowledge of a prospect's problem, from which the network was synthesized."""
    problem = prospect.problem
    search = Search(problem, network)

    def doubt(x: np.ndarray) -> None:
        if not search.from_line(prospect.progress):  # an optimum leaves no doubt
            prospect.doubt(*path_of(network, x))

    return Knowledge(
        doubt=doubt,
        cost=lambda x: certify(problem, *kkt_point(network, x)).objective,
        finder=search.find,
        cheaper=search.cheaper,
    )
