"""Decks for LTspice and Xyce: part by part, and run in ngspice's modes for their dialects."""

import csv
import io
import re
import subprocess

import numpy as np
import pytest
from simulator import needs_ngspice

import ann_dc
from ann_dc.errors import ExportError
from ann_dc.export.netlists.dialects import ltspice_files, xyce_files
from ann_dc.export.netlists.pack import pack_files
from ann_dc.export.reference.vector import reference_vector

BOTH = pytest.mark.parametrize("files_of", [ltspice_files, xyce_files])


def measured(files, mode, folder):
    """Volts of the controls that a run measured, and those that were expected."""
    for name, content in files.items():
        (folder / name).write_bytes(content)
    (folder / ".spiceinit").write_text(f"set ngbehavior={mode}\n")
    ran = subprocess.run(
        ["ngspice", "-b", "deck.cir"], cwd=folder, capture_output=True, text=True, timeout=300
    )
    found = dict(re.findall(r"^end_(\w+)\s*=\s*(\S+)", ran.stdout, re.MULTILINE))
    rows = csv.DictReader(io.StringIO(files["expected_controls.csv"].decode()))
    expected = {row["node"]: float(row["volts"]) for row in rows}
    assert set(found) == set(expected), ran.stdout[-500:] + ran.stderr[-500:]
    return np.array([float(found[n]) for n in expected]), np.array([*expected.values()])


@pytest.mark.sampled(1)
@needs_ngspice
@pytest.mark.parametrize("level", ["behavioural", "macro"])
def test_the_ltspice_deck_runs_in_ngspices_ltspice_mode(level, car, tmp_path):
    found, expected = measured(ltspice_files(*car, level=level), "lta", tmp_path)
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())


@needs_ngspice
def test_the_xyce_deck_runs_in_ngspices_pspice_mode(car, tmp_path):
    """Whose expressions, switches and parameters are those of Xyce."""
    found, expected = measured(xyce_files(*car, level="macro"), "psa", tmp_path)
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())


@BOTH
@pytest.mark.parametrize("level", ["behavioural", "macro", "transistor", "ota-c"])
def test_the_parts_are_those_of_the_pack(files_of, level, small):
    files = files_of(*small, level=level)
    mine, theirs = (
        sorted(row.split(",", 3)[3] for row in text["parts.csv"].decode().splitlines()[1:])
        for text in (files, pack_files(*small, level=level))
    )
    assert mine == theirs


def cards(files):
    text = re.sub(r"\n\+ *", " ", files["deck.cir"].decode())
    return [line for line in text.splitlines() if line and not line.startswith("*")]


@pytest.mark.sampled(1)
@BOTH
def test_decks_of_coarse_neurons(files_of):
    """Their comments are long, and stay in one line: what continues a comment were a card's."""
    problem = ann_dc.plants.double_integrator(N=3)
    network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.MULTILEVEL).network
    files = files_of(network, reference_vector(network))
    deck = files["deck.cir"].decode()
    assert max(len(line) for line in deck.splitlines() if line.startswith("*")) > 100
    assert not re.search(r"^\*.*\n\+", deck, re.MULTILINE)


XYCE = {
    ".param": r"\.param \w+=\{.*\}",
    ".model": r"\.model \w+ (vswitch\(von=2\.6 voff=2\.4 |d\(|[np]mos\(|npn\().*\)",
    "b": r"B\w+ \S+ \S+ [VI]=\{[^{}]*\}",
    "x": r"X\w+( [^\s=:]+)+( params:( \w+=(\{[^{}]*\}|\S+))+)?",
    "d": r"D\w+ \S+ \S+ \w+",
    "s": r"S\w+( \S+){4} \w+ on",
    "r": r"R\w+ \S+ \S+ \S+",
    "c": r"C\w+ \S+ \S+ \S+",
}
"""What Xyce's manual asks of a card, by its letter or first word."""


def test_the_grammar_of_xyce(car):
    allowed = (".subckt", ".ends", ".options", ".tran", ".print", ".measure", ".global", ".end")
    for level in ("behavioural", "macro", "ota-c"):
        for card in cards(xyce_files(*car, level=level)):
            kind = card.split()[0] if card.startswith(".") else card[0].lower()
            if kind in XYCE:
                assert re.fullmatch(XYCE[kind], card, re.IGNORECASE), card
            else:
                assert kind in allowed or kind in "viegmq", card


def test_the_grammar_of_ltspice(car):
    allowed = (".param", ".model", ".subckt", ".ends", ".options", ".tran", ".save", ".meas",
               ".global", ".end")  # fmt: skip
    for level in ("behavioural", "macro", "ota-c"):
        for card in cards(ltspice_files(*car, level=level)):
            assert not card.startswith(".") or card.split()[0] in allowed
            assert not re.search(r"(?<![\w.])e(?=[=)}*])", card), card


@BOTH
def test_what_is_said_of_them(files_of, small):
    said = files_of(*small)["README.md"].decode()
    name = "LTspice" if files_of is ltspice_files else "Xyce"
    assert f"has not been\nrun in {name}" in said
    assert said.count("\n| ") >= 5


def test_switched_capacitors_are_refused_for_xyce(small):
    assert ltspice_files(*small, level="switched-capacitor")
    with pytest.raises(ExportError, match="switches need a hard threshold"):
        xyce_files(*small, level="switched-capacitor")


@BOTH
def test_a_foundrys_transistors_are_refused(files_of, small):
    with pytest.raises(ExportError, match="level sky130: its models are written for ngspice"):
        files_of(*small, level="sky130")
