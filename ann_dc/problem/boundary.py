"""Slope of a row g <= 0 at the point of its boundary that is nearest to a path.

A row divided by this slope is a distance, independent of how the row is written and of the position
of the path. The slope on the path itself is unsuitable: it is zero at the centre of a disc.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from ann_dc.problem.functions import ProblemFunctions

Rows: TypeAlias = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Values (r, K) and slopes (r, n, K) of rows at points (n, K)."""
TOWARDS = 8
"""Number of Newton steps from a point to the boundary of a row."""
THERE = 0.01
"""Largest distance from the boundary, in scales, at which a point counts as on the boundary."""


def boundary_slopes(
    functions: ProblemFunctions, q: np.ndarray, u: np.ndarray, factors: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return slope lengths (r,) and (r_e,) of stage and end rows on their boundaries.

    Each row uses the boundary point nearest to any of the states (n, N+1) and controls (m, N); an
    entry is one if no boundary is found. Slopes refer to variables scaled by `factors` (n+m,).
    """
    n = len(q)

    def of_stages(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rows = functions.rows(z[:n], z[n:])
        return rows.value, rows.jacobian

    def of_end(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, slope = functions.end_rows(z[:, 0])
        return value[:, None], slope[..., None]

    factors = factors[:, None]
    path, end = np.vstack([q[:, :-1], u]), q[:, -1:]
    return _all_on_boundary(of_stages, path, factors), _all_on_boundary(of_end, end, factors[:n])


def _all_on_boundary(rows: Rows, z: np.ndarray, factors: np.ndarray) -> np.ndarray:
    count = len(rows(z)[0])
    return np.array([_on_boundary(rows, row, z, factors) for row in range(count)])


def _on_boundary(rows: Rows, row: int, z: np.ndarray, factors: np.ndarray) -> float:
    """Return the slope length of a row at its boundary point nearest to (n, K) points.

    If the row is flat at the points (a product at zero), the search restarts one scale away.
    """
    for began in (z, z + factors):
        length, way, left = _towards(rows, row, began, factors)
        found = np.isfinite(way) & (length > 0) & (left <= THERE * length)
        if found.any():
            return float(length[found][np.argmin(way[found])])
    return 1.0


def _towards(
    rows: Rows, row: int, began: np.ndarray, factors: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return slope lengths (K,) after Newton steps, distances moved and abs(values)."""
    z = began
    with np.errstate(all="ignore"):
        for _ in range(TOWARDS):
            value, slope = (part[row] for part in rows(z))
            z = z - factors * value * slope * factors / ((slope * factors) ** 2).sum(axis=0)
        value, slope = (part[row] for part in rows(z))
        length = np.linalg.norm(slope * factors, axis=0)
        way = np.linalg.norm((z - began) / factors, axis=0)
    return length, way, np.abs(value)
