"""Exports: the formats that there are, and what was found in one."""

from __future__ import annotations

from rich.table import Table
from rich.text import Text

from ann_dc.export.catalogue import FORMATS
from ann_dc.export.inspecting import Inspection
from ann_dc.report.tables import named_rows, table


def formats_table() -> Table:
    """Every format with its title, what it loses, and its settings with their defaults."""
    shown = table("format", "what it is", "carries", "loses", "settings")
    for name, form in FORMATS.items():
        settings = "\n".join(f"{key}={p.default}" for key, p in form.settings.items())
        shown.add_row(name, form.title, form.carries, form.loses, settings or "-")
    return shown


def formats_markdown() -> str:
    """The same table for a page of documentation."""
    rows = ["| format | what it is | carries | loses | settings |", "|---|---|---|---|---|"]
    for name, form in FORMATS.items():
        settings = ", ".join(f"`{key}={p.default}`" for key, p in form.settings.items())
        rows.append(f"| `{name}` | {form.title} | {form.carries} | {form.loses} | {settings} |")
    return "\n".join(rows)


def inspection_table(found: Inspection) -> Table:
    """What was found in one place."""
    good = Text("yes", "green") if found.good else Text(f"no: {found.wrong}", "red")
    place = {"place": str(found.place), "format": found.kind}
    return named_rows({**place, **found.facts, "as it was": good})
