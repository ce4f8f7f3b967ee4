r"""Settling time predicted from the modes of a network, without a run.

Near its settled point x* the flow of a network is x' = J (x - x*) + n(x), where n is the nonlinear
part.

.. math:: x(t) - x^* = e^{J t} (x_0 - x^*) + \int_0^t e^{J (t - s)}\, n(x(s))\, ds .

Without the integral this is the linearised flow. With it, the trajectory is computed in a few steps
that grow towards the end. The modes are exact, whatever their speed, and n is linear in every step
[1]_. The amplitudes of the slowest modes after the nonlinear part determine the result; few steps
suffice for these:

.. math:: y_i(t + h) = e^{\lambda_i h} y_i(t) + \int_0^h e^{\lambda_i (h - s)} n_i(t + s)\, ds .

The residual is that of runs, and its last exit from the tolerance counts.

References
----------
.. [1] S. M. Cox and P. C. Matthews, Exponential time differencing for stiff systems, Journal of
   Computational Physics 176 (2002), scheme ETD2RK.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.linalg

from ann_dc.analysis.spectra import dense_flow
from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.evaluator import FastEvaluator, fast_evaluator
from ann_dc.network.network import Network
from ann_dc.validation import PositiveFinite, State, checked

_WORST_CONDITION = 1e10
"""Largest condition of eigenvectors that separate the modes: half of the digits are lost."""
SMALL = 1e-2
"""|lambda h| below which an integral is summed as a series; the next term is rounding."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Modes:
    """Eigenvalues and vectors of a flow J (n, n), one per complex pair.

    The eigenvalue of a pair counts twice.

    Attributes
    ----------
    values : (m,) complex array
        Eigenvalues in units of 1 / network time.
    right, left : (n, m) and (m, n) complex arrays
        A deviation is the real part of ``right`` times the amplitudes; ``left`` times a deviation
        gives the amplitudes.
    condition : float
        Condition of all eigenvectors; infinite if there are too few.

    Examples
    --------
    >>> modes = Modes.of(np.array([[-1.0, 1.0], [0.0, -3.0]]))
    >>> modes.at([0.0, 2.0], np.array([0.0])).round(12).tolist() == [[0.0], [2.0]]
    True
    """

    values: np.ndarray
    right: np.ndarray
    left: np.ndarray
    condition: float

    @classmethod
    def of(cls, flow: np.ndarray) -> Modes:
        """Compute the modes of a dense flow (n, n)."""
        values, right = np.linalg.eig(flow)
        try:
            left = np.linalg.inv(right)
            condition = float(np.linalg.norm(left) * np.linalg.norm(right))
        except np.linalg.LinAlgError:
            left, condition = np.zeros_like(right), np.inf
        one = np.imag(values) >= 0
        twice = np.where(np.imag(values) > 0, 2.0, 1.0)[one]
        return cls(
            values=values[one].astype(complex),
            right=right[:, one] * twice,
            left=left[one],
            condition=condition,
        )

    @property
    def slowest(self) -> float:
        """Rate of the slowest mode; zero or less if the flow does not settle."""
        return float(-np.real(self.values).max(initial=-np.inf))

    def at(self, deviation: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return the deviations (n, T) at some times, from one (n,) at time zero."""
        return self.deviations(self.decay(self.amplitudes(np.asarray(deviation)), times))

    def amplitudes(self, deviations: np.ndarray) -> np.ndarray:
        """Return the amplitudes (m, ...) of real deviations (n, ...)."""
        return np.real(self.left) @ deviations + 1j * (np.imag(self.left) @ deviations)

    def decay(self, amplitudes: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return the amplitudes (m, T) after some times, from those (m,) at time zero."""
        return amplitudes[:, None] * np.exp(np.multiply.outer(self.values, times))

    def deviations(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return the real deviations (n, ...) of amplitudes (m, ...)."""
        real, imaginary = np.real(amplitudes), np.imag(amplitudes)
        return np.real(self.right) @ real - np.imag(self.right) @ imaginary

    def steps(self, lengths: np.ndarray) -> Steps:
        """Return the weights of steps of lengths (T,) with a forcing term linear in time."""
        z = np.multiply.outer(self.values, lengths)
        factor = np.exp(z)
        series, safe = np.abs(z) < SMALL, np.where(np.abs(z) < SMALL, 1.0, z)
        first = np.where(series, 1 + z / 2 + z**2 / 6 + z**3 / 24, (factor - 1) / safe)
        second = np.where(series, 0.5 + z / 6 + z**2 / 24, (first - 1) / safe)
        return Steps(decay=factor, constant=lengths * first, slope=lengths * second)


class Steps(NamedTuple):
    """Weights (m, T) of steps: ``decay * a + constant * n + slope * (n_end - n)``."""

    decay: np.ndarray
    """Weight of the amplitudes a at the beginning of a step."""
    constant: np.ndarray
    """Weight of the amplitudes n of the forcing term at the beginning."""
    slope: np.ndarray
    """Weight of the increase of the forcing term at the end."""


LARGEST = 1500
"""Number of neurons up to which all modes are computed, in some seconds."""
STEPS, FINE = 160, 32
"""Steps of the whole trajectory; times within the step of the exit."""
_BEND = 6.0
"""Exponent of the step growth: the steps grow by a factor of e to this power."""
BEYOND = 1e-3
"""Amplitude of the slowest mode at the end of the trajectory, relative to the tolerance."""


@checked
def predicted_settling(
    network: Network,
    settled: State,
    start: State,
    tolerance: PositiveFinite = 1e-6,
    *,
    linear: bool = False,
) -> float:
    """Predict the network time at which the KKT residual settles below a tolerance.

    The residual is relative and stays below the tolerance afterwards. The cost is two evaluations
    of the drives in each of `STEPS` steps, and all eigenvectors. The linear path is used if
    eigenvectors do not separate the modes, or if the steps leave the domains of function blocks.
    The result is zero if the residual never exceeds the tolerance, and nan if the settled point is
    unstable or the initial state lies outside a domain. Raises `NetworkError` if the network has
    more than `LARGEST` neurons.

    Parameters
    ----------
    settled : (n,) array
        Settled point: `equilibrium`, or the end of a run of a similar network.
    start : (n,) array
        Initial state.
    tolerance : float
        As `Settling.tolerance`.
    linear : bool
        Use only the linearised flow.

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
            f"network: expected at most {LARGEST} neurons for the computation of all modes, "
            f"got {network.size}"
        )
    path = _Path(network, settled, start, tolerance)
    if not np.isfinite(path.end):
        return float("nan")
    if path.is_defective:
        return path.exponential_exit()
    return path.exit(path.linear() if linear else path.bent())


class _Path:
    """Trajectory from an initial state to a settled point."""

    def __init__(
        self, network: Network, settled: np.ndarray, start: np.ndarray, tolerance: float
    ) -> None:
        self.evaluator: FastEvaluator = fast_evaluator(network)
        self.settled, self.tolerance = settled, tolerance
        drive_jacobian = self.evaluator.drive_jacobian(settled)
        self.free = self.evaluator.free(settled)
        self.flow = dense_flow(network.preconditioner, network.layout, drive_jacobian, self.free)
        self.modes = Modes.of(self.flow)
        self.deviation = (start - settled)[self.free]
        largest = max(*self.evaluator.residuals(start), 1 / BEYOND * tolerance)
        decay = np.log(largest / (BEYOND * tolerance))
        self.end = decay / self.modes.slowest if self.modes.slowest > 0 else np.inf

    @property
    def is_defective(self) -> bool:
        """True if eigenvectors do not separate the modes."""
        return not self.modes.condition < _WORST_CONDITION

    @property
    def times(self) -> np.ndarray:
        """Times of the steps, denser at the beginning."""
        return self.end * np.expm1(_BEND * np.linspace(0, 1, STEPS + 1)) / np.expm1(_BEND)

    def states(self, deviations: np.ndarray) -> np.ndarray:
        """Return states (T, n) from deviations (free, T)."""
        states = np.repeat(self.settled[None], deviations.shape[1], axis=0)
        states[:, self.free] += deviations.T
        return states

    # ---- the way -------------------------------------------------------------------------------

    def linear(self) -> np.ndarray:
        """Return the amplitudes (m, T) of the linearised flow."""
        return self.modes.decay(self.modes.amplitudes(self.deviation), self.times)

    def bent(self) -> np.ndarray:
        """Return the amplitudes (m, T) of the nonlinear flow; linear if that fails."""
        found, step = self.linear(), self.modes.steps(np.diff(self.times))
        with np.errstate(all="ignore"):
            for k in range(STEPS):
                here = found[:, k]
                push = self._push(here)
                ahead = step.decay[:, k] * here + step.constant[:, k] * push
                found[:, k + 1] = ahead + step.slope[:, k] * (self._push(ahead) - push)
        return found if np.isfinite(found).all() else self.linear()

    def _push(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return the amplitudes (m,) of the nonlinear part of the flow."""
        deviation = self.modes.deviations(amplitudes)
        derivative = self.evaluator.rhs(self.states(deviation[:, None])[0])
        return self.modes.amplitudes(derivative[self.free] - self.flow @ deviation)

    # ---- the exit ------------------------------------------------------------------------------

    def _above(self, deviations: np.ndarray) -> int:
        """Return the index of the last deviation with a residual above tolerance, or -1."""
        states = self.states(deviations)
        for number in range(len(states) - 1, -1, -1):
            if not max(self.evaluator.residuals(states[number])) < self.tolerance:
                return number
        return -1

    def exit(self, amplitudes: np.ndarray) -> float:
        """Return the last exit time of a path; within a step the flow is linear."""
        times, node = self.times, self._above(self.modes.deviations(amplitudes))
        if node < 0 or node == STEPS:
            return 0.0 if node < 0 else float("nan")
        within = np.linspace(0, times[node + 1] - times[node], FINE + 1)
        decayed = self.modes.decay(amplitudes[:, node], within)
        return float(times[node] + within[self._above(self.modes.deviations(decayed))])

    def exponential_exit(self) -> float:
        """Return the exit time of the linear path by matrix exponentials in equal steps."""
        step = self.end / STEPS
        deviations = _stepped(self.flow, self.deviation, step, STEPS)
        node = self._above(deviations)
        if node < 0 or node == STEPS:
            return 0.0 if node < 0 else float("nan")
        fine = _stepped(self.flow, deviations[:, node], step / FINE, FINE)
        return float(step * (node + self._above(fine) / FINE))


def _stepped(flow: np.ndarray, deviation: np.ndarray, step: float, count: int) -> np.ndarray:
    """Return the deviations (n, count + 1) after every step of a linear flow."""
    found, matrix = [deviation], scipy.linalg.expm(step * flow)
    for _ in range(count):
        found.append(matrix @ found[-1])
    return np.array(found).T
