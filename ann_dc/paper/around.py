"""Figures 4 and 5 with obstacles: IV.C as printed, with segments, and discs.

IV.C follows a plan until an obstacle is detected. The next plan begins at q_obs + delta. The path
from the robot to this point belongs to no plan. As printed it is omitted. In the second variant a
separate network plans this segment (leg). The third variant is one network with the obstacles as
constraints, whose result is certified.

The paper gives no radius. Points between nodes also satisfy the disc constraints, so whole segments
are clear.
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
"""Detection distance of an obstacle in m, smaller than the node spacing of T_0."""
RADIUS = 0.25
"""Radius of the obstacles, in m."""
SEGMENT = 3
"""Stages of the segment to q_obs + delta."""
CHECKED = 0.0, 1 / 3, 2 / 3
"""Constrained points between two nodes, as fractions of the distance."""
APART = 0.36
"""Distance of these points from the centres, in m; the segments between them are then also clear.
"""


class Piece(NamedTuple):
    """Driven part of a plan: states (n, K + 1), at least the initial one, and controls (m, K)."""

    q: np.ndarray
    u: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Around:
    """Three variants of the path around the obstacles of a case.

    `printed` is IV.C as printed, without plans between the pieces. `drive` is IV.C with the
    segments that `segments` plan, a path that can be driven. `discs` is the run of one network with
    the obstacles as constraints.
    """

    plans: Plans
    printed: list[Piece]
    drive: Piece
    segments: list[Solution]
    discs: Solution

    @property
    def ways(self) -> dict[str, Piece]:
        """Paths that can be driven, by name."""
        return {"with segments": self.drive, "discs": whole(self.discs)}

    @property
    def leap(self) -> float:
        """Length omitted by the printed path, in m."""
        ends = pairwise(piece.q[:2] for piece in self.printed)
        return float(sum(np.linalg.norm(b[:, 0] - a[:, -1]) for a, b in ends))

    def room(self, way: Piece) -> float:
        """Return the smallest distance of whole segments from an obstacle's edge, in m."""
        centres = obstacles(self.plans)
        a, b = way.q[:2, :-1].T[:, None], way.q[:2, 1:].T[:, None]
        step = b - a
        length = np.maximum((step**2).sum(axis=-1), np.finfo(float).tiny)
        share = np.clip(((centres - a) * step).sum(axis=-1) / length, 0.0, 1.0)
        apart = np.linalg.norm(a + share[..., None] * step - centres, axis=-1)
        return float(apart.min()) - RADIUS

    def error(self, way: Piece) -> float:
        """Return the largest distance of a path from a simulation of its controls, by state."""
        led = self.discs.problem.functions.rollout(way.q[:, 0], way.u)
        return float(np.abs(led - way.q).max())


def around(plans: Plans, problem: OptimalControlProblem, progress: Progress = silent) -> Around:
    """Plan a case in the three variants; the first two states are x and y."""
    printed = driven(plans)
    short, segments = problem.with_horizon(SEGMENT), []
    for before, after in pairwise(printed):
        progress(f"{plans.case.name}: segment {len(segments) + 1}")
        ends = (before.q[:, -1], after.q[:, 0])
        q_0, q_d = (tuple(end.tolist()) for end in ends)
        segments.append(solve(short.with_inputs(q_0=q_0, q_d=q_d)))
    progress(f"{plans.case.name}: discs as constraints")
    return Around(
        plans=plans,
        printed=printed,
        drive=_joined(printed, [whole(segment) for segment in segments]),
        segments=segments,
        discs=solve(with_discs(problem, obstacles(plans))),
    )


def with_discs(problem: OptimalControlProblem, centres: np.ndarray) -> OptimalControlProblem:
    """Return the problem with disc constraints at centres (M, 2), at nodes and between them."""
    rows = {}
    for number, centre in enumerate(centres.tolist()):
        for part, share in enumerate(CHECKED):
            points = (s + share * (f - s) for s, f in zip(problem.states[:2], problem.f[:2]))
            apart = sum((point - c) ** 2 for point, c in zip(points, centre))
            rows[f"disc_{number + 1}_{part}"] = apart >= APART**2
    return replace(problem, name=f"{problem.name} among discs", constraints=rows)


def whole(solution: Solution) -> Piece:
    """Return the states including the final state, and the controls, of a solution."""
    states, controls = solution.problem.states, solution.problem.controls
    return Piece(*(np.stack([solution[str(s)] for s in of]) for of in (states, controls)))


def _joined(pieces: list[Piece], segments: list[Piece]) -> Piece:
    """Return one path of the pieces with the segments between them."""
    parts = [part for pair in zip(pieces, segments) for part in pair] + [pieces[-1]]
    q = np.hstack([part.q[:, :-1] for part in parts] + [parts[-1].q[:, -1:]])
    return Piece(q, np.hstack([part.u for part in parts]))


def obstacles(plans: Plans) -> np.ndarray:
    """Return the centres (M, 2) of a case's obstacles, which are nodes of T_0."""
    return plans.states[0][:2, list(plans.case.stages)].T


def driven(plans: Plans) -> list[Piece]:
    """Return the driven piece of each plan, up to the last node before a detection.

    The first two states are x and y. A plan without a new obstacle is driven to its end, and later
    plans are not started.
    """
    pieces = []
    for q, u, centre in zip(plans.states, plans.controls, [*obstacles(plans), None]):
        near = np.linalg.norm(q[:2] - centre[:, None], axis=0) < SIGHT if centre is not None else []
        end = max(int(np.argmax(near)) - 1, 0) if np.any(near) else u.shape[1]
        pieces.append(Piece(q[:, : end + 1], u[:, :end]))
        if not np.any(near):
            break
    return pieces
