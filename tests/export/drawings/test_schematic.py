"""Schematics: parts with the values of their circuit, drawn where they can be read."""

import csv
import io
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from drawn import Picture, rows

import ann_dc
from ann_dc.errors import ExportError, ExportPackageMissing
from ann_dc.export.drawings.schematic import circuit_sheets, schematic_files
from ann_dc.export.netlists.pack import pack_files
from ann_dc.export.reference.vector import reference_vector
from ann_dc.hardware.schematic.elements import Integrator

pytest.importorskip("schemdraw", reason="no schemdraw here")
TOLD = {"title": "a picture"}
PREFIXES = {"k": 1e3, "M": 1e6, "G": 1e9, "m": 1e-3, "µ": 1e-6, "n": 1e-9, "p": 1e-12, "f": 1e-15}


@pytest.fixture(scope="module")
def files(network, vector):
    return schematic_files(network, vector)


def pictures(network) -> list[Picture]:
    circuit, _ = ann_dc.SpiceBackend().prepare(network)
    return [Picture(page.svg(TOLD)) for page in circuit_sheets(circuit, "behavioural")]


def designed(problem, kind=ann_dc.PreconditionerKind.DIAGONAL):
    return ann_dc.design(problem, preconditioner=[kind]).network


PROBLEMS = {
    "car": lambda: designed(ann_dc.plants.car()),
    "rows": lambda: designed(rows()),
    "pyramid": lambda: designed(
        ann_dc.plants.double_integrator(N=5), ann_dc.PreconditionerKind.MULTILEVEL
    ),
    "tree": lambda: designed(
        ann_dc.plants.double_integrator(N=5), ann_dc.PreconditionerKind.CYCLIC_REDUCTION
    ),
}


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("rows", "tree")]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["car", "pyramid", *SLOW])
def test_sheets_can_be_read(name):
    for picture in pictures(PROBLEMS[name]()):
        assert picture.collisions() == []
        assert picture.outside() == []
        assert min(words.size for words in picture.words) >= 6


def quantity(text: str, unit: str) -> float:
    number, _, said = text.partition(" ")
    return float(number.replace("−", "-")) * PREFIXES.get(said.removesuffix(unit), 1.0)


def test_values_are_those_of_the_circuit(network):
    """R C of every input of an integrator is T / (rate |w|), in volts."""
    circuit, _ = ann_dc.SpiceBackend().prepare(network)
    words = pictures(network)[0].words
    texts = [word.text for word in words]
    title = next(word for word in words if word.text == "integrator u.a")
    inside = [
        w for w in words if title.left < w.right < title.left + 260 and 0 < w.top - title.top < 110
    ]
    ohms = sorted(quantity(w.text, "Ω") for w in inside if w.text.endswith("Ω"))
    (farads,) = [quantity(w.text, "F") for w in inside if w.text.endswith("F")]
    part = circuit.schematic.by_name["u.a"]
    assert isinstance(part, Integrator)
    unit, time = circuit.scaling.unit, circuit.scaling.time
    expected = sorted(
        time * unit["u.a"] / (part.rate[2] * abs(wire.weight[2]) * unit[wire.source])
        for wire in part.wires
    )
    np.testing.assert_allclose(np.array(ohms) * farads, expected, rtol=2e-3)
    assert {"PI amplifier m.x", "PI amplifier b.x"} <= set(texts)


def texts_of(network) -> list[str]:
    return [words.text for picture in pictures(network) for words in picture.words]


@pytest.mark.slow
def test_a_diode_neuron_is_drawn():
    assert "rectifying multiplier zeta.pace" in texts_of(PROBLEMS["rows"]())


def test_rails_are_drawn():
    problem = ann_dc.plants.double_integrator()
    with_limits = replace(problem, bounds={problem.controls[0]: (-1.3, 1.3)})
    assert any(text.startswith("rails −") for text in texts_of(designed(with_limits)))


def test_a_rail_beyond_full_scale_is_told():
    problem = ann_dc.plants.double_integrator()
    with_limits = replace(problem, bounds={problem.controls[0]: (-1.3, 500.0)})
    [words] = {text for text in texts_of(designed(with_limits)) if text.startswith("rails")}
    assert re.fullmatch(r"rails −\S+ m?V, \S+ V \(beyond full scale\)", words)


@pytest.mark.slow
def test_files_are_the_same_bytes(network, vector, files):
    assert files == schematic_files(network, vector)
    assert sorted(files) == ["reference_vector.json", "schematic_1.pdf", "schematic_1.svg"]


def test_parts_have_the_values_of_the_pack():
    """A pyramid of op amps gets another margin, and with it other capacitors."""
    network = designed(ann_dc.plants.double_integrator(N=3), ann_dc.PreconditionerKind.MULTILEVEL)
    vector = reference_vector(network)
    drawn = schematic_files(network, vector, level="macro")["schematic_1.svg"].decode()
    bill = pack_files(network, vector, level="macro")["bill.csv"].decode()
    bought = {
        float(row["value"]) for row in csv.DictReader(io.StringIO(bill)) if row["unit"] == "F"
    }
    shown = re.findall(r">(\d[\d.]*) ?([pnfµ])F<", drawn)
    assert shown
    for number, prefix in shown:
        farads = float(number) * PREFIXES[prefix]
        assert min(abs(farads / own - 1) for own in bought) < 0.01


def test_a_level_of_real_parts(network, vector):
    files = schematic_files(network, vector, level="tl072_ad633")
    assert b"Full scale 10 V" in files["schematic_1.svg"]


@pytest.mark.parametrize("level", ["transistor", ""])
def test_an_unknown_level_is_refused(network, vector, level):
    with pytest.raises(ExportError, match=r"level: .* cannot be drawn; choose one of: behavioural"):
        schematic_files(network, vector, level=level)


def test_a_grid_is_refused_by_its_neurons():
    grid = designed(ann_dc.plants.double_integrator(N=3), ann_dc.PreconditionerKind.RESISTIVE_GRID)
    with pytest.raises(ExportError, match=r"grid between q\.x, q\.v, u\.a, t\.x, t\.v"):
        schematic_files(grid, reference_vector(grid), level="macro")


def test_schemdraw_is_optional(network, vector, monkeypatch):
    monkeypatch.setitem(sys.modules, "schemdraw", None)
    with pytest.raises(ExportPackageMissing, match=r"pip install 'ann-dc\[export\]'"):
        schematic_files(network, vector)


def test_row_of_one_cell_is_drawn_without_the_kinds_that_it_lacks():
    x, a = sp.symbols("x a")
    problem = ann_dc.OptimalControlProblem(
        states=(x,), controls=(a,), dynamics=(a,), dt=0.1, horizon=1, cost=a**2, q_0=(0,), q_d=(1,)
    )
    network = designed(problem)
    files = schematic_files(network, reference_vector(network))
    assert sorted(files) == ["reference_vector.json", "schematic_1.pdf", "schematic_1.svg"]
    drawn = files["schematic_1.svg"].decode()
    assert "u.a" in drawn
    assert "beta.x" not in drawn
