"""Atomic Parquet files."""

import sys

import pytest

from ann_dc.errors import OutputError, PyarrowMissing
from ann_dc.parquet import pyarrow_modules, write_blocks


def test_blocks_of_columns_become_one_table(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    types = {"count": "int64", "name": "string"}
    write_blocks(tmp_path / "a.parquet", types, [[[1, 2], ["a", None]], [[3], ["b"]]], {"key": "x"})
    table = parquet.read_table(tmp_path / "a.parquet")
    assert table.to_pydict() == {"count": [1, 2, 3], "name": ["a", None, "b"]}
    assert table.schema.metadata[b"key"] == b"x"


def test_failed_block_leaves_an_existing_file_unchanged(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    (tmp_path / "a.parquet").write_text("kept")
    with pytest.raises(pyarrow.ArrowInvalid):
        write_blocks(tmp_path / "a.parquet", {"count": "int64"}, [[["many"]]], {})
    assert (tmp_path / "a.parquet").read_text() == "kept"
    assert [*tmp_path.iterdir()] == [tmp_path / "a.parquet"]
    with pytest.raises(OutputError, match="cannot be written"):
        write_blocks(tmp_path / "no" / "a.parquet", {}, [], {})


def test_missing_pyarrow_is_named_with_purpose_and_alternative(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(
        PyarrowMissing, match=r"^export: .*'ann-dc\[study\]'; CSV does not need it$"
    ):
        pyarrow_modules("export", "CSV does not need it")
