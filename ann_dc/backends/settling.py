"""Settling criterion: the last exit of the residual, never its first crossing.

The settling time is the last moment at which the KKT residual was not below the tolerance. Only
later values can confirm that an exit is the last, so a run continues until the residual has fallen
to a small fraction of the tolerance. A hovering residual therefore does not count as settled.

A run without further headway is ended: its best residual in one window of steps must be below that
of the window before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ann_dc.backends.integration.exits import CHECKS, last_exit as last_exit, located_exit
from ann_dc.backends.trajectory import Trajectory, control_values
from ann_dc.errors import require_positive, such_as
from ann_dc.evaluation.rules import size_of
from ann_dc.validation import PositiveFinite, checked

HEADWAY = 0.97
"""Ratio to the best residual of the last window that the best of a window must fall below."""
GROWTH = 1.1
"""Growth factor per window of the largest state of a diverging run."""
WINDOW = 2500
"""Smallest number of steps per window: a twentieth of the longest run by default."""
WINDOWS = 20
"""Largest number of windows in the longest run."""
SWING = 0.1
"""Fraction of a band: if both ends of a step lie within it, controls stay in the band."""


def window_of(limit: int) -> int:
    """Return the steps per window of a run with the given largest number of steps."""
    return max(WINDOW, limit // WINDOWS)


@such_as("ann_dc.Settling()")
@checked
@dataclass(frozen=True, kw_only=True)
class Settling:
    """Definition of a settled run.

    Attributes
    ----------
    tolerance : float, default 1e-6
        Tolerance on the relative KKT residual. The settling time is the last exit from below it.
    confirm : float, default 0.005
        Fraction of the tolerance that the residual must reach before the run ends.
    controls : float or None, default None
        Additional tolerance on every control, as a fraction of the largest final control counted
        from the offset of its scale. If all controls end below 1 % of the largest on the way, the
        tolerance is a fraction of that 1 %.

    Raises
    ------
    NetworkError
        If ``tolerance`` or ``confirm`` is not a positive number.

    Examples
    --------
    A looser tolerance is met earlier:

    >>> import ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    >>> loose, tight = (
    ...     ann_dc.OdeBackend(settling=ann_dc.Settling(tolerance=tolerance), verify=False)
    ...     for tolerance in (1e-3, 1e-6)
    ... )
    >>> loose.run(network).settling_time < tight.run(network).settling_time
    True
    """

    tolerance: float = 1e-6
    confirm: float = 0.005
    controls: PositiveFinite | None = None

    def __post_init__(self) -> None:
        require_positive(tolerance=self.tolerance, confirm=self.confirm)

    @property
    def confirmed(self) -> float:
        """Residual at which a run ends as settled."""
        return self.tolerance * self.confirm


def settles(trajectory: Trajectory) -> bool:
    """Return True if a network with constant inputs is at rest at the end of a run."""
    at_rest = bool(trajectory.kkt[-1] < Settling().tolerance)
    return at_rest and not trajectory.network.waveforms


def settling_time(trajectory: Trajectory, settling: Settling, exit: float | None = None) -> float:
    """Return the last exit of the residual and, if requested, of the controls.

    The result is nan if the run ended outside a tolerance. ``exit`` is the last exit of the
    residual located inside its step. By default, and if it is nan, as in runs with inputs over
    time, the exit is interpolated between steps.
    """
    if exit is None or np.isnan(exit):
        exit = last_exit(trajectory.residual_time, trajectory.kkt, settling.tolerance)
    if settling.controls is None:
        return exit
    return max(exit, control_settling(trajectory, settling.controls))


def control_settling(
    trajectory: Trajectory,
    share: float = 1e-3,
    controls: Callable[[np.ndarray], np.ndarray] | None = None,
) -> float:
    """Return the time after which all controls stay close to their final values.

    The allowed deviation is the fraction ``share`` of the size of the final controls; see
    `size_of`. The time is located inside its step if states between steps are known, and otherwise
    interpolated. ``controls`` returns the controls (T, m) of states (T, n); by default those of the
    network.
    """
    of_states = controls or partial(control_values, trajectory.network)
    final = of_states(trajectory.final)
    time, states = trajectory.known
    scale = size_of(final, np.abs(of_states(states)).max(initial=0.0))

    def deviation(states: np.ndarray) -> np.ndarray:
        return np.abs(of_states(states) - final).max(axis=1) / scale

    error = deviation(states)
    above = np.flatnonzero(~(error < share))
    first = int(above[-1]) if above.size else 0
    if first == len(time) - 1 or not trajectory.is_dense:
        return last_exit(time, error, share)
    gaps = first + np.flatnonzero(np.maximum(error[first:-1], error[first + 1 :]) >= SWING * share)
    if not gaps.size:
        return float(time[0])
    grid = np.unique(np.linspace(time[gaps], time[gaps + 1], CHECKS + 1))
    exit = located_exit(lambda times: deviation(trajectory.at(times)), grid, share)
    return float(time[0]) if exit is None else exit
