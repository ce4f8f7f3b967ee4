"""Linearised obstacle constraints: half-planes for cells of a planning network.

A path around a convex obstacle is collision-free beyond a tangent of the obstacle. The tangent is
chosen once per period, about the previous planned path. A tangent is linear: the optimum then
attracts in cases in which the curvature of a disc constraint would make it repel. If the previous
path crosses an obstacle, all stages have tangents on one side, and the normals of earlier stages
are turned towards that side. Cells with disc constraints receive the discs instead (`discs`). The
half-planes resemble those of J. van den Berg, S. J. Guy, M. Lin, D. Manocha, Reciprocal n-body
collision avoidance, Robotics Research, Springer 2011, 3-19, which apply to velocities.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ann_dc.navigation.obstacles import Obstacle
from ann_dc.problem.robot_planning import LINEAR, NONLINEAR
from ann_dc.validation import Count, NotNegative, checked

CROSSED = 0.9
"""Fraction of an obstacle's reach below which a passing path counts as crossing."""
TURNED = 0.9
"""Fraction of the angle to the tangent by which earlier normals are turned."""
STEEPEST = 0.95
"""Sine of the largest angle between the normals of a crossing and its side."""
CLOSE = 1.3
"""Distance, in reaches, below which a point next to an obstacle has a normal of the crossing."""
NO_WAY = 1e-3
"""Length of a path below which the direction to the goal replaces that of the path."""


@checked
@dataclass(frozen=True, kw_only=True)
class Margin:
    """Clearance of a plan between the robot's rim and obstacles, in length units.

    ``near`` applies now and ``far`` from ``stages`` later on, because distant predictions are less
    certain. ``between`` is half the distance between two nodes of a plan, so that the plan does not
    cut corners.
    """

    near: NotNegative = 0.08
    far: NotNegative = 0.16
    stages: Count = 6
    between: NotNegative = 0.1

    def at(self, stages: int) -> np.ndarray:
        """Return the margin of every stage (N,)."""
        return self.near + (self.far - self.near) * np.minimum(1, np.arange(stages) / self.stages)


class Ahead(NamedTuple):
    """Expected places of the cells of a plan and their required clearance.

    ``path`` (N, 2) is the previous plan at the times ``time`` (N,) in seconds, ``room`` (N,) the
    radius of the robot plus the margin, and ``between`` that of `Margin`.
    """

    path: np.ndarray
    goal: np.ndarray
    time: np.ndarray
    room: np.ndarray
    between: float

    def reach(self, extent: np.ndarray | float) -> np.ndarray:
        """Return the required distances (N,) from the centre of an obstacle of a given extent."""
        return np.hypot(extent + self.room, self.between)


def half_planes(
    obstacles: Sequence[tuple[int, Obstacle]], ahead: Ahead, slots: int, sides: dict[int, float]
) -> np.ndarray:
    """Return constraint rows b - a'p <= 0 for every cell and its nearest obstacles.

    Obstacles, with their keys in ``sides``, are those nearest to the path. The result (N, slots, 3)
    contains a_x, a_y and b; empty slots are far away. ``sides`` maps keys to the passing side, 1
    for left and -1 for right, and is changed in place.
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
    """Return disc constraints for every cell and its nearest obstacles.

    Obstacles are those nearest to the path; a polygon is replaced by the enclosing disc. The result
    (N, slots, 3) contains the centre o_x, o_y and the reach R; empty slots are far away. ``sides``
    is not used: a plan passes a disc on the same side as before.
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
    """Passing side of an obstacle that the path crosses."""

    sign: float
    along: np.ndarray
    left: np.ndarray


def _side(obstacle: Obstacle, offset: np.ndarray, ahead: Ahead, before: float | None):
    """Return the passing side of a path (N, 2) relative to the centre; None if clear."""
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
    """Return normals (N, 2) that lead past an obstacle on one side."""
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
    """Return the point (2,) of a path (N, 2) nearest to the origin, and its segment."""
    way = np.diff(offset, axis=0)
    square = np.maximum((way**2).sum(axis=1), 1e-12)
    share = np.clip(-(offset[:-1] * way).sum(axis=1) / square, 0.0, 1.0)
    points = offset[:-1] + share[:, None] * way
    k = int(np.linalg.norm(points, axis=1).argmin())
    return points[k], k


def _turned(normal: np.ndarray, towards: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Turn unit vectors (N, 2) towards another vector by an angle, at most onto it."""
    apart = np.arccos(np.clip(normal @ towards, -1.0, 1.0))
    sense = np.sign(normal[:, 0] * towards[1] - normal[:, 1] * towards[0])
    turn = sense * np.minimum(angle, apart)
    cos, sin = np.cos(turn), np.sin(turn)
    return np.stack(
        [cos * normal[:, 0] - sin * normal[:, 1], sin * normal[:, 0] + cos * normal[:, 1]], axis=1
    )
