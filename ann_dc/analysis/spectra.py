"""Eigenvalues of the flow at a settled point: how fast it will settle, and whether it stays.

``ratio`` = spectral radius / |spectral abscissa| measures settling in fastest time constants: a run
to a relative residual eps takes about ratio * ln(1/eps) of them.

The fastest modes and the rightmost ones, which decide how long settling takes, come from products
with J. Where a metric leaves the rightmost ones hundreds of times slower than the fastest, not all
of them are found, and those that are may not be the rightmost. Products with the inverse then find
the smallest ones: one sparse LU factorisation of the drive Jacobian, which is block tridiagonal,
and one of the metric's factors. More of these are asked for, since a rightmost one that swings is
not among the first. The ends of a long row's spectrum are crowded, and every further eigenvalue
takes more products than the one before: few are asked for.

A mode that swings in between, as those of op amps do, is at neither end, and decides all the same
where it hardly decays. With time constants alone J - c has a sparse factorisation too, whose
inverse finds those nearest to c, and the farthest of them says how far around c none is missed,
where all have converged. Such discs follow the imaginary axis. Their centres stand right of it,
where what grows is found before the rest, each as high as the disc before it reaches on the axis;
where modes are crowded it is higher by a share of its height, and what lies between may be missed.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg

from ann_dc.evaluation.codegen.evaluator import FastEvaluator, fast_evaluator
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Kind, Metric, Row
from ann_dc.progress import Paced, Progress, silent
from ann_dc.validation.checked import checked
from ann_dc.validation.values import Count, State

# ---- the ends of a large network's spectrum, by Arnoldi iterations on J = M d drive / dx

LinearOperator: Any = scipy.sparse.linalg.LinearOperator  # its arguments are not in the stubs

ENDS = 4
"""Number of eigenvalues asked for at each end of a spectrum."""
CLOSE, ROUGH = 1e-4, 0.02
"""Relative residual of these; of rightmost ones that are too crowded to be told apart."""
EXACT = 1e-6
"""The same of modes that swing, whose growth is a small share of their frequency."""
BASIS, RESTARTS = 60, 6
"""Vectors and restarts within which the rightmost ones are found, or else the inverse is asked."""
SMALLEST = 24
"""Number of those asked for from the inverse."""
NEAREST, CROWDED = 12, 0.125
"""Number of those asked for around a frequency; least step to the next, as a share of it."""
FARTHER = 2.2
"""Height of the last centre over the fastest mode: what grows and does not swing is nearest to
centres twice as far."""
RIGHT = 0.25
"""Distance of the centres right of the axis over the frequency: what grows is nearer to them."""
SLOWEST, RIGHTMOST = 12, 6
"""Number of modes asked for from either operator, where their vectors count."""


def spectrum_ends(
    evaluator: FastEvaluator,
    metric: Metric,
    row: Row,
    drive_jacobian: Any,
    free: np.ndarray,
    progress: Progress = silent,
) -> np.ndarray:
    """The fastest and the slowest eigenvalues of M ``drive_jacobian`` among free neurons.

    The slowest are the rightmost ones; where iterations do not find all of them, the smallest too.
    With time constants alone they are those near the imaginary axis.

    Parameters
    ----------
    evaluator : FastEvaluator
        With the tape that has this metric.
    metric : Metric
    row : Row
        With the rates of the tape.
    drive_jacobian : (n, n) sparse array
    free : (n,) array of bool
        Neurons that do not stand at a rail.
    progress : Progress
        Takes a line every now and then.

    Returns
    -------
    complex array
        In units of 1 / network time.

    References
    ----------
    .. [1] R. B. Lehoucq, D. C. Sorensen, C. Yang, ARPACK Users' Guide, SIAM, 1998.
    """
    flow = _flow(evaluator, drive_jacobian, free, progress)
    fastest = _eigenvalues(flow, "LM", ncv=BASIS // 2)
    if metric.kind is Kind.TIME_CONSTANTS:
        smallest = _smallest(metric, row, drive_jacobian, free)
        fast = float(np.abs(fastest).max(initial=0.0))
        slow = float(np.abs(smallest).max(initial=0.0)) or CLOSE * fast
        swinging = _swinging(row, drive_jacobian, free, (slow, fast), progress)
        return np.concatenate([fastest, smallest, *swinging])
    slowest = np.zeros(0)
    for residual in (CLOSE, ROUGH):
        slowest = _eigenvalues(flow, "LR", residual, ncv=BASIS, maxiter=RESTARTS)
        if len(slowest) == ENDS:
            return np.concatenate([fastest, slowest])
    return np.concatenate([fastest, slowest, _smallest(metric, row, drive_jacobian, free)])


def slow_modes(
    evaluator: FastEvaluator, metric: Metric, row: Row, drive_jacobian: Any, free: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The smallest and the rightmost eigenvalues of M ``drive_jacobian`` with their vectors.

    Parameters
    ----------
    evaluator : FastEvaluator
        With the tape that has this metric.
    metric : Metric
    row : Row
        With the rates of the tape.
    drive_jacobian : (n, n) sparse array
    free : (n,) array of bool
        Neurons that do not stand at a rail.

    Returns
    -------
    eigenvalues : (c,) complex array
        In units of 1 / network time; one that is found from both ends stands once.
    vectors : (free neurons, c) complex array

    Raises
    ------
    RuntimeError
        If the Jacobian is singular.
    """
    slow, slow_vectors = _eigenpairs(_inverse(metric, row, drive_jacobian, free), "LM", SLOWEST)
    flow = _flow(evaluator, drive_jacobian, free)
    right, right_vectors = _eigenpairs(flow, "LR", RIGHTMOST, ncv=80, maxiter=40)
    slow = 1 / slow
    new = (np.abs(right[:, None] - slow) > 1e-3 * np.abs(slow)).all(axis=1)
    return np.concatenate([slow, right[new]]), np.hstack([slow_vectors, right_vectors[:, new]])


