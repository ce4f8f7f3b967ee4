"""Serialisation of a problem: all fields of a declaration, with formulas as text.

Reading repeats the declaration, so all checks of a declaration apply. A new field of
`OptimalControlProblem` must be added to `WrittenProblem`, and to `_CODECS` if it is not plain data.

An expression becomes a few lines that `parse_expression` reads. A part that would make a line too
long or too deep becomes a separate line, which later lines call by a name that no symbol can have,
such as ``_1``. Sums and products are written in halves, so that lines do not nest deeply. A number
retains all its digits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np
import sympy as sp

from ann_dc.errors import ExpressionError, ProblemError
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.expression import MAX_CHARACTERS, parse_expression
from ann_dc.problem.inequality import SIGNS
from ann_dc.problem.minimax import weight_inputs
from ann_dc.problem.named_functions import FUNCTIONS, IN_OTHER_WORDS
from ann_dc.problem.soft import Soft
from ann_dc.problem.step_length import StepLength
from ann_dc.scale import Scale

LONGEST_PART = MAX_CHARACTERS // 8
"""Length in characters from which a part of an expression becomes a separate line."""
DEEPEST_PART = 20
"""Depth of nested parentheses from which a part becomes a separate line."""


def lines_of(expression: sp.Expr) -> tuple[str, ...]:
    """Return an expression as lines of text, the last of which is its value.

    A small expression is one line. Raises `ExpressionError` if the parser does not know a function.

    Examples
    --------
    >>> x, y = sp.symbols("x y")
    >>> lines_of(0.1 - x * sp.sin(y))
    ('0.1-x*sin(y)',)
    """
    writer = _Writer()
    last = writer.write(expression)
    return (*writer.lines, last)


def expression_of(lines: Sequence[str], symbols: Mapping[str, sp.Expr], where: str) -> sp.Expr:
    """Return the expression that lines written by `lines_of` represent.

    Raises `ExpressionError`, which begins with the field ``where``, if there is no line, or if a
    line is not an expression.
    """
    if not lines:
        raise ExpressionError(f"{where}: expected a line of text; write an expression, or 0")
    known = dict(symbols)
    value = sp.S.Zero
    for number, line in enumerate(lines, 1):
        value = parse_expression(line, known, where)
        known[f"_{number}"] = value
    return value


class _Writer:
    """Writer of one expression; parts that are too large become separate lines."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def write(self, expression: Any) -> str:
        return self._in_line(self._text(expression))

    def _text(self, expression: Any) -> str:
        if expression.is_Symbol:
            return expression.name
        if expression.is_number and not expression.args:
            return _number(expression)
        if expression.is_Add:
            return self._halves(expression.args, "+")
        if expression.is_Mul:
            return self._product(expression)
        if expression.is_Pow:
            return self._power(*expression.args)
        return self._call(expression)

    def _halves(self, parts: Sequence[Any], sign: str) -> str:
        """Return a sum or product, with the halves of a long one in parentheses."""
        if len(parts) > 4:
            middle = len(parts) // 2
            halves = self._halves(parts[:middle], sign), self._halves(parts[middle:], sign)
            return sign.join(f"({self._in_line(half)})" for half in halves)
        texts = [self.write(part) if sign == "+" else self._factor(part) for part in parts]
        return sign.join(texts).replace("+-", "-")

    def _in_line(self, text: str) -> str:
        """Return the text, or the name of a new line that contains the text."""
        if len(text) <= LONGEST_PART and _depth(text) <= DEEPEST_PART:
            return text
        self.lines.append(text)
        return f"_{len(self.lines)}"

    def _product(self, product: Any) -> str:
        """Return a product with the number first, so that 2*(x*(y + 1)) is not expanded."""
        number, rest = product.as_coeff_Mul()
        is_exact = not number.is_Float
        if is_exact and number == 1:
            return self._halves(product.args, "*")
        factors = rest.args if rest.is_Mul else (rest,)
        together = self._halves(factors, "*")
        if len(factors) > 1 and any(part.is_Add for part in factors):
            together = f"({together})"
        if is_exact and number == -1:
            return f"-{together}"
        return f"{self._factor(number)}*{together}"

    def _factor(self, part: Any) -> str:
        text = self.write(part)
        plain = text.isidentifier() or text.replace(".", "").isdigit()
        bare = plain or part.is_Function or (part.is_Pow and not text.startswith("1/"))
        return text if bare else f"({text})"

    def _power(self, base: Any, exponent: Any) -> str:
        if not exponent.is_number:
            return f"exp({self.write(exponent * sp.log(base))})"
        if exponent == sp.S.Half:
            return f"sqrt({self.write(base)})"
        below = f"({self.write(base)})" if base.is_Pow or base.is_number else self._factor(base)
        if exponent == -1:
            return f"1/{below}"
        above = self.write(exponent)
        return f"{below}**{above if above.isdigit() else f'({above})'}"

    def _call(self, call: Any) -> str:
        name = type(call).__name__
        if len(call.args) == 1 and name in FUNCTIONS:
            return f"{name}({self.write(call.args[0])})"
        if len(call.args) == 1 and name in IN_OTHER_WORDS:
            return self._text(IN_OTHER_WORDS[name](call.args[0]))
        raise ExpressionError(
            f"{call}: cannot be written as text; use {', '.join(FUNCTIONS)} or with sums, "
            "products and powers"
        )


