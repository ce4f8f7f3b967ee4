"""Binary table of a page: JSON header and raw columns, compressed, as base64.

    length of the head (4 bytes) | head | padding to 8 bytes | columns, each padded to 8 bytes

All numbers are little-endian and the compression is gzip. A numeric column has 8 bytes per record.
A text column has the codes of its values, in 1, 2 or 4 bytes per record.
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
"""Alignment of columns in bytes."""


def pack(columns: Iterable[Column], rows: int) -> str:
    """Return the first `rows` records of a table as base64 text."""
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
    count = len(column.words)
    kind = "<u1" if count <= 2**8 else "<u2" if count <= 2**16 else "<u4"
    return column.places.astype(kind)


def _padded(content: bytes) -> bytes:
    return content + bytes(-len(content) % ALIGNED)
