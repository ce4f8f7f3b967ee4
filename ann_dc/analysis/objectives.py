r"""Slowness of a flow as a smooth function of its eigenvalues, for minimisation.

An objective gives the decay b > 0 of each mode in its unit, the fastest time constant or a step.
The slowest mode counts:

.. math:: \log \max_i \frac{1}{b_i} \;\le\; \frac{1}{p} \log \sum_i b_i^{-p} ,

where the right side is smooth, and closer to the left side for larger p.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple, final

import numpy as np

from ann_dc.errors import such_as


class Slope(NamedTuple):
    """Value and derivatives: d value = Re sum by_eigenvalue dlambda + by_step d log h."""

    value: float
    by_eigenvalue: np.ndarray
    by_step: float = 0.0


@such_as("ann_dc.SETTLING_TIME")
class Objective(ABC):
    """Objective of a gain refinement; definition in the module docstring.

    `unit` is that of the slowest mode's time. `stepped` is True if the objective depends on a step
    h, which is then optimised too. `dual_late` is True if the dual neurons move on the new
    residual, which adds h K to the penalty.
    """

    unit: str
    stepped: bool = False
    dual_late: bool = False

    @abstractmethod
    def decays(self, eigenvalues: np.ndarray, step: float) -> np.ndarray:
        """Return the decays (n,) of the modes in the objective's unit; growth is negative."""

    @abstractmethod
    def smoothed(
        self, eigenvalues: np.ndarray, step: float, sharpness: float, floor: float
    ) -> Slope:
        """Return the smoothed logarithm of the slowest mode's time.

        `eigenvalues` (n,) are those of the flow in 1 / network time, `step` is h in network time,
        `sharpness` p. `floor` is the decay below which the logarithm is extended linearly through
        zero, so that the gradient of a growing mode still leads to decay.
        """

    def slowness(self, eigenvalues: np.ndarray, step: float) -> float:
        """Return the unsmoothed time of the slowest mode; infinite if a mode grows.

        `eigenvalues` are (n,); `step` is h in network time.
        """
        slowest = self.decays(eigenvalues, step).min()
        return float(1 / slowest) if slowest > 0 else float("inf")


@final
class _SettlingTime(Objective):
    unit = "ratio"

    def decays(self, eigenvalues, step):
        return -np.real(eigenvalues) / np.abs(eigenvalues).max()

    def smoothed(self, eigenvalues, step, sharpness, floor):
        moduli = np.maximum(np.abs(eigenvalues), 1e-300)
        scaled = (moduli / moduli.max()) ** sharpness
        radius = moduli.max() * scaled.sum() ** (1 / sharpness)
        fast = scaled / scaled.sum() * eigenvalues.conj() / moduli**2  # d log radius
        b = -np.real(eigenvalues) / radius
        value, by_decay = _log_slowest(b, sharpness, floor)
        return Slope(value, -by_decay / radius - (by_decay @ b) * fast)


@final
class _Steps(Objective):
    unit = "steps a factor of e:"
    stepped = True

    def __init__(self, *, dual_late: bool) -> None:
        self.dual_late = dual_late

    def decays(self, eigenvalues, step):
        return -np.log(np.maximum(np.abs(1 + step * eigenvalues), 1e-300))

    def smoothed(self, eigenvalues, step, sharpness, floor):
        value, by_decay = _log_slowest(self.decays(eigenvalues, step), sharpness, floor)
        left = 1 + step * eigenvalues
        by_eigenvalue = -by_decay * step / np.where(left == 0, 1e-300, left)
        return Slope(value, by_eigenvalue, float(np.real(by_eigenvalue @ eigenvalues)))


SETTLING_TIME: Objective = _SettlingTime()
"""Ratio radius / |abscissa|: settling in fastest time constants, per factor of e."""

STEPS: Objective = _Steps(dual_late=False)
"""Simultaneous steps at the best h, per factor of e: -1 / log max |1 + h lambda|."""

TWO_PHASE_STEPS: Objective = _Steps(dual_late=True)
"""Steps per factor of e if dual neurons move after the primal ones, on the new residual.

The best h may be far above the largest stable step of the simultaneous order, because h K adds to
the penalty. Such gains require this fixed step; adaptive rules do not find it.
"""


def _log_slowest(decays: np.ndarray, sharpness: float, floor: float) -> tuple[float, np.ndarray]:
    """Return (1/p) log sum b^-p and its gradient (n,)."""
    above = np.maximum(decays, floor)
    below = np.minimum(decays - floor, 0.0) / floor
    logs = -np.log(above) - below
    largest = logs.max()
    shares = np.exp(sharpness * (logs - largest))
    value = largest + np.log(shares.sum()) / sharpness
    return float(value), -shares / shares.sum() / above
