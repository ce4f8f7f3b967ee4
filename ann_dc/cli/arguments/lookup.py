"""A word stands for a thing in a table; where it does not, the error lists the words that do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from ann_dc.errors import UnknownNameError

Thing = TypeVar("Thing")


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


def hyphened(table: Mapping[str, Thing]) -> dict[str, Thing]:
    """The same table with names that can be typed without quotes.

    >>> hyphened({"two phase": 2})
    {'two-phase': 2}
    """
    return {name.replace(" ", "-"): thing for name, thing in table.items()}