def _number(number: Any) -> str:
    """Return a number with all its digits."""
    if number.is_Integer:
        return str(number)
    if number.is_Rational:
        return f"{number.p}/{number.q}"
    if number is sp.pi:
        return "pi"
    if number is sp.E:
        return "exp(1)"
    return repr(float(number))


def _depth(text: str) -> int:
    deepest = depth = 0
    for character in text:
        depth += (character == "(") - (character == ")")
        deepest = max(deepest, depth)
    return deepest


# ---- records


Formula = tuple[str, ...]
"""Lines of text, the last of which is the value; see `lines_of`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WrittenStep:
    """Fields of a `StepLength`."""

    low: float
    high: float | None
    guess: float
    symbol: str


@dataclass(frozen=True, kw_only=True, eq=False)
class WrittenRelation:
    """Serialised inequality: two formulas and a sign, one of `SIGNS`."""

    left: Formula
    sign: str
    right: Formula


@dataclass(frozen=True, kw_only=True, eq=False)
class WrittenSoft:
    """Fields of a `Soft`; the weight is None if it is infinite."""

    weight: float | None
    compliance: float


@dataclass(frozen=True, kw_only=True, eq=False)
class WrittenProblem:
    """Fields of an `OptimalControlProblem` as text, numbers and arrays.

    `assumptions` are the SymPy assumptions of each symbol, for instance that it is positive. `step`
    replaces `dt` if the step length is optimised. `inputs` are (N,) arrays; `scales` contain a
    factor, followed by the offset if there is one.
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
    """
    given = _users_fields(problem)
    symbols = (*given["states"], *given["controls"], *given["inputs"])
    data = {name: _CODECS[name].write(v) if name in _CODECS else v for name, v in given.items()}
    step = None
    if isinstance(problem.dt, StepLength):
        data["dt"], step = (
            None,
            WrittenStep(**{**vars(problem.dt), "symbol": str(problem.dt.symbol)}),
        )
    assumptions = {s.name: facts for s in symbols if (facts := _assumptions_of(s))}
    return WrittenProblem(assumptions=assumptions, step=step, **data)


def _users_fields(problem: OptimalControlProblem) -> dict[str, Any]:
    """Return the fields without the additions of a step length and of weights."""
    given = {field.name: getattr(problem, field.name) for field in fields(problem)}
    own, added = problem.n - len(problem.handed_on), {str(s) for s in problem.handed_on}
    for name in ("states", "dynamics", "map", "q_0", "q_d"):
        given[name] = given[name] and given[name][:own]
    for name in ("units", "scales"):
        given[name] = {key: value for key, value in given[name].items() if key not in added}
    weights = weight_inputs(problem.weights)
    given["inputs"] = {s: values for s, values in problem.inputs.items() if s not in weights}
    return given


def declared(given: WrittenProblem) -> OptimalControlProblem:
    """Return the problem that plain data describes.

    Raises `ProblemError` if the data are not a valid problem; the message begins with the field.
    """
    data = dict(vars(given))
    assumptions, step = data.pop("assumptions"), data.pop("step")
    if step is not None:
        data["dt"] = StepLength(**vars(step))
    elif given.dt is None:
        raise ProblemError("dt: expected a number or a step length, got none")
    names = (*given.states, *given.controls, *given.inputs)
    symbols: dict[str, Any] = {name: _symbol(name, assumptions.get(name, {})) for name in names}
    if step is not None:
        symbols[step.symbol] = data["dt"].symbol
    for name, codec in _CODECS.items():
        data[name] = codec.read(data[name], symbols, name)
    return OptimalControlProblem(**data)


def _assumptions_of(symbol: sp.Symbol) -> dict[str, bool]:
    """Return the assumptions of a symbol, without those common to all symbols."""
    return {fact: holds for fact, holds in symbol.assumptions0.items() if fact != "commutative"}


def _symbol(name: str, assumptions: Mapping[str, bool]) -> sp.Symbol:
    try:
        return sp.Symbol(name, **assumptions)
    except (TypeError, ValueError) as error:
        raise ProblemError(f"assumptions.{name}: SymPy rejects them: {error}") from error


# ---- fields that are not plain data


class _Codec(NamedTuple):
    """Conversion of a value to data, and back with the symbols by name and the place in errors."""

    write: Callable[[Any], Any]
    read: Callable[[Any, Mapping[str, sp.Symbol], str], Any]


def _of_each(codec: _Codec) -> _Codec:
    """Return the codec of a sequence, or of None."""
    return _Codec(
        lambda given: given and tuple(map(codec.write, given)),
        lambda given, symbols, place: (
            given
            and tuple(codec.read(part, symbols, f"{place}[{i}]") for i, part in enumerate(given))
        ),
    )


def _by_name(codec: _Codec) -> _Codec:
    """Return the codec of a mapping from names."""
    return _Codec(
        lambda given: {name: codec.write(value) for name, value in given.items()},
        lambda given, symbols, place: {
            name: codec.read(value, symbols, f"{place}[{name}]") for name, value in given.items()
        },
    )


def _write_relation(relation: Any) -> WrittenRelation:
    left, right = lines_of(relation.lhs), lines_of(relation.rhs)
    return WrittenRelation(left=left, sign=relation.rel_op, right=right)


def _read_relation(given: WrittenRelation, symbols: Mapping[str, sp.Symbol], place: str) -> sp.Rel:
    if given.sign not in SIGNS:
        raise ProblemError(f"{place}: {given.sign!r} is not one of {', '.join(SIGNS)}")
    sides = (expression_of(side, symbols, place) for side in (given.left, given.right))
    return SIGNS[given.sign](*sides, evaluate=False)


def _write_scale(scale: float | Scale) -> tuple[float, ...]:
    return tuple(scale) if isinstance(scale, Scale) else (scale,)


def _read_scale(numbers: tuple[float, ...], _: object, place: str) -> float | Scale:
    if not 1 <= len(numbers) <= 2:
        raise ProblemError(f"{place}: expected a factor and an offset, got {numbers!r}")
    return numbers[0] if len(numbers) == 1 else Scale(*numbers)


def _write_soft(soft: Soft) -> WrittenSoft:
    weight = None if math.isinf(soft.weight) else soft.weight
    return WrittenSoft(weight=weight, compliance=soft.compliance)


def _read_soft(given: WrittenSoft, *_: object) -> Soft:
    weight = math.inf if given.weight is None else given.weight
    return Soft(weight=weight, compliance=given.compliance)


_SYMBOL = _Codec(lambda symbol: symbol.name, lambda name, symbols, place: symbols[name])
_INPUTS = _Codec(
    lambda given: {symbol.name: np.asarray(values) for symbol, values in given.items()},
    lambda given, symbols, place: {symbols[name]: values for name, values in given.items()},
)
_FORMULA, _RELATION = _Codec(lines_of, expression_of), _Codec(_write_relation, _read_relation)
_CODECS = {
    "states": _of_each(_SYMBOL),
    "controls": _of_each(_SYMBOL),
    "dynamics": _of_each(_FORMULA),
    "map": _of_each(_FORMULA),
    "cost": _FORMULA,
    "terminal_cost": _FORMULA,
    "objectives": _by_name(_FORMULA),
    "constraints": _by_name(_RELATION),
    "terminal_constraints": _by_name(_RELATION),
    "inputs": _INPUTS,
    "scales": _by_name(_Codec(_write_scale, _read_scale)),
    "soft": _by_name(_Codec(_write_soft, _read_soft)),
}
"""Conversions by field; the other fields of a declaration are plain data."""
