"""Validation of declaration fields: names, numbers, formulas, values, units.

Every function takes a user's value and returns the value as the problem stores it. Otherwise it
raises a `ProblemError` with the field, the value and the expected value.
"""

from __future__ import annotations

import keyword
import math
import numbers
from collections.abc import Mapping, Sequence, Set, Sized

import numpy as np
import sympy as sp
from sympy.concrete.expr_with_limits import ExprWithLimits
from sympy.core.function import AppliedUndef

from ann_dc.errors import ProblemError
from ann_dc.network.functions import FUNCTIONS
from ann_dc.scale import Scale

FORMULA_NAMES: frozenset[str] = frozenset(
    ("pi", *(block.name for block in FUNCTIONS if block.in_expressions))
)
"""Names with a predefined meaning in formulas that are written as text."""

NO_SYMBOL: dict[str, str] = {
    **dict.fromkeys(FORMULA_NAMES, "formulas in text form use it for a function or a number"),
    **dict.fromkeys(("nan", "inf"), "tables and files use it for a number"),
}
"""Names that are reserved for all symbols, with the reason."""

NO_INPUT = {"one": "the node of constants has this name"} | dict.fromkeys(
    ("q_0", "q_d"), "with_inputs and --set use it for a boundary condition"
)
"""Names that a state or a control may have but an input may not, with the reason."""

MAX_HORIZON = 1_000_000

NON_SMOOTH = (sp.Abs, sp.sign, sp.Max, sp.Min, sp.Piecewise, sp.Heaviside, sp.floor, sp.ceiling)

UNFIT = (
    (
        NON_SMOOTH,
        "is not smooth; the stationarity equations need a derivative everywhere, so use a "
        "smooth approximation (for instance sqrt(x**2 + 0.01) for |x|)",
    ),
    (
        (AppliedUndef, sp.Derivative, sp.Subs, ExprWithLimits),
        "has a function, derivative, sum or integral that is not evaluated; evaluate it (doit())",
    ),
    ((sp.nan, sp.oo, -sp.oo, sp.zoo, sp.I), "is not a finite real expression"),
)
"""Parts that a formula must not contain, with the reason."""

UNITS_OF_ALL = ("cost", "time")
"""Quantities that have a unit of measure in addition to states, controls and inputs."""

LONGEST_UNIT = 24
"""Maximum number of letters of a unit, because it labels an axis."""

MARKUP = frozenset("$\\[]")
"""Characters that figures and reports would interpret as mathematics or colours."""


def symbols(name: str, given) -> tuple[sp.Symbol, ...]:
    """Return a non-empty tuple of symbols, or raise a `ProblemError`."""
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


def check_names(given: Sequence[sp.Symbol], inputs: Sequence[sp.Symbol]) -> None:
    """Raise a `ProblemError` if a name is not an identifier, reserved or used twice."""
    seen: set[str] = set()
    for symbol in (*given, *inputs):
        text = symbol.name
        if not (text.isascii() and text.isidentifier()) or keyword.iskeyword(text):
            raise ProblemError(
                f"name {text!r} is not a plain identifier; use letters, digits and '_', "
                "starting with a letter, and no Python keyword"
            )
        taken = NO_SYMBOL | NO_INPUT if symbol in inputs else NO_SYMBOL
        if text in taken:
            raise ProblemError(f"name {text!r} is reserved: {taken[text]}; rename it")
        if text.startswith("_") or "__" in text:
            raise ProblemError(
                f"name {text!r} is reserved: netlists write the stage behind a double '_'; rename "
                "it, without a leading and without a double '_'"
            )
        if text.lower() in seen:
            raise ProblemError(
                f"name {text!r} is used twice (upper and lower case count as the same, because "
                "a netlist does not distinguish them); use different names"
            )
        seen.add(text.lower())


def text(name: str, given) -> str:
    """Return a text, or raise a `ProblemError` if the value is not a string."""
    if not isinstance(given, str):
        raise ProblemError(f"{name}: expected text, got {given!r}")
    return given


def by_name(field: str, given, prefix: str, expected: str) -> dict:
    """Return a mapping, or the parts of a sequence by numbered names; else a `ProblemError`."""
    if isinstance(given, Mapping):
        return dict(given)
    if isinstance(given, Sequence) and not isinstance(given, (str, bytes)):
        return {f"{prefix}{number}": part for number, part in enumerate(given, 1)}
    raise ProblemError(f"{field}: expected a sequence of {expected}, got {given!r}")


