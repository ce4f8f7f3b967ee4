"""Circuits that netlists are written from: made once, refused by name."""

import re
import subprocess
import warnings
from dataclasses import replace

import constrained
import numpy as np
import pytest
from simulator import needs_ngspice
from small_pdk import needs_pdk

import ann_dc
from ann_dc.errors import ExportError, NetworkError
from ann_dc.export.exporting import export_network
from ann_dc.export.index import read_index
from ann_dc.export.netlists.dialects import ltspice_files, xyce_files
from ann_dc.export.netlists.kicad import kicad_files
from ann_dc.export.netlists.pack import pack_files
from ann_dc.export.netlists.verilog_a import verilog_a_files
from ann_dc.export.reference.contents import stated
from ann_dc.export.reference.vector import reference_vector
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.parts.level_words import level_words


def test_formats_share_a_circuit(small, monkeypatch):
    """The probe run, which takes longest, is not repeated."""
    network, vector = small
    pack_files(network, vector, level="macro")

    def fail(*_):
        raise AssertionError("built again")

    monkeypatch.setattr(ann_dc.SpiceBackend, "prepare", fail)
    assert ltspice_files(network, vector, level="MACRO")


def test_a_level_object_builds_its_parts_under_its_name(small, tmp_path):
    network, vector = small
    own = replace(ann_dc.levels.macro(a0=2e5, output_swing=4.0), name="my parts", full_scale=2.0)
    for write in (pack_files, ltspice_files, xyce_files, kicad_files):
        files = write(network, vector, level=own)
        assert "my parts" in files["README.md"].decode()
    deck = pack_files(network, vector, level=own)["deck.cir"].decode()
    assert "opamp_a0=200000" in deck
    [done] = export_network(network, "pack", tmp_path, level=own)
    assert read_index(done.folder).settings == {"level": "my parts"}
    clocked = ann_dc.levels.switched_capacitor(step=1e-3)
    with pytest.raises(ExportError, match="level wrong: its switches"):
        xyce_files(network, vector, level=replace(clocked, name="wrong"))


@pytest.mark.slow
def test_every_word_names_a_level(small):
    words = level_words()
    assert {"behavioural", "macro", "transistor", "tl072_ad633"} < set(words)
    for word in words.keys() - {"sky130"}:
        assert b"level" in pack_files(*small, level=word)["deck.cir"].splitlines()[0]


@needs_pdk
def test_a_deck_of_a_foundrys_transistors_holds_their_models(small):
    text = pack_files(*small, level="sky130")["deck.cir"].decode()
    assert "Apache License" in text
    assert ".options scale=1u" in text
    assert ".model sky130_fd_pr__nfet_g5v0d10v5__model" in text


@pytest.mark.slow
def test_netlists_with_rows_for_rails_are_of_the_network_with_rails():
    """A tree hands the currents of rails on, so that rows stand in their place in the circuit."""
    problem = constrained.integrator(N=4, dt=0.5, bounds={"a": (-1.1, 1.1)})
    network = ann_dc.design(
        problem, preconditioner=ann_dc.PreconditionerKind.CYCLIC_REDUCTION
    ).network
    vector = reference_vector(network)
    for make in (pack_files, kicad_files):
        files = make(network, vector)
        assert any(b"zeta_high_u_a" in content for content in files.values())
        assert any(f"content {vector.content}".encode() in content for content in files.values())


@pytest.fixture(scope="module")
def pyramid():
    problem = ann_dc.plants.double_integrator(N=6)
    network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.MULTILEVEL).network
    assert network.preconditioner.kind is ann_dc.PreconditionerKind.MULTILEVEL
    return network, reference_vector(network)


@pytest.mark.slow
@needs_ngspice
def test_a_pyramid_settles_with_the_margin_that_suits_it(pyramid, tmp_path):
    files = pack_files(*pyramid, level="macro")
    (tmp_path / "library").mkdir()
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    command = ["ngspice", "-n", "-b", "deck.cir"]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert float(re.search(r"controls settled: off by (\S+)", ran.stdout)[1]) < 1e-3


@pytest.mark.slow
def test_a_preconditioner_that_no_margin_makes_stable_is_refused(pyramid, monkeypatch):
    monkeypatch.setattr("ann_dc.export.netlists.build.fitting_margin", lambda *_: np.inf)
    monkeypatch.setattr("ann_dc.hardware.sizing.bandwidth_margin.least_margin", lambda *_: np.inf)
    meant = "no margin is sufficient; use op amps with less capacitance, or design the network with"
    with pytest.raises(ExportError, match=meant):
        pack_files(*pyramid, level="ad8065_ad835")


@pytest.mark.slow
def test_a_circuit_that_oscillates_is_refused(pyramid, monkeypatch):
    """What the backend says of it is kept, with the level before it."""

    def oscillates(*_):
        raise NetworkError("circuit: the pole model is unstable")

    monkeypatch.setattr(ann_dc.SpiceBackend, "check_stable", oscillates)
    with pytest.raises(ExportError, match="level macro: circuit: the pole model is unstable"):
        pack_files(*pyramid, level="macro", series="E12")


