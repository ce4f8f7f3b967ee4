"""Export of a study table to a data frame, CSV and Parquet, in blocks of records."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

from ann_dc.errors import PandasMissing
from ann_dc.files import writing_whole
from ann_dc.parquet import pyarrow_modules, write_blocks
from ann_dc.study.columns import Kinds

Pieces: TypeAlias = Iterable[list[list[Any]]]
"""Blocks of records, as lists of cells."""


def frame(pieces: Pieces, kinds: Kinds, identity: Mapping[str, Any]) -> Any:
    """Return the table as a pandas data frame.

    The identity supplies the units of measure. Raises `PandasMissing` if pandas is not installed.
    """
    try:
        import pandas
    except ImportError as error:
        raise PandasMissing(
            "to_frame: a data frame needs pandas, which is not installed: pip install "
            "'ann-dc[study]'; to_csv does not need it"
        ) from error

    def framed(piece: list[list[Any]]) -> Any:
        values = zip(*piece) if piece else [()] * len(kinds)
        return pandas.DataFrame(
            {
                name: pandas.array(list(column), dtype=_frame_type(held))
                for (name, held), column in zip(kinds.items(), values)
            }
        )

    found = pandas.concat([framed([]), *map(framed, pieces)], ignore_index=True)
    found.attrs["units"] = {
        name: about["unit"]
        for part in ("settings", "metrics")
        for name, about in identity.get(part, {}).items()
        if about.get("unit")
    }
    return found


def _frame_type(held: Sequence[str]) -> str:
    """Return the pandas type of a column that has contained these types."""
    kinds, has_gaps = {*held} - {"none"}, "none" in held
    if kinds == {"int"}:
        return "Int64" if has_gaps else "int64"
    if kinds == {"bool"}:
        return "boolean" if has_gaps else "bool"
    if kinds == {"str"}:
        return "string"
    return "float64" if kinds <= {"int", "float"} else "object"


def write_csv(path: str | os.PathLike[str], pieces: Pieces, columns: Sequence[str]) -> None:
    """Write a CSV file with empty cells for missing values.

    Raises `OutputError` if the file cannot be written; an existing file is then unchanged.
    """
    with writing_whole(path) as stream:
        text = io.TextIOWrapper(stream, encoding="utf-8", newline="")
        table = csv.writer(text, lineterminator="\n")
        table.writerow(columns)
        for piece in pieces:
            table.writerows(piece)
        text.flush()
        text.detach()


def write_parquet(
    path: str | os.PathLike[str], pieces: Pieces, kinds: Kinds, identity: str
) -> None:
    """Write a Parquet file with the identity as metadata ``ann_dc.study``.

    Raises `PyarrowMissing` if pyarrow is not installed and `OutputError` if the file cannot be
    written. An existing file is then unchanged.
    """
    pyarrow_modules("to_parquet", "to_csv does not need it")
    types = {name: _parquet_type(held) for name, held in kinds.items()}
    mixed = [_frame_type(held) == "object" for held in kinds.values()]
    blocks = (
        [map(_text, column) if is_mixed else column for column, is_mixed in zip(zip(*piece), mixed)]
        for piece in pieces
    )
    write_blocks(path, types, blocks, {"ann_dc.study": identity})


def _text(value: Any) -> str | None:
    return None if value is None else str(value)


def _parquet_type(held: Sequence[str]) -> str:
    """Return the pyarrow type name of a column that has contained these types."""
    word = _frame_type(held).lower()
    return {"object": "string", "boolean": "bool_", "bool": "bool_"}.get(word, word)
