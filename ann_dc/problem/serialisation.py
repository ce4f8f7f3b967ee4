"""Serialisation of a problem: all fields of a declaration, with formulas as text.

Reading repeats the declaration, so all checks of a declaration apply. A new field of
`OptimalControlProblem` must be added here, in the record and in both functions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import sympy as sp

from ann_dc.errors import ProblemError
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.formulas import expression_of, lines_of
from ann_dc.problem.inequality import SIGNS
from ann_dc.problem.minimax import weight_inputs
from ann_dc.problem.soft import Soft
from ann_dc.problem.step_length import Coordinate, StepLength
from ann_dc.scale import Scale

Formula = tuple[str, ...]
"""Lines of text, the last of which is the value; see `formulas`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WrittenStep:
    """Fields of a `StepLength`."""

    low: float
    high: float | None
    guess: float
    symbol: str


@dataclass(frozen=True, kw_only=True, eq=False)
class WrittenRelation:
    """Serialised inequality: two formulas and a sign.

    Attributes
    ----------
    sign : str
        Relation between the formulas, one of `SIGNS`.
    """

    left: Formula
    sign: str
    right: Formula


@dataclass(frozen=True, kw_only=True, eq=False)
class WrittenSoft:
    """Fields of a `Soft`.

    Attributes
    ----------
    weight : float or None
        Penalty weight; None if infinite.
    """

    weight: float | None
    compliance: float


@dataclass(frozen=True, kw_only=True, eq=False)
class WrittenProblem:
    """Fields of an `OptimalControlProblem` as text, numbers and arrays.

    Attributes
    ----------
    assumptions : mapping of str to mapping of str to bool
        SymPy assumptions of each symbol, for instance that it is positive.
    dynamics, map : tuple of n formulas, or None
        Continuous or discrete dynamics.
    step : WrittenStep or None
        Replaces dt if the step length is optimised.
    inputs : mapping of str to (N,) array
        Input values per stage.
    scales : mapping of str to tuple of float
        Factor, followed by the offset if there is one.
    """

    name: str
    states: tuple[str, ...]
    controls: tuple[str, ...]
    assumptions: Mapping[str, Mapping[str, bool]]
    dynamics: tuple[Formula, ...] | None
    map: tuple[Formula, ...] | None
    cost: Formula
    terminal_cost: Formula
    horizon: int
    dt: float | None
    step: WrittenStep | None
    q_0: tuple[float | None, ...]
    q_d: tuple[float | None, ...]
    inputs: Mapping[str, np.ndarray]
    units: Mapping[str, str]
    scales: Mapping[str, tuple[float, ...]]
    constraints: Mapping[str, WrittenRelation] = field(default_factory=dict)
    terminal_constraints: Mapping[str, WrittenRelation] = field(default_factory=dict)
    bounds: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    soft: Mapping[str, WrittenSoft] = field(default_factory=dict)
    objectives: Mapping[str, Formula] = field(default_factory=dict)
    weights: Mapping[str, float] = field(default_factory=dict)
    temperature: float = 0.0


def written(problem: OptimalControlProblem) -> WrittenProblem:
    """Return a problem as plain data.

    Raises `ExpressionError` if the problem has a function that the parser does not know.

    Examples
    --------
    >>> from ann_dc import plants
    >>> written(plants.double_integrator(N=3)).cost
    ('(1/2)*a**2',)
    """
    own = [s for s in problem.states if not isinstance(s, Coordinate)]  # a step length adds its own
    added = weight_inputs(problem.named_weights)
    inputs = [(s, values) for s, values in problem.inputs.items() if s not in added]
    symbols = (*own, *problem.controls, *(s for s, _ in inputs))
    return WrittenProblem(
        name=problem.name,
        states=tuple(s.name for s in own),
        controls=tuple(s.name for s in problem.controls),
        assumptions={s.name: said for s in symbols if (said := _said_of(s))},
        dynamics=_formulas(problem.dynamics, len(own)),
        map=_formulas(problem.map, len(own)),
        cost=lines_of(problem.cost),
        terminal_cost=lines_of(problem.terminal_cost),
        horizon=problem.horizon,
        dt=None if isinstance(problem.dt, StepLength) else problem.dt,
        step=_written_step(problem.dt),
        q_0=tuple(problem.q_0[: len(own)]),
        q_d=tuple((problem.q_d or ())[: len(own)]),
        inputs={s.name: np.asarray(values) for s, values in inputs},
        units=_of_users(problem.units, problem, own),
        scales={
            name: tuple(scale) if isinstance(scale, Scale) else (scale,)
            for name, scale in _of_users(problem.scales, problem, own).items()
        },
        constraints=_written_relations(problem.constraints),
        terminal_constraints=_written_relations(problem.terminal_constraints),
        bounds=dict(problem.bounds),  # type: ignore[arg-type]
        soft={name: _written_soft(soft) for name, soft in problem.soft.items()},
        objectives={name: lines_of(own) for name, own in problem.named_objectives.items()},
        weights=problem.named_weights,
        temperature=problem.temperature,
    )