def _flow(
    evaluator: FastEvaluator,
    drive_jacobian: Any,
    free: np.ndarray,
    progress: Progress = silent,
) -> Any:
    """v -> M ``drive_jacobian`` v, with M among the free neurons."""
    products, told, move = itertools.count(1), Paced(progress), evaluator.clamped(~free)

    def product(v: np.ndarray) -> np.ndarray:
        number = next(products)
        told(lambda: f"spectrum: product {number}")
        return move(np.ascontiguousarray(drive_jacobian @ _padded(v, free)))[free]

    return _operator(free, product)


def _inverse(metric: Metric, row: Row, drive_jacobian: Any, free: np.ndarray) -> Any:
    """v -> (M ``drive_jacobian``)^{-1} v; RuntimeError where that is exactly singular.

    The inverse of the metric among the free neurons is the part of M^{-1} among them.
    """
    factors = scipy.sparse.linalg.splu(drive_jacobian[free][:, free].tocsc())
    unspread = metric.inverse(row)
    return _operator(free, lambda v: factors.solve(unspread(_padded(v, free))[free]))


def _operator(free: np.ndarray, product: Any, dtype: type = float) -> Any:
    return LinearOperator((int(free.sum()),) * 2, dtype=dtype, matvec=product)


def _padded(v: np.ndarray, free: np.ndarray) -> np.ndarray:
    """A vector of all neurons: zero where one is not free."""
    whole = np.zeros(len(free))
    whole[free] = v.ravel()
    return whole


def _smallest(metric: Metric, row: Row, drive_jacobian: Any, free: np.ndarray) -> np.ndarray:
    try:
        inverse = _inverse(metric, row, drive_jacobian, free)
    except RuntimeError:  # the point is not isolated
        return np.zeros(1)
    return 1 / _eigenvalues(inverse, "LM", count=SMALLEST, ncv=BASIS // 2)


def _swinging(
    row: Row,
    drive_jacobian: Any,
    free: np.ndarray,
    band: tuple[float, float],
    progress: Progress,
) -> Iterator[np.ndarray]:
    """Eigenvalues near the imaginary axis between the frequencies of ``band``."""
    among, slowness = drive_jacobian[free][:, free], 1 / row.state_rates[free]
    omega, fast = band
    told = Paced(progress)
    while omega < FARTHER * fast:  # never where one of them is nan
        told(lambda reached=omega: f"spectrum: modes that swing, at {reached / fast:.1%} of all")
        centre = (RIGHT + 1j) * omega
        shift = scipy.sparse.diags_array(centre * slowness)
        factors = scipy.sparse.linalg.splu((among - shift).tocsc())

        def product(v: np.ndarray, factors: Any = factors) -> np.ndarray:
            return factors.solve(slowness * v.ravel())

        inverse = _operator(free, product, complex)
        options = {"count": NEAREST, "ncv": BASIS // 2, "maxiter": RESTARTS}
        away = 1 / _eigenvalues(inverse, "LM", EXACT, **options)
        yield centre + away
        radius = np.abs(away).max() if len(away) == NEAREST else 0.0
        half_chord = math.sqrt(max(radius**2 - centre.real**2, 0.0))
        omega += max(half_chord, CROWDED * omega)


def _eigenvalues(
    operator: Any, which: str, residual: float = CLOSE, count: int = ENDS, **options: Any
) -> np.ndarray:
    """Some eigenvalues; those that have converged, where not all do."""
    start = np.random.default_rng(0).standard_normal(operator.shape[0])
    try:
        found = scipy.sparse.linalg.eigs(
            operator,
            k=count,
            which=which,  # pyright: ignore[reportArgumentType]
            v0=start,
            tol=residual,  # pyright: ignore[reportArgumentType]
            return_eigenvectors=False,
            **options,
        )
        return np.asarray(found)
    except scipy.sparse.linalg.ArpackNoConvergence as partial:
        return partial.eigenvalues
    except scipy.sparse.linalg.ArpackError:  # the numbers are beyond an eigenvalue computation
        return np.array([complex(np.nan, np.nan)])


def _eigenpairs(
    operator: Any, which: str, count: int, **options: Any
) -> tuple[np.ndarray, np.ndarray]:
    """Some eigenvalues with their vectors; those that have converged, where not all do."""
    start = np.ones(operator.shape[0])
    try:
        found: Any = scipy.sparse.linalg.eigs(
            operator,
            k=count,
            which=which,  # pyright: ignore[reportArgumentType]
            v0=start,
            tol=1e-6,  # pyright: ignore[reportArgumentType]
            **options,
        )
        return found
    except scipy.sparse.linalg.ArpackNoConvergence as partial:
        return partial.eigenvalues, partial.eigenvectors


# ---- eigenvalues of the flow at a settled point: how fast it will settle, and whether it stays

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
