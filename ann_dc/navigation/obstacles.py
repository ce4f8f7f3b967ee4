"""Obstacles: static or moving discs and convex polygons with known velocity.

An obstacle is the convex hull of its corners, widened by a radius; a disc has one corner. A planner
uses only the reach in a direction and the distance to a point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ann_dc.errors import ScenarioError

Pair: TypeAlias = Sequence[float] | np.ndarray
"""Coordinates (x, y)."""


class Nearness(NamedTuple):
    """Distances (K,) and unit directions (K, 2) from obstacles to points.

    A distance is that to the boundary, in the world's length unit, and negative inside. The normals
    point away from the obstacle at the nearest boundary point.
    """

    distance: np.ndarray
    normal: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Obstacle:
    """Convex obstacle; see `disc` and `polygon`.

    Attributes
    ----------
    corners : (c, 2) array
        Corners at time zero, counter-clockwise; one corner for a disc.
    radius : float
        Distance by which the hull of the corners is widened.
    velocity : (2,) array
        Velocity in length units per second.
    appears : float
        Time in seconds from which the obstacle can be sensed.
    """

    corners: np.ndarray
    radius: float
    velocity: np.ndarray
    appears: float = 0.0

    @property
    def centre(self) -> np.ndarray:
        """Centre (2,) of the corners at time zero."""
        return self.corners.mean(axis=0)

    @property
    def moves(self) -> bool:
        """True if the obstacle has a velocity."""
        return bool(self.velocity.any())

    def centres(self, time: np.ndarray) -> np.ndarray:
        """Return the centres (K, 2) at times (K,)."""
        return self.centre + np.outer(time, self.velocity)

    def reach(self, direction: np.ndarray) -> np.ndarray:
        """Return the reaches (K,) from the centre in unit directions (K, 2)."""
        return ((self.corners - self.centre) @ direction.T).max(axis=0) + self.radius

    def near(self, points: np.ndarray, time: np.ndarray) -> Nearness:
        """Return distances and normals to points (K, 2) at times (K,)."""
        away = points - np.outer(time, self.velocity)
        if len(self.corners) == 1:
            offset = away - self.corners[0]
            return _from(offset, np.linalg.norm(offset, axis=1) - self.radius)
        return self._near_polygon(away)

    def _near_polygon(self, points: np.ndarray) -> Nearness:
        sides = np.roll(self.corners, -1, axis=0) - self.corners
        lengths = np.linalg.norm(sides, axis=1)
        along = sides / lengths[:, None]
        outward = np.stack([along[:, 1], -along[:, 0]], axis=1)
        offset = points[:, None] - self.corners
        beyond = np.einsum("kci,ci->kc", offset, outward)
        side = beyond.argmax(axis=1)
        inside = beyond.max(axis=1) <= 0.0
        foot = np.clip(np.einsum("kci,ci->kc", offset, along), 0.0, lengths)
        gap = offset - foot[..., None] * along
        nearest = np.linalg.norm(gap, axis=2).argmin(axis=1)
        each = np.arange(len(points))
        found = _from(gap[each, nearest], np.linalg.norm(gap[each, nearest], axis=1))
        return Nearness(
            np.where(inside, beyond[each, side], found.distance) - self.radius,
            np.where(inside[:, None] | (found.distance < 1e-12)[:, None], outward[side],
                     found.normal),
        )  # fmt: skip


def _from(offset: np.ndarray, distance: np.ndarray) -> Nearness:
    length = np.linalg.norm(offset, axis=1, keepdims=True)
    straight = np.where(length > 0.0, offset / np.where(length > 0.0, length, 1.0), [1.0, 0.0])
    return Nearness(distance, straight)


def disc(
    centre: Pair,
    radius: float,
    *,
    velocity: Pair = (0.0, 0.0),
    appears: float = 0.0,
) -> Obstacle:
    """Return a disc obstacle.

    The centre is that at time zero, the velocity is in length units per second, and ``appears`` is
    the time in seconds from which the disc can be sensed. Raises `ScenarioError` if a number is not
    finite or the radius is not positive; the message names the argument.
    """
    if not (np.ndim(radius) == 0 and np.isfinite(radius) and radius > 0):
        raise ScenarioError(f"radius: expected a positive number, got {radius!r}")
    return _obstacle(_pair("centre", centre)[None], float(radius), velocity, appears)


def polygon(
    corners: Sequence[Pair],
    *,
    velocity: Pair = (0.0, 0.0),
    appears: float = 0.0,
) -> Obstacle:
    """Return a convex polygon with three or more corners.

    The corners are those at time zero, in order around the polygon in either direction.
    ``velocity`` and ``appears`` are as for a `disc`. Raises `ScenarioError` if the polygon is not
    convex or a number is not finite.
    """
    points = np.array([_pair(f"corners[{i}]", corner) for i, corner in enumerate(corners)])
    if len(points) < 3:
        raise ScenarioError(f"corners: expected three or more, got {len(points)}")
    try:
        hull = points[ConvexHull(points).vertices]
    except QhullError:
        raise ScenarioError("corners: expected a polygon, got points on one line") from None
    if len(hull) < len(points):
        raise ScenarioError(
            f"corners: the polygon is not convex: its hull has {len(hull)} of {len(points)} "
            "corners; cut it into convex ones"
        )
    return _obstacle(hull, 0.0, velocity, appears)


def _obstacle(corners: np.ndarray, radius: float, velocity, appears) -> Obstacle:
    if not (np.ndim(appears) == 0 and np.isfinite(appears)):
        raise ScenarioError(f"appears: expected seconds, got {appears!r}")
    return Obstacle(
        corners=corners,
        radius=radius,
        velocity=_pair("velocity", velocity),
        appears=float(appears),
    )


def _pair(field: str, given) -> np.ndarray:
    try:
        pair = np.array(given, float)
    except (TypeError, ValueError):
        pair = np.array(np.nan)
    if pair.shape != (2,) or not np.isfinite(pair).all():
        raise ScenarioError(f"{field}: expected two finite numbers (x, y), got {given!r}")
    return pair
