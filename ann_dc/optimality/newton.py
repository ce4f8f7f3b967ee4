r"""How far is the optimum? The Newton step of the KKT conditions, from the problem's derivatives.

A residual is related to one scale for all components, so a small state or a cheap control can hide
behind a large one. The step that would make every residual vanish,

.. math::
    \begin{pmatrix} W & A^T \\ A & 0 \end{pmatrix}
    \begin{pmatrix} \delta z \\ \delta \mu \end{pmatrix}
    = -\begin{pmatrix} \nabla_z L \\ c \end{pmatrix}, \qquad
    z = (q_0, \ldots, q_N, u_0, \ldots, u_{N-1}) \text{ where they are free},

has the units of each component, and is compared with that component's own range.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from ann_dc.hints.checked import checked
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import natural_scales
from ann_dc.scale import Scale

SINGULAR = 1e-13
"""Smallest pivot over the largest below which a matrix is singular: rounding makes 1e-17 of zero,
and problems that have one optimum stay above 1e-5."""

SMALL = 1e-6
"""Share of the largest component's range that a component is related to at least."""


@checked
def newton_step(
    problem: OptimalControlProblem, q: np.ndarray, u: np.ndarray, mu: np.ndarray
) -> float:
    """Largest relative Newton step of a state or control component; nan where it is not defined.

    Parameters
    ----------
    problem : OptimalControlProblem
    q : (n, N+1) array
        States with the end.
    u : (m, N) array
    mu : (n, N) array
        Multipliers of the map.

    Returns
    -------
    float
        max_i |step of component i| / max(range of component i), over all stages. nan at a point
        where the KKT matrix is singular.

    Examples
    --------
    The optimal controls of a double integrator, and the same a little off:

    >>> from ann_dc import equilibrium, plants, synthesize
    >>> from ann_dc.evaluation import kkt_point
    >>> problem = plants.double_integrator(N=5)
    >>> network = synthesize(problem)
    >>> q, u, t, mu, _ = kkt_point(network, equilibrium(network, network.start_state))
    >>> states = np.c_[q, t[:, -1:]]
    >>> newton_step(problem, states, u, mu) < 1e-9 < newton_step(problem, states, 1.01 * u, mu)
    True
    """
    matrix, residual, states = _system(problem, q, u, mu)
    scales = natural_scales(problem)
    state, control = scales.state_factors, scales.control_factors
    unknowns = [np.tile(state, problem.horizon + 1)[states], np.tile(control, problem.horizon)]
    balance = np.concatenate([*unknowns, np.tile(scales.cost / state, problem.horizon)])
    scaled = sparse.diags_array(balance)
    step = balance * _solved((scaled @ matrix @ scaled).tocsc(), -balance * residual)
    n, m, stages = problem.n, problem.m, problem.horizon
    moves = np.zeros(n * (stages + 1))
    moves[states] = step[: states.sum()]
    controls = step[states.sum() :][: m * stages]
    return max(
        _relative(moves.reshape(stages + 1, n).T, q, scales.states),
        _relative(controls.reshape(stages, m).T, u, scales.controls),
    )


def _solved(matrix, right: np.ndarray) -> np.ndarray:
    """Solution of a square system; nan where the matrix is singular, to rounding."""
    try:
        factors = splu(matrix)
    except RuntimeError:  # exactly singular
        return np.full(len(right), np.nan)
    pivots = np.abs(factors.U.diagonal())
    if not pivots.min() > SINGULAR * pivots.max():
        return np.full(len(right), np.nan)
    return factors.solve(right)


def _system(problem: OptimalControlProblem, q, u, mu):
    """KKT matrix (sparse), residual, and which state components of q_0..q_N are free."""
    functions, n, stages = problem.functions, problem.n, problem.horizon
    F, B = functions.map_jacobian(q[:, :-1], u)
    hessian = np.moveaxis(functions.hessian(q[:, :-1], u, mu), -1, 0)
    cost_q, cost_u = functions.cost_gradient(q[:, :-1], u)
    _, end_slope, end_hessian = functions.terminal(q[:, -1])
    free = np.ones((stages + 1, n), bool)
    free[0], free[-1] = ~np.array(problem.fixed_start), ~np.array(problem.fixed)
    states = free.ravel()

    blocks = lambda parts: sparse.block_diag(list(parts), format="csr")  # noqa: E731
    here, after = (  # row k reads q_k, and q_{k+1}
        sparse.eye_array(n * stages, n * (stages + 1), k=places, format="csr") for places in (0, n)
    )
    A_q = blocks(np.moveaxis(F, -1, 0)) @ here - after
    A = sparse.hstack([A_q.tocsc()[:, states], blocks(np.moveaxis(B, -1, 0))])
    W_qq = here.T @ blocks(hessian[:, :n, :n]) @ here
    W_qq = W_qq + blocks([*np.zeros((stages, n, n)), end_hessian])
    W_qu = here.T @ blocks(hessian[:, :n, n:])
    W = sparse.block_array(
        [
            [W_qq.tocsr()[states][:, states], W_qu.tocsr()[states]],
            [W_qu.tocsr()[states].T, blocks(hessian[:, n:, n:])],
        ]
    )
    later = cost_q + np.einsum("ijk,ik->jk", F, mu)
    slope_q = np.column_stack([later, end_slope]) - np.column_stack([np.zeros(n), mu])
    slope_u = cost_u + np.einsum("ijk,ik->jk", B, mu)
    gap = functions.map(q[:, :-1], u) - q[:, 1:]
    residual = np.concatenate([slope_q.T.ravel()[states], slope_u.T.ravel(), gap.T.ravel()])
    return sparse.block_array([[W, A.T], [A, None]], format="csc"), residual, states


def _relative(moves: np.ndarray, values: np.ndarray, scales: tuple[Scale, ...]) -> float:
    """Largest move (components, N) of a component over its own range."""
    factor, offset = np.array(scales)[:, :, None].transpose(1, 0, 2)
    size = np.abs((values - offset) / factor).max(axis=1)
    size = np.maximum(size, SMALL * max(float(size.max()), SMALL))
    return float((np.abs(moves / factor).max(axis=1) / size).max())
