"""How far controls go beyond where they end."""

from __future__ import annotations

import numpy as np

from ann_dc.backends.integration.exits import LOOKS
from ann_dc.backends.trajectory import Trajectory, control_values
from ann_dc.validation.checked import checked

STAYS = 1e-6
"""Share of the largest final control by which one has moved in the end that counts as moving."""


@checked
def overshoot(trajectory: Trajectory) -> float:
    """Return the largest excursion of a control beyond its final value, over their size.

    Beyond is the side of the final value on which the control does not start; of one that ends
    where it starts, either side. Controls count in network units, in which all count alike.

    Parameters
    ----------
    trajectory : Trajectory
        Whose last controls count as final.

    Returns
    -------
    float
        0 where no control goes beyond its end, 0.1 where one does by a tenth of the largest.

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    >>> 0 <= overshoot(ann_dc.OdeBackend(verify=False).run(network).trajectory) < 1
    True
    """
    controls = _finely(trajectory)
    final, way = controls[-1], controls[-1] - controls[0]
    side = np.where(np.abs(way) > STAYS * np.abs(final).max(initial=0.0), np.sign(way), 0.0)
    apart = controls - final
    beyond = np.where(side == 0, np.abs(apart), side * apart)
    return float(beyond.max(initial=0.0) / trajectory.control_size)


def _finely(trajectory: Trajectory) -> np.ndarray:
    """Return controls at rows and, if known, inside steps: a peak lies between rows."""
    if not trajectory.is_dense:
        return trajectory.control_values
    time, _ = trajectory.known
    grid = np.unique(np.linspace(time[:-1], time[1:], LOOKS + 1))
    return control_values(trajectory.network, trajectory.at(grid))
