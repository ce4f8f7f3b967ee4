"""Verilog-A modules: what is well formed, and what is not."""

import time

import pytest

from ann_dc.errors import FileFormatError
from ann_dc.export.netlists.verilog_reader import modules_of

GOOD = """
`include "disciplines.vams"
// a comment
module leaf(a, b);
  inout a, b;
  electrical a, b;
  branch (a) into;
  parameter real r = 1e3;
  analog begin
    V(into) <+ 0;
    V(b) <+ -r * I(into);
  end
endmodule
module top(x);
  inout x;
  electrical x, y;
  electrical gnd;
  ground gnd;
  leaf #(.r(2 * 5)) one (x, y);
  analog begin
    I(y, gnd) <+ V(y, gnd) / 5;
  end
endmodule
"""


def test_a_module_is_taken_apart():
    top = modules_of(GOOD)["top"]
    assert top.nodes == {"x", "y", "gnd"}
    assert top.contributions == [("I", ("y", "gnd"), "V(y, gnd) / 5")]
    (leaf,) = top.instances
    assert (leaf.module, leaf.name, leaf.nets, leaf.given) == (
        "leaf",
        "one",
        ("x", "y"),
        {"r": "2 * 5"},
    )


@pytest.mark.parametrize(
    ("there", "instead"),
    [
        ("endmodule\nmodule", "module"),
        ('  end\nendmodule\n"""', ""),
        ("electrical a, b;", "electrical a;"),
        ("electrical x, y;", "electrical x;"),
        ("V(b) <+", "V(c) <+"),
        ("V(b) <+", "V(b) ="),
        ("-r * I(into)", "-r * (I(into)"),
        ("I(into);", "I(onto);"),
        ("leaf #(.r", "leaf #(.s"),
        ("one (x, y)", "one (x)"),
        ("leaf #", "twig #"),
        ("module top", "module leaf"),
        ("branch (a) into", "branch (z) into"),
        ("(x, y);", "(x, y)"),
        ("ground gnd", "wire gnd"),
    ],
)
def test_what_is_not_well_formed_is_refused(there, instead):
    assert there in GOOD or there.startswith("  end")
    broken = (
        GOOD.replace(there, instead) if there in GOOD else GOOD.rstrip().removesuffix("endmodule")
    )
    with pytest.raises(FileFormatError, match="Verilog-A: "):
        modules_of(broken)


@pytest.mark.parametrize(
    "text",
    [
        "/* " * 20_000,
        "\n" * 60_000 + "?",
        "module m(a); " + "a" * 20_000 + "; endmodule",
        "module m(a); inout a; electrical a; " + "analog begin " * 5_000 + "; endmodule",
        GOOD + "module m(a); inout a; electrical a; endmodule " * 3000,
    ],
    ids=["comments", "blank lines", "a long name", "blocks that never end", "modules"],
)
def test_a_long_file_is_refused_at_once(text):
    begun = time.process_time()
    with pytest.raises(FileFormatError, match="Verilog-A: "):
        modules_of(text)
    assert time.process_time() - begun < 1.0
