"""Lookup of names in tables, with errors that list the valid names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from ann_dc.errors import UnknownNameError

Thing = TypeVar("Thing")


def named(option: str, word: str, table: Mapping[str, Thing]) -> Thing:
    """Return the table entry of a name, in upper or lower case.

    Raises `UnknownNameError` with the valid names.

    >>> named("--colour", "RED", {"red": 1})
    1
    """
    for name, thing in table.items():
        if name.lower() == word.lower():
            return thing
    raise UnknownNameError.of(option, word, table)


def hyphened(table: Mapping[str, Thing]) -> dict[str, Thing]:
    """Return the table with names that need no quotes on a command line.

    >>> hyphened({"two phase": 2})
    {'two-phase': 2}
    """
    return {name.replace(" ", "-"): thing for name, thing in table.items()}
