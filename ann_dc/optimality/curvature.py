r"""How strict is a minimum? The smallest eigenvalue of the reduced Hessian, for who asks for it.

The states are eliminated through the linearised plant, so the matrix is that of the controls and of
what q_0 leaves free, restricted to those that keep the fixed end and the inequalities that are
strongly active. It is dense: its eigenvalues take
a time that grows with the third power of N, where `by_stages` tells their sign in a linear one.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from ann_dc.optimality.expansion import Expansion
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.validation.checked import checked

LARGEST_REDUCED = 2000
"""Number of control values above which it is left out."""


@checked
def smallest_curvature(
    problem: OptimalControlProblem,
    q: np.ndarray,
    u: np.ndarray,
    mu: np.ndarray,
    zeta: np.ndarray | None = None,
    zeta_end: np.ndarray | None = None,
) -> float:
    """Smallest eigenvalue of the reduced Hessian relative to its largest, in `natural_scales`.

    Parameters
    ----------
    problem : OptimalControlProblem
    q : (n, N+1) array
        States with the end.
    u : (m, N) array
    mu : (n, N) array
        Multipliers of the map.
    zeta : (r, N) array, optional
        Of the inequalities; zero where they are not given.
    zeta_end : (r_e,) array, optional
        Of those of the end.

    Returns
    -------
    float
        inf where what has to hold leaves no freedom; nan where it is not finite, or N m is above
        `LARGEST_REDUCED`.

    Examples
    --------
    Least effort of a double integrator costs the same along every direction:

    >>> from ann_dc import plants
    >>> problem = plants.double_integrator(N=5)
    >>> round(smallest_curvature(problem, np.zeros((2, 6)), np.zeros((1, 5)), np.zeros((2, 5))), 9)
    1.0
    """
    if u.size > LARGEST_REDUCED:
        return float("nan")
    expansion = Expansion.at(problem, q, u, mu, zeta, zeta_end).condensed()
    with np.errstate(all="ignore"):
        total, held = _reduced(expansion)
    if not np.isfinite(total).all():
        return float("nan")
    tangent = scipy.linalg.null_space(held) if len(held) else np.eye(len(total))
    if tangent.shape[1] == 0:  # no freedom: trivially a minimum
        return float("inf")
    values = np.linalg.eigvalsh(tangent.T @ total @ tangent)
    return float(values[0] / max(abs(values[-1]), 1e-300))


def _reduced(expansion: Expansion) -> tuple[np.ndarray, np.ndarray]:
    """The Hessian in all that is chosen, q_0 as far as it is free before all u; rows held there."""
    stages, n, z = expansion.jacobian.shape
    untied = np.flatnonzero(~expansion.fixed_start)
    size = len(untied) + stages * (z - n)
    reach, total = np.zeros((n, size)), np.zeros((size, size))
    reach[untied, np.arange(len(untied))] = 1.0
    rows, held = expansion.active_rows()[0], []
    for k, (J, W) in enumerate(zip(expansion.jacobian, expansion.hessian)):
        before = len(untied) + k * (z - n)
        own = np.zeros((z - n, size))
        own[:, before : before + z - n] = np.eye(z - n)
        moved = np.concatenate([reach, own])
        held.append(rows[k][rows[k].any(axis=1)] @ moved)
        seen = moved[:, : before + z - n]
        total[: before + z - n, : before + z - n] += seen.T @ W @ seen
        reach = J @ moved
    held += [rows[-1][rows[-1].any(axis=1)][:, :n] @ reach, reach[expansion.fixed]]
    return total + reach.T @ expansion.end_hessian @ reach, np.concatenate(held)
