"""Short representations of records: one line of text, or an HTML table in a notebook."""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np

Kind = TypeVar("Kind", bound=type)

LONGEST = 120
"""Number of characters of a value in a representation."""


def summarised(rows: Callable[[Any], Mapping[str, object]]) -> Callable[[Kind], Kind]:
    """Add a short ``repr`` and a notebook table of the named values of ``rows`` to a class.

    Examples
    --------
    >>> @summarised(lambda self: {"name": "car", "stages": 20})
    ... class Example: ...
    >>> Example()
    Example(name: car, stages: 20)
    """

    def text_of(self: Any) -> str:
        inside = ", ".join(f"{name}: {_short(value)}" for name, value in rows(self).items())
        return f"{type(self).__name__}({inside})"

    def html_of(self: Any) -> str:
        lines = "".join(
            f"<tr><th>{html.escape(name)}</th><td>{html.escape(_short(value))}</td></tr>"
            for name, value in rows(self).items()
        )
        return f"<table><caption>{type(self).__name__}</caption>{lines}</table>"

    def give(kind: Kind) -> Kind:
        methods: dict[str, Callable[[Any], str]] = {"__repr__": text_of, "_repr_html_": html_of}
        for name, method in methods.items():
            setattr(kind, name, method)
        return kind

    return give


def extent(values: np.ndarray) -> str:
    """Return the range of an array in a few words.

    Examples
    --------
    >>> extent(np.array([0.25, 3.0, np.nan])), extent(np.array([2, 2]))
    ('0.25 .. 3', '2')
    """
    known = values[~np.isnan(values)]
    if not known.size:
        return "none"
    low, high = f"{known.min():.4g}", f"{known.max():.4g}"
    return low if low == high else f"{low} .. {high}"


def _short(value: object) -> str:
    text = " ".join(str(value).split())
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."
