r"""Second-order test by stages: sign of the Hessian on the tangent space.

A backward recursion eliminates the stages. C_k q_k = 0 is the condition at stage k that the fixed
end imposes, and V_k the minimal curvature of all later stages. With

.. math:: \delta q_{k+1} = F \delta q_k + B \delta u_k

the part of u_k that C_{k+1} B maps to nonzero values is determined by the end; the remainder of
C_{k+1} F is C_k. The other part, w_k, is free. The tangent space of the constraints consists of all
w_k and the free components of q_0. In these coordinates the Hessian is block diagonal (LDL'): the
point is a strict minimum if and only if every block

.. math:: Z^T (W_{uu} + B^T V_{k+1} B) Z, \qquad u = K q + Z w,

is positive definite. The run time is linear in N. The test is exact for fixed, partly fixed and
free ends, a free start, and constraints that are inconsistent or leave no freedom. A block is
compared with the size of its terms in the scales of the problem, so the result does not depend on
units. Inequalities that hold as equations, G_k (q_k, u_k) = 0, are appended below the rows C_{k+1}.

References
----------
.. [1] D. P. Bertsekas, Dynamic Programming and Optimal Control, vol. 1, 2017, section 3.1.
.. [2] F. Laine, C. Tomlin, Efficient computation of feedback control for equality-constrained LQR,
   ICRA 2019.
"""

from __future__ import annotations

from enum import Enum

import numpy as np

from ann_dc.jit_functions import kept
from ann_dc.optimality.expansion import Expansion

FLAT = 1e-12
"""Threshold of zero curvature relative to the size of its terms."""
ROUNDING = 1e-12
"""Threshold below which a sum is zero relative to the size of its terms."""
DEPENDENT = 1e-9
"""Threshold below which a row remainder is linearly dependent, relative to the row."""

_STRICT, _FALLING, _FLAT, _UNKNOWN = range(4)

lengthy = kept(no_cfunc_wrapper=True, seconds=6.0)
"""Decorator: compile once per machine, cached on disk. Loops compile twice as fast as slices."""
inner = kept(no_cfunc_wrapper=True, no_cpython_wrapper=True)
"""Decorator as `lengthy`, for functions that only compiled code calls."""


class Minimum(Enum):
    """Result of the second-order test; the value is the sentence that is displayed."""

    STRICT = "strict local minimum"
    NOT_A_MINIMUM = "NOT a minimum: the cost decreases along a feasible direction"
    FLAT = "not a strict minimum: the cost has no curvature along some direction"
    NOT_SHOWN = "not proven to be a minimum: the result depends on weakly active inequalities"
    NOT_CHECKED = "not checked"


_ANSWERS = {
    _STRICT: Minimum.STRICT,
    _FALLING: Minimum.NOT_A_MINIMUM,
    _FLAT: Minimum.FLAT,
    _UNKNOWN: Minimum.NOT_CHECKED,
}


def counted(expansion: Expansion, rows: np.ndarray) -> Minimum:
    """Return the result of the second-order test of a finite expansion by stages.

    `rows` (N+1, R, n+m) contains the gradients of inequalities that hold as equations, and zeros in
    empty slots.
    """
    J, W, end = expansion.jacobian, expansion.hessian, expansion.end_hessian
    n, free = len(end), np.flatnonzero(~expansion.fixed_start)
    first = np.zeros((n, n + len(free)))  # what q_0 leaves free counts like a stage's controls
    first[free, n + np.arange(len(free))] = 1.0
    held = np.concatenate([np.eye(n)[expansion.fixed], rows[-1, :, :n]])
    G, nothing = rows[:-1], FLAT * expansion.largest_curvature()
    found = _swept(J, W, G, end, held, first, nothing, False)
    if found == _FLAT and _swept(J, W, G, end, held, first, nothing, True) == _FALLING:
        return Minimum.NOT_A_MINIMUM
    return _ANSWERS[found]


@lengthy
def _swept(J, W, G, end, held, first, nothing, is_lifted):
    """Run the recursion from the end to the start; the free q_0 is one more stage."""
    V, C, found = end, held, _STRICT
    without_cost = np.zeros((first.shape[1], first.shape[1]))
    without_rows = np.zeros((0, first.shape[1]))
    for k in range(len(J) - 1, -2, -1):
        stage, cost = (J[k], W[k]) if k >= 0 else (first, without_cost)
        rows = G[k] if k >= 0 else without_rows
        V, C, found = _stage(stage, cost, rows, V, C, nothing, is_lifted)
        if found != _STRICT:
            break
    return found


