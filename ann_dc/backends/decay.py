"""Measured decay rate of the residual at the end of a run.

Near the settled point the residual falls as the slowest mode does, independent of the path to it.
The rate is therefore that of the spectrum, minus its abscissa.
"""

from __future__ import annotations

import numpy as np

from ann_dc.backends.settling import last_exit
from ann_dc.backends.trajectory import Trajectory
from ann_dc.validation import PositiveFinite, checked

FEWEST = 5
"""Smallest number of residuals in a tail for which a rate is computed."""


@checked
def decay_rate(
    trajectory: Trajectory, high: PositiveFinite = 1e-3, low: PositiveFinite = 1e-7
) -> float:
    """Return the rate a of the exponential e^{-a s} fitted to the residual tail.

    The tail goes from the last exit from below ``high`` to the last exit from below ``low``, both
    relative KKT residuals. The fit minimises squared errors of the logarithm of the residual, each
    weighted with the time interval of its step. Oscillations therefore average out, and the step
    length has no effect.

    The rate is in units of 1 / network time. It is nan if the run ended above ``low`` or if the
    tail has fewer than `FEWEST` residuals.

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    >>> trajectory = ann_dc.OdeBackend(verify=False).run(network).trajectory
    >>> predicted = -ann_dc.spectrum(network, trajectory.final).abscissa
    >>> 0.8 < decay_rate(trajectory) / predicted < 1.5
    True
    """
    time, residual = trajectory.residual_time, trajectory.kkt
    first, last = (last_exit(time, residual, share) for share in (high, low))
    chosen = (time >= first) & (time <= last) & (residual > 0)
    if not np.isfinite(last) or chosen.sum() < FEWEST:
        return float("nan")
    weight = np.sqrt(np.gradient(time[chosen]))
    slope, _ = np.polyfit(time[chosen] - first, np.log(residual[chosen]), 1, w=weight)
    return float(-slope)
