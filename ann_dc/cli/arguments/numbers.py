"""Conversion of ``--set NAME=VALUE`` text to numbers of the type of the default.

Every number is finite and small enough that products in a network do not overflow.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Any

from ann_dc.errors import ProblemError

ENDS = ("q_0", "q_d")
"""Settings with components that may be free."""
LARGEST = 1e100
"""Magnitude above which products of three numbers overflow."""


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
            raise ProblemError(f"{name}: given twice ({pairs[name]} and {text}); give it once")
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
        raise ProblemError(f"{name}: expected {allowed}, got {text!r}; decimals take a point")
    if abs(number) > LARGEST:
        raise ProblemError(
            f"{name}: {text} is too large for the arithmetic; choose units in which states and "
            "controls are near 1"
        )
    return number


def as_typed(value: Any) -> str:
    """Return a value in the form that --set accepts."""
    if isinstance(value, (tuple, list)):
        return ",".join(map(as_typed, value))
    return "free" if value is None else f"{value:.6g}"
