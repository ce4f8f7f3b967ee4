"""When a network counts as settled: at the last exit of its residual, never at its first crossing.

The settling time is the last moment at which the KKT residual was not below the tolerance. That it
is the last one can be known only later, so a run goes on until the residual has fallen on to a
small share of the tolerance. A residual that merely hovers is not taken for a settled network.

A run that makes no headway any more is ended too: its best residual in one window of steps has to
be below that of the window before.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import require_positive
from ann_dc.hints.checked import checked
from ann_dc.hints.values import PositiveFinite
from ann_dc.hints.words import such_as

HEADWAY = 0.97
"""Share of the best residual of one window that the best of the next one has to fall below."""
GROWTH = 1.1
"""Factor from window to window by which the largest state of a run that diverges grows."""
WINDOW = 2500
"""Steps of a window, at least: a twentieth of the longest run by default."""
WINDOWS = 20
"""Windows in the longest run, at most."""


def window_of(limit: int) -> int:
    """Steps of a window of a run.

    Parameters
    ----------
    limit : int
        Largest number of steps of the run.
    """
    return max(WINDOW, limit // WINDOWS)


@such_as("ann_dc.Settling()")
@checked
@dataclass(frozen=True, kw_only=True)
class Settling:
    """When a run counts as settled.

    Attributes
    ----------
    tolerance : float
        On the relative KKT residual; the settling time is the last exit from below it.
    confirm : float
        The run goes on until the residual is below this share of the tolerance.
    controls : float or None
        Additionally, every control must stay within this share of the largest final control.

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


def settling_time(trajectory: Trajectory, settling: Settling) -> float:
    """The last exit of the residual, and of the controls where they are asked for.

    Parameters
    ----------
    trajectory : Trajectory
        Of a run that went on for long enough to tell.
    settling : Settling
        Tolerances on the residual and on the controls.

    Returns
    -------
    float
        Network time; nan if the run ended outside.
    """
    found = last_exit(trajectory.residual_time, trajectory.kkt, settling.tolerance)
    if settling.controls is None:
        return found
    return max(found, control_settling(trajectory, settling.controls))


def control_settling(trajectory: Trajectory, share: float = 1e-3) -> float:
    """Network time after which every control stays within ``share`` of the largest final one.

    Parameters
    ----------
    trajectory : Trajectory
        Whose last controls count as final.
    share : float

    Returns
    -------
    float
        In units of network time.
    """
    controls = trajectory.control_values
    error = np.abs(controls - controls[-1]).max(axis=1)
    return last_exit(trajectory.time, error / max(np.abs(controls[-1]).max(), 1e-300), share)


def last_exit(time: np.ndarray, residual: np.ndarray, tolerance: float) -> float:
    """The last time at which a residual was above tolerance; nan if it still is.

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
