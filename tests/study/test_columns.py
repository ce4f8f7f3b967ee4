"""Names of columns, checked."""

import pytest

from ann_dc.errors import StoreError
from ann_dc.study.store import Store


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ((), "expected 'point', then others with 'outcome' among them, at most 2000; got 0"),
        (("outcome", "point"), "expected 'point', then others"),
        (("point", "peak"), "expected 'point', then others with 'outcome' among them"),
        (("point", *map(str, range(2000)), "outcome"), "at most 2000; got 2002"),
        (("point", "peak", "peak", "outcome"), "'peak' occurs twice"),
        (("point", "", "outcome"), "expected printable names, got ''"),
        (("point", "a\0b", "outcome"), "expected printable names"),
        (("point", "\ud800", "outcome"), "expected printable names"),
        (("point", 3, "outcome"), "expected printable names, got 3"),
    ],
)
def test_names_that_cannot_be_columns(tmp_path, columns, message):
    with pytest.raises(StoreError, match=message):
        Store.begin(tmp_path / "study", {}, columns)
    assert not (tmp_path / "study").exists()


def test_two_thousand_columns(tmp_path):
    columns = ("point", *map(str, range(1998)), "outcome")
    with Store.begin(tmp_path, {}, columns) as store:
        assert store.columns == columns
