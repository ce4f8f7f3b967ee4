"""Which multipliers a cell gets: shared ones, whatever the names."""

from hypothesis import given, strategies as st

from ann_dc.synthesis.assembly import assemble
from ann_dc.synthesis.signals import times
from ann_dc.synthesis.wiring import Wiring


@given(st.permutations(["a", "b", "c", "d"]))
def test_multipliers_do_not_depend_on_names(names):
    wiring = Wiring(names)
    a, b, c, d = (wiring.signal(name) for name in "abcd")
    drives = {"a": times(times(a, b), c), "b": times(times(a, b), d), "c": times(a, b)}
    blocks, _ = assemble(wiring, drives)
    assert len(blocks) == 3  # a b once, then c and d
