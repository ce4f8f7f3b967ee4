"""Eigenvalues of the flow at a settled point: how fast it will settle, and whether it stays.

``ratio`` = spectral radius / |spectral abscissa| measures settling in fastest time constants: a run
to a relative residual eps takes about ratio * ln(1/eps) of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg

from ann_dc.analysis.arnoldi import slow_modes, spectrum_ends
from ann_dc.evaluation.generated.choice import FastEvaluator, fast_evaluator
from ann_dc.hints.checked import checked
from ann_dc.hints.values import Count, State
from ann_dc.network.metrics.contract import Metric, Row
from ann_dc.network.network import Network
from ann_dc.progress import Progress, silent

DENSE_LIMIT = 600
"""Largest network whose eigenvalues are all computed; beyond it, only the ends of the spectrum."""

EQUAL = 1e-6
"""Eigenvalues that differ by a smaller share count as one."""

AT_REST = 1e-10
"""Eigenvalue over the radius, at most, of a mode that stays where it is."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrum:
    """Eigenvalues of d rhs / dx at a state.

    Attributes
    ----------
    eigenvalues : complex array
        All of them, or the fastest and the slowest of a large network. Unit: 1 / network time.

    Examples
    --------
    >>> modes = Spectrum(eigenvalues=np.array([-4.0, -0.5 + 1j, -0.5 - 1j]))
    >>> modes.radius, modes.abscissa, modes.ratio, modes.largest_step
    (4.0, -0.5, 8.0, 0.5)
    """

    eigenvalues: np.ndarray

    @property
    def radius(self) -> float:
        """Largest modulus: one over the fastest time constant; zero where nothing moves."""
        return float(np.abs(self.eigenvalues).max(initial=0.0))

    @property
    def abscissa(self) -> float:
        """Largest real part: negative when the point attracts, and then the rate of settling."""
        return float(np.real(self.eigenvalues).max(initial=-np.inf))

    @property
    def ratio(self) -> float:
        """radius / |abscissa|; infinite when the point does not attract."""
        return self.radius / -self.abscissa if self.abscissa < 0 else float("inf")

    def moving(self) -> Spectrum:
        """Return the modes whose eigenvalues are not zero to rounding; itself if all are."""
        moves = np.abs(self.eigenvalues) > AT_REST * self.radius
        return (
            self
            if moves.all() or not moves.any()
            else Spectrum(eigenvalues=self.eigenvalues[moves])
        )

    @property
    def largest_step(self) -> float:
        """Largest stable forward Euler step: min 2a / (a^2 + b^2) over eigenvalues -a +- ib."""
        values = self.eigenvalues
        return float(max((-2 * np.real(values) / np.abs(values) ** 2).min(), 0.0))


@checked
def spectrum(
    network: Network, x: State, *, dense: Count | None = None, progress: Progress = silent
) -> Spectrum:
    """Spectrum of a network's flow at a state; neurons that stand at a rail have no mode.

    The ends of the spectrum of a large network come from Arnoldi iterations.

    Parameters
    ----------
    network : Network
    x : (n,) array
        Where the flow is linearised; the settled point, as a rule.
    dense : int, optional
        Neurons up to which all eigenvalues are computed; `DENSE_LIMIT` by default.
    progress : Progress
        Takes a line every now and then, of a large network.

    Returns
    -------
    Spectrum

    Examples
    --------
    >>> from ann_dc import equilibrium, plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=5))
    >>> modes = spectrum(network, equilibrium(network, network.start_state))
    >>> len(modes.eigenvalues) == network.size, modes.abscissa < 0
    (True, True)
    """
    evaluator = fast_evaluator(network)
    return spectrum_of(evaluator, network.metric, network.row, x, dense=dense, progress=progress)


def spectrum_of(
    evaluator: FastEvaluator,
    metric: Metric,
    row: Row,
    x: np.ndarray,
    *,
    dense: int | None = None,
    progress: Progress = silent,
) -> Spectrum:
    """As `spectrum`, where the tape has other gains than its network: a trial of them.

    Parameters
    ----------
    evaluator : FastEvaluator
    metric : Metric
        That of its tape.
    row : Row
        With the rates of the tape.
    x : (n,) array
    dense : int, optional
        Neurons up to which all eigenvalues are computed; `DENSE_LIMIT` by default.
    progress : Progress
        Takes a line every now and then, of a large network.

    Returns
    -------
    Spectrum
        Of one eigenvalue that is no number where the network has none: values overflow, or it is
        singular.
    """
    drive_jacobian = evaluator.drive_jacobian(x)
    unknown = Spectrum(eigenvalues=np.array([complex(np.nan, np.nan)]))
    if not np.isfinite(drive_jacobian.data).all():  # a run that overflowed has no spectrum
        return unknown
    free = evaluator.free(x)
    if len(x) <= (DENSE_LIMIT if dense is None else dense):
        try:
            flow = dense_flow(metric, row, drive_jacobian, free)
        except np.linalg.LinAlgError:  # of a stiffness that is singular to rounding
            return unknown
        if not np.isfinite(flow).all():
            return unknown
        eigenvalues = scipy.linalg.eigvals(flow, check_finite=False)
        return Spectrum(eigenvalues=np.asarray(eigenvalues))
    try:
        ends = spectrum_ends(evaluator, metric, row, drive_jacobian, free, progress)
    except (RuntimeError, np.linalg.LinAlgError):  # SuperLU's and ARPACK's word for singular
        return unknown
    return Spectrum(eigenvalues=ends)


@checked
def slowest_modes(network: Network, x: State, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The slowest eigenvalues of a network's flow with their vectors, one of every complex pair.

    Above `DENSE_LIMIT` neurons they come from Arnoldi iterations at the slow end.

    Parameters
    ----------
    network : Network
    x : (n,) array
        The settled point.
    count : int
        How many, at most.

    Returns
    -------
    eigenvalues : (c,) complex array
        The slowest first, in units of 1 / network time; equal ones stand once.
    vectors : (n, c) complex array

    Raises
    ------
    RuntimeError
        If the Jacobian of a large network is singular.
    """
    evaluator = fast_evaluator(network)
    drive_jacobian = evaluator.drive_jacobian(x)
    free = evaluator.free(x)
    if network.size <= DENSE_LIMIT:
        flow: Any = dense_flow(network.metric, network.row, drive_jacobian, free)
        values, found = np.linalg.eig(flow)
    else:
        values, found = slow_modes(evaluator, network.metric, network.row, drive_jacobian, free)
    vectors = np.zeros((network.size, len(values)), complex)
    vectors[free] = found
    chosen: list[int] = []
    for i in np.argsort(-np.real(values), kind="stable"):
        new = all(abs(values[i] - values[j]) > EQUAL * abs(values[i]) for j in chosen)
        if np.imag(values[i]) >= 0 and new and len(chosen) < count:
            chosen.append(int(i))
    return values[chosen].astype(complex), vectors[:, chosen]


def dense_flow(metric: Metric, row: Row, drive_jacobian: Any, free: np.ndarray) -> np.ndarray:
    """Return the metric among the free neurons times ``drive_jacobian``: the others are held."""
    return metric.among(row, ~free)(drive_jacobian.toarray().T).T[np.ix_(free, free)]


@checked
def stability_limit(network: Network, x: State) -> float:
    """Largest stable step of the simultaneous order at a state (n,).

    min 2a / (a^2 + b^2) over the eigenvalues -a +- ib of the flow; zero at a point that repels.

    Parameters
    ----------
    network : Network
    x : (n,) array

    Returns
    -------
    float
        In units of network time.
    """
    return spectrum(network, x).largest_step
