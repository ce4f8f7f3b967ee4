"""``ann-dc run``: networks wired by hand, in the ODE and in ngspice, and their export."""

import math

import numpy as np
import pytest
from command_line import printed_json, refused, run, strict
from designs import designed
from simulator import needs_ngspice

import ann_dc
from ann_dc.network import Cell, Connection, Network, Neuron, Product

PERIOD = 7.0  # of van der Pol with mu = 1.5, roughly


def wire(source, target, weight=1.0):
    return Connection(source=source, target=target, weight=weight)


@pytest.fixture
def van_der_pol(tmp_path):
    """x'' = mu (1 - x^2) x' - x, in a weight file."""
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="y")),
        blocks=(Product(name="xx", a="x", b="x"), Product(name="xxy", a="xx", b="y")),
        connections=(
            *(wire("y", "x"), wire("x", "y", -1)),
            *(wire("y", "y", 1.5), wire("xxy", "y", -1.5)),
        ),
    )
    network = Network(cell=cell, stages=1, start={"x": 0.1}, title="van der Pol")
    ann_dc.save(network, tmp_path / "van_der_pol.npz")
    return tmp_path / "van_der_pol.npz"


@pytest.fixture
def leak(tmp_path):
    """x' = load - x in 20 cells, in a weight file."""
    cell = Cell(
        neurons=(Neuron(name="x"),),
        inputs=("load",),
        connections=(wire("x", "x", -1), wire("load", "x")),
    )
    ann_dc.save(Network(cell=cell, stages=20, inputs={"load": 0.5}), tmp_path / "leak.safetensors")
    return tmp_path / "leak.safetensors"


@pytest.mark.parametrize(
    "level", [None, pytest.param("macro", marks=[needs_ngspice])], ids=["ode", "circuit"]
)
def test_oscillator_runs_for_its_duration_and_writes_files(tmp_path, van_der_pol, level):
    curves, result = tmp_path / "a.npz", tmp_path / "a.json"
    files = ["--figures", tmp_path, "--trajectory", curves, "--json", result]
    words = ["--duration", 4 * PERIOD, *files]
    code, text = run("run", van_der_pol, *words, *(["--level", level] if level else []))
    assert code == 0, text
    assert "completed" in text
    assert text.count("wrote ") == 3
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")
    found = strict(result)
    assert found["outcome"] == "completed"
    assert found["settling_time"] is None
    assert found["time"] == pytest.approx(4 * PERIOD, rel=1e-6)
    assert found["neurons"]["x[0]"]["largest"] == pytest.approx(2.0, abs=0.03)  # limit cycle
    seconds = found["seconds_per_unit"] if level else 1.0
    with np.load(curves) as table:
        assert table["time"][-1] == pytest.approx(4 * PERIOD * seconds, rel=1e-6)
        assert table["x"][-1, 0] == pytest.approx(found["neurons"]["x[0]"]["end"])
    if level:
        assert "against the ODE" in text
        assert math.sqrt(found["mean_square_error"]) < 1e-3


def test_oscillator_without_duration_is_told_to_give_one(van_der_pol):
    code, text = run("run", van_der_pol)
    assert code == 1
    assert "add --duration T" in text
    refused(["run", van_der_pol, "--level", "macro"], "--duration T")
    refused(["export", van_der_pol, "--to", "pack"], "--duration T")
    words = ["--duration", 1, "--level", "switched-capacitor"]
    refused(["run", van_der_pol, *words], "but a mode of this network is unstable there; use macro")


def test_oscillator_is_exported_for_a_duration(tmp_path, van_der_pol):
    words = ["export", van_der_pol, "--to", "pack", "--duration", 20, "--output", tmp_path / "out"]
    assert run(*words)[0] == 0
    assert (tmp_path / "out" / "pack" / "export.json").is_file()


