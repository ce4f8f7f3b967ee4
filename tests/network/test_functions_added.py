"""A new function block is one record and two SPICE subcircuits; nothing else has to change.

The block ``softplus`` is added to a copy of the package, in one module and two files of the SPICE
library. Every realisation of the copy must be right, or refuse the block by name.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ann_dc.export.catalogue import FORMATS

HOUSE = Path(__file__).parents[2]
MODULE = "ann_dc/network/functions.py"
RECORD = """\
    FunctionBlock(
        name="softplus",
        formula=lambda lib, x: lib.log(1 + lib.exp(x)),
        slope_formula=lambda lib, x, y: 1 - lib.exp(-y),
    ),
"""
END = ')\n"""Function blocks; the position'
"""End of the table of records."""
SUBCIRCUITS = {
    "circuits/models/ideal/func.lib": """
* func_softplus: softplus
* equation: v(out) = (1 + ge) * ln(1 + exp(u)) / sy + oy, u = sx * v(x) in lo .. hi
* pins: x (input), out (output)
* params: sx (1/V) = 1, sy (1/V) = 1, lo (1) = -20, hi (1) = 20, ge (1) = 0, oy (V) = 0
* level: ideal
.subckt func_softplus x out params: sx=1 sy=1 lo=-20 hi=20 ge=0 oy=0
B1 out 0 V={(1+ge)/sy}*ln(1+exp(min(max({sx}*v(x),{lo}),{hi})))+{oy}
.ends func_softplus
""",
    "circuits/models/macro/func.lib": """
* func_softplus: softplus
* equation: v(out) = (1 + ge) * ln(1 + exp(u)) / sy + oy, u = sx * v(x) in lo .. hi, one pole
* pins: x (input), out (output)
* params: sx (1/V) = 1, sy (1/V) = 1, lo (1) = -20, hi (1) = 20, ge (1) = 0, oy (V) = 0
* level: macro
.subckt func_softplus x out params: sx=1 sy=1 lo=-20 hi=20 ge=0 oy=0
B1 0 p I={1m*(1+ge)/sy/mul_vsat}*ln(1+exp(min(max({sx}*v(x),{lo}),{hi})))+{1m*oy/mul_vsat}
R1 p 0 1k
C1 p 0 {1m/(6.283185307*func_bw)}
D1 p 0 func_rail off
G2 0 out p 0 {mul_vsat/100u}
R2 out 0 100u
.ends func_softplus
""",
}
RIGHT = {
    **dict.fromkeys(("parser", "problem", "reference", "interpreted", "generated"), 1e-13),
    **{"torch": 1e-13, "onnx float64": 1e-13, "onnx float32": 1e-5, "casadi": 1e-5},
    **{"weights": 1e-12, "latex": 0.0, "verilog_a": 0.0, "emulation": 1e-3},
    **{"ideal circuit": 1e-4, "macro circuit": 1e-3, "transistor circuit": 2e-2},
    **{f"export {form}": 0.0 for form in FORMATS},
}
"""Largest relative error of every realisation; an export passes its own check."""
REFUSED = {"export nir"}
"""Realisations without function blocks; their messages name the block."""


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """Results of ``tests/added_function.py`` in a copy of the package with the block."""
    copy = tmp_path_factory.mktemp("copy")
    for folder in ("ann_dc", "circuits"):
        shutil.copytree(HOUSE / folder, copy / folder, ignore=shutil.ignore_patterns("__pycache__"))
    module = copy / MODULE
    before, end, after = module.read_text(encoding="utf-8").rpartition(END)
    module.write_text(f"{before}{RECORD}{end}{after}", encoding="utf-8")
    for name, text in SUBCIRCUITS.items():
        with (copy / name).open("a", encoding="ascii") as file:
            file.write(text)
    path = os.pathsep.join((str(copy), str(HOUSE / "tests")))
    run = subprocess.run(
        [sys.executable, str(HOUSE / "tests" / "added_function.py")],
        cwd=copy, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout.splitlines()[-1])


@pytest.mark.slow
@pytest.mark.parametrize("realisation", RIGHT)
def test_a_realisation_of_an_added_block_is_right_or_refuses_by_name(found, realisation):
    result = found[realisation]
    if realisation in REFUSED:
        assert "function softplus" in result
    else:
        assert isinstance(result, float), result
        assert result <= RIGHT[realisation]