def whole_stages(given) -> int:
    """Return N as an int from 1 to MAX_HORIZON, or raise a `ProblemError`."""
    whole = isinstance(given, numbers.Integral) and not isinstance(given, bool)
    if not whole or not 1 <= int(given) <= MAX_HORIZON:
        raise ProblemError(
            f"horizon: expected a whole number of stages from 1 to {MAX_HORIZON}, got {given!r}"
        )
    return int(given)


def positive(name: str, given) -> float:
    """Return a positive finite float, or raise a `ProblemError`."""
    if not is_finite(given) or float(given) <= 0:
        raise ProblemError(f"{name}: expected a positive finite number, got {given!r}")
    return float(given)


def is_finite(given) -> bool:
    """Return True if a value is a real number, not a bool, and finite as a float."""
    if isinstance(given, bool) or not isinstance(given, (numbers.Real, sp.Expr)):
        return False
    try:
        return math.isfinite(float(given))
    except (TypeError, OverflowError):  # x + 1, or 10**400
        return False


def is_vector(given, length: int) -> bool:
    """Return True if a value is list-like with this length; a mapping has no order."""
    return (
        isinstance(given, Sized)
        and not isinstance(given, (str, Mapping, Set))
        and len(given) == length
    )


def smooth_expression(name: str, given, known: set[sp.Symbol]) -> sp.Expr:
    """Return a smooth real expression in known symbols, or raise a `ProblemError`."""
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
            "replace it by a number; symbols with other SymPy assumptions are other symbols)"
        )
    for kinds, words in UNFIT:
        if expression.has(*kinds):
            raise ProblemError(f"{name}: {expression} {words}")
    return expression


def one_a_state(name: str, given, states) -> tuple:
    """Return a finite float per state, None if free, or raise a `ProblemError`."""
    if not is_vector(given, len(states)):
        raise ProblemError(
            f"{name}: {len(states)} values expected, one for each of "
            f"{', '.join(map(str, states))}, but got {given!r}"
        )
    for state, value in zip(states, given):
        if value is not None and not is_finite(value):
            raise ProblemError(
                f"{name}: component {state} is {value!r}; give a finite number or None "
                '(in a file, "free")'
            )
    return tuple(None if value is None else float(value) for value in given)


def both_ends(
    q_0: Sequence[float | None], q_d: Sequence[float | None], scales: Sequence[float | Scale | None]
) -> tuple[np.ndarray, np.ndarray]:
    """Return (q_0, q_d) as arrays (n,); a free component has its other end or offset."""
    places = [scale.offset if isinstance(scale, Scale) else 0.0 for scale in scales]
    given = [*zip(q_0, q_d, places)]
    first = [(q if d is None else d) if a is None else a for a, d, q in given]
    last = [(q if a is None else a) if d is None else d for a, d, q in given]
    return np.array(first, float), np.array(last, float)


def values_a_stage(given, horizon: int) -> dict[sp.Symbol, np.ndarray]:
    """Return read-only values (horizon,) of every input, or raise a `ProblemError`."""
    if not isinstance(given, Mapping):
        raise ProblemError(f"inputs: expected a mapping of symbol to value, got {given!r}")
    checked: dict[sp.Symbol, np.ndarray] = {}
    for symbol, value in given.items():
        symbols("inputs", (symbol,))
        try:
            array = np.array(np.broadcast_to(_numbers(value), (horizon,)))
        except (TypeError, ValueError, OverflowError) as error:
            raise ProblemError(
                f"inputs[{symbol}]: expected one number or {horizon} of them, one per stage, "
                f"got {value!r}"
            ) from error
        if not np.isfinite(array).all():
            raise ProblemError(f"inputs[{symbol}]: {value!r} holds a value that is not finite")
        array.setflags(write=False)
        checked[symbol] = array
    return checked


def _numbers(given) -> np.ndarray:
    """Return real numbers as floats; raise a TypeError for text and booleans."""
    if np.asarray(given).dtype.kind not in "iufO":
        raise TypeError("text, booleans and complex numbers are not real numbers")
    return np.asarray(given, dtype=float)


def inputs_by_name(
    given: Mapping[str, object], declared: Sequence[sp.Symbol]
) -> dict[sp.Symbol, object]:
    """Return values of declared inputs by symbol, or raise a `ProblemError`."""
    by_name = {str(symbol): symbol for symbol in declared}
    unknown = set(given) - set(by_name)
    if unknown:
        raise ProblemError(
            f"inputs: {', '.join(sorted(unknown))} not declared; this problem has "
            f"{', '.join(['q_0', 'q_d', *by_name])}"
        )
    return {by_name[name]: value for name, value in given.items()}


