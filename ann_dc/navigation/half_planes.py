"""Obstacles as half-planes: what each cell of a planning network is told of the world.

Around a convex obstacle a path is free where it lies beyond a tangent of it; which tangent is a
choice, made once a period about the path planned before. A tangent is linear: with it the optimum
attracts where the curvature of a disc's own row would make it repel. Where the path before crosses
an obstacle, all stages get tangents of one side, and those before it are turned towards that side.

References
----------
.. [1] J. van den Berg, S. J. Guy, M. Lin, D. Manocha, Reciprocal n-body collision avoidance,
   Robotics Research, Springer 2011, 3-19: half-planes, of velocities.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ann_dc.hints.checked import checked
from ann_dc.hints.values import Count, NotNegative
from ann_dc.navigation.obstacles import Obstacle
from ann_dc.problem.robots.planning import NOWHERE

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


def half_planes(
    obstacles: Sequence[tuple[int, Obstacle]],
    path: np.ndarray,
    goal: np.ndarray,
    time: np.ndarray,
    room: np.ndarray,
    margin: Margin,
    slots: int,
    sides: dict[int, float],
) -> np.ndarray:
    """Rows b - a'p <= 0 for every cell, of the obstacles nearest to a path.

    Parameters
    ----------
    obstacles : sequence of (int, Obstacle)
        In sight, with the number under which ``sides`` remembers them.
    path : (N, 2) array
        Planned before: where each cell is about to be.
    goal : (2,) array
    time : (N,) array
        Of the cells.
    room : (N,) array
        The robot's radius and the margin.
    margin : Margin
    slots : int
    sides : dict of int to float
        On which side, 1 left and -1 right, an obstacle is passed; changed in place.

    Returns
    -------
    (N, slots, 3) array
        a_x, a_y and b, empty slots far away.
    """
    rows = np.tile(np.array(NOWHERE), (len(path), slots, 1))
    nearest = sorted(obstacles, key=lambda o: (o[1].near(path, time).distance - room).min())
    for slot, (number, obstacle) in enumerate(nearest[:slots]):
        centre = obstacle.centres(time)
        normal = _normals(obstacle, number, path - centre, path, goal, time, room, margin, sides)
        reach = np.hypot(obstacle.reach(normal) + room, margin.between)
        rows[:, slot, :2] = normal
        rows[:, slot, 2] = (normal * centre).sum(axis=1) + reach
    return rows


def _normals(obstacle, number, offset, path, goal, time, room, margin, sides) -> np.ndarray:
    """(N, 2): away from an obstacle; towards one side, where the path crosses it."""
    near = obstacle.near(path, time)
    closest, k = _closest(offset)
    towards = closest / max(np.linalg.norm(closest), 1e-12)
    reach = np.hypot(obstacle.reach(towards[None])[0] + room, margin.between)
    if np.linalg.norm(closest) >= CROSSED * reach[k]:
        sides.pop(number, None)
        return near.normal
    ahead = offset[min(k + 3, len(offset) - 1)] - offset[max(k - 2, 0)]
    if np.linalg.norm(ahead) < NO_WAY:
        ahead = goal - path[0]
    ahead = ahead / max(np.linalg.norm(ahead), 1e-12)
    left = np.array([-ahead[1], ahead[0]])
    side = sides.setdefault(number, 1.0 if left @ closest >= 0 else -1.0)
    reach = np.hypot(obstacle.reach(side * left[None])[0] + room, margin.between)
    along, length = offset @ ahead, np.linalg.norm(offset, axis=1)
    sine = np.clip(along / reach, -STEEPEST, STEEPEST)
    abreast = sine[:, None] * ahead + side * np.sqrt(1 - sine**2)[:, None] * left
    angle = TURNED * np.arccos(np.clip(reach / np.maximum(length, 1e-12), 0.0, 1.0))
    before = _turned(near.normal, side * left, angle)
    beside = (np.abs(along) < reach) & (length < CLOSE * reach)
    normals = np.where(((along < 0) & ~beside)[:, None], before, near.normal)
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
