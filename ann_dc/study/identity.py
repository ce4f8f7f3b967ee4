"""Identity of a study as plain data, and differences between two identities."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from ann_dc.errors import StoreError

WORDS = ("title", "spec")
"""Entries that affect only the interpretation of records."""
TOLD = 6
"""Number of differences listed in a message; further ones are counted."""
LONGEST = 60
"""Largest number of characters of a value in a message."""


def as_text(identity: Mapping[str, Any]) -> str:
    """Return nested plain data as JSON, with arrays as lists.

    Raises `StoreError` if the data contains other objects.

    Examples
    --------
    >>> as_text({"vary": {"problem.N": (9, 18)}, "seed": 0})
    '{"vary": {"problem.N": [9, 18]}, "seed": 0}'
    """
    try:
        return json.dumps(dict(identity), default=_plain)
    except (TypeError, ValueError) as error:
        raise StoreError(f"identity: expected plain data, as JSON has it: {error}") from error


def _plain(value: Any) -> Any:
    """Convert NumPy arrays and numbers; raise `TypeError` for other objects."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{value!r:.80} is none")


def lasting(identity: str) -> str:
    """Return the part of an identity (JSON) that determines the records (not `WORDS`).

    Examples
    --------
    >>> lasting('{"title": "chips", "seed": 0}')
    '{"seed": 0}'
    """
    kept = {name: value for name, value in json.loads(identity).items() if name not in WORDS}
    return json.dumps(kept)


def differences(stored: str, given: str) -> str:
    """Return a description of the differences between two identities (JSON), or "".

    Examples
    --------
    >>> differences('{"vary": {"N": [9, 18]}, "seed": 0}', '{"vary": {"N": [9, 36, 72]}}')
    'seed: 0 -> none; vary.N[1]: 18 -> 36; vary.N[2]: none -> 72'
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
    """Yield each single value (or empty container) as JSON with its dotted name."""
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
