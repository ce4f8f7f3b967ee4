"""Last exits: the last time at which a deviation exceeds its tolerance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

CHECKS, ROUNDS = 8, 4
"""Number of parts of an interval and number of grids.

The deviation is evaluated at the ends of the parts, and each grid divides the part with the last
exit. The exit is located to 1 / 8^4 of a step and then interpolated.
"""


def last_exit(time: np.ndarray, residual: np.ndarray, tolerance: float) -> float:
    """Return the last time at which a residual exceeds a tolerance.

    The result is nan if the residual still exceeds the tolerance. The logarithm is interpolated
    between samples (T,) at rising times (T,). A residual that is not a number counts as above the
    tolerance. The result is in the unit of ``time``, and is its first entry if the residual never
    exceeds the tolerance.

    Examples
    --------
    >>> round(last_exit(np.array([0.0, 1.0, 2.0]), np.array([1.0, 1e-2, 1e-4]), 1e-3), 3)
    1.5
    """
    above = np.flatnonzero(~(residual < tolerance))
    if above.size == 0:
        return float(time[0])
    i = int(above[-1])
    if i == len(time) - 1:
        return float("nan")
    high, low = np.log(residual[i]), np.log(max(residual[i + 1], 1e-300))
    share = (high - np.log(tolerance)) / (high - low) if np.isfinite(high) else 1.0
    return float(time[i] + share * (time[i + 1] - time[i]))


def located_exit(
    deviation: Callable[[np.ndarray], np.ndarray],
    grid: np.ndarray,
    tolerance: float,
    rounds: int = ROUNDS,
) -> float | None:
    """Locate the last time at which a deviation exceeds a tolerance, on refined grids.

    ``deviation`` returns deviations (K,) at rising times (K,). The deviation at the last time of
    the first grid (K,) must be below the tolerance. Returns None if no deviation on the grid
    exceeds the tolerance.

    Examples
    --------
    >>> round(located_exit(lambda s: np.cos(s) ** 2, np.linspace(0.0, 2.0, 9), 0.5), 6)
    0.785398
    """
    found = deviation(grid)
    above = np.flatnonzero(~(found < tolerance))
    if not above.size:
        return None
    last = int(above[-1])
    if last == len(grid) - 1:
        return float(grid[-1])
    if rounds == 1:
        return last_exit(grid, found, tolerance)
    finer = np.linspace(grid[last], grid[last + 1], CHECKS + 1)
    return located_exit(deviation, finer, tolerance, rounds - 1)
