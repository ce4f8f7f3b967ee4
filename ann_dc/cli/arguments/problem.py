"""Problem options: PROBLEM, --set, --horizon, --q-0 and --q-d as one problem.

PROBLEM is the name of a plant, whose parameters --set changes, or a .toml file. For a file, q_0,
q_d, horizon and dt can be changed. Text becomes numbers of the type of the default. Every number is
finite and small enough that products in a network do not overflow.
"""

from __future__ import annotations

import contextlib
import difflib
import inspect
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ann_dc.cli.arguments.options import argument, completing, option
from ann_dc.errors import AnnDcError, ProblemError, UnknownNameError
from ann_dc.timing import phase

ENDS = ("q_0", "q_d")
"""Settings with components that may be free."""
LARGEST = 1e100
"""Magnitude above which products of three numbers overflow."""


def plants_known() -> tuple[str, ...]:
    """Return the names of the plants."""
    from ann_dc.problem import plants

    return plants.names()


def settings_of(given: Iterable[str]) -> dict[str, str]:
    """Return ``["D=0.5", "horizon=18"]`` as a table; horizon is an alias of N.

    Raises `ProblemError` if an item is not NAME=VALUE, or a name occurs twice.
    """
    renamed = [re.sub(r"^\s*horizon\s*=", "N=", item) for item in given]
    return pairs_of(renamed, "--set", "D=0.5 or q_d=5,5,0,free")


def pairs_of(given: Iterable[str], option: str, example: str) -> dict[str, str]:
    """Return a table of NAME=VALUE items.

    Raises `ProblemError` if an item is not NAME=VALUE, or a name occurs twice.
    """
    pairs: dict[str, str] = {}
    for item in given:
        name, equals, text = (part.strip() for part in item.partition("="))
        if not (name and equals and text):
            raise ProblemError(
                f"{option}: expected NAME=VALUE, for instance {example}, got {item!r}"
            )
        if name in pairs:
            raise ProblemError(
                f"{name}: specified twice ({pairs[name]} and {text}); specify it once"
            )
        pairs[name] = text
    return pairs


def value_of(name: str, text: str, like: Any) -> Any:
    """Return a parameter value of the type of its default `like` from text.

    For None and sequences the text contains comma-separated numbers, except for dt, which takes
    one. Raises `ProblemError` for invalid numbers or a wrong count.
    """
    if isinstance(like, (tuple, list)) or like is None:
        if name in ("q_d", "dt") and text.lower() == "free":
            return None
        if name == "dt":
            return number_of(name, text)
        words = [word.strip() for word in text.strip("()[]").split(",")]
        is_free = lambda word: name in ENDS and word.lower() == "free"  # noqa: E731
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
    """Return a number whose magnitude is at most `LARGEST`.

    Raises `ProblemError` with the parameter name for other text.
    """
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        allowed = "a finite number, or free" if name in ENDS else "a finite number"
        raise ProblemError(f"{name}: expected {allowed}, got {text!r}; use a decimal point")
    if abs(number) > LARGEST:
        raise ProblemError(
            f"{name}: {text} is too large for the arithmetic; choose units in which states and "
            "controls are of order 1"
        )
    return number


def as_typed(value: Any) -> str:
    """Return a value in the form that --set accepts."""
    if isinstance(value, (tuple, list)):
        return ",".join(map(as_typed, value))
    return "free" if value is None else f"{value:.6g}"


SCALE = "scale."
"""Prefix that distinguishes a manual scale from a parameter of a plant."""

NOT_FINITE = re.compile(r"\b(infs?|nans?|finite|too big|too large|maximum)\b", re.IGNORECASE)
"""Pattern of NumPy and SciPy messages on numbers and arrays that are too large."""


@dataclass(frozen=True, kw_only=True)
class ProblemOptions:
    """Options that describe a problem."""

    problem: str = argument(
        "Plant (see ann-dc plants) or .toml file.",
        metavar="PROBLEM",
        autocompletion=completing(plants_known),
    )
    settings: list[str] | None = option(
        "Parameter of the plant (D=0.5, q_d=5,5,0,free), q_0, q_d, horizon or dt of a .toml file, "
        "or a scale (scale.x=1000). Repeatable.",
        "--set",
        metavar="NAME=VALUE",
    )
    horizon: int | None = option("Number of stages N, each of duration dt.", "--horizon", "-N")
    q_0: str | None = option(
        "Initial state; free for an open component.", "--q-0", metavar="NUMBERS"
    )
    q_d: str | None = option(
        "Terminal state; free for an open component.", "--q-d", metavar="NUMBERS"
    )

    @phase("problem")
    def declared(self):
        """Return the described `OptimalControlProblem`."""
        return problem_of(self.problem, self.settings or (), self.horizon, self.q_0, self.q_d)


