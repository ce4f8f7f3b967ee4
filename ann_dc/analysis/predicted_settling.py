r"""The settling time that a network's own modes predict, without a run.

Near its settled point x* a network flows as x' = J (x - x*) + n(x), where n is what is not linear.

.. math:: x(t) - x^* = e^{J t} (x_0 - x^*) + \int_0^t e^{J (t - s)}\, n(x(s))\, ds .

Without the integral that is the linearised flow. With it, the way is taken in a few steps that
grow towards its end: the modes go exactly, whatever their speed, and n is a straight line in every
step [1]_. What the nonlinear way leaves of the slowest modes decides, and few steps tell it. The
residual on that way is the one that runs use, and its last exit counts.

References
----------
.. [1] S. M. Cox and P. C. Matthews, Exponential time differencing for stiff systems, Journal of
   Computational Physics 176 (2002), scheme ETD2RK.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from ann_dc.analysis.settling_modes import WORST_CONDITION, Modes
from ann_dc.analysis.spectra import dense_flow
from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.evaluator import FastEvaluator, fast_evaluator
from ann_dc.network.network import Network
from ann_dc.validation.checked import checked
from ann_dc.validation.values import PositiveFinite, State

LARGEST = 1500
"""Neurons up to which all modes are computed: some seconds."""
STEPS, FINE = 160, 32
"""Steps on the whole way, and times between two of their ends around the exit."""
BEND = 6.0
"""How much closer they lie at the beginning: by a factor of e to this power."""
BEYOND = 1e-3
"""Share of the tolerance to which the slowest mode has fallen when the way ends."""


@checked
def predicted_settling(
    network: Network,
    settled: State,
    start: State,
    tolerance: PositiveFinite = 1e-6,
    *,
    linear: bool = False,
) -> float:
    """Network time after which the relative KKT residual stays below a tolerance, predicted.

    It costs `STEPS` times two looks at the drives, and all eigenvectors. The linear path is taken
    where eigenvectors do not tell the modes apart, and where the steps leave the function blocks'
    domains.

    Parameters
    ----------
    network : Network
    settled : (n,) array
        Where it settles: `equilibrium`, or the end of a run of a network like it.
    start : (n,) array
        Where it starts.
    tolerance : float
        As `Settling.tolerance`.
    linear : bool
        The linearised flow alone.

    Returns
    -------
    float
        In units of network time; zero where the residual never is above the tolerance, nan where
        the settled point does not attract or the start lies outside a domain.

    Raises
    ------
    NetworkError
        If the network has more than `LARGEST` neurons.

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    >>> run = ann_dc.OdeBackend(verify=False).run(network)
    >>> predicted = predicted_settling(network, run.trajectory.final, network.start_state)
    >>> abs(predicted / run.settling_time - 1) < 0.01
    True
    """
    if network.size > LARGEST:
        raise NetworkError(
            f"network: it has {network.size} neurons, and all modes are computed up to {LARGEST}"
        )
    path = _Path(network, settled, start, tolerance)
    if not np.isfinite(path.end):
        return float("nan")
    if path.is_defective:
        return path.exponential_exit()
    return path.exit(path.linear() if linear else path.bent())


class _Path:
    """The way from a start to a settled point."""

    def __init__(
        self, network: Network, settled: np.ndarray, start: np.ndarray, tolerance: float
    ) -> None:
        self.evaluator: FastEvaluator = fast_evaluator(network)
        self.settled, self.tolerance = settled, tolerance
        drive_jacobian = self.evaluator.drive_jacobian(settled)
        self.free = self.evaluator.free(settled)
        self.flow = dense_flow(network.metric, network.row, drive_jacobian, self.free)
        self.modes = Modes.of(self.flow)
        self.deviation = (start - settled)[self.free]
        largest = max(*self.evaluator.residuals(start), 1 / BEYOND * tolerance)
        decay = np.log(largest / (BEYOND * tolerance))
        self.end = decay / self.modes.slowest if self.modes.slowest > 0 else np.inf

    @property
    def is_defective(self) -> bool:
        """Whether eigenvectors do not tell the modes apart."""
        return not self.modes.condition < WORST_CONDITION

    @property
    def times(self) -> np.ndarray:
        """Nodes of the way, the closer the earlier."""
        return self.end * np.expm1(BEND * np.linspace(0, 1, STEPS + 1)) / np.expm1(BEND)

    def states(self, deviations: np.ndarray) -> np.ndarray:
        """(T, n) of deviations (free, T)."""
        states = np.repeat(self.settled[None], deviations.shape[1], axis=0)
        states[:, self.free] += deviations.T
        return states

    # ---- the way -------------------------------------------------------------------------------

    def linear(self) -> np.ndarray:
        """Amplitudes (m, T) of the linearised flow."""
        return self.modes.decay(self.modes.amplitudes(self.deviation), self.times)

    def bent(self) -> np.ndarray:
        """Amplitudes (m, T) of the way as it is; linear where it cannot be taken."""
        found, step = self.linear(), self.modes.steps(np.diff(self.times))
        with np.errstate(all="ignore"):
            for k in range(STEPS):
                here = found[:, k]
                push = self._push(here)
                ahead = step.decay[:, k] * here + step.constant[:, k] * push
                found[:, k + 1] = ahead + step.slope[:, k] * (self._push(ahead) - push)
        return found if np.isfinite(found).all() else self.linear()

    def _push(self, amplitudes: np.ndarray) -> np.ndarray:
        """Amplitudes (m,) of what is not linear at a place of the way."""
        deviation = self.modes.deviations(amplitudes)
        move = self.evaluator.rhs(self.states(deviation[:, None])[0])
        return self.modes.amplitudes(move[self.free] - self.flow @ deviation)

    # ---- the exit ------------------------------------------------------------------------------

    def _above(self, deviations: np.ndarray) -> int:
        """The last of some deviations whose residual is not below the tolerance; -1: none."""
        states = self.states(deviations)
        for number in range(len(states) - 1, -1, -1):
            if not max(self.evaluator.residuals(states[number])) < self.tolerance:
                return number
        return -1

    def exit(self, amplitudes: np.ndarray) -> float:
        """The last exit of a path; from node to node around it the flow is linear."""
        times, node = self.times, self._above(self.modes.deviations(amplitudes))
        if node < 0 or node == STEPS:
            return 0.0 if node < 0 else float("nan")
        within = np.linspace(0, times[node + 1] - times[node], FINE + 1)
        decayed = self.modes.decay(amplitudes[:, node], within)
        return float(times[node] + within[self._above(self.modes.deviations(decayed))])

    def exponential_exit(self) -> float:
        """That of the linear path, by matrix exponentials, in equal steps."""
        step = self.end / STEPS
        deviations = _stepped(self.flow, self.deviation, step, STEPS)
        node = self._above(deviations)
        if node < 0 or node == STEPS:
            return 0.0 if node < 0 else float("nan")
        fine = _stepped(self.flow, deviations[:, node], step / FINE, FINE)
        return float(step * (node + self._above(fine) / FINE))


def _stepped(flow: np.ndarray, deviation: np.ndarray, step: float, count: int) -> np.ndarray:
    """Deviations (n, count + 1) after every step of a linear flow."""
    found, matrix = [deviation], scipy.linalg.expm(step * flow)
    for _ in range(count):
        found.append(matrix @ found[-1])
    return np.array(found).T
