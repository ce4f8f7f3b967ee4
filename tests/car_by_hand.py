"""The paper's car, stage by stage, in NumPy alone: no network, no symbols. D = 1, c/m = 1."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import root

A, DT = 0.99, 0.1
"""1 - gamma dt and dt of (22)."""


def control_matrix(q: np.ndarray) -> np.ndarray:
    """B(q) of (22)."""
    _, _, phi, varphi = q
    return np.array([[np.cos(phi), 0], [np.sin(phi), 0], [np.tan(varphi), 0], [0, 1]])


def step(q: np.ndarray, u: np.ndarray) -> np.ndarray:
    """(22)."""
    return A * q + DT * control_matrix(q) @ u


def state_matrix(q: np.ndarray, u: np.ndarray) -> np.ndarray:
    """df/dq, with the term d(Bu)/dq."""
    _, _, phi, varphi = q
    F = A * np.eye(4)
    F[0, 2], F[1, 2] = -DT * u[0] * np.sin(phi), DT * u[0] * np.cos(phi)
    F[2, 3] = DT * u[0] / np.cos(varphi) ** 2
    return F


def stage_equations(q, u, mu, t, beta) -> np.ndarray:
    """(11), (12), (13), corrected, on the plain Lagrangian."""
    return np.concatenate(
        [
            state_matrix(q, u).T @ mu + beta,
            u + DT * control_matrix(q).T @ mu,
            step(q, u) - t,
        ]
    )


def solved_stage(t: np.ndarray, beta: np.ndarray, near: np.ndarray) -> np.ndarray:
    """(q, u, mu) of a stage (10,) that is told t and beta, the solution next to a guess."""
    residual: Callable = lambda z: stage_equations(z[:4], z[4:6], z[6:], t, beta)  # noqa: E731
    found = root(residual, near, tol=1e-13)
    assert np.abs(residual(found.x)).max() < 1e-9
    return found.x
