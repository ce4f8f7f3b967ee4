r"""Distance to the optimum, estimated by a Newton step of the KKT conditions.

A residual is relative to one scale for all components, so errors of a small state or a cheap
control are hidden by large components. The step that makes every residual vanish,

.. math::
    \begin{pmatrix} W & A^T \\ A & 0 \end{pmatrix}
    \begin{pmatrix} \delta z \\ \delta \mu \end{pmatrix}
    = -\begin{pmatrix} \nabla_z L \\ c \end{pmatrix}, \qquad
    z = (q_0, \ldots, q_N, u_0, \ldots, u_{N-1}) \text{ where they are free},

has the units of each component and is compared with the range of that component. If the step leads
to zero, the optimum has no range, and a fraction of the component's scale replaces it. With the
unknowns ordered (q_k, u_k, mu_k) by stage, the matrix is banded and the run time is linear in N.

Active inequalities are equations of the step; their multipliers are unknowns of their stage. A
constraint whose multiplier would become negative is released, and the step is repeated. A point
held by a constraint with a wrong multiplier sign is therefore not accepted, however small that
multiplier is. The equation of a compliant constraint is g - d zeta = 0.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.linalg import get_lapack_funcs

from ann_dc.optimality.expansion import Expansion

(solve_band,) = get_lapack_funcs(("gbsv",), dtype=np.float64)

SINGULAR = 1e-13
"""Smallest pivot ratio of a regular matrix.

Rounding turns zero into 1e-17; problems with one optimum stay above 1e-5.
"""

SMALL = 1e-6
"""Smallest reference range of a component relative to the largest component's range."""

VANISHES = 1e-3
"""Component after a step, relative to the step, below which its range is zero and is replaced."""

OF_STATE, OF_CONTROL = 1e-3, 1e-5
"""Fractions of the scales that replace a range.

Residuals of 1e-9 of a state's scale, admissible for a certified point at every stage, add up along
the stages. A residual of 1e-8 of a largest gradient of 0.1 moves a control by 1e-9.
"""

YIELD = 1e-9
"""Compliance of a constraint with unit gradient, in scales: dependent ones divide their load."""

EQUILIBRATIONS = 3
"""Sweeps of the equilibration (Ruiz scaling) of a band."""

RELEASES = 20
"""Largest number of releases of constraints."""


def newton_step(expansion: Expansion, q: np.ndarray) -> float:
    """Return the largest relative Newton step of a state or control component.

    The result is max_i |step of component i| / max(range of component i), over all stages. If the
    step leads to zero, a fraction of the scale (`OF_STATE`, `OF_CONTROL`) replaces the range. The
    result is nan if the KKT matrix is singular. The expansion is that at q (n, N+1), in the user's
    units.
    """
    gap = (expansion.map - q[:, 1:]).T / expansion.state
    step, n, z = _step(expansion, gap), len(q), expansion.slope.shape[1]
    of_states = _relative(step[:, :n], expansion.q, OF_STATE)
    of_controls = _relative(step[:-1, n:z], expansion.u, OF_CONTROL)
    return float(np.maximum(of_states, of_controls))


def _step(expansion: Expansion, gap: np.ndarray) -> np.ndarray:
    """Return the step (N+1, 2n+m+R) of all unknowns; nan if it is not defined."""
    contact, z = expansion.contact, expansion.slope.shape[1]
    if contact is None:
        return solved(*banded_system(expansion, gap))
    held = contact.near & contact.slope.any(axis=-1)
    for _ in range(RELEASES):
        contact = contact.only(held)
        step = solved(*banded_system(replace(expansion, contact=contact), gap))
        pulls = contact.multiplier + step[:, z : z + held.shape[1]]
        if not (held & (pulls < 0.0)).any():
            return step
        held = held & ~(pulls < 0.0)
    return np.full((len(held), len(expansion.state) + z + held.shape[1]), np.nan)


