"""Comparison of network wiring: equality except for weights and time constants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.network.network import Network

NUMBERS = {"weight", "tau"}
"""Fields in which connections and neurons of one wiring may differ."""
WORDS = {"title", "ranges", "cell"}
"""Fields of a network that do not affect the wiring or are compared separately."""
ELSEWHERE = {
    "inputs": "; give them to run_batch as inputs",
    "start": "; give them to run_batch as x",
}
"""Remedies for fields that differ."""


def require_one_wiring(first: Network, other: Network, number: int) -> None:
    """Raise `NetworkError` if networks differ in more than weights and tau.

    The message contains the given number of the network and names the difference.
    """
    for a, b in ((first, other), (first.cell, other.cell)):
        for field in (f.name for f in fields(a) if f.name not in WORDS):
            own, its = getattr(a, field), getattr(b, field)
            if not _is_same(own, its):
                raise NetworkError(
                    f"networks: number {number} has other {field.replace('_', ' ')} than the first"
                    f"{_where(own, its)}{ELSEWHERE.get(field, '')}"
                )


def _is_same(own: Any, its: Any) -> bool:
    """Return True if two values are equal except for the fields `NUMBERS`."""
    if own is its:
        return True
    if type(own) is not type(its):
        return False
    if isinstance(own, Mapping):
        return own.keys() == its.keys() and all(_is_same(own[key], its[key]) for key in own)
    if isinstance(own, (tuple, list)):
        return len(own) == len(its) and all(map(_is_same, own, its))
    if is_dataclass(own):
        names = [f.name for f in fields(own) if f.name not in NUMBERS]
        return all(_is_same(getattr(own, name), getattr(its, name)) for name in names)
    return bool(np.array_equal(own, its))


def _where(own: Any, its: Any) -> str:
    """Return the name of the first item that differs, for the message."""
    if isinstance(own, Mapping):
        keys = [key for key in own if key not in its or not _is_same(own[key], its[key])]
        keys += [key for key in its if key not in own]
        return f": {keys[0]}"
    if not isinstance(own, tuple):
        return ""
    if len(own) != len(its):
        return f": {len(its)} for {len(own)}"
    differing = next(a for a, b in zip(own, its) if not _is_same(a, b))
    name = getattr(differing, "name", "")
    return f": {name}" if name else ""
