"""Every testbench measures what its header says; every header says what its subcircuit is."""

import os
import re
import shutil
import subprocess
from collections import Counter
from pathlib import Path

import library_table
import numpy as np
import pytest
from library_table import CIRCUITS, FOUNDRY, INSTANCE, LEVELS, VARIANTS, head_of, library, split

from ann_dc.network.functions import FUNCTIONS

BENCHES = sorted((CIRCUITS / "testbenches").glob("*.cir"))
PRESETS = sorted((CIRCUITS / "models" / "presets").glob("*.lib"))
FILES = [*library_table.files(), *PRESETS, CIRCUITS / "models" / "switch.lib"]
LIBRARY = library()

SCALE = {"f": 1e-15, "p": 1e-12, "n": 1e-9, "u": 1e-6, "m": 1e-3, "k": 1e3, "": 1.0}
EXPECT = re.compile(r"^\* expect: (\w+) = (\S+) \+- (\S+)$", re.MULTILINE)
MEASURED = re.compile(r"^(\w+)\s+=\s+([-+.\de]+)", re.MULTILINE)

BOARD = (
    ".param opamp_cin=1p opamp_ib=1n opamp_pole2=30e6 opamp_imax=20m"
    " cap_leakage=1 switch_leakage=1e9 switch_capacitance=1p switch_charge=1f"
    " mul_nonlinearity=1e-5 mul_feedthrough=1e-5 mul_capacitance=1p"
)
MACRO = (
    ".param opamp_a0=1e5 opamp_gbw=10e6 opamp_sr=20e6 opamp_vsat=13 opamp_rout=50"
    " mul_bw=1e6 mul_vsat=13 func_bw=1e6"
)


def number(text: str) -> float:
    return float(text.rstrip("fpnumk")) * SCALE["".join(c for c in text[-1] if c in SCALE)]


def tolerance(text: str, value: float) -> float:
    return abs(value) * float(text[:-1]) / 100 if text.endswith("%") else number(text)


