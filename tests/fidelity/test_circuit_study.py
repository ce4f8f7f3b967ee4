"""A study of one circuit: everything is computed once, and says whether the optimum was found."""

from collections import Counter
from dataclasses import replace
from functools import cache
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest
from simulator import needs_ngspice

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.errors import NetworkError
from ann_dc.fidelity import circuit_instance as instance
from ann_dc.fidelity.circuit_study import NEAR, study_circuit
from ann_dc.fidelity.prediction import Reason
from ann_dc.gain_design.gain_rule import DIAGONAL_RULE
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.emulation import states
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.e_series import E96
from ann_dc.hardware.parts.levels import BEHAVIOURAL, macro, ota_c
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.solver import synthesize

SAMPLES = 3


@cache
def network() -> Network:
    return design(synthesize(plants.double_integrator(N=4)), gain_rule=DIAGONAL_RULE).network


@cache
def unsimulated(level=None):
    return study_circuit(network(), SpiceBackend(level=level or macro()), simulated=False)


# ---- once --------------------------------------------------------------------------------------


@pytest.fixture
def counted(monkeypatch):
    """How often a circuit was emulated, solved by Newton's method, and written."""
    counts = Counter()

    def count(module, name):
        function = getattr(module, name)

        def counting(*given, **named):
            counts[name] += 1
            return function(*given, **named)

        monkeypatch.setattr(module, name, counting)

    count(instance, "emulate")
    count(states, "equilibrium")
    count(SpiceBackend, "deck")
    silent = SimpleNamespace(timed=None)  # ngspice does not matter here
    monkeypatch.setattr(SpiceBackend, "measure", lambda *_: silent)
    return counts


@pytest.mark.sampled(2)
@pytest.mark.parametrize("simulated", [True, pytest.param(False, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("given", "more"),
    [({}, 0), ({"seed": 1}, 1), ({"series": E96}, 1)],
    ids=["nominal", "seed", "series"],
)
def test_a_circuit_is_emulated_solved_and_written_once(counted, given, more, simulated):
    """The nominal circuit once, the one with errors once where there are any, each sample once."""
    level = presets.get("opa192_ad734")
    backend = SpiceBackend(level=level, **given)
    found = study_circuit(network(), backend, items=5, samples=SAMPLES, simulated=simulated)
    assert len(found.items) == 5
    assert np.isfinite(found.samples).all()
    assert np.isfinite(found.noise)
    assert found.prediction is not None
    circuits = 1 + more + SAMPLES
    assert counted == {"emulate": circuits, "equilibrium": circuits, "deck": 1}


# ---- why there is no prediction ----------------------------------------------------------------


def test_a_level_without_an_emulation_says_so():
    found = unsimulated(BEHAVIOURAL)
    assert found.prediction is None
    assert found.unpredicted is not None
    assert found.unpredicted.reason is Reason.LEVEL
    assert str(found.unpredicted) == "behavioural circuits are not emulated"
    assert np.isnan(found.noise)


def test_a_circuit_that_is_predicted_has_no_reason():
    found = unsimulated()
    assert found.unpredicted is None
    assert found.prediction is not None
    assert found.prediction.stable


def test_the_noise_of_both_signs_is_not_known():
    assert np.isnan(unsimulated(ota_c()).noise)


# ---- near the optimum --------------------------------------------------------------------------


def test_a_prediction_tells_whether_it_is_near():
    found = unsimulated()
    assert found.prediction is not None
    assert found.within_tolerance
    far = replace(found.prediction, control_error=1.01 * NEAR)
    assert not replace(found, prediction=far).within_tolerance
    heard = replace(found, noise=1.01 * NEAR)
    assert not heard.within_tolerance
    assert "rms noise of the controls 1.0%" in heard.shortcoming
    both = replace(found.prediction, control_error=0.8 * NEAR)  # as rms, 0.8 and 0.7 are above 1
    assert not replace(found, prediction=both, noise=0.7 * NEAR).within_tolerance
    assert replace(found, prediction=both, noise=0.5 * NEAR).within_tolerance
    assert replace(found, prediction=both, noise=float("nan")).within_tolerance
    unknown = replace(found, prediction=None)
    assert unknown.unknown
    assert not unknown.within_tolerance


@needs_ngspice
def test_a_run_tells_before_a_prediction_does():
    found = study_circuit(network(), SpiceBackend(level=macro()))
    assert found.run is not None
    assert found.within_tolerance
    assert found.prediction is not None
    unstable = replace(found.prediction, control_error=1.0)
    assert replace(found, prediction=unstable).within_tolerance
    assert found.deck is found.run.deck


# ---- why there is no demand on a preconditioner's wires ------------------------------------------


def study_of_a_pyramid():
    pyramid = design(
        synthesize(plants.double_integrator(N=4)), preconditioner=PreconditionerKind.MULTILEVEL
    ).network
    return study_circuit(pyramid, SpiceBackend(level=macro()), simulated=False)


def test_a_demand_that_is_told_needs_no_reason():
    found = study_of_a_pyramid()
    assert found.demand is not None
    assert found.undemanded == ""


def test_a_network_of_too_many_neurons_says_so(monkeypatch):
    monkeypatch.setattr("ann_dc.fidelity.circuit_study.DENSE_LIMIT", 10)
    found = study_of_a_pyramid()
    assert found.demand is None
    assert f"{found.circuit.schematic.network.size} neurons, above 10" in found.undemanded


def test_a_point_that_does_not_attract_says_so(monkeypatch):
    def refused(*_):
        raise NetworkError("the settled point is unstable")

    monkeypatch.setattr("ann_dc.fidelity.circuit_study.preconditioner_demand", refused)
    found = study_of_a_pyramid()
    assert (found.demand, found.undemanded) == (None, "the settled point is unstable")


def test_time_constants_have_no_demand_and_need_no_reason(monkeypatch):
    monkeypatch.setattr("ann_dc.fidelity.circuit_study.DENSE_LIMIT", 10)
    found = study_circuit(network(), SpiceBackend(level=macro()), simulated=False)
    assert (found.demand, found.undemanded) == (None, "")


def test_loops_that_take_too_long_cost_nothing_else(monkeypatch):
    module = import_module("ann_dc.fidelity.loop_gains")
    monkeypatch.setattr(module, "LARGEST", 10)
    found = study_circuit(network(), SpiceBackend(level=macro()), loops=1, simulated=False)
    assert found.loops == ()
    assert "neurons, but loop gains are computed up to 10" in found.unlooped
    assert found.prediction is not None
    with pytest.raises(NetworkError, match="ota-c circuits have no op amps"):
        study_circuit(network(), SpiceBackend(level=ota_c()), loops=1, simulated=False)


def test_loops_that_cannot_be_had_are_refused_before_ngspice_runs(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))  # no ngspice there
    with pytest.raises(NetworkError, match="ota-c circuits have no op amps"):
        study_circuit(network(), SpiceBackend(level=ota_c()), loops=1)


def test_a_study_with_a_budget_adds_up_its_kinds_and_is_short_in_print():
    study = study_circuit(network(), SpiceBackend(level=macro()), items=2, simulated=False)
    assert len(study.items) == 2
    assert sum(study.budget_shares.values()) == pytest.approx(1)
    assert len(repr(study)) < 300
