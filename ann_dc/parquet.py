"""Atomic output of Parquet files with pyarrow, an optional package."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ann_dc.errors import PyarrowMissing
from ann_dc.files import writing_whole


def pyarrow_modules(purpose: str, alternative: str) -> tuple[Any, Any]:
    """Return the modules ``pyarrow`` and ``pyarrow.parquet``.

    Raises `PyarrowMissing` if pyarrow is not installed. The message begins with `purpose` and ends
    with `alternative`.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise PyarrowMissing(
            f"{purpose}: a Parquet file needs pyarrow, which is not installed: pip install "
            f"'ann-dc[study]'; {alternative}"
        ) from error
    return pyarrow, parquet


def write_blocks(
    path: str | os.PathLike[str],
    types: Mapping[str, str],
    blocks: Iterable[Sequence[Any]],
    metadata: Mapping[str, str],
) -> None:
    """Write blocks of columns as one Parquet file.

    `types` contains the pyarrow type name of every column. pyarrow must be installed. Raises
    `OutputError` if the file cannot be written; an existing file is then unchanged.
    """
    pyarrow, parquet = pyarrow_modules("write_blocks", "CSV does not need it")
    fields = [(name, getattr(pyarrow, word)()) for name, word in types.items()]
    schema = pyarrow.schema(fields, metadata=dict(metadata))
    with writing_whole(path) as stream, parquet.ParquetWriter(stream, schema) as table:
        for block in blocks:
            columns = [
                pyarrow.array(column, type=field.type) for field, column in zip(schema, block)
            ]
            table.write_batch(pyarrow.record_batch(columns, schema=schema))
