"""Yield: drawn circuits within a spec, and ngspice beside the emulation."""

from dataclasses import replace

import numpy as np
import pytest
from simulator import needs_ngspice

from ann_dc import PreconditionerKind, SpiceBackend, design, plants
from ann_dc.analysis.spectra import stability_limit
from ann_dc.errors import NetworkError
from ann_dc.fidelity.boards.yields import Spec, yield_of
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.circuit_study import predicted_errors
from ann_dc.fidelity.noise_run import control_noise
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.parts.conditions import Conditions
from ann_dc.hardware.parts.datasheet import Tolerances
from ann_dc.hardware.parts.e_series import E12
from ann_dc.hardware.parts.levels import BEHAVIOURAL, TRANSISTOR, macro, switched_capacitor
from ann_dc.study.yield_metrics import Yield

SAMPLES = 8


@pytest.fixture(scope="module")
def backend():
    return SpiceBackend(level=macro())


@pytest.fixture(scope="module")
def built(backend):
    network = design(
        plants.double_integrator(N=3), preconditioner=PreconditionerKind.DIAGONAL
    ).network
    return backend.prepare(network)


def test_the_share_within_is_that_of_predicted_errors(backend, built):
    errors = predicted_errors(built[0], backend.level, built[1], range(SAMPLES))
    noise = control_noise(CircuitInstance(circuit=built[0], level=backend.level, probe=built[1]))
    limit = float(np.hypot(np.sort(errors)[3:5].mean(), noise))
    found = yield_of(backend, *built, Spec(error=limit), samples=SAMPLES)
    assert found.errors == pytest.approx(errors, rel=1e-12)
    assert str(found.found) == str(Yield(passed=4, count=SAMPLES))
    assert found.closest == errors.argmin()


def test_noise_counts_with_every_error(backend, built):
    """At a full scale of 10 uV: no circuit keeps what all of them kept at 1 V."""
    found = []
    for volts in (1.0, 1e-5):
        level = replace(macro(tolerances=Tolerances(resistor=1e-2)), full_scale=volts)
        asked = replace(backend, level=level)
        circuit, probe = asked.prepare(built[0].schematic.network)
        found.append(yield_of(asked, circuit, probe, Spec(error=0.2), samples=2))
    quiet, loud = found
    assert loud.errors == pytest.approx(quiet.errors)
    assert (quiet.noise, loud.noise) < (1e-3, 0.2) < (loud.noise, np.inf)
    assert (quiet.found.passed, loud.found.passed) == (2, 0)


def test_a_settling_time_is_that_of_the_drawn_circuit(backend, built):
    found = yield_of(backend, *built, Spec(settling_time=1e-9), samples=2)
    assert found.found.passed == 0
    off = SpiceBackend(level=backend.level, seed=1).deviations(built[0])
    wanted = predict(built[0], backend.level, built[1], off)
    assert found.settling_times[1] == pytest.approx(wanted.settling_time, rel=1e-9)
    assert found.closest == found.settling_times.argmin()


def test_circuits_that_only_have_to_settle_do(backend, built):
    assert yield_of(backend, *built, Spec(), samples=3).found.passed == 3


def clocked(network, share):
    """A switched-capacitor circuit that takes a share of the largest stable step."""
    level = switched_capacitor(step=share * stability_limit(network, network.start_state), a0=1e6)
    backend = SpiceBackend(level=level)
    return backend, *backend.prepare(network)


@pytest.mark.parametrize(("share", "passed"), [(0.3, 2), (1.5, 0)])
def test_clocked_circuits_are_judged_by_their_recurrence(built, share, passed):
    found = yield_of(*clocked(built[0].schematic.network, share), Spec(error=0.2), samples=2)
    assert found.found.passed == passed


def test_a_settling_time_that_is_not_known_is_not_asked_for(built, backend, monkeypatch):
    spec = Spec(settling_time=1.0)
    with pytest.raises(NetworkError, match=r"yield: the settling time .*: it is not a network"):
        yield_of(*clocked(built[0].schematic.network, 0.3), spec, samples=2)
    monkeypatch.setattr("ann_dc.fidelity.prediction.LARGEST", 10)
    with pytest.raises(NetworkError, match="neurons are more than 10"):
        yield_of(backend, *built, spec, samples=2)


def test_a_settling_time_that_is_not_found_is_told(built, backend, monkeypatch):
    monkeypatch.setattr("ann_dc.fidelity.boards.yields.untimed", lambda instance: "")
    monkeypatch.setattr("ann_dc.fidelity.prediction.LARGEST", 10)
    found = yield_of(backend, *built, Spec(settling_time=1.0), samples=2)
    assert found.found.passed == 0
    assert all("more than 10" in why for why in found.unknown)
    assert np.isfinite(found.errors).all()


@needs_ngspice
def test_ngspice_agrees_with_the_emulation_from_the_best_to_the_worst(backend, built):
    found = yield_of(backend, *built, Spec(error=0.01), samples=SAMPLES, spots=3)
    seeds = [spot.seed for spot in found.spots]
    assert seeds[0] == found.errors.argmin()
    assert seeds[-1] == found.errors.argmax()
    assert all(spot.agreed for spot in found.spots)
    assert all(abs(spot.measured / spot.predicted - 1) < 0.02 for spot in found.spots)


@needs_ngspice
def test_circuits_and_spots_have_resistors_of_the_series(backend, built):
    """Of E12, up to 10 % off: what ngspice runs is as far off as what is emulated."""
    plain = yield_of(backend, *built, Spec(error=0.5), samples=1)
    found = yield_of(replace(backend, series=E12), *built, Spec(error=0.5), samples=1, spots=1)
    assert abs(found.spots[0].measured / found.spots[0].predicted - 1) < 0.02
    assert abs(found.errors[0] - plain.errors[0]) > 0.1 * plain.errors[0]


@needs_ngspice
def test_a_settling_time_that_counts_is_measured_in_fine_steps(backend, built):
    limits = Spec(settling_time=1e-3), Spec(error=0.5)
    fine, coarse = (yield_of(backend, *built, spec, samples=1, spots=1).spots[0] for spec in limits)
    assert fine.measured_time == pytest.approx(fine.predicted_time, rel=2e-3)
    assert np.isnan(coarse.measured_time)  # without a limit on it, no finer steps are taken


@pytest.mark.parametrize(
    ("level", "meaning"),
    [
        (BEHAVIOURAL, "behavioural circuits are not emulated"),
        (TRANSISTOR.at(Conditions(temperature=85.0)), "emulated at room temperature"),
    ],
)
def test_a_level_without_an_emulation_is_refused(built, level, meaning):
    with pytest.raises(NetworkError, match=meaning):
        yield_of(SpiceBackend(level=level), *built, Spec(), samples=2)
