"""A table packed for a page: a head in JSON and the columns as raw numbers, in gzip, in base64.

    length of the head (4 bytes) | head | padding to 8 bytes | columns, each padded to 8 bytes

Everything is little-endian. A column of numbers has 8 bytes a row; one of words has the codes of
its words, in 1, 2 or 4 bytes a row.
"""

from __future__ import annotations

import base64
import gzip
import json
import struct
from collections.abc import Iterable

import numpy as np

from ann_dc.report.study_columns import Column

ALIGNED = 8
"""Bytes at whose multiples columns begin."""


def pack(columns: Iterable[Column], rows: int) -> str:
    """The first rows of a table, as letters that stand anywhere in a page.

    Parameters
    ----------
    columns : iterable of Column
    rows : int
        How many.
    """
    heads, blocks, offset = [], [], 0
    for column in columns:
        values = _values(column)[:rows]
        head = {"name": column.name, "unit": column.unit, "says": column.says}
        words = {} if column.numbers is not None else {"words": list(column.words)}
        heads.append({**head, "kind": values.dtype.name, "offset": offset, **words})
        blocks.append(_padded(values.tobytes()))
        offset += len(blocks[-1])
    head = json.dumps({"rows": rows, "columns": heads}).encode("ascii")
    whole = b"".join([_padded(struct.pack("<I", len(head)) + head), *blocks])
    return base64.b64encode(gzip.compress(whole, 6, mtime=0)).decode("ascii")


def _values(column: Column) -> np.ndarray:
    if column.numbers is not None:
        return column.numbers.astype("<f8")
    assert column.codes is not None
    count = len(column.words)
    kind = "<u1" if count <= 2**8 else "<u2" if count <= 2**16 else "<u4"
    return column.codes.astype(kind)


def _padded(content: bytes) -> bytes:
    return content + bytes(-len(content) % ALIGNED)