@pytest.fixture(scope="module")
def ngspice():
    """Runs a deck in the folder of the testbenches and returns what it measured."""
    program = shutil.which("ngspice")
    if program is None:
        absent = pytest.fail if os.environ.get("CI") else pytest.skip
        absent("ngspice is not installed (Debian: apt-get install ngspice)")

    def run(deck) -> dict[str, float]:
        done = subprocess.run(
            [program, "-b", str(deck)],
            cwd=CIRCUITS / "testbenches",
            capture_output=True,
            text=True,
            timeout=60,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return {name: float(value) for name, value in MEASURED.findall(done.stdout)}

    return run


# ---- what is measured ------------------------------------------------------------------------


@pytest.mark.sampled(12)
@pytest.mark.parametrize("bench", BENCHES, ids=lambda file: file.stem)
def test_a_testbench_measures_what_its_header_says(ngspice, bench):
    before = set(bench.parent.iterdir())
    expected = EXPECT.findall(bench.read_text(encoding="utf-8"))
    assert expected, "a testbench expects something"
    measured = ngspice(bench.name)
    wrong = {
        name: (measured.get(name), f"{value} +- {allowed}")
        for name, value, allowed in expected
        if name not in measured
        or abs(measured[name] - number(value)) > tolerance(allowed, number(value))
    }
    assert not wrong
    assert set(bench.parent.iterdir()) == before, "a testbench leaves no file behind"


@pytest.mark.parametrize("preset", PRESETS, ids=lambda file: file.stem)
def test_a_preset_completes_the_macro_models(ngspice, preset, tmp_path):
    models = CIRCUITS / "models" / "macro"
    deck = tmp_path / "deck.cir"
    deck.write_text(
        "\n".join(
            [
                "* inverted product of a sine: -(1 V * 1 V / full scale) * sin(1)",
                f".include {preset}",
                *(f".include {file}" for file in sorted(models.iterdir())),
                f".include {CIRCUITS / 'cells' / 'inv.cir'}",
                "V1 one 0 1",
                "X1 one s func_sin",
                "X2 s 0 one 0 0 p mul4q vm={full_scale}",
                "X3 p out inv",
                ".dc V1 1 2 1",
                ".meas dc full FIND v(out) AT=1",
                ".end",
            ]
        )
    )
    scale = float(re.search(r"full_scale=(\S+)", preset.read_text(encoding="utf-8"))[1])
    assert ngspice(deck)["full"] == pytest.approx(-0.8414710 / scale, rel=1e-4)


def files_of(level: str) -> list[Path]:
    """Files of a level and of all cells; a variant's instead of those that it replaces."""
    folders = [CIRCUITS / "models" / VARIANTS.get(level, level), CIRCUITS / "cells"]
    folders += [CIRCUITS / "models" / level] if level in VARIANTS else []
    files = {"switch.lib": CIRCUITS / "models" / "switch.lib"}
    files |= {file.name: file for folder in folders for file in sorted(folder.iterdir())}
    return list(files.values())


@pytest.mark.parametrize("level", [*LEVELS, *VARIANTS])
def test_a_level_is_chosen_by_its_folder(ngspice, level, tmp_path):
    deck = tmp_path / "deck.cir"
    deck.write_text(
        "\n".join(
            [
                "* x' = cos(x) - x * x at the rate of 1 / 10 us, all files of a level together",
                MACRO,
                BOARD,
                *(f".include {file}" for file in files_of(level)),
                "Vrst rst 0 PWL(0 5 0.9u 5 1u 0)",
                "X1 s x rst integ c=100p",
                "R1 cn s 100k",
                "X2 c cn inv r=100k",
                "X3 x c func_cos",
                "X4 x 0 x 0 0 p mul4q",
                "R2 p s 100k",
                ".tran 0.1u 150u",
                ".meas tran root FIND v(x) AT=150u",
                ".end",
            ]
        )
    )
    assert ngspice(deck)["root"] == pytest.approx(0.824132, abs=1e-3)


SADDLE = """
Vrst rst 0 PWL(0 5 9u 5 9.01u 0)
Vone one 0 1
R1 x s1 {ohms}
R2 lam s1 {ohms}
X1 s1 x rst integ c=1n
X2 x xm inv
R3 xm s2 {ohms}
R4 one s2 {ohms}
X3 s2 lam rst integ c=1n
.tran 50n {end} 0 50n
.meas tran x_end FIND v(x) AT={end}
.meas tran lam_end FIND v(lam) AT={end}
"""


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("ohms", "end"), [("10k", "300u"), ("100k", "2m")])
@pytest.mark.parametrize("level", [*LEVELS, *VARIANTS])
def test_an_inverter_with_its_default_resistors_drives_a_saddle_flow(
    ngspice, level, ohms, end, tmp_path
):
    """x' = -(x + lam), lam' = x - 1 rests at x = 1, lam = -1."""
    deck = tmp_path / "deck.cir"
    included = "\n".join(f".include {file}" for file in files_of(level))
    flow = SADDLE.format(ohms=ohms, end=end)
    deck.write_text(f"* saddle flow\n{MACRO}\n{BOARD}\n{included}{flow}.end\n")
    found = ngspice(deck)
    assert (found["x_end"], found["lam_end"]) == pytest.approx((1.0, -1.0), abs=3e-3)


DEFAULTS = {
    "sum": "R1 one s1 30k\nX1 s1 v sum",
    "pi_cell": "R1 one s1 30k\nX1 s1 v rst pi_cell c=1n",
    "pi_diode": "R1 one s1 30k\nX1 s1 v rst pi_diode c=1n",
}
"""Cells with a resistor of their own, from 1 V through 30 kohm; in reset they are inverters."""


