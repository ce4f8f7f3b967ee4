"""The table for others says what the rows say."""

import builtins
import csv
import math
import os
import subprocess
import sys

import pandas
import pytest
from pyarrow import parquet

from ann_dc.errors import OutputError, PandasMissing, PyarrowMissing
from ann_dc.study.records import Finished
from ann_dc.study.store import Store

COLUMNS = ("point", "number", "gaps", "all", "some", "word", "none", "mixed", "outcome")
IDENTITY = {"settings": {"number": {"unit": "m"}}, "metrics": {"gaps": {"unit": ""}}}
ROWS = [
    dict(zip(COLUMNS, (0, 0.1, 5, True, None, "a,\nb", None, "ä", "settled"))),
    dict(zip(COLUMNS, (1, math.inf, None, False, True, "", None, 3, "settled"))),
    dict(zip(COLUMNS, (2, None, 2**60 + 1, True, False, None, None, None, "failed"))),
]


@pytest.fixture
def store(tmp_path, monkeypatch):
    monkeypatch.setattr("ann_dc.study.store.PIECE", 2)
    with Store.begin(tmp_path / "study", IDENTITY, COLUMNS) as store:
        store.append([Finished(row) for row in ROWS])
        yield store


def without_gaps(value):
    return None if value is pandas.NA or value != value else value


def test_a_frame_has_every_cell(store):
    frame = store.to_frame()
    found = [
        {name: without_gaps(value) for name, value in row.items()}
        for row in frame.to_dict("records")
    ]
    assert found == ROWS
    assert frame.dtypes.map(str).to_dict() == {
        "point": "int64", "number": "float64", "gaps": "Int64", "all": "bool", "some": "boolean",
        "word": "string", "none": "float64", "mixed": "object", "outcome": "string",
    }  # fmt: skip
    assert frame.attrs["units"] == {"number": "m"}
    assert (frame["outcome"] == "failed").sum() == 1


def test_a_parquet_file_has_every_cell(store, tmp_path):
    store.to_parquet(tmp_path / "rows.parquet")
    table = parquet.read_table(tmp_path / "rows.parquet")
    expected = [row | {"mixed": row["mixed"] and str(row["mixed"])} for row in ROWS]
    assert table.to_pylist() == expected
    assert b'"unit": "m"' in table.schema.metadata[b"ann_dc.study"]


def test_a_csv_file_has_every_cell(store, tmp_path):
    store.to_csv(tmp_path / "rows.csv")
    with (tmp_path / "rows.csv").open(encoding="utf-8", newline="") as stream:
        found = list(csv.DictReader(stream))
    assert found == [
        {name: "" if value is None else str(value) for name, value in row.items()} for row in ROWS
    ]


def test_a_store_without_rows(tmp_path):
    with Store.begin(tmp_path / "study", {}, COLUMNS) as store:
        assert store.to_frame().shape == (0, len(COLUMNS))
        store.to_csv(tmp_path / "rows.csv")
        store.to_parquet(tmp_path / "rows.parquet")
    assert (tmp_path / "rows.csv").read_text() == ",".join(COLUMNS) + "\n"
    assert parquet.read_table(tmp_path / "rows.parquet").num_rows == 0


@pytest.mark.parametrize("name", ["to_csv", "to_parquet"])
def test_what_cannot_be_written(store, tmp_path, name):
    with pytest.raises(OutputError, match="rows' cannot be written"):
        getattr(store, name)(tmp_path / "no folder" / "rows")
    assert len(store) == 3


@pytest.mark.parametrize(
    ("name", "arguments", "error", "missing"),
    [
        ("to_frame", (), PandasMissing, "pandas"),
        ("to_parquet", ("rows",), PyarrowMissing, "pyarrow"),
    ],
)
def test_what_is_not_installed(store, monkeypatch, name, arguments, error, missing):
    real = builtins.__import__

    def without(wanted, *rest, **words):
        if wanted.partition(".")[0] == missing:
            raise ImportError(wanted)
        return real(wanted, *rest, **words)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(error, match=rf"{name}: .* needs {missing}, which is not installed: pip"):
        getattr(store, name)(*arguments)
    assert len(store) == 3


MEMORY = """
import resource, sys
from ann_dc.study.records import Finished
from ann_dc.study.store import Store
folder, rows = sys.argv[1], int(sys.argv[2])
import pyarrow.parquet
with Store.begin(folder, {}, ["point", *"abcdefghij", "outcome"]) as store:
    for first in range(0, rows, 10_000):
        store.append([
            Finished({"point": n, **{name: n / 3 for name in "abcdefghij"}, "outcome": "settled"})
            for n in range(first, first + 10_000)
        ])
    sum(1 for _ in store.rows())
    store.to_csv(folder + "/rows.csv")
    store.to_parquet(folder + "/rows.parquet")
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.slow
def test_memory_is_flat(tmp_path):
    def peak(rows):
        done = subprocess.run(
            [sys.executable, "-c", MEMORY, os.fspath(tmp_path / str(rows)), str(rows)],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        return int(done.stdout) / 1024

    assert peak(300_000) < peak(30_000) + 25
