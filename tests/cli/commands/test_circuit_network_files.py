"""``ann-dc circuit`` of networks in files: no problem, no optimum."""

import math

import numpy as np
import pytest
from command_line import refused, run, strict
from oscillators import lorenz, reference, van_der_pol, wire
from simulator import needs_ngspice

import ann_dc
from ann_dc.network import Cell, Network, Neuron


@pytest.fixture
def damped(tmp_path):
    """x' = v, v' = load - x - v, in a weight file."""
    wires = wire("v", "x"), wire("x", "v", -1.0), wire("v", "v", -1.0), wire("load", "v")
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="v")), inputs=("load",), connections=wires)
    network = Network(cell=cell, stages=1, inputs={"load": 0.5}, start={"x": 0.8}, title="damped")
    ann_dc.save(network, tmp_path / "damped.npz")
    return tmp_path / "damped.npz"


@pytest.fixture
def oscillator(tmp_path):
    ann_dc.save(van_der_pol(), tmp_path / "oscillator.npz")
    return tmp_path / "oscillator.npz"


@needs_ngspice
def test_settling_network_is_compared_with_its_ode_and_its_prediction(tmp_path, damped):
    curves, result = tmp_path / "a.csv", tmp_path / "a.json"
    words = [
        "--figures",
        tmp_path,
        "--trajectory",
        curves,
        "--json",
        result,
        "--input",
        "load=0.25",
    ]
    code, text = run("circuit", damped, *words)
    assert code == 0, text
    for row in (
        "within 1 % of the settled states",
        "state error",
        "1 V =",
        "x: ",
        "noise",
        "x[0] ",
    ):
        assert row in text
    for word in ("optimum", "objective", "KKT", "problem"):
        assert word not in text
    assert (tmp_path / "circuit.png").read_bytes().startswith(b"\x89PNG")
    found = strict(result)
    assert found["network"] == "damped"
    assert found["settled"] is True
    assert found["control_error"] < 1e-5
    assert found["final_difference"] < 1e-7
    assert found["settling_time"] == pytest.approx(found["predicted"]["settling_time"], rel=0.02)
    assert 0 < found["noise"] < 1e-3
    assert {"objective", "kkt_residual", "problem"}.isdisjoint(found)
    end = np.genfromtxt(curves, delimiter=",", names=True)[-1]
    assert end["x0"] == pytest.approx(0.25, rel=1e-5)


@needs_ngspice
def test_oscillator_runs_for_its_duration_beside_its_emulation(tmp_path, oscillator):
    result = tmp_path / "a.json"
    words = ["--duration", 30, "--figures", tmp_path, "--json", result]
    code, text = run("circuit", oscillator, *words)
    assert code == 0, text
    assert "completed" in text
    assert "within 1 % of the settled" not in text
    found = strict(result)
    exact = reference(van_der_pol(), 30.0)
    largest = np.abs(exact(np.linspace(0, 30, 3001))).max()
    assert found["outcome"] == "completed"
    for each in ("measured", "predicted"):
        assert found[each]["final_error"] < 5e-3
        assert found[each]["follows_until"] is None  # never off by 1 %
    assert found["final_difference"] < 5e-3
    assert found["noise"] is None
    assert largest * 0.99 < found["volt"]["y"]["factor"]  # nothing exceeds 1 V


@pytest.mark.slow
@needs_ngspice
def test_chaos_leaves_the_ode_at_a_reported_time(tmp_path):
    ann_dc.save(lorenz(), tmp_path / "lorenz.npz")
    words = ["--duration", 20, "--level", "opa192_ad734", "--json", tmp_path / "a.json"]
    code, text = run("circuit", tmp_path / "lorenz.npz", *words)
    assert code == 0, text
    found = strict(tmp_path / "a.json")
    measured, predicted = (found[each]["follows_until"] for each in ("measured", "predicted"))
    assert 1 < measured < 20
    assert predicted == pytest.approx(measured, rel=0.2)
    assert found["measured"]["final_error"] > 0.01


@needs_ngspice
def test_inputs_over_time_have_no_prediction(tmp_path, damped):
    """An input that rises by one a unit of time: x lags by one."""
    (tmp_path / "load.csv").write_text("time,force\n0,0.5\n30,30.5\n")
    load = ["--input", f"load={tmp_path / 'load.csv'}:force"]
    files = ["--json", tmp_path / "a.json", "--trajectory", tmp_path / "a.csv"]
    code, text = run("circuit", damped, *load, "--duration", 30, *files)
    assert code == 0, text
    assert "not available: inputs load change over time" in text
    end = np.genfromtxt(tmp_path / "a.csv", delimiter=",", names=True)[-1]
    assert end["x0"] == pytest.approx(29.5, abs=1e-3)
    found = strict(tmp_path / "a.json")
    assert found["predicted"] is None
    assert math.sqrt(found["measured"]["mean_square_error"]) < 1e-3
    refused(["circuit", damped, *load], "set the duration of the run")


def test_network_is_predicted_without_ngspice(damped, oscillator):
    code, text = run("circuit", damped, "--no-simulate", "--error-budget", 2, "--samples", 3)
    assert code == 0, text
    assert "within 1 % of the settled states (predicted, nominal parts" in text
    code, text = run("circuit", oscillator, "--no-simulate", "--duration", 5)
    assert code == 0, text
    assert "not simulated" in text
    assert "against the ODE" in text


def test_bad_options_of_a_network_are_refused_by_name(damped, oscillator):
    refused(["circuit", oscillator], "duration=T or --duration T")
    refused(["circuit", oscillator, "--duration", 0], "--duration: expected a positive")
    refused(["circuit", damped, "-N", 3], "a stored network cannot be changed")
    refused(["circuit", damped, "--preconditioner", "diagonal"], "omit --set")
    refused(["circuit", damped, "--input", "force=1"], "'force' does not exist")
    refused(["circuit", damped, "--corners", "--duration", 3], "--duration: corners, yields")
    words = ["circuit", oscillator, "--duration", 3, "--no-simulate"]
    for name in ("error-budget", "samples", "loops"):
        refused([*words, f"--{name}", 2], f"(--{name}), got one that does not")


def test_yield_of_a_network_in_a_file(damped, tmp_path):
    words = ["--yield", "error<20%", "--samples", 5, "--json", tmp_path / "a.json"]
    assert run("circuit", damped, *words)[0] == 0
    assert strict(tmp_path / "a.json")["network"] == "damped"
