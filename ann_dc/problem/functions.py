r"""The problem's own NumPy functions and their exact derivatives, straight from SymPy.

The certificate and the start point use these, not the network, so that a network which was wired
wrongly cannot certify itself. Stages are the last axis: q has shape (n, N), u (m, N).
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import sympy as sp


class Derivatives(NamedTuple):
    """Map and cost of all stages with their derivatives, and the Hessian of l + mu' f."""

    map: np.ndarray
    """(n, N): f(q_k, u_k)."""
    jacobian: np.ndarray
    """(n, n+m, N): of the map, in (q, u)."""
    cost: np.ndarray
    """(N,): l(q_k, u_k)."""
    gradient: np.ndarray
    """(n+m, N): of the cost, in (q, u)."""
    hessian: np.ndarray
    """(n+m, n+m, N): of l + mu' f, in (q, u)."""


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

    def _inputs_of(self, stages: int) -> list[np.ndarray]:
        return [np.asarray(v)[:stages] for v in self._inputs.values()]

    def map(self, q, u):
        """f(q_k, u_k), shape (n, N)."""
        return self.derivatives(q, u, np.zeros_like(q, float)).map

    def derivatives(self, q, u, mu) -> Derivatives:
        """All that a stage says at (q, u), in one call; ``mu`` (n, N) weighs the map's Hessians."""
        function, constant, places = self._compiled.derivatives
        stages = q.shape[-1]
        table = np.empty((len(constant), stages))
        table[:] = constant[:, None]
        with np.errstate(all="ignore"):
            try:
                for place, value in zip(places, function(*q, *u, *self._inputs_of(stages), *mu)):
                    table[place] = value
            except ZeroDivisionError:  # a constant power of a constant zero
                table[:] = np.nan
        n, z = self._n, len(q) + len(u)
        own, slopes = n * z, z * z
        return Derivatives(
            map=table[:n],
            jacobian=table[n : n + own].reshape(n, z, stages),
            cost=table[n + own],
            gradient=table[n + own + 1 :][:z],
            hessian=table[-slopes:].reshape(z, z, stages),
        )

    def map_jacobian(self, q, u):
        """(F_k, B_k): df/dq of shape (n, n, N) and df/du of shape (n, m, N)."""
        jacobian = self.derivatives(q, u, np.zeros_like(q, float)).jacobian
        n = self._n
        return jacobian[:, :n], jacobian[:, n:]

    def cost(self, q, u):
        """Stage cost l(q_k, u_k), shape (N,)."""
        return self.derivatives(q, u, np.zeros_like(q, float)).cost

    def cost_gradient(self, q, u):
        """(dl/dq, dl/du) of shapes (n, N) and (m, N)."""
        gradient = self.derivatives(q, u, np.zeros_like(q, float)).gradient
        n = self._n
        return gradient[:n], gradient[n:]

    def hessian(self, q, u, mu):
        """Hessian of l + mu' f in (q, u), shape (n+m, n+m, N); ``mu`` has shape (n, N)."""
        return self.derivatives(q, u, mu).hessian

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
        try:
            return self._rolled_out(self._compiled.step, np.asarray(q_0, float), u)
        except (ArithmeticError, ValueError, TypeError):  # where NumPy has inf and nan
            with np.errstate(all="ignore"):
                return self._rolled_out(self._compiled.step_of_arrays, np.asarray(q_0, float), u)

    def _rolled_out(self, step, q_0, u):
        states = [q_0.tolist()]
        for given in zip(*u.tolist(), *(values.tolist() for values in self._inputs_of(u.shape[1]))):
            states.append(step(*states[-1], *given))
        return np.array(states, float).T

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

    @cached_property
    def step(self):
        """The map of one stage, of numbers."""
        return sp.lambdify(self.arguments, self.f, modules="math", cse=True)

    @cached_property
    def step_of_arrays(self):
        """The map of one stage, which has inf and nan where numbers have errors."""
        function = sp.lambdify(self.arguments, self.f, modules="numpy", cse=True)
        return lambda *given: function(*map(np.float64, given))

    @cached_property
    def derivatives(self):
        """A function of what varies, all entries with the values of those that do not, its places.

        Entries are those of `Derivatives`, one after the other.
        """
        z, size = self.z, len(self.z)
        hamiltonian = self.l + sum(mu * f for mu, f in zip(self.multipliers, self.f))
        slopes = [_slope(hamiltonian, s) for s in z]
        half = {(i, j): _slope(slopes[i], z[j]) for i in range(size) for j in range(i + 1)}
        entries = [*self.f, *(_slope(f, s) for f in self.f for s in z)]
        entries += [self.l, *(_slope(self.l, s) for s in z)]
        entries += [half[max(i, j), min(i, j)] for i in range(size) for j in range(size)]
        entries = [sp.sympify(entry) for entry in entries]
        varying = [place for place, entry in enumerate(entries) if not entry.is_number]
        constant = [_number(entry) if entry.is_number else math.nan for entry in entries]
        arguments = [*self.arguments, *self.multipliers]
        told = [entries[place] for place in varying]
        function = sp.lambdify(arguments, told, modules="numpy", cse=True)
        return function, np.array(constant), varying

    @cached_property
    def terminal(self):
        states, cost = self.states, self.l_N
        gradient = [_slope(cost, s) for s in states]
        hessian = [_slope(slope, s) for slope in gradient for s in states]
        arguments = [*states, *self.inputs]
        return sp.lambdify(arguments, [cost, *gradient, *hessian], modules="numpy", cse=True)


def _number(entry: sp.Expr) -> float:
    try:
        return float(entry)
    except TypeError:  # complex, or no number at all
        return math.nan


def _slope(formula: Any, symbol: sp.Symbol) -> Any:
    """d formula / d symbol; SymPy takes its time where that is zero."""
    return formula.diff(symbol) if symbol in formula.free_symbols else sp.S.Zero


@lru_cache(maxsize=64)
def _compiled(*declared) -> _Compiled:
    """Problems of the same formulas share what is compiled of them."""
    return _Compiled(*declared)
