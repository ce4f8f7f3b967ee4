"""A packed table holds what was put in."""

import base64
import gzip
import json
import struct

import numpy as np
import pytest
from study_pages import findings, hostile

from ann_dc.report.study_page.page import pack


def unpacked(text):
    """The cells of every column, as a script of the page reads them."""
    whole = gzip.decompress(base64.b64decode(text))
    (size,) = struct.unpack_from("<I", whole)
    head = json.loads(whole[4 : 4 + size])
    start = -(-(4 + size) // 8) * 8
    columns = {}
    for column in head["columns"]:
        kind, count, place = np.dtype(column["kind"]), head["rows"], start + column["offset"]
        assert place % kind.itemsize == 0
        values = np.frombuffer(whole, kind.newbyteorder("<"), count, place)
        words = column.get("words")
        columns[column["name"]] = [words[code] for code in values] if words else values
    return columns


@pytest.mark.parametrize("made", [lambda: findings(700), hostile], ids=["usual", "hostile"])
def test_all_cells_come_back(made):
    found = made()
    cells = unpacked(pack(found.columns.values(), len(found)))
    assert [*cells] == [*found.frame.columns]
    for name, column in found.columns.items():
        if column.numbers is None:
            assert cells[name] == [column.words[code] for code in column.codes]
        else:
            np.testing.assert_array_equal(cells[name], column.numbers)
    assert [int(seed) for seed in cells["seed"]] == [*found.frame["seed"]]


def test_only_the_first_rows():
    found = findings(300)
    assert [*unpacked(pack(found.columns.values(), 7))["point"]] == [*range(7)]
