"""S-expressions: what is written is read back, what is none is refused."""

import random

import pytest
from hypothesis import given, strategies as st

from ann_dc.errors import FileFormatError
from ann_dc.export.netlists.s_expressions import entries, entry, read, written

TEXTS = st.text(st.characters(codec="utf-8", exclude_categories=["Cs"]), max_size=12)
TREES = st.recursive(
    TEXTS,
    lambda inner: st.lists(inner, max_size=4).map(lambda each: ["word", *each]),
    max_leaves=25,
).map(lambda tree: ["export", tree])


@given(tree=TREES)
def test_reading_is_the_inverse_of_writing(tree):
    assert read(written(tree)) == tree


@pytest.mark.parametrize(
    "text", ["", "(", ")", "a", "(a))", "(a) (b)", '(a "b)', "(" * 60 + ")" * 60]
)
def test_what_is_none_is_refused(text):
    with pytest.raises(FileFormatError, match="s-expression: "):
        read(text)


def test_entries_are_found_by_their_word():
    tree = read('(net (code "1") (name "GND") (node (ref "R1")) (node (ref "R2")))')
    assert entry(tree, "name") == "GND"
    assert [entry(node, "ref") for node in entries(tree, "node")] == ["R1", "R2"]
    for word in ("node", "other"):
        with pytest.raises(FileFormatError, match=rf"expected one \({word} "):
            entry(tree, word)


def test_hostile_texts_end_in_a_reason_or_in_a_tree():
    text, draw = '(export (version "E") (net (code "1") (name "a\\"b")))', random.Random(3)
    for _ in range(3000):
        letters = list(text)
        for _ in range(draw.randint(1, 5)):
            letters[draw.randrange(len(letters))] = draw.choice('()"\\ a\n')
        try:
            read("".join(letters))
        except FileFormatError:
            continue
