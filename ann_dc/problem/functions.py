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


class Rows(NamedTuple):
    """Inequality rows g(q_k, u_k) of all stages with their derivatives."""

    value: np.ndarray
    """(r, N)."""
    jacobian: np.ndarray
    """(r, n+m, N): in (q, u)."""


class EndRows(NamedTuple):
    """Inequality rows of q_N with their derivatives."""

    value: np.ndarray
    """(r_e,)."""
    jacobian: np.ndarray
    """(r_e, n)."""


class ProblemFunctions:
    """Vectorised map, cost, inequalities and derivatives of an optimal-control problem.

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
    rows : sequence of r expressions
        g(q_k, u_k), of inequalities g <= 0.
    end_rows : sequence of r_e expressions
        The same of q_N, with the inputs' values of the last stage.

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
        rows: Sequence[sp.Expr] = (),
        end_rows: Sequence[sp.Expr] = (),
    ) -> None:
        self._n, self._inputs = len(states), inputs
        formulas = tuple(f), cost, terminal_cost, tuple(rows), tuple(end_rows)
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
        stages = q.shape[-1]
        given = *q, *u, *self._inputs_of(stages), *mu
        table = self._compiled.derivatives.filled(given, stages)
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
        values = np.array(self._compiled.terminal(*q_N, *self._last_inputs), float)
        return values[0], values[1 : n + 1], values[n + 1 :].reshape(n, n)

    def rows(self, q, u) -> Rows:
        """Inequality rows g(q_k, u_k) of every stage, with their slopes in (q, u)."""
        stages, z, r = q.shape[-1], len(q) + len(u), len(self._compiled.g)
        table = self._compiled.rows.filled([*q, *u, *self._inputs_of(stages)], stages)
        return Rows(table[:r], table[r:].reshape(r, z, stages))

    def rows_hessian(self, q, u, zeta):
        """Hessian of zeta' g in (q, u), shape (n+m, n+m, N); ``zeta`` has shape (r, N)."""
        stages, z = q.shape[-1], len(q) + len(u)
        given = [*q, *u, *self._inputs_of(stages), *zeta]
        return self._compiled.rows_hessian.filled(given, stages).reshape(z, z, stages)

    def end_rows(self, q_N) -> EndRows:
        """Inequality rows of q_N (n,), with their slopes."""
        n, r = self._n, len(self._compiled.g_N)
        table = self._compiled.end_rows.filled([*q_N, *self._last_inputs], 1)[:, 0]
        return EndRows(table[:r], table[r:].reshape(r, n))

    def end_rows_hessian(self, q_N, zeta):
        """Hessian (n, n) of zeta' g at q_N (n,); ``zeta`` has shape (r_e,)."""
        n, given = self._n, [*q_N, *self._last_inputs, *zeta]
        return self._compiled.end_rows_hessian.filled(given, 1).reshape(n, n)

    @property
    def _last_inputs(self) -> list[np.ndarray]:
        return [np.asarray(v)[-1] for v in self._inputs.values()]

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

    def in_library(self, modules) -> tuple[Callable, ...]:
        """What the problem says, computed by another library, one stage at a time.

        Parameters
        ----------
        modules : list
            Where the functions are looked up, as `sympy.lambdify` takes it.

        Returns
        -------
        tuple of five functions
            Map, stage cost, terminal cost, inequality rows and those of the end, of all states,
            controls and inputs as positional arguments; each gives a list.
        """
        own = self._compiled
        told = own.f, [own.l], [own.l_N], own.g, own.g_N
        return tuple(sp.lambdify(own.arguments, part, modules=modules) for part in told)


class _Table:
    """Expressions as rows of a table: compiled are those that vary, the others are numbers."""

    def __init__(self, arguments: Sequence[sp.Symbol], entries: Sequence[Any]) -> None:
        entries = [sp.sympify(entry) for entry in entries]
        self.places = [place for place, entry in enumerate(entries) if not entry.is_number]
        constant = [_number(entry) if entry.is_number else math.nan for entry in entries]
        self.constant = np.array(constant, float)
        told = [entries[place] for place in self.places]
        self.function = sp.lambdify(arguments, told, modules="numpy", cse=True)

    def filled(self, given: Sequence[Any], stages: int) -> np.ndarray:
        """Values (entries, stages) at arguments that are numbers or arrays (stages,)."""
        table = np.empty((len(self.constant), stages))
        table[:] = self.constant[:, None]
        with np.errstate(all="ignore"):
            try:
                for place, value in zip(self.places, self.function(*given)):
                    table[place] = value
            except ZeroDivisionError:  # a constant power of a constant zero
                table[:] = np.nan
        return table


class _Compiled:
    """Expressions and their derivatives, each compiled when it is first asked for."""

    def __init__(self, states, controls, inputs, f, cost, terminal_cost, rows, end_rows) -> None:
        self.states, self.inputs = list(states), list(inputs)
        self.f, self.l, self.l_N = list(f), cost, terminal_cost
        self.g, self.g_N = list(rows), list(end_rows)
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
    def derivatives(self) -> _Table:
        """The entries of `Derivatives`, one after the other."""
        z = self.z
        hamiltonian = self.l + sum(mu * f for mu, f in zip(self.multipliers, self.f))
        entries = [*self.f, *(_slope(f, s) for f in self.f for s in z)]
        entries += [self.l, *(_slope(self.l, s) for s in z), *_hessian(hamiltonian, z)]
        return _Table([*self.arguments, *self.multipliers], entries)

    @cached_property
    def rows(self) -> _Table:
        return _Table(self.arguments, [*self.g, *(_slope(g, s) for g in self.g for s in self.z)])

    @cached_property
    def rows_hessian(self) -> _Table:
        weighted, zeta = _weighted(self.g)
        return _Table([*self.arguments, *zeta], _hessian(weighted, self.z))

    @cached_property
    def end_rows(self) -> _Table:
        slopes = [_slope(g, s) for g in self.g_N for s in self.states]
        return _Table([*self.states, *self.inputs], [*self.g_N, *slopes])

    @cached_property
    def end_rows_hessian(self) -> _Table:
        weighted, zeta = _weighted(self.g_N)
        return _Table([*self.states, *self.inputs, *zeta], _hessian(weighted, self.states))

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


def _weighted(rows: Sequence[sp.Expr]) -> tuple[Any, list[sp.Dummy]]:
    """zeta' g, and zeta."""
    zeta = [sp.Dummy(f"zeta_{i}") for i in range(len(rows))]
    return sum((z * g for z, g in zip(zeta, rows)), start=sp.S.Zero), zeta


def _hessian(formula: Any, z: Sequence[sp.Symbol]) -> list[Any]:
    """The second derivatives in z, row by row."""
    slopes, size = [_slope(formula, s) for s in z], len(z)
    half = {(i, j): _slope(slopes[i], z[j]) for i in range(size) for j in range(i + 1)}
    return [half[max(i, j), min(i, j)] for i in range(size) for j in range(size)]


def _slope(formula: Any, symbol: sp.Symbol) -> Any:
    """d formula / d symbol; SymPy takes its time where that is zero."""
    return formula.diff(symbol) if symbol in formula.free_symbols else sp.S.Zero


@lru_cache(maxsize=64)
def _compiled(*declared) -> _Compiled:
    """Problems of the same formulas share what is compiled of them."""
    return _Compiled(*declared)
