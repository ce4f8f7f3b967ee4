"""How fast a residual falls at the end of a run, as it was measured.

Near the settled point it falls as the slowest mode does: the rate is that of the spectrum, minus
its abscissa, whatever the way there was.
"""

from __future__ import annotations

import numpy as np

from ann_dc.backends.settling import last_exit
from ann_dc.backends.trajectory import Trajectory
from ann_dc.validation.checked import checked
from ann_dc.validation.values import PositiveFinite

FEWEST = 5
"""Looks at a tail from which on it has a rate."""


@checked
def decay_rate(
    trajectory: Trajectory, high: PositiveFinite = 1e-3, low: PositiveFinite = 1e-7
) -> float:
    """Rate a of the exponential e^{-a s} that fits the tail of the KKT residual best.

    The tail goes from the last exit from below ``high`` to that from below ``low``. The fit is one
    of least squares on the logarithm of the residual, every look weighted with the time that it
    stands for: an oscillation averages out, and the length of steps does not count.

    Parameters
    ----------
    trajectory : Trajectory
    high, low : float
        Relative KKT residuals at the two ends of the tail.

    Returns
    -------
    float
        In units of 1 / network time; nan where the run ended above ``low``, or was seen less than
        `FEWEST` times on the tail.

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
