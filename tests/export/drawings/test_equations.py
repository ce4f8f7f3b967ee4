"""Equations as LaTeX: a mathematics parser reads every one, and the numbers are the network's."""

import dataclasses
import re
import shutil
import subprocess

import numpy as np
import pytest
from drawn import MADE, network_of
from matplotlib.mathtext import MathTextParser

import ann_dc
from ann_dc.export.drawings.equations import latex_files
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network
from ann_dc.weights.network_file import load, save

QUICK = ("pendulum",)
SLOW = [name for name in (*ann_dc.plants.names(), *MADE) if name not in QUICK]
NAMES = [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)]


@pytest.fixture(scope="module")
def text_of(vector):
    """The text of a network's document; the vector beside it plays no part."""
    return lambda network: latex_files(network, vector)["equations.tex"].decode()


@pytest.fixture(scope="module")
def files(network, vector):
    return latex_files(network, vector)


def formulas(text: str) -> list[str]:
    """Everything that is set as mathematics, line by line; an ampersand is no sign here."""
    aligned = re.findall(r"\\begin\{align\*\}\n(.*?)\\end\{align\*\}", text, re.DOTALL)
    lines = [line.removesuffix(r" \\") for block in aligned for line in block.splitlines()]
    inline = re.findall(r"\$([^$]*)\$", re.sub(r"\\\$", "", text))
    plain = [line.replace(r"\&", "+").replace("&", "") for line in (*lines, *inline)]
    return list(dict.fromkeys(plain))


@pytest.mark.parametrize("name", NAMES)
def test_every_formula_is_mathematics(name, text_of):
    """As another program reads it."""
    parser = MathTextParser("path")
    found = formulas(text_of(network_of(name)))
    assert len(found) > len(network_of(name).cell.neurons)
    for formula in found:
        parser.parse(f"${formula}$")


def test_an_equation_says_what_a_neuron_adds_up(text_of):
    text = text_of(network_of("pendulum"))
    assert r"\frac{d {\theta}_{k}}{ds} &= -{m}^{{\theta}}_{k} - 0.196253\,p_{1,k} - {b}" in text
    assert r"p_{1,k} &= {m}^{{\omega}}_{k}\,\cos({\mathrm{value}}^{{\theta}}_{k}) \\" in text
    assert r"{t}^{{\theta}}_{k}}{ds} &= {m}^{{\theta}}_{k} + {b}^{{\theta}}_{k+1} \\" in text
    assert r"{t}^{{\theta}}_{39}$ & $= {{q}_{d}}^{{\theta}}_{39}$" in text


@pytest.mark.parametrize("name", ["car", "rows", "minimax"])
def test_the_table_has_every_weight(name, text_of):
    table = re.findall(r"^(\d+) & .* & \$(.*)\$ \\\\$", text_of(network_of(name)), re.MULTILINE)
    wires = network_of(name).cell.connections
    assert [int(place) for place, _ in table] == list(range(1, len(wires) + 1))
    for (_, said), wire in zip(table, wires):
        ends = [value(part) for part in said.split(r" \dots ")]
        np.testing.assert_allclose(ends[0], np.min(wire.weight), rtol=1e-5)
        np.testing.assert_allclose(ends[-1], np.max(wire.weight), rtol=1e-5)


def value(text: str) -> float:
    return float(re.sub(r" \\cdot 10\^\{(.*)\}", r"e\1", text))


def test_a_loaded_network_has_the_same_equations(network, vector, tmp_path):
    save(network, tmp_path / "network.npz")
    assert latex_files(load(tmp_path / "network.npz"), vector) == latex_files(network, vector)


def test_a_preconditioner_is_told(text_of, network):
    assert "couples them" not in text_of(network)
    kinds = [ann_dc.PreconditionerKind.MULTILEVEL]
    pyramid = ann_dc.design(ann_dc.plants.double_integrator(N=5), preconditioner=kinds).network
    assert "The multilevel preconditioner couples them along the array" in text_of(pyramid)


def hostile() -> Network:
    """Names with everything that LaTeX reads as something else."""
    names = (r"\input{x}", "50%&#~^$ {", "ω_t", "日本", "a@b")
    neurons = tuple(Neuron(name=f"x.{name}") for name in names)
    wires = tuple(Connection(source=n.name, target=n.name, weight=-1e-9) for n in neurons)
    return Network(cell=Cell(neurons=neurons, connections=wires), stages=2, title="100% \\end{x}")


def test_names_stand_for_themselves(vector):
    vector = dataclasses.replace(vector, start=np.zeros((5, 2)))
    files = latex_files(hostile(), vector)
    text = files["equations.tex"].decode("ascii")
    assert re.findall(r"\\(?:input|end\{x)", text) == []
    assert r"\omega" in text
    parser = MathTextParser("path")
    for formula in formulas(text):
        parser.parse(f"${formula}$")


def test_signs_of_micro_and_ohm_are_greek(vector):
    network = dataclasses.replace(hostile(), title="\N{MICRO SIGN}\N{OHM SIGN}")
    vector = dataclasses.replace(vector, start=np.zeros((5, 2)))
    assert rb"\mathrm{\mu \Omega }" in latex_files(network, vector)["equations.tex"]


def test_every_neuron_has_an_equation_and_the_document_its_hashes(files, vector):
    text = files["equations.tex"].decode("ascii")
    assert len(re.findall(r"^\\tau\\,\\frac", text, re.MULTILINE)) == 9
    assert text.startswith(f"% wiring: {vector.wiring}\n% content: {vector.content}\n")


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no pdflatex here")
@pytest.mark.parametrize("name", ["car", "minimax"])
def test_it_compiles(name, vector, tmp_path):
    (tmp_path / "equations.tex").write_bytes(latex_files(network_of(name), vector)["equations.tex"])
    command = ["pdflatex", "-halt-on-error", "-no-shell-escape", "equations.tex"]
    assert subprocess.run(command, cwd=tmp_path, capture_output=True, timeout=60).returncode == 0
