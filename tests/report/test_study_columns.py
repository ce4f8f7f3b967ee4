"""Columns as arrays, whatever they hold."""

import numpy as np
import pandas
import pytest

from ann_dc.report.study_columns import column_of

NUMBERS = {
    "floats": [1.5, 2.0, None],
    "whole numbers": [1, 2, 3],
    "numbers and none as objects": pandas.Series([1, 2.5, None], dtype=object),
    "nullable": pandas.Series([1, None, 3], dtype="Int64"),
    "infinite": [1.0, np.inf, np.nan],
    "none at all": [None, None],
}
WORDS = {
    "text": (["a", None, "b"], ["a", "", "b"]),
    "booleans": ([True, False], ["true", "false"]),
    "booleans and none": ([True, None], ["true", ""]),
    "numbers and booleans": (pandas.Series([1, True], dtype=object), ["1", "true"]),
    "numbers and text": ([1.5, "circuit"], ["1.5", "circuit"]),
    "digits as text": (["12", "13"], ["12", "13"]),
    "whole numbers from 2^53 on": ([2**53 + 1, 5], [str(2**53 + 1), "5"]),
}


@pytest.mark.parametrize("cells", NUMBERS.values(), ids=NUMBERS)
def test_numbers(cells):
    series = pandas.Series(cells)
    column = column_of("x", series)
    expected = [np.nan if pandas.isna(cell) else float(cell) for cell in series]
    np.testing.assert_array_equal(column.numbers, expected)
    np.testing.assert_array_equal(column.distinct, np.unique(np.array(expected)[column.finite]))


@pytest.mark.parametrize(("cells", "expected"), WORDS.values(), ids=WORDS)
def test_words(cells, expected):
    column = column_of("x", pandas.Series(cells))
    assert column.numbers is None
    assert [column.words[code] for code in column.codes] == expected
    assert set(column.distinct) == set(expected) - {""}


def test_only_what_spreads_over_decades_has_a_logarithmic_axis():
    draw = np.random.default_rng(0)
    wide = {
        "three decades": 10 ** draw.uniform(0, 3, 500),
        "evenly spread down to nothing": draw.uniform(1e-4, 1, 500),
        "both signs": draw.normal(size=500),
        "one value": np.full(5, 3.0),
        "none": np.full(5, np.nan),
    }
    columns = {name: column_of("x", pandas.Series(values)) for name, values in wide.items()}
    assert [name for name, column in columns.items() if column.is_wide] == ["three decades"]
