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
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import sympy as sp

from ann_dc.errors import ProblemError
from ann_dc.files import read_table
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.expression import parse_expression
from ann_dc.problem.fields import FORMULA_NAMES
from ann_dc.problem.inequality import PREFIXES
from ann_dc.problem.relation_text import parse_relations
from ann_dc.problem.step_length import StepLength
from ann_dc.scale import Scale
from ann_dc.validation import checked

REQUIRED = ("states", "controls", "dt", "horizon", "q_0")
OPTIONAL = (
    "name",
    "q_d",
    "cost",
    "terminal_cost",
    "parameters",
    "dynamics",
    "map",
    "inputs",
    "units",
    "scales",
    "constraints",
    "terminal_constraints",
    "bounds",
    "soft",
    "objectives",
    "weights",
    "temperature",
)


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
    inputs = _table("inputs", table.get("inputs", {}))
    dt = _step(table["dt"])
    symbols = {name: sp.Symbol(name) for name in (*states, *controls, *inputs)}
    if isinstance(dt, StepLength):
        symbols.setdefault(str(dt.symbol), sp.Symbol(str(dt.symbol)))
    numbers = _parameters(table.get("parameters", {}), symbols)
    terms = symbols | numbers
    return OptimalControlProblem(
        name=_text("name", table.get("name", default_name)),
        states=[symbols[name] for name in states],
        controls=[symbols[name] for name in controls],
        dt=dt,
        horizon=table["horizon"],
        q_0=_end("q_0", table["q_0"], states, numbers),
        q_d=_end("q_d", table["q_d"], states, numbers) if "q_d" in table else None,
        **({"cost": _formula("cost", table["cost"], terms)} if "cost" in table else {}),
        terminal_cost=_formula("terminal_cost", table.get("terminal_cost", 0), terms),
        dynamics=_formulas("dynamics", table, states, terms),
        map=_formulas("map", table, states, terms),
        inputs={symbols[name]: _input(name, value) for name, value in inputs.items()},
        units=_table("units", table.get("units", {})),
        scales=_scales(_table("scales", table.get("scales", {}))),
        constraints=_relations("constraints", table, terms),
        terminal_constraints=_relations("terminal_constraints", table, terms),
        bounds=_bounds(_table("bounds", table.get("bounds", {})), numbers),
        soft=table.get("soft", {}),
        objectives=_objectives(table.get("objectives", []), terms),
        weights=table.get("weights"),
        temperature=table.get("temperature", 0.0),
    )


