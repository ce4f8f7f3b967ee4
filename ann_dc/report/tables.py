"""TODO: the idea."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text


def named_rows(rows: Mapping[str, object]) -> Table:
    """A table of names and what is said of them."""
    table = Table(show_header=False)
    table.add_column(no_wrap=True, style="bold")
    table.add_column(overflow="fold")
    for name, value in rows.items():
        table.add_row(name, value if isinstance(value, Text) else str(value))
    return table


def verdict_text(good: bool, verdict: str) -> Text:
    """Certified or not, and why."""
    return Text(f"{'yes' if good else 'no'}: {verdict}", "green" if good else "red")


def table(*columns: str, dense: bool = False) -> Table:
    """A table; dense ones have many columns and still fit into 80 letters."""
    shown = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=0) if dense else Table()
    for column in columns:
        shown.add_column(column, overflow="fold")
    return shown


def span(values: Any) -> str:
    """One number, or the range of those that differ from row to row or stage to stage."""
    each = [float(value) for value in values] if hasattr(values, "__len__") else [float(values)]
    low, high = f"{min(each):.4g}", f"{max(each):.4g}"
    return low if low == high else f"({low} .. {high})"
