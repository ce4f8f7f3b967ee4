"""Multipliers of an optimum that was found elsewhere, by the costate recursion."""

import numpy as np


def costates(problem, q: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """mu and beta (n, N) at states ``q`` (n, N+1) and controls ``u`` (m, N).

    mu_{k-1} = F_k' mu_k + dl/dq_k runs backward from an end that is the gradient of the terminal
    cost where q_d is free, and otherwise whatever makes the gradients of the controls vanish.
    """
    functions, N, n = problem.functions, problem.horizon, problem.n
    F, B = functions.map_jacobian(q[:, :-1], u)
    cost_q, cost_u = functions.cost_gradient(q[:, :-1], u)
    fixed = np.array(problem.fixed)
    _, slope, _ = functions.terminal(q[:, -1])
    reach, rest = np.zeros((N, n, n)), np.zeros((N, n))  # mu_k = reach_k mu_{N-1} + rest_k
    reach[-1], rest[-1] = np.diag(fixed.astype(float)), np.where(fixed, 0.0, slope)
    for k in range(N - 1, 0, -1):
        reach[k - 1] = F[:, :, k].T @ reach[k]
        rest[k - 1] = F[:, :, k].T @ rest[k] + cost_q[:, k]
    rows = np.concatenate([B[:, :, k].T @ reach[k] for k in range(N)])
    gaps = np.concatenate([cost_u[:, k] + B[:, :, k].T @ rest[k] for k in range(N)])
    last = np.linalg.lstsq(rows, -gaps, rcond=None)[0]
    mu = (reach @ last + rest).T
    return mu, np.column_stack([np.zeros(n), -mu[:, :-1]])