@pytest.mark.slow
def test_a_circuit_that_gets_lost_on_its_way_is_told():
    """Stable where it should settle; on the way there a steering angle runs past tan's domain."""
    problem = ann_dc.plants.car(N=30)
    network = ann_dc.design(problem, gain_rule=ann_dc.DIAGONAL_RULE).network
    vector = reference_vector(network)
    assert ann_dc.OdeBackend().run(network).status.settled
    with pytest.warns(
        UserWarning, match="may settle at another equilibrium: .* its transient .*MULTILEVEL"
    ):
        files = pack_files(network, vector, level="macro")
    assert b"WARNING: it may settle at another equilibrium" in files["README.md"]


@pytest.mark.slow
def test_a_circuit_that_would_ring_gets_the_margin_that_it_asks_for():
    problem = ann_dc.plants.bicycle(N=16)
    network = ann_dc.design(problem, gain_rule=ann_dc.DIAGONAL_RULE).network
    backend = ann_dc.SpiceBackend(level=ann_dc.levels.macro())
    circuit, probe = backend.prepare(network)
    assert not predict(circuit, backend.level, probe).stable
    with pytest.warns(UserWarning, match="may settle at another equilibrium"):
        assert pack_files(network, reference_vector(network), level="macro")


def test_a_circuit_that_gets_there_is_not_doubted(small):
    assert b"WARNING" not in pack_files(*small, level="macro")["README.md"]


@pytest.fixture(scope="module")
def integrator():
    problem = ann_dc.plants.double_integrator()
    network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    return network, reference_vector(network)


def predicted(words):
    return float(re.search(r"predicted to be off by (\S+) of the largest", words)[1])


@needs_ngspice
def test_series_is_predicted_warned_of_and_confirmed_by_ngspice(integrator, tmp_path):
    """Of resistors that can be bought: 1.5 % off, and within 1e-4 with pairs."""
    meant = r"1\.5% of the largest control off, above 1%, because of the series .* series=E96-pairs"
    with pytest.warns(UserWarning, match=meant):
        files = pack_files(*integrator, series="E96")
    words = stated(files)
    assert "NOT within 1%" in words
    (tmp_path / "library").mkdir()
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    command = ["ngspice", "-n", "-b", "deck.cir"]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    measured = float(re.search(r"NOT where .*: off by (\S+) of", ran.stdout)[1])
    assert predicted(words) == pytest.approx(measured, rel=0.02)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert predicted(stated(pack_files(*integrator, series="E96-pairs"))) < 1e-4


@pytest.mark.sampled(3)
@pytest.mark.parametrize("files", [ltspice_files, xyce_files, kicad_files, verilog_a_files])
@pytest.mark.filterwarnings("ignore:level:UserWarning")
def test_every_netlist_carries_the_accuracy_of_its_series(integrator, files):
    made = files(*integrator, series="E96")
    assert predicted(stated(made)) == pytest.approx(0.0152, rel=0.02)
    assert b"WARNING: its controls are predicted to be" in made["README.md"]


def test_parts_without_a_maker_are_told_first(small):
    files = pack_files(*small, level="opa192_ad734")
    reported = "o part to buy for: analog switch (21), preset (21), voltage source (5)"
    assert files["README.md"].decode().splitlines()[2] == f"N{reported}."
    assert stated(files).startswith(f"N{reported}. A circuit whose controls are predicted")
    assert f"N{reported}." in stated(kicad_files(*small, level="opa192_ad734"))
    assert "part to buy" not in stated(pack_files(*small, level="macro"))


def test_parts_that_settle_at_their_rails_are_doubted(small, monkeypatch):
    for module in ("export.netlists.build", "fidelity.prediction"):
        name = f"ann_dc.{module}.clipped_at"
        monkeypatch.setattr(name, lambda emulation, x: np.arange(len(x)) == 0)
    with pytest.warns(UserWarning, match="parts of the settled circuit are at their output limits"):
        files = pack_files(*small, level="macro", series="E24-pairs")
    assert b"WARNING: parts of the settled circuit" in files["README.md"]


@needs_ngspice
def test_a_deck_says_when_it_is_not_where_it_should_be(small, tmp_path):
    """It ends elsewhere when its target is another."""
    files = pack_files(*small, level="behavioural")
    deck, changed = re.subn(
        r"(?m)^(V_src__t_x__2\S* \S+ 0) .*$", r"\1 -0.5", files["deck.cir"].decode()
    )
    assert changed == 1
    (tmp_path / "library").mkdir()
    for name, content in (files | {"deck.cir": deck.encode()}).items():
        (tmp_path / name).write_bytes(content)
    command = ["ngspice", "-n", "-b", "deck.cir"]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "NOT where the ideal network settles: off by" in ran.stdout
    assert ran.returncode == 1