@inner
def _stage(J, W, G, V, C, nothing, is_lifted):
    """Return V and C of the previous stage and the sign; they need a positive block."""
    n, p = len(V), len(C) + len(G)
    little = DEPENDENT if len(G) else 0.0
    rows, r, sizes = _eliminated(_rows(C, J, G), p, n, little)
    T = _freed(rows, r, p, n)
    M = _seen(J, W, V, T)
    for i in range(n, len(M)):
        flat = max(FLAT * _size(J, W, V, T, i), nothing)
        found = _reduced(M, i, n, flat, is_lifted)
        if found != _STRICT:
            return V, C, found
    rest = np.zeros((n, n))
    for a in range(n):
        for b in range(n):
            rest[a, b] = M[a, b]
            for i in range(n, len(M)):
                rest[a, b] -= M[i, a] * M[i, b]
    left = _left_over(rows, r, p, n, little * sizes)
    return rest, _independent(left) if len(G) else left, _STRICT


@inner
def _freed(rows, r, p, n):
    """Return T with (q, u) = T (q, w), u = Q y; q fixes the first r of y, w the rest."""
    z = rows.shape[1]
    T = np.zeros((z, z - r))
    for i in range(n):
        T[i, i] = 1.0
    for a in range(z - n):
        for b in range(n):
            for i in range(r):
                T[n + a, b] -= rows[p + a, n + i] * rows[i, b] / rows[i, n + i]
        for i in range(r, z - n):
            T[n + a, n + i - r] = rows[p + a, n + i]
    return T


@inner
def _rows(C, J, G):
    """Return (C F, C B) above G and (0, I); entries that cancel to rounding are zero."""
    p, (n, z) = len(C) + len(G), J.shape
    rows = np.zeros((p + z - n, z))
    for i in range(len(G)):
        for j in range(z):
            rows[len(C) + i, j] = G[i, j]
    for i in range(len(C)):
        for j in range(z):
            size = 0.0
            for k in range(n):
                rows[i, j] += C[i, k] * J[k, j]
                size += abs(C[i, k] * J[k, j])
            if abs(rows[i, j]) <= ROUNDING * size:
                rows[i, j] = 0.0
    for j in range(z - n):
        rows[p + j, n + j] = 1.0
    return rows


@inner
def _eliminated(rows, p, n, little):
    """Reduce C B Q to a diagonal above zero rows, in place, with u = Q y and Q orthogonal (m, m).

    Returns the rows above Q, the number of components of y that they determine, and the largest
    entry of each row during elimination.
    """
    z = rows.shape[1]
    sizes, largest = np.zeros(p), np.zeros(p)
    for i in range(p):
        for j in range(z):
            largest[i] = max(largest[i], abs(rows[i, j]))
            if j >= n:
                sizes[i] = max(sizes[i], abs(rows[i, j]))
    for r in range(min(p, z - n)):
        best, length = _longest(rows, np.maximum(ROUNDING * sizes, little * largest), n + r, r)
        if length == 0.0:
            return rows, r, largest
        for j in range(z):
            rows[r, j], rows[best, j] = rows[best, j], rows[r, j]
        sizes[r], sizes[best] = sizes[best], sizes[r]
        largest[r], largest[best] = largest[best], largest[r]
        _reflect(rows, n + r, r, length)
        _remove(rows, n + r, r, p, n, largest)
    return rows, min(p, z - n), largest


@inner
def _longest(rows, least, first, r):
    """Return the row from r on with the longest control part; length 0 for rounding."""
    best, longest = r, 0.0
    for i in range(r, len(least)):
        square = 0.0
        for j in range(first, rows.shape[1]):
            square += rows[i, j] * rows[i, j]
        if np.sqrt(square) > max(longest, least[i]):
            best, longest = i, np.sqrt(square)
    return best, longest


