"""SystemVerilog as simulators see it: bit for bit the golden model."""

import re
from pathlib import Path

import pytest
from fixed_points import PROBLEMS, in_integers, needs, pressed, said, walked, written

from ann_dc.export.fixed_point.golden import FixedPoint
from ann_dc.export.fixed_point.hdl import hdl_check, hdl_files

SOURCES = ("ann_dc_network.sv", "testbench.sv")


def exported(name: str, folder: Path, **options) -> Path:
    return written(hdl_files(*walked(name), **options), folder)


def simulated(folder: Path, *options: str) -> str:
    needs("iverilog")
    needs("vvp")
    code, log = said(folder, "iverilog", "-g2012", "-o", "simulation", *SOURCES)
    assert (code, log) == (0, "")
    return said(folder, "vvp", "-n", "simulation", *options)[1]


def expecting(folder: Path, model: FixedPoint, count: int) -> None:
    """Every vector is that of the golden model after another number of steps."""
    width = model.machine.wide
    states = [f"{state % 2**width:x}\n" for state in model.states_after(count).tolist()]
    (folder / "counts.hex").write_text(f"{count:x}\n" * len(model.vectors))
    (folder / "expected.hex").write_text("".join(states * len(model.vectors)))


def test_icarus_walks_like_the_golden_model(tmp_path):
    """All vectors, and the settle test."""
    log = simulated(exported("double_integrator", tmp_path))
    assert re.match(r"PASS: 0 differences in \d vectors, the last after \d+ steps", log)


def test_a_drive_that_a_rail_stops_does_not_saturate_in_hardware(tmp_path):
    assert simulated(written(hdl_files(*pressed(), bits=16), tmp_path)).startswith("PASS")


@pytest.mark.parametrize("name", ["car", "bounds", "objectives"])
def test_icarus_takes_the_first_steps(name, tmp_path):
    """Functions, products, diodes, rails, and neurons that all cells share."""
    folder = exported(name, tmp_path)
    expecting(folder, in_integers(name), 3)
    assert simulated(folder, "+vectors=1").startswith("PASS: 0 differences in 1 vectors")


def test_the_bench_can_fail(tmp_path):
    folder = exported("double_integrator", tmp_path)
    design = (folder / SOURCES[0]).read_text()
    changed = design.replace("(a + (ONE <<< less)) >>> by", "a >>> by")
    assert changed != design
    (folder / SOURCES[0]).write_text(changed)
    assert simulated(folder, "+vectors=1").startswith("FAIL")


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(PROBLEMS))
def test_verilator_walks_2000_steps_like_the_golden_model(name, tmp_path):
    needs("verilator")
    folder = exported(name, tmp_path)
    expecting(folder, in_integers(name), 2000)
    code, log = said(folder, "verilator", "--binary", "-O3", "--top-module", "testbench", *SOURCES)
    assert code == 0, log
    code, log = said(folder, "obj_dir/Vtestbench", "+vectors=1")
    assert log.startswith("PASS: 0 differences in 1 vectors, the last after 2000 steps")


def test_verilator_has_no_complaint(tmp_path):
    needs("verilator")
    folder = exported("car", tmp_path, bits=16)
    command = ("verilator", "--lint-only", "-Wall", "--top-module", "ann_dc_network", SOURCES[0])
    assert said(folder, *command) == (0, "")


def test_nothing_in_the_design_is_for_simulation_only():
    design = hdl_files(*walked("car"), bits=16)["ann_dc_network.sv"].decode()
    code = re.sub(r"//.*", "", design)
    assert not re.search(r"\breal\b|\$random|\$urandom|#\d|\bwait\b|\$display", code)


def test_it_is_checked():
    files = hdl_files(*walked("car"), bits=16)
    found = hdl_check(files)
    assert re.match(r"\d+ steps of the golden model in words of 16 bits, equal to the last", found)
