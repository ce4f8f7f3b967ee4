"""HTML page of a study: one local file without external requests or scripts.

Content of the store appears as text or data, never as markup. Texts are escaped when they become
HTML; figures and the table are data that scripts read. A security policy in the page head lists the
hashes of permitted scripts and forbids every request. Injected text is therefore never executed.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
from importlib import resources

import ann_dc
from ann_dc.errors import PlotlyMissing
from ann_dc.files import write_whole
from ann_dc.progress import Progress, silent
from ann_dc.report.statistics import Findings
from ann_dc.report.study_page import sections
from ann_dc.report.study_page.choice import chosen
from ann_dc.report.study_page.figure import Figure
from ann_dc.report.study_page.markup import Markup, element, joined
from ann_dc.report.study_page.packed import pack
from ann_dc.study.store import Store

LARGEST_TABLE = 200_000
"""Largest number of records in a page; statistics and figures use all records."""
NAMED = 12
"""Largest number of omitted figures that are listed."""
MENU = {
    "asked": "Asked", "summary": "Summary", "figures": "Figures", "points": "Points",
    "table": "Table", "versions": "Versions",
}  # fmt: skip


def write_study_page(
    store: Store, path: str | os.PathLike[str], *, progress: Progress = silent
) -> None:
    """Write the HTML page of a finished or unfinished study into an existing folder.

    Raises `OutputError` if the file cannot be written, and `PandasMissing` or `PlotlyMissing` if a
    package is not installed.
    """
    _plotly()
    progress("reading the store")
    found = Findings.of(store)
    write_whole(path, page_of(found, progress=progress).encode("utf-8"))


def page_of(found: Findings, *, progress: Progress = silent) -> str:
    """Return the HTML page of a study; equal data give equal text.

    Raises `PlotlyMissing` if plotly is not installed.
    """
    library, version = _plotly()
    progress("drawing the figures")
    figures, left_out = chosen(found)
    progress("writing the table")
    written_by = f"ann_dc {ann_dc.__version__} with plotly.js {version}"
    content = {
        "asked": sections.asked(found),
        "summary": sections.summary(found),
        "figures": _figures(figures, left_out),
        "points": sections.standing_out(found),
        "table": _table(found),
        "versions": sections.versions(found, written_by),
    }
    body = [sections.section(name, MENU[name], content[name]) for name in MENU]
    data = [
        _data("figure-data", json.dumps([figure.content() for figure in figures])),
        _data("table-data", pack(found.columns.values(), min(len(found), LARGEST_TABLE))),
        _data("command", json.dumps(found.command)),
    ]
    scripts = [library, *(_asset(name) for name in ("table.js", "figures.js"))]
    return _document(found.title, _menu(content), body, data, scripts)


def _plotly() -> tuple[str, str]:
    """Return the source of plotly.js, and its version."""
    try:
        from plotly.offline import get_plotlyjs, get_plotlyjs_version
    except ImportError as error:
        raise PlotlyMissing(
            "the page of a study needs plotly: pip install 'ann-dc[study]'"
        ) from error
    return get_plotlyjs(), get_plotlyjs_version()


def _asset(name: str) -> str:
    return (resources.files("ann_dc.report.study_page") / "assets" / name).read_text(
        encoding="utf-8"
    )


def _figures(figures: list[Figure], left_out: list[str]) -> Markup:
    drawn = [
        element(
            "figure", element("figcaption", element("b", figure.title), " ", figure.says),
            element("div", "", class_="plot", id=f"figure-{number}"),
        )
        for number, figure in enumerate(figures)
    ]  # fmt: skip
    more = f", and {len(left_out) - NAMED} more" if len(left_out) > NAMED else ""
    names = ", ".join(left_out[:NAMED]) + more
    note = element("p", f"Left out, because they tell less: {names}.", class_="note")
    return joined([element("div", *drawn, class_="figures"), note if left_out else None])


def _table(found: Findings) -> Markup:
    says = "Click a heading to sort. Filters: words, >= 0.1, < 3, 1..5, =exactly, !without."
    cut = f" The page holds the first {LARGEST_TABLE:,} of {len(found):,} rows."
    controls = element(
        "div",
        element("input", id="search", type="search", placeholder="search all columns",
                aria_label="search all columns"),
        element("button", "clear", id="clear", type="button"),
        element("span", "", id="count", aria_live="polite"),
        class_="controls",
    )  # fmt: skip
    return joined([
        element("div",
                element("p", says, cut if len(found) > LARGEST_TABLE else "", class_="note"),
                controls,
                element("div", element("table", id="rows"), id="window", tabindex=0,
                        role="region", aria_label="table of all points"),
                element("div", "", id="detail"),
                class_="screen"),
        sections.printed(found),
    ])  # fmt: skip


def _menu(content: dict[str, Markup]) -> Markup:
    links = (element("a", MENU[name], href=f"#{name}") for name in MENU if content[name])
    return element("nav", *links)


def _data(name: str, text: str) -> Markup:
    """Return data for scripts in an element that the data cannot terminate."""
    safe = text.replace("<", "\\u003c")
    return Markup(f'<script type="application/json" id="{name}">{safe}</script>\n')


def _document(
    title: str, menu: Markup, body: list[Markup], data: list[Markup], scripts: list[str]
) -> str:
    texts = [_within_element(script) for script in scripts]
    hashes = " ".join(f"'sha256-{_digest(text)}'" for text in texts)
    policy = (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )
    head = [
        Markup('<meta charset="utf-8">'),
        Markup(f'<meta http-equiv="Content-Security-Policy" content="{policy}">'),
        Markup('<meta name="viewport" content="width=device-width, initial-scale=1">'),
        element("title", title),
        element("style", Markup(_asset("page.css"))),
    ]
    without = element(
        "noscript", element("p", "Figures and the table of all points need JavaScript.")
    )
    run = [Markup(f"<script>{text}</script>\n") for text in texts]
    main = element("main", element("h1", title), menu, without, *body)
    html = element("html", element("head", *head), element("body", main, *data, *run), lang="en")
    return f"<!DOCTYPE html>\n{html}\n"


def _within_element(script: str) -> str:
    """Return a script exactly as a browser reads it from the page."""
    lines = script.replace("\r\n", "\n").replace("\r", "\n")
    return lines.replace("</script", "<\\/script").replace("<!--", "\\x3c!--")


def _digest(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")