def problem_of(
    word: str, given: Sequence[str], horizon: int | None, q_0: str | None, q_d: str | None
):
    """Return the problem that PROBLEM, --set, --horizon, --q-0 and --q-d describe."""
    short = {"N": horizon, "q_0": q_0, "q_d": q_d}
    settings = settings_of([*given, *(f"{n}={v}" for n, v in short.items() if v is not None)])
    scales = {
        name.removeprefix(SCALE): number_of(name, settings.pop(name))
        for name in [name for name in settings if name.startswith(SCALE)]
    }
    problem = _unscaled(word, settings)
    return replace(problem, scales={**problem.scales, **scales}) if scales else problem


def _unscaled(word: str, settings: Mapping[str, str]):
    """Return the problem of a plant or file with its settings, without manual scales."""
    from ann_dc.problem import plants

    is_file = word.lower().endswith(".toml") or os.sep in word or Path(word).is_file()
    if is_file and word not in plants.names():
        return _from_file(word, settings)
    return _declared(plant_of(word), settings)


def plant_of(word: str):
    """Return the plant of a name.

    Raises `UnknownNameError` with the nearest and all other names.
    """
    from ann_dc.problem import plants

    if word in plants.names():
        return plants.get(word)
    near = difflib.get_close_matches(word.lower(), plants.names(), n=2, cutoff=0.5)
    hint = f"; did you mean {' or '.join(near)}?" if near else "."
    raise UnknownNameError(
        f"unknown plant {word!r}{hint} The plants are {', '.join(plants.names())}. Other "
        "problems are declared in a .toml file"
    )


def defaults_of(plant: Callable[..., object]) -> dict[str, Any]:
    """Return the parameters of a plant with their defaults."""
    return {p.name: p.default for p in inspect.signature(plant).parameters.values()}


def _declared(plant: Callable[..., Any], settings: Mapping[str, str]):
    """Return the problem of a plant with some parameters changed."""
    defaults = defaults_of(plant)
    values = {}
    for name, text in settings.items():
        if name not in defaults:
            raise UnknownNameError.of(f"--set: parameter of {plant.__name__}", name, defaults)
        values[name] = value_of(name, text, defaults[name])
    try:
        return plant(**values)
    except (ArithmeticError, TypeError, ValueError) as error:  # a wheel base of 0, a seed of -1
        given = ", ".join(f"{name}={text}" for name, text in settings.items())
        raise ProblemError(f"{plant.__name__} with {given}: {error}") from error


def _from_file(path: str, settings: Mapping[str, str]):
    """Return the problem of a file with some numbers changed."""
    from ann_dc.problem.toml_file import load_problem

    problem = load_problem(path)
    own = slice(problem.n - len(problem.handed_on))
    ends = {"q_0": problem.q_0[own], "q_d": (problem.q_d or ())[own]}
    like = {"N": problem.horizon, **ends, "dt": 0.1}
    values = {}
    for name, text in settings.items():
        if name not in like:
            raise UnknownNameError(
                f"--set: {name!r} of a file cannot be set on the command line; choose one of: "
                f"q_0, q_d, horizon, dt, or edit {path}"
            )
        values[name] = value_of(name, text, like[name])
    if "N" in values:
        problem = problem.with_horizon(values.pop("N"))
    return replace(problem, **values)


@contextlib.contextmanager
def arithmetic_of(name: str) -> Iterator[None]:
    """Convert overflow, singular matrices and oversized arrays to a `ProblemError`.

    The message begins with the name of the problem or network. Any other ValueError or TypeError
    indicates a defect of the library and is raised unchanged.
    """
    import numpy as np

    try:
        with np.errstate(all="ignore"):  # the outcome tells, not a warning on the way
            yield
    except AnnDcError:
        raise
    except (ArithmeticError, MemoryError, ValueError) as error:
        numeric = not isinstance(error, ValueError) or isinstance(error, np.linalg.LinAlgError)
        if not (numeric or NOT_FINITE.search(str(error))):
            raise
        raise ProblemError(
            f"{name}: the arithmetic failed ({error}); choose units in which states and "
            "controls are of order 1, or a shorter horizon"
        ) from error
