r"""The problem's own NumPy functions and their exact derivatives, straight from SymPy.

The certificate and the start point use these, not the network, so that a network which was wired
wrongly cannot certify itself. Stages are the last axis: q has shape (n, N), u (m, N).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp


class ProblemFunctions:
    """Vectorised map, cost and derivatives of an optimal-control problem.

    Every method takes ``q`` (n, N) and ``u`` (m, N) and evaluates all stages at once.

    Parameters
    ----------
    states, controls : sequence of n and of m symbols
    inputs : mapping of symbol to (N,) array
        Further symbols of the expressions, with their values at every stage.
    f : sequence of n expressions
        The map q_{k+1} = f(q_k, u_k).
    cost : expression
        Stage cost l(q_k, u_k).
    terminal_cost : expression
        l_N(q_N), with the inputs' values of the last stage.
    """

    def __init__(
        self,
        *,
        states: Sequence[sp.Symbol],
        controls: Sequence[sp.Symbol],
        inputs: Mapping[sp.Symbol, np.ndarray],
        f: Sequence[sp.Expr],
        cost: sp.Expr,
        terminal_cost: sp.Expr,
    ) -> None:
        self._states, self._inputs = list(states), inputs
        self._f, self._l, self._l_N = list(f), cost, terminal_cost
        self._z = [*states, *controls]
        self._arguments = [*self._z, *inputs]
        self._multipliers = sp.symbols(f"mu_0:{len(states)}", cls=sp.Dummy)

    def _compile(self, expressions, extra=()):
        shape = np.shape(np.asarray(expressions, dtype=object))
        flat = list(np.asarray(expressions, dtype=object).ravel())
        return sp.lambdify([*self._arguments, *extra], flat, modules="numpy", cse=True), shape

    def _call(self, compiled, q, u, *extra):
        function, shape = compiled
        stages = q.shape[-1]
        inputs = [np.asarray(v)[:stages] for v in self._inputs.values()]
        with np.errstate(all="ignore"):
            try:
                values = function(*q, *u, *inputs, *extra)
            except ZeroDivisionError:  # a constant power of a constant zero
                return np.full((*shape, stages), np.nan)
        return np.array([np.broadcast_to(v, (stages,)) for v in values], float).reshape(
            *shape, stages
        )

    @cached_property
    def _map(self):
        return self._compile(self._f)

    @cached_property
    def _map_jacobian(self):
        return self._compile(sp.Matrix(self._f).jacobian(self._z).tolist())

    @cached_property
    def _cost(self):
        return self._compile([self._l])

    @cached_property
    def _cost_gradient(self):
        return self._compile([self._l.diff(s) for s in self._z])

    @cached_property
    def _hessian(self):
        hamiltonian = self._l + sum(mu * f for mu, f in zip(self._multipliers, self._f))
        return self._compile(sp.hessian(hamiltonian, self._z).tolist(), self._multipliers)

    @cached_property
    def _terminal(self):
        states, cost = self._states, self._l_N
        gradient = [cost.diff(s) for s in states]
        hessian = [cost.diff(a, b) for a in states for b in states]
        arguments = [*states, *self._inputs]
        return sp.lambdify(arguments, [cost, *gradient, *hessian], modules="numpy", cse=True)

    def map(self, q, u):
        """f(q_k, u_k), shape (n, N)."""
        return self._call(self._map, q, u)

    def map_jacobian(self, q, u):
        """(F_k, B_k): df/dq of shape (n, n, N) and df/du of shape (n, m, N)."""
        jacobian = self._call(self._map_jacobian, q, u)
        n = len(self._states)
        return jacobian[:, :n], jacobian[:, n:]

    def cost(self, q, u):
        """Stage cost l(q_k, u_k), shape (N,)."""
        return self._call(self._cost, q, u)[0]

    def cost_gradient(self, q, u):
        """(dl/dq, dl/du) of shapes (n, N) and (m, N)."""
        gradient = self._call(self._cost_gradient, q, u)
        n = len(self._states)
        return gradient[:n], gradient[n:]

    def hessian(self, q, u, mu):
        """Hessian of l + mu' f in (q, u), shape (n+m, n+m, N); ``mu`` has shape (n, N)."""
        return self._call(self._hessian, q, u, *mu)

    def terminal(self, q_N):
        """(l_N, gradient (n,), Hessian (n, n)) of the terminal cost at q_N (n,)."""
        n = len(self._states)
        inputs = [np.asarray(v)[-1] for v in self._inputs.values()]
        values = np.array(self._terminal(*q_N, *inputs), float)
        return values[0], values[1 : n + 1], values[n + 1 :].reshape(n, n)

    def objective(self, q, u):
        """Total cost of a trajectory: ``q`` (n, N+1) with q_N, ``u`` (m, N)."""
        return float(self.cost(q[:, :-1], u).sum() + self.terminal(q[:, -1])[0])

    def rollout(self, q_0, u):
        """States (n, N+1) that the controls ``u`` (m, N) produce from ``q_0`` (n,) through f."""
        q = np.empty((len(self._states), u.shape[1] + 1))
        q[:, 0] = q_0
        function, _ = self._map
        inputs: list[Any] = list(self._inputs.values())
        for k in range(u.shape[1]):
            with np.errstate(all="ignore"):
                q[:, k + 1] = function(*q[:, k], *u[:, k], *(v[k] for v in inputs))
        return q

    def in_library(self, modules) -> tuple[Callable, Callable, Callable]:
        """Map, stage cost and terminal cost computed by another library, one stage at a time.

        Parameters
        ----------
        modules : list
            Where the functions are looked up, as `sympy.lambdify` takes it.

        Returns
        -------
        tuple of three functions
            Of all states, controls and inputs, as positional arguments; each gives a list.
        """
        return (
            sp.lambdify(self._arguments, self._f, modules=modules),
            sp.lambdify(self._arguments, [self._l], modules=modules),
            sp.lambdify(self._arguments, [self._l_N], modules=modules),
        )
