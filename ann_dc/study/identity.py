"""What makes a study this one: plain data, and in what another differs from it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from ann_dc.errors import StoreError

WORDS = ("title", "spec")
"""What says only how rows are read."""
TOLD = 6
"""Differences in a sentence; the others are counted."""
LONGEST = 60
"""Characters of a value in a sentence."""


def as_text(identity: Mapping[str, Any]) -> str:
    """Nested plain data as JSON, arrays as lists.

    Parameters
    ----------
    identity : mapping

    Raises
    ------
    StoreError
        If something in it is no plain data.

    Examples
    --------
    >>> as_text({"over": {"problem.N": (9, 18)}, "seed": 0})
    '{"over": {"problem.N": [9, 18]}, "seed": 0}'
    """
    try:
        return json.dumps(dict(identity), default=_plain)
    except (TypeError, ValueError) as error:
        raise StoreError(f"identity: expected plain data, as JSON has it: {error}") from error


def _plain(value: Any) -> Any:
    """NumPy's arrays and numbers."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{value!r:.80} is none")


def lasting(identity: str) -> str:
    """What decides the rows: all but `WORDS`.

    Parameters
    ----------
    identity : str
        As `as_text` writes it.

    Examples
    --------
    >>> lasting('{"title": "chips", "seed": 0}')
    '{"seed": 0}'
    """
    kept = {name: value for name, value in json.loads(identity).items() if name not in WORDS}
    return json.dumps(kept)


def differences(stored: str, given: str) -> str:
    """Tell what changed from one identity to another; nothing if they are the same.

    Parameters
    ----------
    stored, given : str
        As `as_text` writes them.

    Examples
    --------
    >>> differences('{"over": {"N": [9, 18]}, "seed": 0}', '{"over": {"N": [9, 36, 72]}}')
    'over.N[1]: 18 -> 36; over.N[2]: none -> 72; seed: 0 -> none'
    """
    if stored == given:
        return ""
    before, after = dict(_leaves(json.loads(stored))), dict(_leaves(json.loads(given)))
    names = [*before, *(name for name in after if name not in before)]
    found = [
        f"{name}: {_told(before.get(name))} -> {_told(after.get(name))}"
        for name in sorted(names)
        if before.get(name) != after.get(name)
    ]
    if len(found) > TOLD:
        found[TOLD:] = [f"and {len(found) - TOLD} more"]
    return "; ".join(found) or "the order of its entries"


def _leaves(value: Any, name: str = "") -> Iterator[tuple[str, str]]:
    """Every single value as JSON, by its name; what is empty too."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from _leaves(inner, f"{name}.{key}".removeprefix("."))
    elif isinstance(value, list) and value:
        for index, inner in enumerate(value):
            yield from _leaves(inner, f"{name}[{index}]")
    else:
        yield name, json.dumps(value)


def _told(value: str | None) -> str:
    if value is None:
        return "none"
    return value if len(value) <= LONGEST else f"{value[:LONGEST]}..."
