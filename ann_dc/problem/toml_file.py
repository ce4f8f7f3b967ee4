"""Problems as text: conversion of a TOML file to an `OptimalControlProblem`.

A file contains the fields of a declaration with formulas as text (`expression.parse_expression`).
The text is never executed, so files from unknown sources are safe. TOML requires plain keys before
tables::

    states = ["x", "v"]
    controls = ["a"]
    dt = 0.1                # or {low = 0.02, high = 0.5}: optimised, called h in formulas
    horizon = 20
    q_0 = [0, 0]
    q_d = [1, "free"]
    cost = "weight * a**2"

    [parameters]            # optional; numbers for formulas, ends and bounds,
    weight = 0.5            # or formulas of numbers and earlier parameters: "2*pi/3"

    [dynamics]              # or [map]
    x = "v"
    v = "a - drag"

    [inputs]                # optional; one number, or one per stage
    drag = 0.0

    [units]                 # optional; units in figures and reports
    x = "m"
    cost = "J"
    time = "s"

    [scales]                # optional; value that a network value of 1 represents
    x = 1000.0              # or [1000.0, 20.0], with the value of a network's zero

    [constraints]           # optional; at every stage; or a list of texts
    wall = "x + v**2 <= 2"
    speed = "-1 <= v <= 1"  # double inequality: speed_low and speed_high

    [terminal_constraints]  # optional; at the end, in states and inputs
    near = "(x - 1)**2 + v**2 <= 0.01"

    [bounds]                # optional; of states and controls
    a = [-2, "none"]

    [soft]                  # optional; rows that may be violated, each with its penalty weight
    wall = 30.0             # or {weight = 30.0, compliance = 0.001}, one of them or both

    [objectives]            # with or without cost; the largest is minimised; or a list, with
    effort = "a**2"         # weights = [0.4, 0.6] of the same form if there are weights
    error = "(x - 1)**2"

Two further keys precede the tables: a penalty weight of all rows, ``soft = 30.0``, and the
temperature that softens the largest of objectives, ``temperature = 0.1``.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import sympy as sp

from ann_dc.errors import ExpressionError, ProblemError
from ann_dc.files import read_table
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.expression import parse_expression
from ann_dc.problem.fields import FORMULA_NAMES
from ann_dc.problem.inequality import PREFIXES, SIGNS, row_name
from ann_dc.problem.step_length import StepLength
from ann_dc.scale import Scale
from ann_dc.validation import checked

SIGN = re.compile("([<>]=?)")
LONGEST = 60
"""Maximum number of letters of a text that an error message repeats."""


@checked
def load_problem(path: str | os.PathLike[str]) -> OptimalControlProblem:
    """Read a problem from a TOML file.

    Parameters
    ----------
    path : path-like
        File to read. Its stem names the problem unless the file has a ``name``.

    Returns
    -------
    OptimalControlProblem

    Raises
    ------
    FileFormatError
        If the file is missing, or is not TOML in UTF-8 of at most 1 MB.
    ProblemError
        If the file's content is not a problem; the message begins with the path and the field.

    Examples
    --------
    >>> import tempfile
    >>> text = '''
    ... states = ["x"]
    ... controls = ["a"]
    ... dt = 0.1
    ... horizon = 20
    ... q_0 = [0]
    ... q_d = [1]
    ... cost = "a**2"
    ... dynamics = {x = "a - 0.5*sin(x)"}
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "bead.toml")
    ...     _ = path.write_text(text, encoding="utf-8")
    ...     print(load_problem(path))
    bead: 1 state (x), 1 control (a), 20 stages of 0.1 s
    """
    file = Path(path)
    table = read_table(file, "problem", "demos/pendulum.toml")
    try:
        return _declared(table, default_name=file.stem)
    except ProblemError as error:
        raise type(error)(f"{file}: {error}") from error


def _declared(table: Mapping, default_name: str) -> OptimalControlProblem:
    _check_keys(table)
    states, controls = _names("states", table["states"]), _names("controls", table["controls"])
    dt, inputs = _step(table["dt"]), _table("inputs", table.get("inputs", {}))
    symbols = {name: sp.Symbol(name) for name in (*states, *controls, *inputs)}
    if isinstance(dt, StepLength):
        symbols.setdefault(str(dt.symbol), sp.Symbol(str(dt.symbol)))
    numbers = _parameters(table.get("parameters", {}), symbols)
    names = _Names(symbols=symbols, states=states, numbers=numbers)
    given = {"name": default_name, **table, "dt": dt}
    read = {key: _READERS[key](key, value, names) for key, value in given.items()}
    return OptimalControlProblem(**{key: v for key, v in read.items() if key != "parameters"})


def _check_keys(table: Mapping) -> None:
    known = ", ".join(_READERS)
    for key in table:
        if key not in _READERS:
            raise ProblemError(f"unknown key {key!r}; a problem file has the keys {known}")
    for key in REQUIRED:
        if key not in table:
            raise ProblemError(
                f"{key}: missing; a problem file has the keys {known} (plain keys precede the "
                "first [table])"
            )


def _step(given: object) -> Any:
    """Return a number, or the bounds of an optimised step length."""
    if not isinstance(given, Mapping):
        return given
    known = [field.name for field in fields(StepLength)]
    for key in given:
        if key not in known:
            raise ProblemError(f"dt: unknown key {key!r}; a step length has {', '.join(known)}")
    if "low" not in given:
        raise ProblemError("dt.low: missing; a free step length has a lower bound")
    return StepLength(**given)


def _names(field: str, given: object) -> list[str]:
    if not isinstance(given, list) or not all(isinstance(name, str) and name for name in given):
        raise ProblemError(f'{field}: expected a list of names such as ["x", "v"], got {given!r}')
    return given


def _table(field: str, given: object, _: object = None) -> Mapping:
    if not isinstance(given, Mapping):
        raise ProblemError(f"{field}: expected a table, written [{field}], got {given!r}")
    return given


def _numbered(prefix: str, given: object) -> object:
    """Return a list as a table of numbered names, and other values unchanged."""
    if isinstance(given, list):
        return {f"{prefix}{number}": part for number, part in enumerate(given, 1)}
    return given


def _parameters(given: object, symbols: Mapping[str, sp.Symbol]) -> dict[str, sp.Expr]:
    numbers = {}
    for name, value in _table("parameters", given).items():
        if name in symbols or name in FORMULA_NAMES:
            raise ProblemError(f"parameters.{name}: the name is already used; choose another")
        if not _is_number(value) and not isinstance(value, str):
            raise ProblemError(f"parameters.{name}: expected a number, got {value!r}")
        numbers[name] = _formula(f"parameters.{name}", value, numbers)
    return numbers


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _formula(field: str, given: Any, terms: Mapping[str, sp.Expr]) -> sp.Expr:
    return parse_expression(str(given) if _is_number(given) else given, terms, field)


def parse_relations(
    name: str, text: object, symbols: Mapping[str, sp.Expr], where: str
) -> dict[str, sp.Rel]:
    """Read a single or double inequality from text, without evaluating or comparing its sides.

    A double inequality gives ``name_low`` and ``name_high``. Formulas are separated by ``<=``,
    ``<``, ``>=`` or ``>``. Raises `ExpressionError`, which begins with ``where``, if the text is
    not an inequality, or if three formulas are not in order.

    Examples
    --------
    >>> x, y = sp.symbols("x y")
    >>> parse_relations("gap", "-1 <= x - y < 1", {"x": x, "y": y}, "constraints.gap")
    {'gap_low': -1 <= x - y, 'gap_high': x - y < 1}
    """
    if not isinstance(text, str):
        raise ExpressionError(f'{where}: expected text such as "x <= 1", got {text!r}')
    parts = SIGN.split(text)
    sides, signs = parts[::2], parts[1::2]
    if not 1 <= len(signs) <= 2 or "=" in "".join(sides):
        raise ExpressionError(
            f'{where}: {text[:LONGEST]!r} is not an inequality; write it as "x**2 + y <= 1" or '
            '"-1 <= x <= 1", with <=, <, >= or > (express an equality by the map, q_0 or q_d)'
        )
    if len({sign[0] for sign in signs}) > 1:
        raise ExpressionError(
            f"{where}: {text[:LONGEST]!r} has two bounds on the same side; write two inequalities"
        )
    formulas = [parse_expression(side, symbols, where) for side in sides]
    names = [name] if len(signs) == 1 else [row_name(name, side) for side in ("low", "high")]
    if signs[0][0] == ">":
        names.reverse()
    return {
        own: SIGNS[sign](left, right, evaluate=False)
        for own, sign, left, right in zip(names, signs, formulas, formulas[1:])
    }


# ---- readers of the keys


@dataclass(frozen=True, kw_only=True, eq=False)
class _Names:
    """Names of a file: symbols, states in their order, and parameters with their numbers."""

    symbols: Mapping[str, sp.Symbol]
    states: list[str]
    numbers: Mapping[str, sp.Expr]

    @property
    def terms(self) -> dict[str, sp.Expr]:
        """Meaning of every name in a formula."""
        return {**self.symbols, **self.numbers}

    def value(self, field: str, given: Any, word: str) -> Any:
        """Return a number, a formula of parameters as a number, or None for the given word."""
        if given == word:
            return None
        if not isinstance(given, str):
            return given
        try:
            return float(_formula(field, given, self.numbers))
        except ProblemError as error:
            raise ProblemError(
                f'{field}: {given!r} is neither a number nor "{word}", nor a formula of numbers '
                f"and parameters: {str(error).removeprefix(f'{field}: ')}"
            ) from None

    def of_states(self, field: str, given: Any) -> list:
        """Return a list, or a table with every state exactly once, in the states' order."""
        if not isinstance(given, Mapping):
            if not isinstance(given, list):
                raise ProblemError(f"{field}: expected one value for each state, got {given!r}")
            return given
        missing = [name for name in self.states if name not in given]
        unknown = [name for name in given if name not in self.states]
        if missing or unknown:
            raise ProblemError(
                f"{field}: every state exactly once ({', '.join(self.states)}), but "
                f"missing: {', '.join(missing) or '-'}; unknown: {', '.join(unknown) or '-'}"
            )
        return [given[name] for name in self.states]


def _as_given(field: str, given: Any, _: object) -> Any:
    return given


def _symbols(field: str, given: Any, names: _Names) -> list[sp.Symbol]:
    return [names.symbols[name] for name in given]


def _expression(field: str, given: Any, names: _Names) -> sp.Expr:
    return _formula(field, given, names.terms)


def _expressions(field: str, given: Any, names: _Names) -> list[sp.Expr]:
    rows = zip(names.states, names.of_states(field, _table(field, given)))
    return [_formula(f"{field}.{name}", row, names.terms) for name, row in rows]


def _end(field: str, given: Any, names: _Names) -> list:
    return [names.value(field, value, "free") for value in names.of_states(field, given)]


def _inputs(field: str, given: Any, names: _Names) -> dict[sp.Symbol, float | list[float]]:
    for name, value in given.items():
        if not all(map(_is_number, value if isinstance(value, list) else [value])):
            raise ProblemError(
                f"{field}.{name}: expected a number or a list of numbers, one for each stage, "
                f"got {value!r}"
            )
    return {names.symbols[name]: value for name, value in given.items()}


def _scales(field: str, given: Any, names: _Names) -> dict[str, Any]:
    """Return scales; a list of two numbers is a factor and an offset."""
    pair = lambda value: isinstance(value, list) and len(value) == 2  # noqa: E731
    table = _table(field, given)
    return {name: Scale(*value) if pair(value) else value for name, value in table.items()}


def _relations(field: str, given: Any, names: _Names) -> dict[str, sp.Rel]:
    found: dict[str, sp.Rel] = {}
    for name, text in _table(field, _numbered(PREFIXES[field], given)).items():
        relations = parse_relations(name, text, names.terms, f"{field}.{name}")
        for own in found.keys() & relations.keys():
            raise ProblemError(f"{field}.{name}: the name {own!r} is already used; choose another")
        found |= relations
    return found


def _bounds(field: str, given: Any, names: _Names) -> dict[str, Any]:
    """Return pairs of numbers, with None for "none"."""
    table = _table(field, given)
    for name, pair in table.items():
        if not isinstance(pair, list) or not all(_is_number(v) or isinstance(v, str) for v in pair):
            raise ProblemError(
                f'{field}.{name}: expected two numbers, or "none" for no bound, got {pair!r}'
            )
    return {
        name: [names.value(f"{field}.{name}", end, "none") for end in pair]
        for name, pair in table.items()
    }


def _objectives(field: str, given: Any, names: _Names) -> dict[str, sp.Expr]:
    table = _table(field, _numbered("J", given))
    return {name: _formula(f"{field}.{name}", text, names.terms) for name, text in table.items()}


_READERS: dict[str, Callable[[str, Any, _Names], Any]] = {
    "states": _symbols,
    "controls": _symbols,
    "dt": _as_given,
    "horizon": _as_given,
    "q_0": _end,
    "name": _as_given,
    "q_d": _end,
    "cost": _expression,
    "terminal_cost": _expression,
    "parameters": _as_given,
    "dynamics": _expressions,
    "map": _expressions,
    "inputs": _inputs,
    "units": _table,
    "scales": _scales,
    "constraints": _relations,
    "terminal_constraints": _relations,
    "bounds": _bounds,
    "soft": _as_given,
    "objectives": _objectives,
    "weights": _as_given,
    "temperature": _as_given,
}
"""Readers by key of a problem file, in the order of messages."""
REQUIRED = ("states", "controls", "dt", "horizon", "q_0")
