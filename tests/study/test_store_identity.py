"""What changed from one study to another, in a sentence."""

import json

from hypothesis import given, strategies as st

from ann_dc.study.store import differences

PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=6,
)


@given(PLAIN, PLAIN)
def test_what_is_the_same_does_not_differ_and_what_is_not_does(first, second):
    before, after = json.dumps({"a": first}), json.dumps({"a": second})
    assert bool(differences(before, after)) == (before != after)


def test_many_differences_are_counted():
    before, after = json.dumps({"vary": [*range(100)]}), json.dumps({"vary": [*range(100, 200)]})
    assert differences(before, after).endswith("vary[14]: 14 -> 114; and 94 more")


def test_long_values_are_cut():
    reported = differences(json.dumps({"text": "x" * 500}), json.dumps({"text": ""}))
    assert len(reported) < 100
    assert reported.endswith('... -> ""')


def test_an_order_that_changed_is_a_change():
    assert differences('{"a": 1, "b": 2}', '{"b": 2, "a": 1}') == "the order of its entries"
