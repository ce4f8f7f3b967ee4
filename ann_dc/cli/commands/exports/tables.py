"""Tables about exports: the formats that there are, and what was found in one."""

from __future__ import annotations

from rich.table import Table
from rich.text import Text

from ann_dc.export.catalogue import FORMATS
from ann_dc.export.inspecting import Inspection
from ann_dc.report.tables import named_rows, printable, table


def formats_table() -> Table:
    """Every format: what it is, what it loses, and its settings with their defaults."""
    shown = table("format", "what it is", "loses", "settings")
    for name, form in FORMATS.items():
        settings = "\n".join(f"{key}={p.default}" for key, p in form.settings.items())
        shown.add_row(name, form.title, form.loses, settings or "-")
    return shown


def inspection_table(found: Inspection) -> Table:
    """What was found in one place."""
    good = Text("yes", "green") if found.good else Text(printable(f"no: {found.wrong}"), "red")
    place = {"place": str(found.place), "format": found.kind}
    return named_rows({**place, **found.facts, "as it was": good})
