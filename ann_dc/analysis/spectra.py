"""Eigenvalues of the flow at a settled point: settling time and stability.

``ratio`` = spectral radius / |spectral abscissa| (stiffness ratio) measures settling in fastest
time constants: a run to a relative residual eps takes about ratio * ln(1/eps) of them.

Products with J give the fastest modes and the rightmost ones, which determine the settling time. If
the rightmost modes are hundreds of times slower than the fastest, some are missed, and those found
may not be the rightmost. Products with the inverse then give the smallest eigenvalues, from one
sparse LU factorisation of the block tridiagonal drive Jacobian and one of the preconditioner's
factors. More of these are requested, since a rightmost oscillatory mode is not among the first. The
ends of a long cell array's spectrum are crowded, and every further eigenvalue takes more products
than the one before; few are requested.

Oscillatory modes between the ends, such as those of op amps, are decisive if they hardly decay.
With a diagonal preconditioner, J - c also has a sparse factorisation, whose inverse gives the
eigenvalues nearest to c. If all converge, the farthest bounds the disc around c in which none is
missed. Such discs follow the imaginary axis. Their centres lie right of the axis, so that growing
modes are found first. Each centre is as high as the previous disc reaches on the axis. Among
crowded modes the step is at least a fraction of the height, and modes in between may be missed.
"""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg

from ann_dc.evaluation.codegen.evaluator import FastEvaluator, fast_evaluator
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import ArrayLayout, Preconditioner, PreconditionerKind
from ann_dc.progress import Paced, Progress, silent
from ann_dc.summaries import summarised
from ann_dc.validation import Count, State, checked

# ---- the ends of a large network's spectrum, by Arnoldi iterations on J = M d drive / dx

LinearOperator: Any = scipy.sparse.linalg.LinearOperator  # its arguments are not in the stubs

ENDS = 4
"""Number of eigenvalues requested at each end of a spectrum."""
CLOSE, ROUGH = 1e-4, 0.02
"""Relative residual of these, and of rightmost ones that are too crowded to be separated."""
EXACT = 1e-6
"""Relative residual of oscillatory modes, whose growth is small against their frequency."""
BASIS, RESTARTS = 60, 6
"""Vectors and restarts to find the rightmost modes, before the inverse is used."""
SMALLEST = 24
"""Number of eigenvalues requested from the inverse."""
NEAREST, CROWDED = 12, 0.125
"""Eigenvalues requested around a frequency; smallest step to the next, relative to it."""
_FARTHER = 2.2
"""Height of the last centre relative to the fastest mode.

Growing modes without oscillation are nearest to centres twice as far.
"""
RIGHT = 0.25
"""Distance of the centres right of the axis over the frequency, nearer to growing modes."""
SLOWEST, RIGHTMOST = 12, 6
"""Number of modes requested from either operator if their vectors are used."""


