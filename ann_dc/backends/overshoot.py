"""Overshoot of controls beyond their final values."""

from __future__ import annotations

import numpy as np

from ann_dc.backends.integration.exits import CHECKS
from ann_dc.backends.trajectory import Trajectory, control_values
from ann_dc.validation import checked

STAYS = 1e-6
"""Smallest net change of a control that counts as moving, relative to the largest final control."""


@checked
def overshoot(trajectory: Trajectory) -> float:
    """Return the largest overshoot of a control relative to the control size.

    Overshoot is an excursion beyond the final value, on the side opposite to the start. For a
    control that ends at its initial value, both sides count. Controls are compared in network
    units, in which all have equal weight; the last controls of the trajectory are the final values.

    The result is 0 if no control overshoots and 0.1 for an overshoot of a tenth of the largest
    control.

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
    """Return controls at rows and, if known, inside steps, where peaks can lie."""
    if not trajectory.is_dense:
        return trajectory.control_values
    time, _ = trajectory.known
    grid = np.unique(np.linspace(time[:-1], time[1:], CHECKS + 1))
    return control_values(trajectory.network, trajectory.at(grid))
