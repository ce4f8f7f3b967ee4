"""Tables of export formats and of inspected exports."""

from __future__ import annotations

import typing
from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

from ann_dc.export.catalogue import FORMATS, Inspection
from ann_dc.export.formats import Format
from ann_dc.report.tables import named_rows, printable, table


def formats_table() -> Table:
    """Return a table of formats: title, preserved and omitted data, and settings.

    Settings are shown with their defaults.
    """
    shown = table("format", "content", "preserves", "omits", "settings")
    for name, form in FORMATS.items():
        settings = "\n".join(_setting(form, key) for key in form.settings)
        shown.add_row(name, form.title, form.carries, form.loses, settings or "-")
    return shown


def _setting(form: Format, key: str) -> str:
    """Return a setting with its default, and its values if they have names."""
    kind = typing.get_type_hints(form.write)[key]
    values = typing.get_args(kind) if typing.get_origin(kind) is typing.Literal else ()
    others = f" ({', '.join(map(str, values))})" if values else ""
    return f"{key}={form.settings[key].default}{others}"


def inspections_table(found: Sequence[Inspection]) -> Table:
    """Return a table of several inspections, with a common verdict."""
    shown = table("format", "unchanged", "result")
    for each in found:
        good = Text("yes", "green") if each.good else Text("no", "red")
        said = each.wrong or each.facts.get("checked", "")
        shown.add_row(printable(each.kind), good, Text(printable(said)))
    wrong = [each.kind for each in found if not each.good]
    verdict = f"changed: {', '.join(wrong)}" if wrong else f"all {len(found)} are unchanged"
    shown.title = printable(verdict)
    return shown


def inspection_table(found: Inspection) -> Table:
    """Return a table of one inspection."""
    good = Text("yes", "green") if found.good else Text(printable(f"no: {found.wrong}"), "red")
    place = {"place": str(found.place), "format": found.kind}
    return named_rows({"unchanged": good, **place, **found.facts})
