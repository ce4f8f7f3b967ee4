r"""The ends of a large network's spectrum, by Arnoldi iterations on J = M d drive / dx.

The fastest modes and the rightmost ones, which decide how long settling takes, come from products
with J. Where a metric leaves the rightmost ones hundreds of times slower than the fastest, not all
of them are found, and those that are may not be the rightmost. Products with the inverse then find
the smallest ones: one sparse LU factorisation of the drive Jacobian, which is block tridiagonal,
and one of the metric's factors. More of these are asked for, since a rightmost one that swings is
not among the first. The ends of a long row's spectrum are crowded, and every further eigenvalue
takes more products than the one before: few are asked for.

A mode that swings in between, as those of op amps do, is at neither end. It stands out in

.. math:: C_a = (J - a)^{-1} (J + a) , \quad a > 0 ,

whose eigenvalues (lambda + a) / (lambda - a) are larger than 1 exactly where lambda grows, and the
more so the nearer a is to \|lambda\|: the largest are asked for with several a.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from ann_dc.evaluation.generated.choice import FastEvaluator
from ann_dc.network.metrics.contract import Kind, Metric, Row
from ann_dc.progress import Paced, Progress, silent

LinearOperator: Any = scipy.sparse.linalg.LinearOperator  # its arguments are not in the stubs

ENDS = 4
"""How many eigenvalues are asked for at each end of a spectrum."""
CLOSE, ROUGH = 1e-4, 0.02
"""Relative residual of these; of rightmost ones that are too crowded to be told apart."""
EXACT = 1e-6
"""The same of modes between the ends, whose growth is a small share of their frequency."""
BASIS, RESTARTS = 60, 6
"""Vectors and restarts within which the rightmost ones are found, or else the inverse is asked."""
SMALLEST = 24
"""How many are asked for from the inverse."""
BETWEEN = 4.0
"""Ratio of one frequency at which modes that swing are looked for over the one before."""
SLOWEST, RIGHTMOST = 12, 6
"""How many modes are asked for from either operator, where their vectors count."""


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
    slowest = np.zeros(0)
    for residual in (CLOSE, ROUGH):
        slowest = _eigenvalues(flow, "LR", residual, ncv=BASIS, maxiter=RESTARTS)
        if len(slowest) == ENDS:
            return np.concatenate([fastest, slowest])
    smallest = _smallest(metric, row, drive_jacobian, free)
    known = np.concatenate([fastest, slowest, smallest])
    if metric.kind is not Kind.TIME_CONSTANTS or not np.isfinite(known).all():
        return known
    band = np.abs(smallest).min(), np.abs(fastest).max()
    return np.concatenate([known, *_swinging(row, drive_jacobian, free, *band)])


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
    """v -> M ``drive_jacobian`` v."""
    products, told = itertools.count(1), Paced(progress)

    def product(v: np.ndarray) -> np.ndarray:
        number = next(products)
        told(lambda: f"spectrum: product {number}")
        return evaluator.move(np.ascontiguousarray(drive_jacobian @ _padded(v, free)))[free]

    return _operator(free, product)


def _inverse(metric: Metric, row: Row, drive_jacobian: Any, free: np.ndarray) -> Any:
    """v -> (M ``drive_jacobian``)^{-1} v; RuntimeError where that is exactly singular."""
    factors = scipy.sparse.linalg.splu(drive_jacobian[free][:, free].tocsc())
    unspread = metric.inverse(row)
    return _operator(free, lambda v: factors.solve(unspread(_padded(v, free))[free]))


def _operator(free: np.ndarray, product: Any) -> Any:
    return LinearOperator((int(free.sum()),) * 2, dtype=float, matvec=product)


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
    row: Row, drive_jacobian: Any, free: np.ndarray, slow: float, fast: float
) -> Iterator[np.ndarray]:
    """Those of C_a, as eigenvalues of J, with a from ``slow`` to ``fast``; of time constants.

    Only those near a: far from it all are near 1, or near -1, and say little of lambda.
    """
    among, slowness = drive_jacobian[free][:, free], 1 / row.state_rates[free]
    for a in np.geomspace(slow, fast, 1 + math.ceil(math.log(fast / slow, BETWEEN))):
        factors = scipy.sparse.linalg.splu((among - scipy.sparse.diags_array(a * slowness)).tocsc())

        def product(v: np.ndarray, a: float = a, factors: Any = factors) -> np.ndarray:
            return v.ravel() + 2 * a * factors.solve(slowness * v.ravel())

        operator = _operator(free, product)
        found = _eigenvalues(operator, "LM", EXACT, ncv=BASIS, maxiter=RESTARTS)
        found = a * (found + 1) / (found - 1)
        yield found[np.abs(np.log(np.abs(found) / a)) <= math.log(BETWEEN)]


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
