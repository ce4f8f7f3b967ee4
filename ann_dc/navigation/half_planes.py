"""Obstacles as half-planes: what each cell of a planning network is told of the world.

Around a convex obstacle a path is free where it lies beyond a tangent of it; which tangent is a
choice, made once a period about the path planned before. A tangent is linear: with it the optimum
attracts where the curvature of a disc's own row would make it repel. Where the path before crosses
an obstacle, all stages get tangents of one side, and those before it are turned towards that side.
Cells that hold discs themselves are told where those are (`discs`).

References
----------
.. [1] J. van den Berg, S. J. Guy, M. Lin, D. Manocha, Reciprocal n-body collision avoidance,
   Robotics Research, Springer 2011, 3-19: half-planes, of velocities.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ann_dc.navigation.obstacles import Obstacle
from ann_dc.problem.robot_planning import LINEAR, NONLINEAR
from ann_dc.validation.checked import checked
from ann_dc.validation.values import Count, NotNegative

CROSSED = 0.9
"""Share of an obstacle's reach below which a path that passes it crosses it."""
TURNED = 0.9
"""Share of the angle up to the tangent by which earlier normals are turned."""
STEEPEST = 0.95
"""Sine of the largest angle between the normals of a crossing and its side."""
CLOSE = 1.3
"""In reaches: how near a point abreast of an obstacle is to have a normal of the crossing."""
NO_WAY = 1e-3
"""Of a path that is shorter than this the way ahead is that to the goal."""


@checked
@dataclass(frozen=True, kw_only=True)
class Margin:
    """Room that a plan leaves between the robot's rim and obstacles, in the world's unit of length.

    Attributes
    ----------
    near, far : float
        Now, and ``stages`` later and beyond: what is far is not so certain.
    stages : int
    between : float
        Half the way between two nodes of a plan, which may not cut a corner.
    """

    near: NotNegative = 0.08
    far: NotNegative = 0.16
    stages: Count = 6
    between: NotNegative = 0.1

    def at(self, stages: int) -> np.ndarray:
        """(N,): of every stage."""
        return self.near + (self.far - self.near) * np.minimum(1, np.arange(stages) / self.stages)


class Ahead(NamedTuple):
    """Where the cells of a plan are about to be, and what they are to keep.

    Attributes
    ----------
    path : (N, 2) array
        Places, of the plan before.
    goal : (2,) array
    time : (N,) array
        In seconds.
    room : (N,) array
        The robot's radius and the margin.
    between : float
        Half the way between two nodes, see `Margin`.
    """

    path: np.ndarray
    goal: np.ndarray
    time: np.ndarray
    room: np.ndarray
    between: float

    def reach(self, extent: np.ndarray | float) -> np.ndarray:
        """(N,): how far from the centre a path stays off what extends so far."""
        return np.hypot(extent + self.room, self.between)


def half_planes(
    obstacles: Sequence[tuple[int, Obstacle]], ahead: Ahead, slots: int, sides: dict[int, float]
) -> np.ndarray:
    """Rows b - a'p <= 0 for every cell, of the obstacles nearest to a path.

    Parameters
    ----------
    obstacles : sequence of (int, Obstacle)
        In sight, with the number under which ``sides`` remembers them.
    ahead : Ahead
    slots : int
    sides : dict of int to float
        On which side, 1 left and -1 right, an obstacle is passed; changed in place.

    Returns
    -------
    (N, slots, 3) array
        a_x, a_y and b, empty slots far away.
    """
    path, time = ahead.path, ahead.time
    rows = np.tile(np.array(LINEAR.nowhere), (len(path), slots, 1))
    for slot, (number, obstacle) in enumerate(_nearest(obstacles, ahead)[:slots]):
        centre = obstacle.centres(time)
        side = _side(obstacle, path - centre, ahead, sides.get(number))
        if side is None:
            sides.pop(number, None)
            normal = obstacle.near(path, time).normal
        else:
            sides[number] = side.sign
            normal = _past(obstacle, path - centre, ahead, side)
        rows[:, slot, :2] = normal
        rows[:, slot, 2] = (normal * centre).sum(axis=1) + ahead.reach(obstacle.reach(normal))
    return rows


