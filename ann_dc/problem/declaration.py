r"""What is to be solved: a discrete-time optimal-control problem, declared with SymPy symbols.

.. math::
    \min \sum_{k=0}^{N-1} l(q_k, u_k) + l_N(q_N)
    \quad\text{s.t.}\quad q_{k+1} = f(q_k, u_k),\; q_0 \text{ given},\;
    q_{N,i} = q_{d,i} \text{ where } q_{d,i} \text{ is fixed.}

This is (5), (7) and (23) of the paper with the terminal condition that those leave out.
"""

from __future__ import annotations

import keyword
import math
import numbers
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import sympy as sp

from ann_dc.errors import ProblemError
from ann_dc.problem.functions import ProblemFunctions

RESERVED_NAMES = frozenset(
    ("t", "mu", "beta", "k", "N", "one", "q_0", "q_d", "pi", "E", "I", "oo", "zoo", "nan", "inf")
).union(("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "sqrt"))
"""Names that the network or the expression language already uses."""

MAX_HORIZON = 1_000_000

NON_SMOOTH = (sp.Abs, sp.sign, sp.Max, sp.Min, sp.Piecewise, sp.Heaviside, sp.floor, sp.ceiling)


@dataclass(frozen=True, kw_only=True, eq=False)
class OptimalControlProblem:
    """A discrete-time optimal-control problem in the user's own symbols.

    Parameters
    ----------
    states, controls : sequence of sympy.Symbol
        The n components of q and the m components of u; each needs its own identifier.
    dynamics : sequence of n expressions, optional
        Continuous right-hand side F; the forward Euler rule (4) makes the map q + dt F(q, u).
    map : sequence of n expressions, optional
        The map f(q, u) = q_{k+1} itself. Give either ``dynamics`` or ``map``.
    dt : float
        Sampling interval in seconds. With ``map`` it only labels the time axis and says which
        factor the printed slips S4 and S6 leave out; it may then be left at 1.
    cost : expression
        Stage cost l(q, u), summed over k = 0..N-1.
    terminal_cost : expression
        Cost of the last state q_N, in the state symbols.
    horizon : int
        Number of stages N >= 1.
    q_0 : sequence of n floats
        The state at the start.
    q_d : sequence of n floats or None, or None
        The state to be reached; a component that is None is free, None frees all of them.
    inputs : mapping of sympy.Symbol to float or sequence of N floats
        Further symbols of cost and dynamics whose value (one for all stages, or one a stage) may
        change without rewiring the network: a reference, a weight, a measured disturbance.
    name : str
        What tables and files call the problem.

    Raises
    ------
    ProblemError
        With the name of the field, what was given, and what to do.

    References
    ----------
    Paper equations (4), (5), (7), (23).

    Examples
    --------
    >>> x, v, a = sp.symbols("x v a")
    >>> problem = OptimalControlProblem(
    ...     states=(x, v), controls=(a,), dynamics=(v, a), dt=0.1,
    ...     cost=a**2 / 2, horizon=20, q_0=(0, 0), q_d=(1, 0))
    >>> problem.f
    (0.1*v + x, 0.1*a + v)
    """

    states: Sequence[sp.Symbol]
    controls: Sequence[sp.Symbol]
    cost: sp.Expr
    horizon: int
    q_0: Sequence[float]
    q_d: Sequence[float | None] | None = None
    dynamics: Sequence[sp.Expr] | None = None
    map: Sequence[sp.Expr] | None = None
    dt: float = 1.0
    terminal_cost: sp.Expr = sp.S.Zero
    inputs: Mapping[sp.Symbol, float | Sequence[float]] = field(default_factory=dict)
    name: str = "problem"

    def __post_init__(self) -> None:
        put = lambda key, value: object.__setattr__(self, key, value)  # noqa: E731
        put("states", _symbols("states", self.states))
        put("controls", _symbols("controls", self.controls))
        put("horizon", _horizon(self.horizon))
        put("dt", _positive("dt", self.dt))
        put("inputs", _inputs(self.inputs, self.horizon))
        _check_names([*self.states, *self.controls, *self.inputs])
        known = {*self.states, *self.controls, *self.inputs}
        self._check_dynamics(known)
        put("cost", _expression("cost", self.cost, known))
        put(
            "terminal_cost",
            _expression("terminal_cost", self.terminal_cost, {*self.states, *self.inputs}),
        )
        put("q_0", _vector("q_0", self.q_0, self.states, free=False))
        target = (None,) * self.n if self.q_d is None else self.q_d
        put("q_d", _vector("q_d", target, self.states, free=True))

    def _check_dynamics(self, known: set[sp.Symbol]) -> None:
        if (self.dynamics is None) == (self.map is None):
            given = "neither" if self.map is None else "both"
            raise ProblemError(
                f"dynamics, map: {given} given; give the continuous right-hand side as "
                "dynamics= or the map q_{k+1} = f(q, u) as map=, one of the two"
            )
        name = "map" if self.dynamics is None else "dynamics"
        given = getattr(self, name)
        if not _is_vector(given, self.n):
            raise ProblemError(
                f"{name}: {self.n} expressions expected, one for each state "
                f"({', '.join(map(str, self.states))}), but got {given!r}"
            )
        checked = tuple(_expression(f"{name}[{s}]", e, known) for s, e in zip(self.states, given))
        object.__setattr__(self, name, checked)

    @cached_property
    def f(self) -> tuple[sp.Expr, ...]:
        """The n components of the map q_{k+1} = f(q_k, u_k): ``map``, or Euler (4)."""
        if self.dynamics is None:
            return tuple(self.map or ())
        return tuple(s + self.dt * e for s, e in zip(self.states, self.dynamics))

    @property
    def n(self) -> int:
        """Number of state components."""
        return len(self.states)

    @property
    def m(self) -> int:
        """Number of control components."""
        return len(self.controls)

    @property
    def fixed(self) -> tuple[bool, ...]:
        """(n,) booleans: for each state component, whether q_d fixes it at the end."""
        return tuple(value is not None for value in self.q_d)  # type: ignore[union-attr]

    @cached_property
    def functions(self) -> ProblemFunctions:
        """The problem as NumPy functions with exact derivatives."""
        return ProblemFunctions(
            states=self.states,
            controls=self.controls,
            inputs={symbol: np.asarray(values) for symbol, values in self.inputs.items()},
            f=self.f,
            cost=self.cost,
            terminal_cost=self.terminal_cost,
        )

    def with_inputs(self, *, q_0=None, q_d=None, **inputs) -> OptimalControlProblem:
        """Same wiring, other data: a new start, a new target, or new values of named inputs.

        Parameters
        ----------
        q_0, q_d : sequence of n floats, optional
        **inputs : float or sequence of N floats
            Values of declared inputs, by the name of their symbol.

        Raises
        ------
        ProblemError
            If an input is not declared, or a value is not one that a declaration takes.
        """
        by_name = {str(symbol): symbol for symbol in self.inputs}
        unknown = set(inputs) - set(by_name)
        if unknown:
            raise ProblemError(
                f"inputs: {', '.join(sorted(unknown))} not declared; this problem has "
                f"{', '.join(['q_0', 'q_d', *by_name])}"
            )
        values = dict(self.inputs) | {by_name[key]: value for key, value in inputs.items()}
        return replace(
            self,
            q_0=self.q_0 if q_0 is None else q_0,
            q_d=self.q_d if q_d is None else q_d,
            inputs=values,
        )

    def with_horizon(self, horizon: int) -> OptimalControlProblem:
        """Same problem over another number N of stages, with the same dt."""
        constant = {  # an input that was given once fits any horizon
            symbol: values if np.ptp(values) else np.min(values)
            for symbol, values in self.inputs.items()
        }
        return replace(self, horizon=horizon, inputs=constant)

    def __str__(self) -> str:
        free = [str(s) for s, f in zip(self.states, self.fixed) if not f]
        return (
            f"{self.name}: {self.n} states ({', '.join(map(str, self.states))}), {self.m} controls "
            f"({', '.join(map(str, self.controls))}), {self.horizon} stages of {self.dt:g}"
            + (f", free at the end: {', '.join(free)}" if free else "")
        )


def _symbols(name: str, given) -> tuple[sp.Symbol, ...]:
    if isinstance(given, sp.Symbol):
        given = (given,)
    if isinstance(given, str) or not isinstance(given, Sequence) or len(given) == 0:
        raise ProblemError(
            f"{name}: expected a non-empty sequence of sympy.Symbol, got {given!r}; "
            'write for instance sp.symbols("x v")'
        )
    for symbol in given:
        if not isinstance(symbol, sp.Symbol):
            raise ProblemError(f"{name}: {symbol!r} is not a sympy.Symbol; use sp.symbols(...)")
    return tuple(given)


def _check_names(symbols: Sequence[sp.Symbol]) -> None:
    seen: set[str] = set()
    for symbol in symbols:
        text = symbol.name
        if not (text.isascii() and text.isidentifier()) or keyword.iskeyword(text):
            raise ProblemError(
                f"name {text!r} is not a plain identifier; use letters, digits and '_', "
                "starting with a letter, and no Python keyword"
            )
        if text in RESERVED_NAMES or text.startswith("_") or "__" in text:
            raise ProblemError(
                f"name {text!r} is reserved; rename it (reserved: "
                f"{', '.join(sorted(RESERVED_NAMES))}, and names with a leading or double '_')"
            )
        if text.lower() in seen:
            raise ProblemError(
                f"name {text!r} is used twice (upper and lower case count as the same, because "
                "a netlist does not tell them apart); give every symbol its own name"
            )
        seen.add(text.lower())


def _horizon(given) -> int:
    whole = isinstance(given, numbers.Integral) and not isinstance(given, bool)
    if not whole or not 1 <= int(given) <= MAX_HORIZON:
        raise ProblemError(
            f"horizon: expected a whole number of stages from 1 to {MAX_HORIZON}, got {given!r}"
        )
    return int(given)


def _positive(name: str, given) -> float:
    if not _is_finite(given) or float(given) <= 0:
        raise ProblemError(f"{name}: expected a positive finite number, got {given!r}")
    return float(given)


def _is_finite(given) -> bool:
    """Whether a value is a real number, not a bool, that a float can hold."""
    if isinstance(given, bool) or not isinstance(given, (numbers.Real, sp.Expr)):
        return False
    try:
        return math.isfinite(float(given))
    except (TypeError, OverflowError):  # x + 1, or 10**400
        return False


def _is_vector(given, length: int) -> bool:
    """Whether a value is a list-like of this length; a mapping has no order to rely on."""
    return (
        hasattr(given, "__len__")
        and not isinstance(given, (str, Mapping, Set))
        and len(given) == length
    )


def _expression(name: str, given, known: set[sp.Symbol]) -> sp.Expr:
    if isinstance(given, (str, bool)):
        raise ProblemError(
            f"{name}: {given!r} is not a SymPy expression; build it from symbols (text is read "
            "only from TOML problem files, by a parser that never evaluates it)"
        )
    try:
        expression = sp.sympify(given, strict=True)
    except (sp.SympifyError, TypeError) as error:
        raise ProblemError(f"{name}: {given!r} is not a SymPy expression") from error
    if not isinstance(expression, sp.Expr) or expression.is_Matrix:
        raise ProblemError(f"{name}: {given!r} is not a scalar SymPy expression")
    foreign = sorted(str(s) for s in expression.free_symbols - known)
    if foreign:
        raise ProblemError(
            f"{name}: unknown symbol {', '.join(foreign)} in {expression}; known are "
            f"{', '.join(sorted(map(str, known)))} (declare it as a state, control or input, or "
            "replace it by a number)"
        )
    if expression.has(*NON_SMOOTH):
        raise ProblemError(
            f"{name}: {expression} is not smooth; the stationarity equations need a derivative "
            "everywhere, so use a smooth stand-in (for instance sqrt(x**2 + 0.01) for |x|)"
        )
    if expression.has(sp.nan, sp.oo, -sp.oo, sp.zoo, sp.I):
        raise ProblemError(f"{name}: {expression} is not a finite real expression")
    return expression


def _vector(name: str, given, states, *, free: bool) -> tuple:
    allowed = 'a finite number or None (in a file, "free")' if free else "a finite number"
    if not _is_vector(given, len(states)):
        raise ProblemError(
            f"{name}: {len(states)} values expected, one for each of "
            f"{', '.join(map(str, states))}, but got {given!r}"
        )
    for state, value in zip(states, given):
        if value is None and free:
            continue
        if not _is_finite(value):
            raise ProblemError(f"{name}: component {state} is {value!r}; give {allowed}")
    return tuple(None if value is None else float(value) for value in given)


def _inputs(given, horizon: int) -> dict[sp.Symbol, np.ndarray]:
    if not isinstance(given, Mapping):
        raise ProblemError(f"inputs: expected a mapping of symbol to value, got {given!r}")
    checked: dict[sp.Symbol, np.ndarray] = {}
    for symbol, value in given.items():
        _symbols("inputs", (symbol,))
        try:
            array = np.array(np.broadcast_to(np.asarray(value, dtype=float), (horizon,)))
        except (TypeError, ValueError, OverflowError) as error:
            raise ProblemError(
                f"inputs[{symbol}]: expected one number or {horizon} of them, one a stage, "
                f"got {value!r}"
            ) from error
        if not np.isfinite(array).all():
            raise ProblemError(f"inputs[{symbol}]: {value!r} holds a value that is not finite")
        array.setflags(write=False)
        checked[symbol] = array
    return checked