def _spectrum_ends(
    evaluator: FastEvaluator,
    preconditioner: Preconditioner,
    row: ArrayLayout,
    drive_jacobian: Any,
    free: np.ndarray,
    progress: Progress = silent,
) -> np.ndarray:
    """Return the fastest and slowest eigenvalues of M ``drive_jacobian``.

    The matrix is restricted to the free neurons: `free` (n,) excludes saturated ones. The slowest
    are the rightmost eigenvalues, and also the smallest if iterations do not find all. With a
    diagonal preconditioner they are those near the imaginary axis. The unit is 1 / network time.
    `preconditioner` is the preconditioner of the evaluator's tape, and `row` has its rates.
    `progress` receives occasional lines.

    References
    ----------
    .. [1] R. B. Lehoucq, D. C. Sorensen, C. Yang, ARPACK Users' Guide, SIAM, 1998.
    """
    flow = _flow(evaluator, drive_jacobian, free, progress)
    fastest = _eigenvalues(flow, "LM", ncv=BASIS // 2)
    if preconditioner.kind is PreconditionerKind.DIAGONAL:
        smallest = _smallest(preconditioner, row, drive_jacobian, free)
        fast = float(np.abs(fastest).max(initial=0.0))
        slow = float(np.abs(smallest).max(initial=0.0)) or CLOSE * fast
        swinging = _swinging(row, drive_jacobian, free, (slow, fast), progress)
        return np.concatenate([fastest, smallest, *swinging])
    slowest = np.zeros(0)
    for residual in (CLOSE, ROUGH):
        slowest = _eigenvalues(flow, "LR", residual, ncv=BASIS, maxiter=RESTARTS)
        if len(slowest) == ENDS:
            return np.concatenate([fastest, slowest])
    return np.concatenate([fastest, slowest, _smallest(preconditioner, row, drive_jacobian, free)])


def _slow_modes(
    evaluator: FastEvaluator,
    preconditioner: Preconditioner,
    row: ArrayLayout,
    drive_jacobian: Any,
    free: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the smallest and rightmost eigenpairs of M ``drive_jacobian``.

    `preconditioner` is the preconditioner of the evaluator's tape, and `row` has its rates. `free`
    (n,) excludes saturated neurons. Returns the eigenvalues (c,) in units of 1 / network time,
    without duplicates, and the vectors (free neurons, c). Raises RuntimeError if the Jacobian is
    singular.
    """
    slow, slow_vectors = _eigenpairs(
        _inverse(preconditioner, row, drive_jacobian, free), "LM", SLOWEST
    )
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
    """Return the operator v -> M ``drive_jacobian`` v, with M among the free neurons."""
    products, reported, derivative = itertools.count(1), Paced(progress), evaluator.clamped(~free)

    def product(v: np.ndarray) -> np.ndarray:
        number = next(products)
        reported(lambda: f"spectrum: product {number}")
        return derivative(np.ascontiguousarray(drive_jacobian @ _padded(v, free)))[free]

    return _operator(free, product)


def _inverse(
    preconditioner: Preconditioner, row: ArrayLayout, drive_jacobian: Any, free: np.ndarray
) -> Any:
    """Return the operator v -> (M ``drive_jacobian``)^{-1} v.

    The inverse of M among the free neurons is the corresponding part of M^{-1}. Raises RuntimeError
    if the Jacobian is exactly singular.
    """
    factors = scipy.sparse.linalg.splu(drive_jacobian[free][:, free].tocsc())
    unspread = preconditioner.inverse(row)
    return _operator(free, lambda v: factors.solve(unspread(_padded(v, free))[free]))


def _operator(free: np.ndarray, product: Any, dtype: type = float) -> Any:
    return LinearOperator((int(free.sum()),) * 2, dtype=dtype, matvec=product)


def _padded(v: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return a vector of all neurons, zero in those that are not free."""
    whole = np.zeros(len(free))
    whole[free] = v.ravel()
    return whole


def _smallest(
    preconditioner: Preconditioner, row: ArrayLayout, drive_jacobian: Any, free: np.ndarray
) -> np.ndarray:
    try:
        inverse = _inverse(preconditioner, row, drive_jacobian, free)
    except RuntimeError:  # the point is not isolated
        return np.zeros(1)
    return 1 / _eigenvalues(inverse, "LM", count=SMALLEST, ncv=BASIS // 2)


def _swinging(
    row: ArrayLayout,
    drive_jacobian: Any,
    free: np.ndarray,
    band: tuple[float, float],
    progress: Progress,
) -> Iterator[np.ndarray]:
    """Yield eigenvalues near the imaginary axis between the frequencies of ``band``."""
    among, slowness = drive_jacobian[free][:, free], 1 / row.state_rates[free]
    omega, fast = band
    reported = Paced(progress)
    while omega < _FARTHER * fast:  # never where one of them is nan
        reported(
            lambda reached=omega: f"spectrum: oscillating modes, at {reached / fast:.1%} of all"
        )
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
    """Return some eigenvalues; only the converged ones if not all converge."""
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
    """Return some eigenpairs; only the converged ones if not all converge."""
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
"""Largest network of which all eigenvalues are computed; beyond, only the ends of the spectrum."""

EQUAL = 1e-6
"""Relative difference below which eigenvalues count as one."""

AT_REST = 1e-10
"""Largest eigenvalue relative to the radius of a mode that does not move."""


@summarised(
    lambda self: {
        "eigenvalues": len(self.eigenvalues),
        "radius": f"{self.radius:.4g}",
        "abscissa": f"{self.abscissa:.4g}",
        "stiffness ratio": f"{self.stiffness_ratio:.4g}",
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrum:
    """Eigenvalues of d rhs / dx at a state.

    Attributes
    ----------
    eigenvalues : complex array
        All eigenvalues, or the fastest and the slowest of a large network. Unit: 1 / network time.

    Examples
    --------
    >>> modes = Spectrum(eigenvalues=np.array([-4.0, -0.5 + 1j, -0.5 - 1j]))
    >>> modes.radius, modes.abscissa, modes.stiffness_ratio, modes.largest_step
    (4.0, -0.5, 8.0, 0.5)
    >>> round(modes.damping_ratio, 3)
    0.447
    """

    eigenvalues: np.ndarray

    @property
    def radius(self) -> float:
        """Largest modulus: one over the fastest time constant; zero if nothing moves."""
        return float(np.abs(self.eigenvalues).max(initial=0.0))

    @property
    def abscissa(self) -> float:
        """Largest real part; negative if the point is stable, minus the settling rate."""
        return float(np.real(self.eigenvalues).max(initial=-np.inf))

    @property
    def damping_ratio(self) -> float:
        """Smallest damping ratio ``-Re(lambda) / |lambda|``; positive if the point is stable."""
        sizes = np.abs(self.eigenvalues)
        ratios = np.divide(-np.real(self.eigenvalues), sizes, where=sizes > 0, out=0 * sizes)
        return float(ratios.min(initial=1.0))

    @property
    def stiffness_ratio(self) -> float:
        """Stiffness ratio: ``radius / |abscissa|``; infinite if the point is not stable."""
        return self.radius / -self.abscissa if self.abscissa < 0 else float("inf")

    @property
    def ratio(self) -> float:
        """Deprecated name of `stiffness_ratio`; removed in 0.2."""
        warnings.warn("ratio: use stiffness_ratio", DeprecationWarning, stacklevel=2)
        return self.stiffness_ratio

    def moving(self) -> Spectrum:
        """Return the modes with eigenvalues not zero to rounding; self if all are such."""
        derivatives = np.abs(self.eigenvalues) > AT_REST * self.radius
        return (
            self
            if derivatives.all() or not derivatives.any()
            else Spectrum(eigenvalues=self.eigenvalues[derivatives])
        )

    @property
    def largest_step(self) -> float:
        """Largest stable forward Euler step: min 2a / (a^2 + b^2) of eigenvalues -a +- ib."""
        values = self.eigenvalues
        return float(max((-2 * np.real(values) / np.abs(values) ** 2).min(), 0.0))


@checked
def spectrum(
    network: Network, x: State, *, dense: Count | None = None, progress: Progress = silent
) -> Spectrum:
    """Compute the spectrum of a network's flow at a state.

    Saturated neurons have no mode. The ends of the spectrum of a large network are computed by
    Arnoldi iterations. Inputs that change over time have their values at time zero; for another
    time pass ``network.at_time(time)``.

    Parameters
    ----------
    network : Network
        Network whose flow is linearised.
    x : (n,) array
        State of the linearisation, usually the settled point.
    dense : int, optional
        Number of neurons up to which all eigenvalues are computed; `DENSE_LIMIT` by default.
    progress : Progress
        Receives occasional lines for a large network.

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
    return spectrum_of(
        evaluator, network.preconditioner, network.layout, x, dense=dense, progress=progress
    )


def spectrum_of(
    evaluator: FastEvaluator,
    preconditioner: Preconditioner,
    row: ArrayLayout,
    x: np.ndarray,
    *,
    dense: int | None = None,
    progress: Progress = silent,
) -> Spectrum:
    """Compute the spectrum for a tape with trial gains; definition in `spectrum`.

    `preconditioner` is the preconditioner of the evaluator's tape, and `row` has its rates. `x` is
    (n,); `dense` is `DENSE_LIMIT` by default. If the network has no spectrum (overflow or singular
    matrix), the result contains one nan eigenvalue.
    """
    drive_jacobian = evaluator.drive_jacobian(x)
    unknown = Spectrum(eigenvalues=np.array([complex(np.nan, np.nan)]))
    if not np.isfinite(drive_jacobian.data).all():  # a run that overflowed has no spectrum
        return unknown
    free = evaluator.free(x)
    if len(x) <= (DENSE_LIMIT if dense is None else dense):
        try:
            flow = dense_flow(preconditioner, row, drive_jacobian, free)
        except np.linalg.LinAlgError:  # of a stiffness that is singular to rounding
            return unknown
        if not np.isfinite(flow).all():
            return unknown
        eigenvalues = scipy.linalg.eigvals(flow, check_finite=False)
        return Spectrum(eigenvalues=np.asarray(eigenvalues))
    try:
        ends = _spectrum_ends(evaluator, preconditioner, row, drive_jacobian, free, progress)
    except (RuntimeError, np.linalg.LinAlgError):  # SuperLU's and ARPACK's word for singular
        return unknown
    return Spectrum(eigenvalues=ends)


@checked
def slowest_modes(network: Network, x: State, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the slowest eigenpairs of a network's flow, one of every complex pair.

    At most `count` modes at the settled point `x` (n,) are returned. Above `DENSE_LIMIT` neurons
    they are computed by Arnoldi iterations at the slow end. Returns the eigenvalues (c,), the
    slowest first, in units of 1 / network time, without duplicates, and the vectors (n, c). Raises
    RuntimeError if the Jacobian of a large network is singular.
    """
    evaluator = fast_evaluator(network)
    drive_jacobian = evaluator.drive_jacobian(x)
    free = evaluator.free(x)
    if network.size <= DENSE_LIMIT:
        flow: Any = dense_flow(network.preconditioner, network.layout, drive_jacobian, free)
        values, found = np.linalg.eig(flow)
    else:
        values, found = _slow_modes(
            evaluator, network.preconditioner, network.layout, drive_jacobian, free
        )
    vectors = np.zeros((network.size, len(values)), complex)
    vectors[free] = found
    chosen: list[int] = []
    for i in np.argsort(-np.real(values), kind="stable"):
        new = all(abs(values[i] - values[j]) > EQUAL * abs(values[i]) for j in chosen)
        if np.imag(values[i]) >= 0 and new and len(chosen) < count:
            chosen.append(int(i))
    return values[chosen].astype(complex), vectors[:, chosen]


def dense_flow(
    preconditioner: Preconditioner, row: ArrayLayout, drive_jacobian: Any, free: np.ndarray
) -> np.ndarray:
    """Return the preconditioner times ``drive_jacobian`` among the free neurons."""
    return preconditioner.among(row, ~free)(drive_jacobian.toarray().T).T[np.ix_(free, free)]


@checked
def stability_limit(network: Network, x: State) -> float:
    """Return the largest stable step of the simultaneous order at a state (n,).

    The step is min 2a / (a^2 + b^2) over the eigenvalues -a +- ib of the flow, in units of network
    time; zero at an unstable point. Inputs that change over time have their values at time zero.
    """
    return spectrum(network, x).largest_step
