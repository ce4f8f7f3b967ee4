"""Last exits: the last time at which a deviation exceeds its tolerance, also between samples."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

LOOKS, ROUNDS = 8, 4
"""Number of parts of an interval at whose ends a deviation is evaluated, and number of grids: each
grid divides the part with the last exit. It is located to 1 / 8^4 of a step, then interpolated."""


def last_exit(time: np.ndarray, residual: np.ndarray, tolerance: float) -> float:
    """Return the last time at which a residual exceeds a tolerance; nan if it still does.

    Between samples the logarithm is interpolated.

    Parameters
    ----------
    time : (T,) array
        Rising, in any unit.
    residual : (T,) array
        What is no number counts as above.
    tolerance : float

    Returns
    -------
    float
        In the unit of ``time``; its first entry if the residual never was above.

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
    """Locate the last time at which a deviation exceeds a tolerance, on ever finer grids.

    Parameters
    ----------
    deviation : callable
        Deviations (K,) at rising times (K,).
    grid : (K,) array
        Times of the first evaluation; the deviation at the last one is below the tolerance.
    tolerance : float
    rounds : int
        Number of grids.

    Returns
    -------
    float or None
        None if no deviation on the grid exceeds the tolerance.

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
    finer = np.linspace(grid[last], grid[last + 1], LOOKS + 1)
    return located_exit(deviation, finer, tolerance, rounds - 1)