def _check_keys(table: Mapping) -> None:
    known = ", ".join(REQUIRED + OPTIONAL)
    for key in table:
        if key not in REQUIRED + OPTIONAL:
            raise ProblemError(f"unknown key {key!r}; a problem file has the keys {known}")
    for key in REQUIRED:
        if key not in table:
            raise ProblemError(
                f"{key}: missing; a problem file has the keys {known} (plain keys stand before "
                "the first [table])"
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
        raise ProblemError("dt.low: missing; a step length that is chosen has a lower bound")
    return StepLength(**given)


def _names(field: str, given: object) -> list[str]:
    if not isinstance(given, list) or not all(isinstance(name, str) and name for name in given):
        raise ProblemError(f'{field}: expected a list of names such as ["x", "v"], got {given!r}')
    return given


def _text(field: str, given: object) -> str:
    if not isinstance(given, str):
        raise ProblemError(f"{field}: expected text, got {given!r}")
    return given


def _table(field: str, given: object) -> Mapping:
    if not isinstance(given, Mapping):
        raise ProblemError(f"{field}: expected a table, written [{field}], got {given!r}")
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


def _value(field: str, given: object, numbers: Mapping[str, sp.Expr], word: str) -> object:
    """Return a number, or None for the given word; other text is a formula.

    Formulas contain numbers and parameters only.
    """
    if given == word:
        return None
    if not isinstance(given, str):
        return given
    try:
        return float(_formula(field, given, numbers))
    except ProblemError as error:
        raise ProblemError(
            f'{field}: {given!r} is neither a number nor "{word}", nor a formula of numbers and '
            f"parameters: {str(error).removeprefix(f'{field}: ')}"
        ) from None


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _formula(field: str, given: object, terms: Mapping[str, sp.Expr]) -> sp.Expr:
    return parse_expression(
        str(given) if _is_number(given) else given,  # type: ignore[arg-type]
        terms,
        field,
    )


def _formulas(
    field: str, table: Mapping, states: Sequence[str], terms: Mapping[str, sp.Expr]
) -> list[sp.Expr] | None:
    if field not in table:
        return None
    rows = _per_state(field, _table(field, table[field]), states)
    return [_formula(f"{field}.{name}", row, terms) for name, row in zip(states, rows)]


def _per_state(field: str, given: object, states: Sequence[str]) -> list:
    """Return a list, or a table with every state exactly once, in the states' order."""
    if isinstance(given, Mapping):
        missing = [name for name in states if name not in given]
        unknown = [name for name in given if name not in states]
        if missing or unknown:
            raise ProblemError(
                f"{field}: every state exactly once ({', '.join(states)}), but "
                f"missing: {', '.join(missing) or '-'}; unknown: {', '.join(unknown) or '-'}"
            )
        return [given[name] for name in states]
    if not isinstance(given, list):
        raise ProblemError(f"{field}: expected one value for each state, got {given!r}")
    return given


def _end(field: str, given: object, states: Sequence[str], numbers: Mapping[str, sp.Expr]) -> list:
    return [_value(field, value, numbers, "free") for value in _per_state(field, given, states)]


def _input(name: str, given: object) -> float | list[float]:
    values = given if isinstance(given, list) else [given]
    if not all(map(_is_number, values)):
        raise ProblemError(
            f"inputs.{name}: expected a number or a list of numbers, one for each stage, "
            f"got {given!r}"
        )
    return given  # type: ignore[return-value]


def _scales(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return scales; a list of two numbers is a factor and an offset."""
    pair = lambda value: isinstance(value, list) and len(value) == 2  # noqa: E731
    return {name: Scale(*value) if pair(value) else value for name, value in table.items()}


def _relations(field: str, table: Mapping, terms: Mapping[str, sp.Expr]) -> dict[str, sp.Rel]:
    """Return relations from a table of texts, or from a list, which is numbered."""
    given = table.get(field, {})
    if isinstance(given, list):
        given = {f"{PREFIXES[field]}{number}": text for number, text in enumerate(given, 1)}
    found: dict[str, sp.Rel] = {}
    for name, text in _table(field, given).items():
        relations = parse_relations(name, text, terms, f"{field}.{name}")
        for own in found.keys() & relations.keys():
            raise ProblemError(f"{field}.{name}: the name {own!r} is already used; choose another")
        found |= relations
    return found


def _objectives(given: object, terms: Mapping[str, sp.Expr]) -> Any:
    """Return objectives from a table of formulas, or from a list, which is numbered."""
    if isinstance(given, list):
        given = {f"J{number}": text for number, text in enumerate(given, 1)}
    table = _table("objectives", given)
    return {name: _formula(f"objectives.{name}", text, terms) for name, text in table.items()}


def _bounds(table: Mapping[str, Any], numbers: Mapping[str, sp.Expr]) -> dict[str, Any]:
    """Return pairs of numbers, with None for "none"."""
    for name, pair in table.items():
        if not isinstance(pair, list) or not all(_is_number(v) or isinstance(v, str) for v in pair):
            raise ProblemError(
                f'bounds.{name}: expected two numbers, or "none" where there is no bound, got '
                f"{pair!r}"
            )
    return {
        name: [_value(f"bounds.{name}", end, numbers, "none") for end in pair]
        for name, pair in table.items()
    }
