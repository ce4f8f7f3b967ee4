"""SPICE library cells as Verilog-A modules with equal names, pins and parameters.

A virtual ground is a branch with a given voltage, through which the sum of the input currents
flows.
"""

from __future__ import annotations

from ann_dc.network.functions import CODE, ELEMENTARY, INFIX, function_block, written

RESET = "0.0, V(rst) > 2.5"
"""Initial value of an integral, and the condition under which it is reset to this value."""

LIBRARY = {
    "integ": f"""\
// integrator: v(out) = v0 + vos - (1/c) * integral of the current into s
module integ(s, out, rst);
  inout s, out, rst;
  electrical s, out, rst;
  branch (s) into;
  parameter real c = 1e-10;
  parameter real v0 = 0;
  parameter real vos = 0;
  analog begin
    V(into) <+ vos;
    V(out) <+ v0 + vos - idt(I(into), {RESET}) / c;
  end
endmodule
""",
    "integ_railed": f"""\
// integrator with rails: it stops at lo and hi, and turns back at once
module integ_railed(s, out, rst);
  inout s, out, rst;
  electrical s, out, rst, held;
  branch (s) into;
  parameter real c = 1e-10;
  parameter real v0 = 0;
  parameter real vos = 0;
  parameter real lo = -1e30;
  parameter real hi = 1e30;
  analog begin
    V(into) <+ vos;
    V(held) <+ v0 + vos - idt((V(held) >= hi && I(into) < 0) || (V(held) <= lo && I(into) > 0)
      ? 0.0 : I(into), {RESET}) / c;
    V(out) <+ min(max(V(held), lo), hi);
  end
endmodule
""",
    "pi_cell": f"""\
// PI cell: v(out) = v0 + vos - rf * i - (1/c) * integral of i, i the current into s
module pi_cell(s, out, rst);
  inout s, out, rst;
  electrical s, out, rst;
  branch (s) into;
  parameter real rf = 3e4;
  parameter real c = 1e-10;
  parameter real v0 = 0;
  parameter real vos = 0;
  analog begin
    V(into) <+ vos;
    V(out) <+ v0 + vos - rf * I(into) - idt(I(into), {RESET}) / c;
  end
endmodule
""",
    "pi_diode": f"""\
// diode neuron: v(out) = -max(m, 0), m = v(held) + rf * i; off, v(held) leaks through rf + rp
module pi_diode(s, out, rst);
  inout s, out, rst;
  electrical s, out, rst, held;
  branch (s) into;
  parameter real rf = 3e4;
  parameter real c = 1e-10;
  parameter real v0 = 0;
  parameter real vos = 0;
  parameter real rp = 3e3;
  analog begin
    V(into) <+ vos;
    V(held) <+ idt(V(held) + rf * I(into) > 0 ? I(into) : -V(held) / (rf + rp), {RESET}) / c - v0;
    V(out) <+ -max(V(held) + rf * I(into), 0.0);
  end
endmodule
""",
    "sum": """\
// adder: v(out) = vos - rf * i, i the current into s
module sum(s, out);
  inout s, out;
  electrical s, out;
  branch (s) into;
  parameter real rf = 3e4;
  parameter real vos = 0;
  analog begin
    V(into) <+ vos;
    V(out) <+ vos - rf * I(into);
  end
endmodule
""",
    "inv": """\
// inverter: v(out) = -(1 + e) * v(in) + (2 + e) * vos
module inv(in, out);
  inout in, out;
  electrical in, out;
  parameter real r = 3e4;
  parameter real vos = 0;
  parameter real e = 0;
  analog begin
    V(out) <+ -(1 + e) * V(in) + (2 + e) * vos;
  end
endmodule
""",
    "mul4q": """\
// multiplier: v(out) = (1 + ge) * (v(x1) - v(x2) + ox) * (v(y1) - v(y2) + oy) / vm + oz + v(z)
module mul4q(x1, x2, y1, y2, z, out);
  inout x1, x2, y1, y2, z, out;
  electrical x1, x2, y1, y2, z, out;
  parameter real vm = 1;
  parameter real ge = 0;
  parameter real ox = 0;
  parameter real oy = 0;
  parameter real oz = 0;
  analog begin
    V(out) <+ (1 + ge) * (V(x1) - V(x2) + ox) * (V(y1) - V(y2) + oy) / vm + oz + V(z);
  end
endmodule
""",
}
"""Modules by library cell name."""

ARGUMENT = "min(max(sx * V(x), lo), hi)"
FORMS = INFIX | {"maximum": "max({}, {})", "where": "({} ? {} : {})"}
FORMS |= {name: f"{name}({{}})" for name in ELEMENTARY.values()} | {"log": "ln({})"}
"""Operations of formulas in Verilog-A."""


def function_module(function: str) -> str:
    """Return the module of a function generator, by function block name.

    Raises `NetworkError` if the formula of the block has no tree.

    Examples
    --------
    >>> print(function_module("sin").splitlines()[-3])
        V(out) <+ (1 + ge) * sin(min(max(sx * V(x), lo), hi)) / sy + oy;
    """
    tree = function_block(function).trees[0]
    formula = written(tree, {"x": ARGUMENT}, FORMS, _number)
    if isinstance(tree, tuple) and tree[0] in ("add", "subtract"):
        formula = f"({formula})"
    return f"""\
// function generator: v(out) = (1 + ge) * {function}(u) / sy + oy, u = sx * v(x) in lo .. hi
module func_{function}(x, out);
  inout x, out;
  electrical x, out;
  parameter real sx = 1;
  parameter real sy = 1;
  parameter real lo = -1e30;
  parameter real hi = 1e30;
  parameter real ge = 0;
  parameter real oy = 0;
  analog begin
    V(out) <+ (1 + ge) * {formula} / sy + oy;
  end
endmodule
"""


def _number(value: float) -> str:
    return f"{value:.17g}" if value else "0.0"  # max(x, 0) would be an integer


def module_text(name: str) -> str | None:
    """Return the text of a library module by the name of its SPICE cell; None if there is none.

    Raises `NetworkError` if the name is that of a function generator without a traceable formula.
    """
    function = name.removeprefix("func_")
    if function != name and function in CODE:
        return function_module(function)
    return LIBRARY.get(name)
