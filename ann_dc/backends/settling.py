"""When a network counts as settled: at the last exit of its residual, never at its first crossing.

The settling time is the last moment at which the KKT residual was not below the tolerance. That it
is the last one can be known only later, so a run goes on until the residual has fallen on to a
small share of the tolerance. A residual that merely hovers is not taken for a settled network.

A run that makes no headway any more is ended too: its best residual in one window of steps has to
be below that of the window before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ann_dc.backends.integration.exits import LOOKS, last_exit as last_exit, located_exit
from ann_dc.backends.trajectory import Trajectory, control_values
from ann_dc.errors import require_positive
from ann_dc.evaluation.rules import size_of
from ann_dc.validation.checked import checked
from ann_dc.validation.values import PositiveFinite, such_as

HEADWAY = 0.97
"""Share of the best residual of one window that the best of the next one has to fall below."""
GROWTH = 1.1
"""Factor from window to window by which the largest state of a run that diverges grows."""
WINDOW = 2500
"""Steps of a window, at least: a twentieth of the longest run by default."""
WINDOWS = 20
"""Windows in the longest run, at most."""
SWING = 0.1
"""Share of a band: where both ends of a step are inside that, controls stay in the band."""


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
        Additionally, every control must stay within this share of the largest final control,
        counted from the offset of its scale; of 1 % of the largest on the way, if all end below
        that.

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


def settling_time(trajectory: Trajectory, settling: Settling, exit: float | None = None) -> float:
    """The last exit of the residual, and of the controls where they are asked for.

    Parameters
    ----------
    trajectory : Trajectory
        Of a run that went on for long enough to tell.
    settling : Settling
        Tolerances on the residual and on the controls.
    exit : float, optional
        The last exit of the residual, located inside its step; by default it is interpolated
        between steps.

    Returns
    -------
    float
        Network time; nan if the run ended outside.
    """
    if exit is None:
        exit = last_exit(trajectory.residual_time, trajectory.kkt, settling.tolerance)
    if settling.controls is None:
        return exit
    return max(exit, control_settling(trajectory, settling.controls))


def control_settling(
    trajectory: Trajectory,
    share: float = 1e-3,
    controls: Callable[[np.ndarray], np.ndarray] | None = None,
) -> float:
    """Return the time after which every control stays within ``share`` of the controls' size.

    The time is located inside its step if states between steps are known, else it is interpolated
    between rows. The size is that of the final controls; see `size_of`.

    Parameters
    ----------
    trajectory : Trajectory
        Whose last controls count as final.
    share : float
    controls : callable, optional
        Gives the controls (T, m) of states (T, n); by default those of its network.

    Returns
    -------
    float
        In units of network time.
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
    grid = np.unique(np.linspace(time[gaps], time[gaps + 1], LOOKS + 1))
    exit = located_exit(lambda times: deviation(trajectory.at(times)), grid, share)
    return float(time[0]) if exit is None else exit