def banded_system(expansion: Expansion, gap: np.ndarray):
    """Return the banded KKT matrix, the right-hand side (N+1, 2n+m+R) and a mask of its unknowns.

    Block k is (q_k, u_k, zeta_k, mu_k); the last one is q_N and zeta_N. The band has LAPACK's
    layout, transposed: column j has entry (i, j) at 2 w + i - j, with w entries on either side of
    the diagonal. A fixed component has a row and a column of the identity.
    """
    stages, n, z = expansion.jacobian.shape
    contact, each = expansion.contact, np.arange(n)
    at = z + (0 if contact is None else contact.value.shape[1])
    w = n + at - 1
    band = np.zeros((stages + 1, n + at, 3 * w + 1))
    band[:stages, *_places(w, 0, 0, z, z)] = expansion.hessian
    band[:stages, *_places(w, at, 0, n, z)] = expansion.jacobian
    band[:stages, *_places(w, 0, at, z, n)] = expansion.jacobian.swapaxes(1, 2)
    band[:stages, at + each, 2 * w + n] = -1.0
    band[1:, each, 2 * w - n] = -1.0
    band[stages, *_places(w, 0, 0, n, n)] = expansion.end_hessian
    right = np.zeros((stages + 1, n + at))
    right[:stages, :z] = -expansion.own_slope()
    right[stages, :n] = -expansion.own_end_slope()
    right[1:, :n] += expansion.mu
    right[:stages, at:] = -gap
    held = b""
    if contact is not None:
        band[:, *_places(w, z, 0, at - z, z)] = contact.slope
        band[:, *_places(w, 0, z, z, at - z)] = contact.slope.swapaxes(1, 2)
        band[:, z:at, 2 * w] = -YIELD - contact.compliance
        right[:, z:at] = -contact.value
        held = contact.is_row.tobytes()
    fixed = expansion.fixed_start.tobytes(), expansion.fixed.tobytes()
    unit, columns, entries, is_there = _fixed(stages, n, z, *fixed, held)
    band = band.reshape(-1, 3 * w + 1)
    band[columns, entries] = 0.0
    band[unit] = 0.0
    band[unit, 2 * w] = 1.0
    right[~is_there] = 0.0
    return band, right, is_there


@lru_cache(maxsize=64)
def _fixed(stages: int, n: int, z: int, start: bytes, end: bytes, held: bytes):
    """Return columns and band indices of fixed unknowns, and the mask of the others."""
    rows = np.frombuffer(held, bool).reshape(stages + 1, -1)
    at = z + rows.shape[1]
    w = n + at - 1
    is_there = np.ones((stages + 1, n + at), bool)
    is_there[0, :n], is_there[stages, :n] = (~np.frombuffer(f, bool) for f in (start, end))
    is_there[stages, n:] = False
    is_there[:, z:at] = rows
    fixed = np.flatnonzero(~is_there)
    near = np.clip(fixed[:, None] + np.arange(-w, w + 1), 0, is_there.size - 1)
    return fixed, near, 2 * w + fixed[:, None] - near, is_there


@lru_cache(maxsize=256)
def _places(w: int, row: int, column: int, rows: int, columns: int):
    """Return the band indices of a block that begins at `row` and `column`."""
    i, j = row + np.arange(rows)[:, None], column + np.arange(columns)
    return np.broadcast_to(j, (rows, columns)), 2 * w + i - j


def equilibrated(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the band D K D with row maxima near one, and the diagonal of D.

    Ruiz scaling of a symmetric matrix; barrier terms span many orders of magnitude.
    """
    size, width = columns.shape
    w = width // 3
    entry = np.arange(w, width)
    other = np.clip(np.arange(size)[:, None] + entry - 2 * w, 0, size - 1)
    factors, magnitude = np.ones(size), np.abs(columns[:, w:])
    for _ in range(EQUILIBRATIONS):
        largest = (magnitude * factors[other]).max(axis=1) * factors
        factors /= np.sqrt(np.where(largest > 0.0, largest, 1.0))
    scaled = columns.copy()
    scaled[:, w:] *= factors[other] * factors[:, None]
    return scaled, factors


def solved(
    columns: np.ndarray, right: np.ndarray, is_there: np.ndarray, least: float = SINGULAR
) -> np.ndarray:
    """Solve for the step; nan if a pivot is at most ``least`` times the largest."""
    w = columns.shape[1] // 3
    factors, _, step, flaw = solve_band(w, w, columns.T, right.ravel(), overwrite_ab=True)
    pivots = np.abs(factors[2 * w, is_there.ravel()])
    if flaw != 0 or not pivots.min() > least * pivots.max():
        return np.full(right.shape, np.nan)
    return step.reshape(right.shape)


def _relative(moves: np.ndarray, values: np.ndarray, least: float) -> float:
    """Return the largest step (N, components) of a component relative to its range."""
    moved, size, left = (np.abs(x).max(axis=0) for x in (moves, values, values + moves))
    floor = SMALL * np.maximum(size.max(), SMALL)
    size = np.maximum(size, np.where(left < VANISHES * moved, np.maximum(least, floor), floor))
    return (moved / size).max()
