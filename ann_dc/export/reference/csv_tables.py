"""Comma-separated tables of an export: writer, and reader of tables with a row per stage."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence

from ann_dc.errors import FileFormatError
from ann_dc.export.reference.contents import text_of


def csv_text(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    r"""Format rows as CSV text.

    Examples
    --------
    >>> csv_text(("a", "b"), [(1, "x, y")])
    'a,b\n1,"x, y"\n'
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return stream.getvalue()


def rows_by_connection(
    files: Mapping[str, bytes], table: str, head: Sequence[str]
) -> dict[str, list[list[str]]]:
    """Read a table whose first two columns are a connection and its stages in turn.

    Returns the remaining columns of every stage, by connection. Raises `FileFormatError` if the
    table is missing, has other columns, or a stage is out of order.
    """
    try:
        rows = list(csv.reader(io.StringIO(text_of(files, table)), strict=True))
    except csv.Error as error:
        raise FileFormatError(f"{table}: no table of text: {error}") from error
    if not rows or rows[0] != [*head] or any(len(row) != len(head) for row in rows):
        raise FileFormatError(f"{table}: expected the columns {', '.join(head)}")
    found: dict[str, list[list[str]]] = {}
    for name, stage, *values in rows[1:]:
        stages = found.setdefault(name, [])
        if stage != str(len(stages)):
            raise FileFormatError(f"{table}: {name}: stage {stage!r:.20} is out of order")
        stages.append(values)
    return found
