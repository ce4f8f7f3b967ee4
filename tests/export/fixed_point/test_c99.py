"""C99 without floating point, as gcc and clang see it, and as it runs."""

import re
from pathlib import Path
from time import process_time

import numpy as np
import pytest
from fixed_points import PROBLEMS, in_integers, needs, pressed, said, walked, written

import ann_dc
from ann_dc.export.fixed_point.c99 import c99_check, c99_files
from ann_dc.export.fixed_point.golden import FixedPoint, Port
from ann_dc.export.fixed_point.machine import Integers
from ann_dc.export.reference.vector import reference_vector
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network

WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-Wconversion")
STRICT = ("-fsanitize=undefined", "-fno-sanitize-recover=all")
COMPILERS = ("gcc", "clang")
WALK = """
#include "ann_dc_network.h"
#include <stdio.h>
#include <stdlib.h>
static ann_dc_network network;
static const int at[] = { AT };
int main(int count, char **words) {
    int n;
    ann_dc_start(&network);
    if (count > 3)
        ann_dc_load_all(&network, atoi(words[2]), atol(words[3]));
    for (n = atoi(words[1]); n > 0; --n)
        (void)ann_dc_step(&network);
    for (n = 0; n < ANN_DC_NEURONS; ++n)
        printf("%ld\\n", (long)network.words[at[n]]);
    for (n = 0; n < ANN_DC_CONTROLS; ++n)
        printf("%ld\\n", (long)ann_dc_control(&network, n));
    return 0;
}
"""


def exported(name: str, folder: Path, bits: int = 0) -> Path:
    return written(c99_files(*walked(name), bits=bits), folder)


def places_of(model: FixedPoint) -> str:
    return ", ".join(map(str, model.machine.neurons[:, 0].tolist()))


def number_of(machine: Integers, port: Port) -> int:
    """A word without its guard bits, to the nearest."""
    guard = machine.machine.guard
    return (2 * int(machine.words[port.words[0]]) + 2**guard) // 2 ** (guard + 1)


def compiled(folder: Path, compiler: str, source: str) -> Path:
    program = folder / f"{Path(source).stem}_{compiler}"
    command = (compiler, *WARNINGS, *STRICT, "-O2", "-o", program.name, source, "ann_dc_network.c")
    code, log = said(folder, *command)
    assert (code, log) == (0, "")
    return program


@pytest.mark.sampled(2)
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("name", ["car", "objectives"])
def test_it_compiles_without_a_warning_and_tests_itself(compiler, name, tmp_path):
    """Undefined behaviour would stop it."""
    needs(compiler)
    program = compiled(exported(name, tmp_path), compiler, "selftest.c")
    code, said_ = said(tmp_path, str(program))
    assert code == 0
    assert said_.startswith("PASS: 0 differences in 3 vectors")


def test_a_drive_that_a_rail_stops_does_not_saturate_in_c(tmp_path):
    needs("gcc")
    written(c99_files(*pressed(), bits=16), tmp_path)
    code, log = said(tmp_path, str(compiled(tmp_path, "gcc", "selftest.c")))
    assert (code, log[:5]) == (0, "PASS:")


def test_its_own_makefile_checks_it(tmp_path):
    needs("make")
    needs("gcc")
    code, log = said(exported("double_integrator", tmp_path), "make", "check", "CC=gcc")
    assert code == 0
    assert "PASS" in log


def test_the_self_test_can_fail(tmp_path):
    needs("gcc")
    exported("double_integrator", tmp_path)
    source = tmp_path / "ann_dc_network.c"
    text = source.read_text()
    changed = text.replace("floored(a + ((int64_t)1 << (shift - 1)), shift)", "floored(a, shift)")
    assert changed != text
    source.write_text(changed)
    code, log = said(tmp_path, str(compiled(tmp_path, "gcc", "selftest.c")))
    assert code == 1
    assert log.startswith("FAIL")


