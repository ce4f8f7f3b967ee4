"""HTML fragments; any input that is not `Markup` is escaped as text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

LONGEST = 400
"""Largest number of characters shown of a value."""
LISTED = 12
"""Largest number of items shown of a list."""


class Markup(str):
    """Text that is already HTML."""

    __slots__ = ()


def element(tag: str, *content: object, **attributes: object) -> Markup:
    """Return an element with its content.

    `Markup` is inserted unchanged, None is omitted, and everything else is text. The attribute
    ``class_`` is written as class, ``data_x`` as data-x.

    Examples
    --------
    >>> element("td", "a<b", class_="n")
    '<td class="n">a&lt;b</td>'
    """
    words = "".join(
        f' {name.rstrip("_").replace("_", "-")}="{escape(str(value))}"'
        for name, value in attributes.items()
    )
    return Markup(f"<{tag}{words}>{joined(content)}</{tag}>")


def joined(content: Iterable[object]) -> Markup:
    """Return the concatenation of fragments."""
    return Markup(
        "".join(
            piece if isinstance(piece, Markup) else escape(str(piece))
            for piece in content
            if piece is not None
        )
    )


def table(head: Iterable[object], rows: Iterable[Iterable[object]], **attributes: object) -> Markup:
    """Return a table with right-aligned numbers; attributes apply to the table."""
    top = element("tr", *(element("th", name, scope="col") for name in head))
    body = [element("tr", *(_cell(cell) for cell in row)) for row in rows]
    inside = (element("thead", top), element("tbody", *body))
    return element("div", element("table", *inside, **attributes), class_="wide")


def _cell(content: object) -> Markup:
    if isinstance(content, (int, float)) and not isinstance(content, bool):
        return element("td", number(content), class_="n", title=repr(content))
    return element("td", content)


def number(value: float) -> str:
    """Return a number with sensible digits; empty for nan.

    Examples
    --------
    >>> number(0.00123456), number(1234567.0), number(10_000), number(float("nan"))
    ('0.001235', '1.235e+06', '10,000', '')
    """
    if value != value:
        return ""
    if isinstance(value, int):
        return f"{value:,}"
    return f"{value:.0f}" if abs(value) < 1e5 and value == int(value) else f"{value:.4g}"


def percent(share: float, digits: int = 1) -> str:
    """Return a fraction in percent, with `digits` decimals.

    Examples
    --------
    >>> percent(0.12345)
    '12.3 %'
    """
    return f"{100 * share:.{digits}f} %"


def plain(value: Any, depth: int = 0) -> object:
    """Return plain data as text or nested lists; long content is visibly truncated."""
    if isinstance(value, Mapping) and value and depth < 4:
        pairs = [(element("dt", key), element("dd", plain(v, depth + 1)))
                 for key, v in value.items()]  # fmt: skip
        return element("dl", *(piece for pair in pairs for piece in pair))
    if isinstance(value, (list, tuple)):
        shown = [str(_short(item)) for item in value[:LISTED]]
        rest = len(value) - LISTED
        text = ", ".join(shown) + (f", ... and {rest} more" if rest > 0 else "")
        return _cut(text)
    return _cut(str(_short(value)))


def _short(value: object) -> object:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.10g}"
    return "none" if value is None else value


def _cut(text: str) -> object:
    if len(text) <= LONGEST:
        return text
    shown = element("summary", text[:LONGEST], " ...")
    return element("details", shown, element("p", text, class_="whole"))
