"""Words become objects: what a user types, looked up in a table or read as numbers.

Nothing that is typed is ever evaluated.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from ann_dc.errors import ProblemError, UnknownNameError

if TYPE_CHECKING:
    from ann_dc.backends.ode import OdeBackend
    from ann_dc.decomposition.form import Form
    from ann_dc.problem.declaration import OptimalControlProblem
    from ann_dc.problem.start import Start

LARGEST = 1e100
"""Beyond this magnitude, products of three numbers do not fit into a float."""

Thing = TypeVar("Thing")

FormOption = Annotated[
    str,
    typer.Option(
        metavar="FORM",
        help="Equations: corrected, printed (as in the paper), or one slip of it, S1 to S16.",
    ),
]


def named(option: str, word: str, table: Mapping[str, Thing]) -> Thing:
    """Look up what a word stands for, in upper or lower case.

    >>> named("--colour", "RED", {"red": 1})
    1

    Raises
    ------
    UnknownNameError
        With the words that exist.
    """
    for name, thing in table.items():
        if name.lower() == word.lower():
            return thing
    raise UnknownNameError.of(option, word, table)


def form_of(word: str) -> Form:
    """The form of the equations that --form names."""
    from ann_dc.decomposition.form import CORRECTED, PRINTED, SWITCHES

    return named("--form", word, {"corrected": CORRECTED, "printed": PRINTED, **SWITCHES})


def start_of(word: str, seed: int, problem: OptimalControlProblem) -> Start:
    """The start that --start and --seed name."""
    from ann_dc.problem.start import line_start, random_start, zero_start

    kinds: dict[str, Callable[[OptimalControlProblem], Start]] = {
        "line": line_start,
        "zero": zero_start,
        "random": partial(random_start, rng=seed),
    }
    return named("--start", word, kinds)(problem)


def backend_of(word: str, *, method: str, limit: float, **settings: Any) -> OdeBackend:
    """The backend that --backend, --method and --limit describe."""
    from ann_dc.backends.ode import METHODS, OdeBackend

    kind = named("--backend", word, {"ode": OdeBackend})
    if not 0 < limit < math.inf:
        raise ProblemError(f"--limit: expected a positive number, got {limit!r}")
    return kind(method=named("--method", method, METHODS), limit=limit, **settings)


def settings_of(given: Iterable[str]) -> dict[str, str]:
    """``["D=0.5", "horizon=18"]`` as a table; horizon is another word for N."""
    settings: dict[str, str] = {}
    for item in given:
        name, equals, text = (part.strip() for part in item.partition("="))
        if not (name and equals and text):
            raise ProblemError(
                f"--set: expected NAME=VALUE, for instance D=0.5 or q_d=5,5,0,free, got {item!r}"
            )
        name = "N" if name == "horizon" else name
        if name in settings:
            raise ProblemError(f"{name}: given twice ({settings[name]} and {text}); give it once")
        settings[name] = text
    return settings


def value_of(name: str, text: str, like: Any) -> Any:
    """A parameter's value from its text, of the same kind as its default."""
    if isinstance(like, (tuple, list)) or like is None:
        if name == "q_d" and text.lower() == "free":
            return None
        words = [word.strip() for word in text.strip("()[]").split(",")]
        is_free = lambda word: name == "q_d" and word.lower() == "free"  # noqa: E731
        values = tuple(None if is_free(word) else number_of(name, word) for word in words)
        if like is not None and len(values) != len(like):
            raise ProblemError(
                f"{name}: expected {len(like)} numbers separated by commas, got {text!r}"
            )
        return values
    if not isinstance(like, int):
        return number_of(name, text)
    if not re.fullmatch(r"[+-]?\d{1,18}", text):
        raise ProblemError(f"{name}: expected a whole number, got {text!r}")
    return int(text)


def number_of(name: str, text: str) -> float:
    """A number that the arithmetic can work with."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        allowed = "a finite number, or free" if name == "q_d" else "a finite number"
        raise ProblemError(f"{name}: expected {allowed}, got {text!r}; decimals take a point")
    if abs(number) > LARGEST:
        raise ProblemError(
            f"{name}: {text} is too large for the arithmetic; choose units in which states and "
            "controls are near 1"
        )
    return number


def as_typed(value: Any) -> str:
    """A value as --set takes it."""
    if isinstance(value, (tuple, list)):
        return ",".join(map(as_typed, value))
    return "free" if value is None else f"{value:.6g}"
