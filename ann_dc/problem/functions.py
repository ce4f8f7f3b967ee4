r"""The problem's own NumPy functions and their exact derivatives, straight from SymPy.

The certificate and the start point use these, not the network, so that a network which was wired
wrongly cannot certify itself. Stages are the last axis: q has shape (n, N), u (m, N).
"""

from __future__ import annotations

import copy
import itertools
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, lru_cache
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

    Examples
    --------
    >>> from ann_dc import plants
    >>> functions = plants.double_integrator(N=3).functions
    >>> functions.rollout([0, 0], np.ones((1, 3))).round(3)
    array([[0.  , 0.  , 0.01, 0.03],
           [0.  , 0.1 , 0.2 , 0.3 ]])
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
        self._n, self._inputs = len(states), inputs
        formulas = tuple(f), cost, terminal_cost
        self._compiled = _compiled(tuple(states), tuple(controls), tuple(inputs), *formulas)

    def with_inputs(self, inputs: Mapping[sp.Symbol, np.ndarray]) -> ProblemFunctions:
        """The same functions, compiled once for both, with other values of the inputs.

        Parameters
        ----------
        inputs : mapping of symbol to (N,) array
            For the same symbols, in the same order.
        """
        other = copy.copy(self)
        other._inputs = inputs
        return other

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

    def map(self, q, u):
        """f(q_k, u_k), shape (n, N)."""
        return self._call(self._compiled.map, q, u)

    def map_jacobian(self, q, u):
        """(F_k, B_k): df/dq of shape (n, n, N) and df/du of shape (n, m, N)."""
        jacobian = self._call(self._compiled.map_jacobian, q, u)
        n = self._n
        return jacobian[:, :n], jacobian[:, n:]

    def cost(self, q, u):
        """Stage cost l(q_k, u_k), shape (N,)."""
        return self._call(self._compiled.cost, q, u)[0]

    def cost_gradient(self, q, u):
        """(dl/dq, dl/du) of shapes (n, N) and (m, N)."""
        gradient = self._call(self._compiled.cost_gradient, q, u)
        n = self._n
        return gradient[:n], gradient[n:]

    def hessian(self, q, u, mu):
        """Hessian of l + mu' f in (q, u), shape (n+m, n+m, N); ``mu`` has shape (n, N)."""
        return self._call(self._compiled.hessian, q, u, *mu)

    def terminal(self, q_N):
        """(l_N, gradient (n,), Hessian (n, n)) of the terminal cost at q_N (n,)."""
        n = self._n
        inputs = [np.asarray(v)[-1] for v in self._inputs.values()]
        values = np.array(self._compiled.terminal(*q_N, *inputs), float)
        return values[0], values[1 : n + 1], values[n + 1 :].reshape(n, n)

    def objective(self, q, u):
        """Total cost of a trajectory: ``q`` (n, N+1) with q_N, ``u`` (m, N)."""
        return float(self.cost(q[:, :-1], u).sum() + self.terminal(q[:, -1])[0])

    def rollout(self, q_0, u):
        """States (n, N+1) that the controls ``u`` (m, N) produce from ``q_0`` (n,) through f."""
        q = np.empty((self._n, u.shape[1] + 1))
        q[:, 0] = q_0
        function, _ = self._compiled.map
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
        compiled = self._compiled
        return (
            sp.lambdify(compiled.arguments, compiled.f, modules=modules),
            sp.lambdify(compiled.arguments, [compiled.l], modules=modules),
            sp.lambdify(compiled.arguments, [compiled.l_N], modules=modules),
        )


class _Compiled:
    """Expressions and their derivatives, each compiled when it is first asked for."""

    def __init__(self, states, controls, inputs, f, cost, terminal_cost) -> None:
        self.states, self.inputs = list(states), list(inputs)
        self.f, self.l, self.l_N = list(f), cost, terminal_cost
        self.z = [*states, *controls]
        self.arguments = [*self.z, *inputs]
        self.multipliers = sp.symbols(f"mu_0:{len(self.states)}", cls=sp.Dummy)

    def _compile(self, expressions, extra=()):
        shape = np.shape(np.asarray(expressions, dtype=object))
        flat = list(np.asarray(expressions, dtype=object).ravel())
        return sp.lambdify([*self.arguments, *extra], flat, modules="numpy", cse=True), shape

    @cached_property
    def _slopes(self) -> list[list[Any]]:
        return [[_slope(f, s) for s in self.z] for f in self.f]

    @cached_property
    def _cost_slopes(self) -> list[Any]:
        return [_slope(self.l, s) for s in self.z]

    @cached_property
    def map(self):
        return self._compile(self.f)

    @cached_property
    def map_jacobian(self):
        return self._compile(self._slopes)

    @cached_property
    def cost(self):
        return self._compile([self.l])

    @cached_property
    def cost_gradient(self):
        return self._compile(self._cost_slopes)

    @cached_property
    def hessian(self):
        size = len(self.z)
        curvature = [[sp.S.Zero] * size for _ in self.z]
        for i, j in itertools.combinations_with_replacement(range(size), 2):
            bends = [_slope(row[i], self.z[j]) for row in self._slopes]
            weighted = [mu * bend for mu, bend in zip(self.multipliers, bends)]
            curvature[i][j] = sp.Add(_slope(self._cost_slopes[i], self.z[j]), *weighted)
            curvature[j][i] = curvature[i][j]
        return self._compile(curvature, self.multipliers)

    @cached_property
    def terminal(self):
        states, cost = self.states, self.l_N
        gradient = [_slope(cost, s) for s in states]
        hessian = [_slope(slope, s) for slope in gradient for s in states]
        arguments = [*states, *self.inputs]
        return sp.lambdify(arguments, [cost, *gradient, *hessian], modules="numpy", cse=True)


def _slope(formula: Any, symbol: sp.Symbol) -> Any:
    """d formula / d symbol; SymPy takes its time where that is zero."""
    return formula.diff(symbol) if symbol in formula.free_symbols else sp.S.Zero


@lru_cache(maxsize=64)
def _compiled(*declared) -> _Compiled:
    """Problems of the same formulas share what is compiled of them."""
    return _Compiled(*declared)