def test_inputs_are_loaded_as_the_golden_model_has_them(tmp_path):
    """And other inputs come to the other controls."""
    needs("gcc")
    exported("double_integrator", tmp_path, bits=16)
    model = in_integers("double_integrator", 16)
    index = next(i for i, port in enumerate(model.inputs) if port.name == "q_d.x")
    target = model.inputs[index]
    word = round(target.scale.network(0.5) * 2 ** int(model.fraction[target.words[0]]))
    (tmp_path / "walk.c").write_text(WALK.replace("AT", places_of(model)))
    program = compiled(tmp_path, "gcc", "walk.c")
    code, log = said(tmp_path, str(program), "300", str(index), str(word))
    machine = Integers(model.machine)
    machine.load(target.words, np.array([word] * len(target.words)))
    machine.run(300)
    controls = [number_of(machine, port) for port in model.controls]
    assert code == 0
    assert [int(line) for line in log.split()] == [*machine.states.tolist(), *controls]


@pytest.mark.slow
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("name", sorted(PROBLEMS))
def test_it_walks_2000_steps_like_the_golden_model(compiler, name, tmp_path):
    needs(compiler)
    exported(name, tmp_path)
    model = in_integers(name)
    (tmp_path / "walk.c").write_text(WALK.replace("AT", places_of(model)))
    code, log = said(tmp_path, str(compiled(tmp_path, compiler, "walk.c")), "2000")
    machine = Integers(model.machine)
    machine.run(2000)
    assert code == 0
    assert [int(line) for line in log.split()][: len(machine.states)] == machine.states.tolist()


def test_there_is_no_floating_point_in_it():
    files = c99_files(*walked("car"), bits=16)
    for name in ("ann_dc_network.c", "ann_dc_network.h", "selftest.c"):
        code = re.sub(r"/\*.*?\*/", "", files[name].decode(), flags=re.S)
        assert not re.search(r"\b(float|double|math\.h)\b|\d\.\d|%[efg]", code)


def test_names_are_those_of_the_network():
    header = c99_files(*walked("double_integrator"))["ann_dc_network.h"].decode()
    assert "ANN_DC_INPUT_Q_D_X" in header
    assert "ANN_DC_CONTROL_U_0_A = 0" in header


@pytest.mark.parametrize("bits", [16, 32])
def test_values_that_inputs_hold_are_listed(bits):
    """The highest is the highest number of the words; one more does not fit."""
    model = in_integers("car", bits)
    files = c99_files(*walked("car"), bits=bits)
    readme, header = files["README.md"].decode(), files["ann_dc_network.h"].decode()
    table = readme.split("| input | name | lowest | highest |\n")[1].split("\n\n")[0]
    rows = [line.strip("| ").split(" | ") for line in table.splitlines()[1:]]
    assert [row[1] for row in rows] == [port.name for port in model.inputs]
    for port, (index, _, low, high) in zip(model.inputs, rows, strict=True):
        fraction = int(model.fraction[port.words[0]])
        for value, number in ((low, -(2 ** (bits - 1))), (high, 2 ** (bits - 1) - 1)):
            assert round(port.scale.network(float(value)) * 2**fraction) == number
        assert re.search(rf"_\w+ = {index},?  /\* {low} to {high} \*/\n", header)


def test_every_name_is_an_identifier_of_its_own():
    """Names that differ in marks alone, and names without a letter of C."""
    names = ("a", "a.2", "(a)", "ω", "日本", "2")
    leaks = [Connection(source="x", target="x", weight=-1.0)]
    leaks += [Connection(source=name, target="x", weight=0.1) for name in names]
    cell = Cell(neurons=(Neuron(name="x"),), inputs=names, connections=tuple(leaks))
    network = Network(cell=cell, stages=1, inputs=dict.fromkeys(names, 0.5))
    header = c99_files(network, reference_vector(network), bits=16)["ann_dc_network.h"].decode()
    found = re.findall(r"^    (ANN_DC_INPUT_\w+) = \d", header, re.MULTILINE)
    assert found == [f"ANN_DC_INPUT_{word}" for word in ("A", "A_2", "A_3", "3", "4", "2")]


def test_it_is_checked():
    files = c99_files(*walked("car"), bits=16)
    found = c99_check(files)
    assert re.match(r"\d+ steps of the golden model in words of 16 bits, equal to the last", found)


@pytest.mark.slow
def test_a_car_of_90_stages_takes_seconds():
    network = ann_dc.design(
        ann_dc.plants.car(N=90), preconditioner=ann_dc.PreconditionerKind.MULTILEVEL
    ).network
    vector = reference_vector(network)
    begun = process_time()
    files = c99_files(network, vector, accuracy=1e-2)
    assert process_time() - begun < 10
    assert len(files["ann_dc_network.c"]) < 2_000_000