def _of_users(
    given: Mapping[str, Any], problem: OptimalControlProblem, own: list[sp.Symbol]
) -> dict[str, Any]:
    """Return the user's fields by name, without the additions of a step length."""
    added = {str(s) for s in problem.states} - {str(s) for s in own}
    return {name: value for name, value in given.items() if name not in added}


def _written_step(dt: float | StepLength) -> WrittenStep | None:
    if not isinstance(dt, StepLength):
        return None
    guess: Any = dt.guess
    return WrittenStep(low=dt.low, high=dt.high, guess=guess, symbol=str(dt.symbol))


def _written_soft(soft: Soft) -> WrittenSoft:
    price = None if math.isinf(soft.weight) else soft.weight
    return WrittenSoft(weight=price, compliance=soft.compliance)


def _soft(given: WrittenSoft) -> Soft:
    price = math.inf if given.weight is None else given.weight
    return Soft(weight=price, compliance=given.compliance)


def declared(given: WrittenProblem) -> OptimalControlProblem:
    """Return the problem that plain data describes.

    Raises `ProblemError` if the data are not a valid problem; the message begins with the field.

    Examples
    --------
    >>> from ann_dc import plants
    >>> problem = plants.car()
    >>> again = declared(written(problem))
    >>> again.f == problem.f, again.cost == problem.cost
    (True, True)
    """
    step = _step_of(given)
    symbols: dict[str, Any] = {
        name: _symbol(name, given.assumptions.get(name, {}))
        for name in (*given.states, *given.controls, *given.inputs)
    }
    if isinstance(step, StepLength):
        symbols[str(step.symbol)] = step.symbol
    return OptimalControlProblem(
        name=given.name,
        states=tuple(symbols[name] for name in given.states),
        controls=tuple(symbols[name] for name in given.controls),
        dynamics=_expressions("dynamics", given.dynamics, symbols),
        map=_expressions("map", given.map, symbols),
        cost=expression_of(given.cost, symbols, "cost"),
        terminal_cost=expression_of(given.terminal_cost, symbols, "terminal_cost"),
        horizon=given.horizon,
        dt=step,
        q_0=given.q_0,  # type: ignore[arg-type]
        q_d=given.q_d,
        inputs={symbols[name]: values for name, values in given.inputs.items()},  # type: ignore[arg-type]
        units=given.units,
        scales={name: _scale(name, numbers) for name, numbers in given.scales.items()},
        constraints=_relations("constraints", given.constraints, symbols),
        terminal_constraints=_relations(
            "terminal_constraints", given.terminal_constraints, symbols
        ),
        bounds=given.bounds,
        soft={name: _soft(soft) for name, soft in given.soft.items()},
        objectives={
            name: expression_of(lines, symbols, f"objectives[{name}]")
            for name, lines in given.objectives.items()
        },
        weights=given.weights,
        temperature=given.temperature,
    )


def _said_of(symbol: sp.Symbol) -> dict[str, bool]:
    """Return the assumptions of a symbol, without those common to all symbols."""
    return {word: said for word, said in symbol.assumptions0.items() if word != "commutative"}


def _symbol(name: str, assumptions: Mapping[str, bool]) -> sp.Symbol:
    try:
        return sp.Symbol(name, **assumptions)
    except (TypeError, ValueError) as error:
        raise ProblemError(f"assumptions.{name}: SymPy does not take them: {error}") from error


def _step_of(given: WrittenProblem) -> float | StepLength:
    step = given.step
    if step is not None:
        return StepLength(low=step.low, high=step.high, guess=step.guess, symbol=step.symbol)
    if given.dt is None:
        raise ProblemError("dt: neither a number nor a step length is given")
    return given.dt


def _formulas(given: Sequence[sp.Expr] | None, own: int) -> tuple[Formula, ...] | None:
    return None if given is None else tuple(map(lines_of, given[:own]))


def _expressions(
    field: str, given: Iterable[Formula] | None, symbols: Mapping[str, sp.Symbol]
) -> tuple[Any, ...] | None:
    if given is None:
        return None
    return tuple(expression_of(lines, symbols, f"{field}[{i}]") for i, lines in enumerate(given))


def _written_relations(given: Any) -> dict[str, WrittenRelation]:
    return {
        name: WrittenRelation(
            left=lines_of(relation.lhs), sign=relation.rel_op, right=lines_of(relation.rhs)
        )
        for name, relation in given.items()
    }


def _relations(
    field: str, given: Mapping[str, WrittenRelation], symbols: Mapping[str, sp.Symbol]
) -> dict[str, sp.Rel]:
    found = {}
    for name, relation in given.items():
        where = f"{field}[{name}]"
        if relation.sign not in SIGNS:
            raise ProblemError(f"{where}: {relation.sign!r} is none of {', '.join(SIGNS)}")
        sides = (expression_of(side, symbols, where) for side in (relation.left, relation.right))
        found[name] = SIGNS[relation.sign](*sides, evaluate=False)
    return found


def _scale(name: str, numbers: tuple[float, ...]) -> float | Scale:
    if not 1 <= len(numbers) <= 2:
        raise ProblemError(f"scales[{name}]: expected a factor and an offset, got {numbers!r}")
    return numbers[0] if len(numbers) == 1 else Scale(*numbers)