@inner
def _reflect(rows, first, r, length):
    """Rotate the controls so that row r reads only the first of them (Householder)."""
    z = rows.shape[1]
    v = rows[r].copy()
    v[first] += length if v[first] > 0.0 else -length
    square = 0.0
    for j in range(first, z):
        square += v[j] * v[j]
    for i in range(r, len(rows)):
        along = 0.0
        for j in range(first, z):
            along += rows[i, j] * v[j]
        along *= 2.0 / square
        for j in range(first, z):
            rows[i, j] -= along * v[j]
    for j in range(first + 1, z):
        rows[r, j] = 0.0


@inner
def _remove(rows, at, r, p, n, largest):
    """Eliminate the control of row r from all rows below it."""
    for i in range(r + 1, p):
        factor = rows[i, at] / rows[r, at]
        rows[i, at] = 0.0
        for j in range(n):
            taken = factor * rows[r, j]
            size = max(abs(rows[i, j]), abs(taken))
            rows[i, j] -= taken
            largest[i] = max(largest[i], abs(taken))
            if abs(rows[i, j]) <= ROUNDING * size:
                rows[i, j] = 0.0


@inner
def _left_over(rows, r, p, n, least):
    """Return rows r to p that constrain the state, with a largest entry of one."""
    sizes, count = np.zeros(p), 0
    for i in range(r, p):
        for j in range(n):
            sizes[i] = max(sizes[i], abs(rows[i, j]))
        if sizes[i] > least[i]:
            count += 1
    kept, at = np.empty((count, n)), 0
    for i in range(r, p):
        if sizes[i] > least[i]:
            for j in range(n):
                kept[at, j] = rows[i, j] / sizes[i]
            at += 1
    return kept


@inner
def _independent(C):
    """Return independent rows that span C, at most as many as states."""
    rows, n = C.copy(), C.shape[1]
    for r in range(min(rows.shape)):
        i, j = _largest(rows, r)
        pivot = rows[i, j]
        if abs(pivot) <= DEPENDENT:
            return rows[:r].copy()
        for a in range(n):
            rows[i, a], rows[r, a] = rows[r, a], rows[i, a] / pivot
        for k in range(r + 1, len(rows)):
            factor = rows[k, j]
            for a in range(n):
                rows[k, a] -= factor * rows[r, a]
    return rows[:n].copy()


@inner
def _largest(rows, first):
    """Return the index of the largest entry of the rows from `first` on."""
    i, j = first, 0
    for k in range(first, len(rows)):
        for a in range(rows.shape[1]):
            if abs(rows[k, a]) > abs(rows[i, j]):
                i, j = k, a
    return i, j


@inner
def _reduced(M, i, n, little, is_lifted):
    """Compute row i of the Cholesky factor of M's block after n; return the sign."""
    pivot = M[i, i] + (little if is_lifted else 0.0)
    for j in range(n, i):
        pivot -= M[j, i] * M[j, i]
    if not np.isfinite(pivot):
        return _UNKNOWN
    if pivot <= (0.0 if is_lifted else little):
        return _FALLING if is_lifted or pivot < -little else _FLAT
    root = np.sqrt(pivot)
    for a in range(len(M)):
        if a < n or a > i:
            for j in range(n, i):
                M[i, a] -= M[j, i] * M[j, a]
            M[i, a] /= root
    M[i, i] = root
    return _STRICT


@inner
def _seen(J, W, V, T):
    """Return T' (W + J' V J) T, the curvature of a stage and of all later stages."""
    G = _product(J, T)
    WT, VG = _product(W, T), _product(V, G)
    size = T.shape[1]
    out = np.zeros((size, size))
    for i in range(size):
        for j in range(i + 1):
            for k in range(len(T)):
                out[i, j] += T[k, i] * WT[k, j]
            for k in range(len(G)):
                out[i, j] += G[k, i] * VG[k, j]
            out[j, i] = out[i, j]
    return out


@inner
def _size(J, W, V, T, i):
    """Return the sum of absolute terms of entry (i, i) of T' (W + J' V J) T."""
    n, z = J.shape
    moved, total = np.zeros(n), 0.0
    for a in range(z):
        for k in range(n):
            moved[k] += abs(J[k, a] * T[a, i])
        for b in range(z):
            total += abs(T[a, i] * W[a, b] * T[b, i])
    for k in range(n):
        for b in range(n):
            total += abs(moved[k] * V[k, b] * moved[b])
    return total


@inner
def _product(A, B):
    out = np.zeros((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            for j in range(B.shape[1]):
                out[i, j] += A[i, k] * B[k, j]
    return out