def measures(given, names: Sequence[str]) -> dict[str, str]:
    """Return units of measure by name, as short text that every figure and report can show.

    Raises `ProblemError` if a name is neither one of ``names`` nor "cost" or "time".
    """
    if not isinstance(given, Mapping):
        raise ProblemError(
            f'units: expected a mapping of name to unit of measure, such as {{"x": "m"}}, '
            f"got {given!r}"
        )
    checked: dict[str, str] = {}
    for key, unit in given.items():
        name = key.name if isinstance(key, sp.Symbol) else key
        if name in checked:
            raise ProblemError(f"units: {name!r} is given twice; use one unit per name")
        if not isinstance(name, str) or name not in (*names, *UNITS_OF_ALL):
            raise ProblemError(
                f"units: {name!r} not declared; units are given to "
                f"{', '.join([*names, *UNITS_OF_ALL])}"
            )
        if name in UNITS_OF_ALL and name in names:
            raise ProblemError(
                f"units: {name!r} is a symbol of the problem, but also names the unit of the "
                f"{name}; rename the symbol"
            )
        checked[name] = _measure(name, unit)
    return checked


def _measure(name: str, given) -> str:
    """Return one unit of measure without surrounding blanks."""
    if not isinstance(given, str):
        raise ProblemError(
            f'units[{name}]: expected text such as "m/s", got {given!r}; a unit is text and '
            'changes no number ("1" where there is none)'
        )
    unit = given.strip()
    if not 1 <= len(unit) <= LONGEST_UNIT:
        raise ProblemError(
            f"units[{name}]: expected 1 to {LONGEST_UNIT} letters, got {given[:60]!r}; write a "
            'unit such as "m/s" ("1" where there is none)'
        )
    if not unit.isprintable() or set(unit) & MARKUP:
        raise ProblemError(
            f"units[{name}]: {given!r} holds a control character or one of "
            f"{' '.join(sorted(MARKUP))}; write plain text such as m/s^2"
        )
    return unit


def units_by_name(
    units: Mapping[str, str],
    states: Sequence[str],
    controls: Sequence[str],
    inputs: Sequence[str],
    rows: Sequence[str],
) -> dict[str, str]:
    """Return the unit of every state, control, input and neuron; empty if unknown.

    The rows are the neurons of inequalities, whose multipliers have no unit.
    """
    known = {name: units.get(name, "") for name in (*states, *controls, *inputs)}
    cost = units.get("cost", "cost")
    known |= {f"{p}.{s}": known[s] for p in ("q", "t") for s in states}
    known |= {f"{p}.{s}": known[s] and _per(cost, known[s]) for p in ("mu", "beta") for s in states}
    known |= {f"u.{s}": known[s] for s in controls}
    return known | dict.fromkeys(rows, "")


def _per(above: str, below: str) -> str:
    """Return the unit of a quotient.

    >>> _per("cost", "m"), _per("cost", "m/s"), _per("J", "1"), _per("J/s", "m")
    ('cost/m', 'cost/(m/s)', 'J', '(J/s)/m')
    """
    if below == "1":
        return above
    above, below = (f"({u})" if set(u) & set("/*· ") else u for u in (above, below))
    return f"{above}/{below}"


def scales_by_hand(given, names: Sequence[str]) -> dict[str, float | Scale]:
    """Return scales by name: a positive number, or a `Scale` with an offset.

    Raises `ProblemError` if a name is neither one of ``names`` nor "cost".
    """
    if not isinstance(given, Mapping):
        raise ProblemError(
            f'scales: expected a mapping of name to number, such as {{"x": 1000}}, got {given!r}'
        )
    checked: dict[str, float | Scale] = {}
    for key, value in given.items():
        name = key.name if isinstance(key, sp.Symbol) else key
        if name in checked or not isinstance(name, str) or name not in (*names, "cost"):
            raise ProblemError(
                f"scales: {name!r} is given twice or is none of {', '.join([*names, 'cost'])}"
            )
        if name == "cost" and (name in names or isinstance(value, Scale)):
            raise ProblemError(
                "scales[cost]: expected a positive number (no offset; no state or control has "
                f"this name), got {value!r}"
            )
        checked[name] = _scale(name, value)
    return checked


def _scale(name: str, given) -> float | Scale:
    factor, offset = given if isinstance(given, Scale) else (given, 0.0)
    if not (is_finite(factor) and is_finite(offset) and float(factor) > 0):
        raise ProblemError(
            f"scales[{name}]: expected a positive finite number, or Scale(factor, offset), got "
            f"{given!r}; the factor is the value of a network value of 1"
        )
    return Scale(float(factor), float(offset)) if isinstance(given, Scale) else float(factor)
