"""Figures 4 and 5 among obstacles: IV.C as printed, with legs, and discs in one network.

IV.C follows a plan until an obstacle comes into sight, and then the next one, which begins at
q_obs + delta. The way from where the robot is to there is in no plan. As printed it is left out;
here it is planned, too, by a network of its own. The third way is one network whose constraints are
the obstacles: what it finds is certified.

The paper gives no radius. A disc is kept from points of the way between nodes, too, so that whole
segments are clear.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ann_dc.paper.replans import Plans
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.progress import Progress, silent
from ann_dc.solution.solution import Solution
from ann_dc.solver import solve

SIGHT = 0.6
"""How near an obstacle is when it appears, in m: less than from node to node of T_0."""
RADIUS = 0.25
"""Radius of the obstacles, in m."""
LEG = 3
"""Stages of the way to q_obs + delta."""
CHECKED = 0.0, 1 / 3, 2 / 3
"""Points between one node and the next that are kept off the obstacles, as shares of the way."""
APART = 0.36
"""Distance of these points from the centres, in m; segments between them are clear, too."""


class Piece(NamedTuple):
    """Driven part of a plan.

    Attributes
    ----------
    q : (n, K + 1) array
        States, at least the one that it begins with.
    u : (m, K) array
        Controls.
    """

    q: np.ndarray
    u: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Around:
    """Three ways around the obstacles of a case.

    Attributes
    ----------
    plans : Plans
    printed : list of Piece
        IV.C to the letter; between the pieces nothing is planned.
    drive : Piece
        The same with its legs: a way that can be driven.
    legs : list of Solution
        Runs of the networks that plan the legs.
    discs : Solution
        The obstacles as constraints of one network.
    """

    plans: Plans
    printed: list[Piece]
    drive: Piece
    legs: list[Solution]
    discs: Solution

    @property
    def ways(self) -> dict[str, Piece]:
        """Ways that can be driven, by name."""
        return {"with legs": self.drive, "discs": whole(self.discs)}

    @property
    def leap(self) -> float:
        """Length of what the printed way leaves out, in m."""
        ends = pairwise(piece.q[:2] for piece in self.printed)
        return float(sum(np.linalg.norm(b[:, 0] - a[:, -1]) for a, b in ends))

    def room(self, way: Piece) -> float:
        """Smallest distance of the segments of a way from an obstacle's edge, in m."""
        centres = obstacles(self.plans)
        a, b = way.q[:2, :-1].T[:, None], way.q[:2, 1:].T[:, None]
        step = b - a
        length = np.maximum((step**2).sum(axis=-1), np.finfo(float).tiny)
        share = np.clip(((centres - a) * step).sum(axis=-1) / length, 0.0, 1.0)
        apart = np.linalg.norm(a + share[..., None] * step - centres, axis=-1)
        return float(apart.min()) - RADIUS

    def error(self, way: Piece) -> float:
        """Largest distance of a way from where its own controls lead, in the units of states."""
        led = self.discs.problem.functions.rollout(way.q[:, 0], way.u)
        return float(np.abs(led - way.q).max())


def around(plans: Plans, problem: OptimalControlProblem, progress: Progress = silent) -> Around:
    """Plan a case in the three ways.

    Parameters
    ----------
    plans : Plans
        With x and y as its first two states.
    problem : OptimalControlProblem
        Whose plans they are.
    progress : Progress
    """
    printed = driven(plans)
    short, legs = problem.with_horizon(LEG), []
    for before, after in pairwise(printed):
        progress(f"{plans.case.name}: leg {len(legs) + 1}")
        ends = (before.q[:, -1], after.q[:, 0])
        q_0, q_d = (tuple(end.tolist()) for end in ends)
        legs.append(solve(short.with_inputs(q_0=q_0, q_d=q_d)))
    progress(f"{plans.case.name}: discs as constraints")
    return Around(
        plans=plans,
        printed=printed,
        drive=_joined(printed, [whole(leg) for leg in legs]),
        legs=legs,
        discs=solve(with_discs(problem, obstacles(plans))),
    )


def with_discs(problem: OptimalControlProblem, centres: np.ndarray) -> OptimalControlProblem:
    """The problem with obstacles (M, 2), kept off every node and off points between nodes.

    Parameters
    ----------
    problem : OptimalControlProblem
        With x and y as its first two states.
    centres : (M, 2) array
    """
    rows = {}
    for number, centre in enumerate(centres.tolist()):
        for part, share in enumerate(CHECKED):
            points = (s + share * (f - s) for s, f in zip(problem.states[:2], problem.f[:2]))
            apart = sum((point - c) ** 2 for point, c in zip(points, centre))
            rows[f"disc_{number + 1}_{part}"] = apart >= APART**2
    return replace(problem, name=f"{problem.name} among discs", constraints=rows)


def whole(solution: Solution) -> Piece:
    """States with the end, and controls, of a solution."""
    states, controls = solution.problem.states, solution.problem.controls
    return Piece(*(np.stack([solution[str(s)] for s in of]) for of in (states, controls)))


def _joined(pieces: list[Piece], legs: list[Piece]) -> Piece:
    """One way: pieces, and a leg between each of them and the next."""
    parts = [part for pair in zip(pieces, legs) for part in pair] + [pieces[-1]]
    q = np.hstack([part.q[:, :-1] for part in parts] + [parts[-1].q[:, -1:]])
    return Piece(q, np.hstack([part.u for part in parts]))


def obstacles(plans: Plans) -> np.ndarray:
    """Centres (M, 2) of a case's obstacles: nodes of T_0."""
    return plans.states[0][:2, list(plans.case.stages)].T


def driven(plans: Plans) -> list[Piece]:
    """Return the driven piece of every plan, up to the last node without a new obstacle in sight.

    A plan that meets no new obstacle is driven to its end; those after it are not begun.

    Parameters
    ----------
    plans : Plans
        With x and y as its first two states.
    """
    pieces = []
    for q, u, centre in zip(plans.states, plans.controls, [*obstacles(plans), None]):
        near = np.linalg.norm(q[:2] - centre[:, None], axis=0) < SIGHT if centre is not None else []
        end = max(int(np.argmax(near)) - 1, 0) if np.any(near) else u.shape[1]
        pieces.append(Piece(q[:, : end + 1], u[:, :end]))
        if not np.any(near):
            break
    return pieces