@pytest.mark.parametrize("cell", DEFAULTS)
@pytest.mark.parametrize("level", [*LEVELS, *VARIANTS])
def test_a_cell_with_its_default_resistor_gives_full_scale(ngspice, level, cell, tmp_path):
    deck = tmp_path / "deck.cir"
    included = "\n".join(f".include {file}" for file in files_of(level))
    deck.write_text(
        f"* a cell in reset\n{MACRO}\n{BOARD}\n{included}\nVrst rst 0 5\nVone one 0 1\n"
        f"{DEFAULTS[cell]}\n.tran 1u 50u\n.meas tran v FIND v(v) AT=50u\n.end\n"
    )
    assert ngspice(deck)["v"] == pytest.approx(-1.0, abs=5e-3)


BOARD_CELLS = """
Vrst rst 0 PWL(0 5 0.9u 5 1.1u 0)
V1 a 0 0.1
V2 b 0 -0.1
V3 h 0 0.5
R1 a s1 10k
X1 s1 integ rst integ c=1n
R2 a s2 10k
X2 s2 pi_cell rst pi_cell rf=10k c=1n
R3 a s3 10k
X3 s3 pi_diode rst pi_diode rf=10k c=1n
R4 a s4 10k
R5 b s5 10k
X4 s4 s5 integ_fd f1 rst integ_fd c=1n
R6 a s6 10k
R7 b s7 10k
X5 s6 s7 pi_cell_fd f2 rst pi_cell_fd rf=10k c=1n
X6 h 0 h 0 0 mul4q mul4q
X7 h 0 h 0 mul4q_fd f3 mul4q_fd
X8 a inv inv r=10k
.tran 20n 10u 0 20n
"""
"""Every cell of ``models/board``: 10 uA into 1 nF for 9 us, products of 0.5 V and 0.5 V."""

BOARD_VALUES = {
    **{"inv": -0.1, "integ": -0.09, "integ_fd": -0.09, "mul4q": 0.25, "mul4q_fd": 0.25},
    **{"pi_cell": -0.19, "pi_cell_fd": -0.19, "pi_diode": -0.19},
}


@pytest.mark.parametrize("preset", PRESETS, ids=lambda file: file.stem)
def test_a_preset_completes_every_model_and_cell_of_a_board(ngspice, preset, tmp_path):
    deck, files = tmp_path / "deck.cir", files_of("board")
    included = "\n".join(f".include {file}" for file in [preset, *files])
    measured = "\n".join(f".meas tran v_{name} FIND v({name}) AT=10u" for name in BOARD_VALUES)
    deck.write_text(f"* all cells of a board\n{included}{BOARD_CELLS}{measured}\n.end\n")
    found = ngspice(deck)
    assert {n: found[f"v_{n}"] for n in BOARD_VALUES} == pytest.approx(BOARD_VALUES, rel=0.02)
    parts = {each.name for each in LIBRARY if each.level == "board"}
    assert parts - {"opamp", "opamp_fd"} <= set(INSTANCE.findall(BOARD_CELLS))


# ---- what is written -------------------------------------------------------------------------


@pytest.mark.parametrize("file", FILES, ids=lambda file: f"{file.parent.name}-{file.stem}")
def test_a_file_opens_with_its_header(file):
    head = head_of(file)
    assert head.name == file.stem
    assert head.title
    assert {"level", "source"} <= set(head.fields)
    assert file.read_text(encoding="ascii").endswith("\n")


@pytest.mark.parametrize("each", LIBRARY, ids=lambda each: f"{each.level}-{each.name}")
def test_a_header_says_what_the_subcircuit_is(each):
    assert {"equation", "pins", "params", "level"} <= set(each.header.fields)
    assert each.header.pins == each.pins
    given = {name: value for name, (_, value) in each.header.parameters.items()}
    assert given == each.parameters
    if each.level != "cell":
        assert each.header.fields["level"].startswith(each.level)


CELLS = [each for each in LIBRARY if each.level == "cell"]