def test_settled_network_reports_settling_time_and_end_values(tmp_path, leak):
    result = tmp_path / "a.json"
    code, text = run("run", leak, "--input", "load=0.25", "--json", result, "--method", "RK45")
    assert code == 0
    assert "ODE, RK45" in text
    assert "20 in 20 cells; 4 are not listed" in text
    assert "x[15] 0.25" in text
    assert "x[16]" not in text
    found = strict(result)
    assert found["outcome"] == "settled"
    assert 5 < found["settling_time"] < 30
    assert found["neurons"]["x[19]"]["end"] == pytest.approx(0.25, rel=1e-6)
    values = ",".join(str(k / 20) for k in range(20))
    assert run("run", leak, "--input", f"load={values}", "--json", result, "--quiet") == (0, "")
    assert strict(result)["neurons"]["x[19]"]["end"] == pytest.approx(0.95, rel=1e-6)


@needs_ngspice
def test_settled_network_runs_as_a_circuit(tmp_path, leak):
    result = tmp_path / "a.json"
    words = ["--bandwidth-margin", 1000, "--figures", tmp_path, "--json", result]
    code, text = run("run", leak, "--level", "MACRO", *words)
    assert code == 0, text
    assert "controls within 0.1 % after" in text
    found = strict(result)
    assert found["control_error"] < 1e-3
    decay = math.log(1e3) * found["seconds_per_unit"]  # exp(-t) falls to 0.1 %
    assert found["settling_time"] == pytest.approx(decay, rel=0.02)


def test_designed_network_runs_from_a_folder(tmp_path):
    ann_dc.save(designed("double_integrator").network, tmp_path / "a.npz")
    assert run("export", tmp_path / "a.npz", "--output", tmp_path / "out", "--quiet")[0] == 0
    assert run("run", tmp_path / "out" / "weights", "--figures", tmp_path / "new")[0] == 0
    assert (tmp_path / "new" / "run.png").is_file()


BAD = {
    "duration": (["--duration", "-1"], "--duration: expected a positive"),
    "method": (["--method", "Euler"], "--method 'Euler' does not exist; choose one of: "),
    "level": (["--level", "wood"], "--level 'wood' does not exist"),
    "method of a circuit": (["--level", "macro", "--method", "RK45"], "applies to the ODE"),
    "gbw of the ODE": (["--gbw", "1e6"], "--gbw: applies to a circuit; add --level macro"),
    "margin": (["--bandwidth-margin", "0", "--level", "macro"], "bandwidth_margin"),
    "input": (["--input", "force=1"], "'force' does not exist"),
    "count": (["--input", "load=1,2"], "--input load: expected 1 or 20 numbers, got '1,2'"),
    "number": (["--input", "load=x"], "--input load: expected a finite number, got 'x'"),
    "curves": (["--trajectory", "a.xlsx"], "name that ends in .csv, .npz or .parquet"),
}


@pytest.mark.parametrize(("words", "meaning"), BAD.values(), ids=BAD)
def test_bad_option_is_refused_by_name(leak, words, meaning):
    refused(["run", leak, *words], meaning)


def test_what_is_no_network_names_the_command_to_use(tmp_path, leak):
    refused(["run", "car"], "a plant or a .toml problem use: ann-dc solve car")
    refused(["run", tmp_path / "nix.npz"], "does not exist")
    refused(["circuit", "car", "--duration", "3"], "--duration: belongs to a network in a file")
    refused(["circuit", "car", "--input", "q_0.x=3"], "--input: belongs to a network in a file")


def test_an_input_follows_the_column_of_a_file(leak, tmp_path):
    """x' = load - x, with a load that rises by one a unit of time: x lags by one."""
    (tmp_path / "load.csv").write_text("time,force\n0,0.5\n30,30.5\n")
    words = "--input", f"load={tmp_path / 'load.csv'}:force", "--duration", "30"
    code, _ = run(
        "run", leak, *words, "--trajectory", tmp_path / "out.csv", "--json", tmp_path / "a"
    )
    assert code == 0
    end = np.genfromtxt(tmp_path / "out.csv", delimiter=",", names=True)[-1]
    assert end["x0"] == pytest.approx(29.5, abs=1e-4)
    refused(["run", leak, "--input", f"load={tmp_path / 'load.csv'}:mass"], "'mass' does not exist")
    refused(["run", leak, "--input", f"load={tmp_path / 'load.csv'}:force"], "duration")


def test_run_json_dash_prints_only_json(leak):
    code, data = printed_json("run", leak)
    assert (code, data["outcome"]) == (0, "settled")
