r"""How slow a flow is, as a smooth function of its eigenvalues: what a search makes small.

An objective says how fast each mode decays, b > 0, in units of its own: the fastest time constant,
or a step. The slowest mode counts:

.. math:: \log \max_i \frac{1}{b_i} \;\le\; \frac{1}{p} \log \sum_i b_i^{-p} ,

which is smooth, and sharper with larger p.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple, final

import numpy as np

from ann_dc.validation.values import such_as


class Slope(NamedTuple):
    """A value and its derivatives: d value = Re sum by_eigenvalue dlambda + by_step d log h."""

    value: float
    by_eigenvalue: np.ndarray
    by_step: float = 0.0


@such_as("ann_dc.SETTLING_TIME")
class Objective(ABC):
    """What is to be small; see the module.

    Attributes
    ----------
    unit : str
        In what the slowest mode's time is told.
    stepped : bool
        Whether a step h counts, which is then chosen too.
    dual_late : bool
        Whether the dual neurons of a step move on the new residual, which acts as h K more penalty.
    """

    unit: str
    stepped: bool = False
    dual_late: bool = False

    @abstractmethod
    def decays(self, eigenvalues: np.ndarray, step: float) -> np.ndarray:
        """How fast every mode (n,) decays, in the unit of the objective; negative: it grows."""

    @abstractmethod
    def smoothed(
        self, eigenvalues: np.ndarray, step: float, sharpness: float, floor: float
    ) -> Slope:
        """Log of the slowest mode's time, smoothed.

        Parameters
        ----------
        eigenvalues : (n,) complex array
            Of the flow, in 1 / network time.
        step : float
            h, in network time.
        sharpness : float
            p.
        floor : float
            Decay below which the logarithm goes on straight, through zero: where a mode grows, the
            value still says how to make it decay.
        """

    def slowness(self, eigenvalues: np.ndarray, step: float) -> float:
        """Time of the slowest mode, not smoothed; infinite if one grows.

        Parameters
        ----------
        eigenvalues : (n,) complex array
        step : float
            h, in network time.
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
"""The ratio radius / |abscissa|: settling in fastest time constants, per factor of e."""

STEPS: Objective = _Steps(dual_late=False)
"""Steps of all neurons at once at the best h, per factor of e: -1 / log max |1 + h lambda|."""

TWO_PHASE_STEPS: Objective = _Steps(dual_late=True)
"""The same where dual neurons move after the primal ones, on the new residual.

The best h may be far above the largest stable one of the simultaneous order, h K being penalty too:
such gains want that fixed step, adaptive rules do not find it.
"""


def _log_slowest(decays: np.ndarray, sharpness: float, floor: float) -> tuple[float, np.ndarray]:
    """(1/p) log sum b^-p and its gradient (n,)."""
    above = np.maximum(decays, floor)
    below = np.minimum(decays - floor, 0.0) / floor
    logs = -np.log(above) - below
    largest = logs.max()
    shares = np.exp(sharpness * (logs - largest))
    value = largest + np.log(shares.sum()) / sharpness
    return float(value), -shares / shares.sum() / above