def discs(
    obstacles: Sequence[tuple[int, Obstacle]], ahead: Ahead, slots: int, sides: dict[int, float]
) -> np.ndarray:
    """Centre and reach, for every cell, of the obstacles nearest to a path.

    Parameters
    ----------
    obstacles : sequence of (int, Obstacle)
        In sight; a polygon becomes the disc around it.
    ahead : Ahead
    slots : int
    sides : dict of int to float
        Not read: a plan passes a disc where it has passed it before.

    Returns
    -------
    (N, slots, 3) array
        o_x, o_y and R, empty slots far away.
    """
    rows = np.tile(np.array(NONLINEAR.nowhere), (len(ahead.path), slots, 1))
    for slot, (_, obstacle) in enumerate(_nearest(obstacles, ahead)[:slots]):
        corners = np.linalg.norm(obstacle.corners - obstacle.centre, axis=1)
        rows[:, slot, :2] = obstacle.centres(ahead.time)
        rows[:, slot, 2] = ahead.reach(corners.max() + obstacle.radius)
    return rows


def _nearest(obstacles: Sequence[tuple[int, Obstacle]], ahead: Ahead) -> list[tuple[int, Obstacle]]:
    gap = lambda obstacle: obstacle.near(ahead.path, ahead.time).distance - ahead.room  # noqa: E731
    return sorted(obstacles, key=lambda entry: gap(entry[1]).min())


class _Side(NamedTuple):
    """On which side a path that crosses an obstacle is to pass it."""

    sign: float
    along: np.ndarray
    left: np.ndarray


def _side(obstacle: Obstacle, offset: np.ndarray, ahead: Ahead, before: float | None):
    """The side of an obstacle that a path (N, 2) from its centre passes; None if it is clear."""
    closest, k = _closest(offset)
    length = max(float(np.linalg.norm(closest)), 1e-12)
    if length >= CROSSED * ahead.reach(obstacle.reach(closest[None] / length)[0])[k]:
        return None
    way = offset[min(k + 3, len(offset) - 1)] - offset[max(k - 2, 0)]
    if np.linalg.norm(way) < NO_WAY:
        way = ahead.goal - ahead.path[0]
    along = way / max(np.linalg.norm(way), 1e-12)
    left = np.array([-along[1], along[0]])
    return _Side(before or (1.0 if left @ closest >= 0 else -1.0), along, left)


def _past(obstacle: Obstacle, offset: np.ndarray, ahead: Ahead, side: _Side) -> np.ndarray:
    """Normals (N, 2) that lead past an obstacle on one side."""
    aside = side.sign * side.left
    radial = obstacle.near(ahead.path, ahead.time).normal
    forth, length = offset @ side.along, np.maximum(np.linalg.norm(offset, axis=1), 1e-12)
    reach = ahead.reach(obstacle.reach(offset / length[:, None]))
    extent = ahead.reach(obstacle.reach(np.array([side.along, -side.along])).max())
    sine = np.clip(forth / extent, -STEEPEST, STEEPEST)
    abreast = sine[:, None] * side.along + np.sqrt(1 - sine**2)[:, None] * aside
    angle = TURNED * np.arccos(np.clip(reach / length, 0.0, 1.0))
    beside = (np.abs(forth) < extent) & (length < CLOSE * reach)
    before = (forth < 0) & ~beside
    normals = np.where(before[:, None], _turned(radial, aside, angle), radial)
    return np.where(beside[:, None], abreast, normals)


def _closest(offset: np.ndarray) -> tuple[np.ndarray, int]:
    """The point (2,) of a path (N, 2) that is nearest to the origin, and its stretch."""
    way = np.diff(offset, axis=0)
    square = np.maximum((way**2).sum(axis=1), 1e-12)
    share = np.clip(-(offset[:-1] * way).sum(axis=1) / square, 0.0, 1.0)
    points = offset[:-1] + share[:, None] * way
    k = int(np.linalg.norm(points, axis=1).argmin())
    return points[k], k


def _turned(normal: np.ndarray, towards: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Unit vectors (N, 2), turned towards another one by an angle, and no further than to it."""
    apart = np.arccos(np.clip(normal @ towards, -1.0, 1.0))
    sense = np.sign(normal[:, 0] * towards[1] - normal[:, 1] * towards[0])
    turn = sense * np.minimum(angle, apart)
    cos, sin = np.cos(turn), np.sin(turn)
    return np.stack(
        [cos * normal[:, 0] - sin * normal[:, 1], sin * normal[:, 0] + cos * normal[:, 1]], axis=1
    )
