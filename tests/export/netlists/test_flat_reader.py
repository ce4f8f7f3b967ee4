"""Decks opened to their elements, compared with what ngspice makes of them."""

import pytest
from ngspice_listing import expanded, number
from simulator import needs_ngspice

import ann_dc
from ann_dc.export.netlists.flat_reader import flattened, logical_lines
from ann_dc.hardware.parts import levels

DECK = """* a title
.param scale=2 twice={2*scale}
.subckt inner a b params: r=1k
R1 a m {r}
R2 m b
+ {r*twice}
.ends inner
.subckt outer a params: k=1
X1 a far inner r={k*10k}
X2 far 0 inner
.ends outer
X1 in outer k=3
V1 in 0 1
.control
R9 nothing here 1
.endc
.end
R8 behind the end
"""


def test_nodes_and_values_go_down():
    found = {e.name: (e.nodes, e.value) for e in flattened(DECK, {})}
    assert found == {
        "x1.x1.r1": (("in", "x1.x1.m"), 30e3),
        "x1.x1.r2": (("x1.x1.m", "x1.far"), 120e3),
        "x1.x2.r1": (("x1.far", "x1.x2.m"), 1e3),
        "x1.x2.r2": (("x1.x2.m", "0"), 4e3),
        "v1": (("in", "0"), 1.0),
    }


def test_includes_stand_in_their_place():
    lines = [*logical_lines("A\n.include lib/B.lib\nC", {"lib/b.lib": "* no\nB1\n+ 2"})]
    assert lines == ["a", "b1 2", "c"]


@needs_ngspice
@pytest.mark.parametrize("level", [levels.BEHAVIOURAL, levels.macro(differential=True)])
def test_ngspice_opens_the_same_elements(level, tmp_path):
    """Every resistor, capacitor, switch and source outside op amps and multipliers."""
    network = ann_dc.design(
        ann_dc.plants.double_integrator(N=3), preconditioner=ann_dc.PreconditionerKind.DIAGONAL
    ).network
    backend = ann_dc.SpiceBackend(level=level)
    deck = backend.deck(*backend.prepare(network), {}).text
    theirs = expanded(deck, tmp_path)
    ours = [e for e in flattened(deck, {}) if e.kind in "rcsvi"]
    assert len(ours) > 100
    for element in ours:
        words = theirs.pop(element.name)
        assert tuple(words[: len(element.nodes)]) == element.nodes
        if element.value is not None:
            assert number(words[len(element.nodes)]) == pytest.approx(element.value, rel=1e-9)
    inside = ("xa", "x1", "x2")  # the op amp, and the halves of a multiplier
    assert all(set(name.split(".")) & {*inside} for name in theirs if name[0] == "x")
