"""HTML in pieces: whatever is no `Markup` yet is text, and is escaped where it comes in."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

LONGEST = 400
"""Letters of a value that are shown."""
LISTED = 12
"""Items of a list that are shown."""


class Markup(str):
    """Text that is HTML already."""

    __slots__ = ()


def element(tag: str, *content: object, **attributes: object) -> Markup:
    """An element with its content.

    Parameters
    ----------
    tag : str
    *content : object
        `Markup` as it is, None not at all, everything else as text.
    **attributes : object
        ``class_`` is class, ``data_x`` is data-x.

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
    """Pieces one behind the other.

    Parameters
    ----------
    content : iterable
        As of `element`.
    """
    return Markup(
        "".join(
            piece if isinstance(piece, Markup) else escape(str(piece))
            for piece in content
            if piece is not None
        )
    )


def table(head: Iterable[object], rows: Iterable[Iterable[object]], **attributes: object) -> Markup:
    """A table; numbers stand on the right.

    Parameters
    ----------
    head : iterable
        Names of the columns.
    rows : iterable of iterables
    **attributes : object
        Of the table.
    """
    top = element("tr", *(element("th", name, scope="col") for name in head))
    body = [element("tr", *(_cell(cell) for cell in row)) for row in rows]
    inside = (element("thead", top), element("tbody", *body))
    return element("div", element("table", *inside, **attributes), class_="wide")


def _cell(content: object) -> Markup:
    if isinstance(content, (int, float)) and not isinstance(content, bool):
        return element("td", number(content), class_="n", title=repr(content))
    return element("td", content)


def number(value: float) -> str:
    """A number with sensible digits; nothing of nan.

    Parameters
    ----------
    value : float

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
    """A share in percent.

    Parameters
    ----------
    share : float
    digits : int
        Behind the point.

    Examples
    --------
    >>> percent(0.12345)
    '12.3 %'
    """
    return f"{100 * share:.{digits}f} %"


def plain(value: Any, depth: int = 0) -> object:
    """Plain data as text or as nested lists of names; what is long is cut short and says so.

    Parameters
    ----------
    value : str, number, bool, None, list or mapping
    depth : int
        Of nesting so far.
    """
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
