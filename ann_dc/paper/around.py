"""Figures 4 and 5 among obstacles: the pieces of the plans T_0, T_1, ... that IV.C drives.

The robot follows a plan until an obstacle comes into sight, and then the next one, which begins at
q_obs + delta. The way from where it is to there is in no plan: as printed, it is left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.paper.replans import Plans

SIGHT = 0.6
"""How near an obstacle is when it appears, in m: less than from node to node of T_0."""


class Piece(NamedTuple):
    """What is driven of a plan.

    Attributes
    ----------
    q : (n, K + 1) array
        States, at least the one that it begins with.
    u : (m, K) array
        Controls.
    """

    q: np.ndarray
    u: np.ndarray


def obstacles(plans: Plans) -> np.ndarray:
    """Centres (M, 2) of a case's obstacles: nodes of T_0."""
    return plans.states[0][:2, list(plans.case.stages)].T


def driven(plans: Plans) -> list[Piece]:
    """What is driven of every plan: up to the last node at which no new obstacle is in sight.

    Parameters
    ----------
    plans : Plans
        With x and y as its first two states.
    """
    ends = [_last_out_of_sight(q, centre) for q, centre in zip(plans.states[:-1], obstacles(plans))]
    return [
        Piece(q[:, : end + 1], u[:, :end])
        for q, u, end in zip(plans.states, plans.controls, [*ends, plans.controls.shape[2]])
    ]


def _last_out_of_sight(q: np.ndarray, centre: np.ndarray) -> int:
    """The last node of a plan (n, N + 1) before it comes near to an obstacle; else the first."""
    near = np.linalg.norm(q[:2] - centre[:, None], axis=0) < SIGHT
    return max(int(near.argmax()) - 1, 0)
