"""Netlists of KiCad, as read."""

import pytest

from ann_dc.errors import FileFormatError
from ann_dc.export.netlists.board_reader import comments_of, values_of, wiring_of
from ann_dc.export.netlists.s_expressions import read

TEXT = """(export (version "E")
 (components (comp (ref "R1") (value "1k")) (comp (ref "C1") (value "1n")))
 (nets (net (code "1") (name "a") (node (ref "R1") (pin "1")) (node (ref "C1") (pin "1")))
  (net (code "2") (name "b") (node (ref "R1") (pin "2")))))"""


def test_pads_have_nets_and_components_values():
    tree = read(TEXT)
    assert wiring_of(tree) == {"R1": {"1": "a", "2": "b"}, "C1": {"1": "a"}}
    assert values_of(tree) == {"R1": "1k", "C1": "1n"}


@pytest.mark.parametrize(
    ("there", "instead"),
    [('(ref "C1") (value', '(ref "R1") (value'), ('(ref "R1") (pin "2")', '(ref "R1") (pin "1")'),
     ('(ref "C1") (pin', '(ref "C9") (pin')],
)  # fmt: skip
def test_what_cannot_be_is_refused(there, instead):
    with pytest.raises(FileFormatError, match="KiCad netlist: "):
        wiring_of(read(TEXT.replace(there, instead)))


def test_it_has_to_say_what_it_is_of():
    with pytest.raises(FileFormatError, match="title block"):
        comments_of(read(TEXT))