@pytest.mark.parametrize("each", CELLS, ids=lambda each: each.name)
def test_a_cell_names_the_levels_that_have_its_models(each):
    parts = set(INSTANCE.findall(each.file.read_text(encoding="ascii")))
    known = {level: {other.name for other in LIBRARY if other.level == level} for level in LEVELS}
    cells = {cell.name for cell in CELLS}
    possible = [level for level in LEVELS if parts <= known[level] | cells]
    assert each.levels == ("every" if possible == list(LEVELS) else ", ".join(possible))


RANGE = "min(max({sx}*v(x),{lo}),{hi})"
"""Argument of a function generator, as behavioural sources have it."""
SPICE = {
    "min": np.minimum,
    "ln": np.log,
    "max": np.maximum,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
}


@pytest.mark.parametrize("level", ["ideal", "macro"])
@pytest.mark.parametrize("block", FUNCTIONS, ids=lambda block: block.name)
def test_a_function_generator_has_the_formula_of_its_function_block(block, level):
    text = (CIRCUITS / "models" / level / "func.lib").read_text(encoding="ascii")
    source = re.search(
        rf"^\.subckt func_{block.name} .*\nB1 [^{{]*{{[^}}]*}}\*(.*)\+{{", text, re.M
    )
    x = np.linspace(*np.clip(block.domain, -2.0, 2.0), 8)[1:-1]
    found = eval(source[1].replace(RANGE, "x"), {"__builtins__": {}}, vars(np) | SPICE | {"x": x})
    np.testing.assert_allclose(found, block.value(x), rtol=1e-14)


def test_names_are_unique_whatever_their_case():
    for level in (*LEVELS, *VARIANTS):
        files = files_of(level)
        here = [each.name.lower() for each in LIBRARY if each.file in files]
        assert [name for name, count in Counter(here).items() if count > 1] == []


def test_a_name_has_the_same_pins_and_parameters_at_every_level():
    shapes = {}
    for each in LIBRARY:
        shape = each.pins, tuple(each.parameters)
        assert shapes.setdefault(each.name, shape) == shape, each.file


def test_nothing_else_lies_in_the_folder():
    known = {*FILES, *BENCHES, CIRCUITS / "README.md"}
    assert {file for file in CIRCUITS.rglob("*") if file.is_file()} == known


def test_every_cell_is_alone_in_its_file():
    names = [each.name for each in LIBRARY if each.level == "cell"]
    assert names == [file.stem for file in sorted((CIRCUITS / "cells").iterdir())]


def test_every_value_of_a_preset_has_a_source():
    needed = set(re.findall(r"(\w+)=", MACRO))
    for preset in PRESETS:
        lines = preset.read_text(encoding="utf-8").splitlines()
        values = [i for i, line in enumerate(lines) if line.startswith(".param")]
        names = [re.fullmatch(r"\.param (\w+)=\S+", lines[i])[1] for i in values]
        assert needed <= set(names)
        for i, name in zip(values, names):
            assert re.match(rf"\* {name} \([^)]+\): \S", lines[i - 1])


def test_testbenches_cover_the_library():
    covered = set()
    for bench in BENCHES:
        head, text = head_of(bench), bench.read_text(encoding="ascii")
        assert head.name == bench.stem
        assert head.fields["run"] == f"ngspice -b {bench.name}"
        names = set(split(head.fields["covers"]))
        inside = {"func_odd", "func_tail", "func_jumpers", "opamp_cmos2"}  # parts of the others
        assert names - inside <= set(INSTANCE.findall(text)), bench
        levels = set(re.findall(r"models/(\w+)/", text)) | {"cell"}
        covered |= {(level, name) for level in levels for name in names}
    here = {(each.level, each.name) for each in LIBRARY if each.level != FOUNDRY}
    assert here <= covered  # a foundry's are run where its models are, in tests/backends/spice/pdk


def test_the_readme_has_the_table_of_the_headers():
    written = (CIRCUITS / "README.md").read_text(encoding="utf-8")
    assert written == library_table.readme(), (
        "circuits/README.md: run python tests/circuits/library_table.py --write"
    )
