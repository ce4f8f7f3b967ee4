"""The emulation of OTA-C circuits: curvature, leak, pairs, and ngspice beside it."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, strategies as st
from problems import SUITE
from simulator import needs_ngspice

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.errors import NetworkError
from ann_dc.fidelity.error_budget import sensitivity
from ann_dc.fidelity.prediction import predict
from ann_dc.gain_design.gains import apply_gains
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.parts.levels import macro, ota_c, switched_capacitor
from ann_dc.hardware.parts.technologies import paired
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.solver import synthesize


@cache
def network(name: str):
    """Frozen with the smallest ratio, where every mode has died out when it is said to settle."""
    found = design(synthesize(SUITE[name].problem), preconditioner=(PreconditionerKind.DIAGONAL,))
    best = min(found.candidates, key=lambda candidate: candidate.ratio)
    return apply_gains(found.network, best.gains)


@cache
def prepared(name: str):
    return SpiceBackend(level=ota_c()).prepare(network(name))


def error(name: str, linear_range: float, a0: float = np.inf, off=None) -> float:
    """Of the settled controls, over the largest one."""
    circuit, probe = prepared(name)
    level = ota_c(linear_range=linear_range, a0=a0)
    return predict(circuit, level, probe, off or {}).control_error


# ---- pairs ---------------------------------------------------------------------------------------

conductances = st.lists(
    st.floats(0.01, 10.0).flatmap(lambda g: st.sampled_from([g, -g])), min_size=1, max_size=6
)


@given(conductances)
def test_pairs_bring_to_a_node_what_single_transconductors_would(given_weights):
    weights = [(str(j), j, g) for j, g in enumerate(given_weights)]
    values = np.arange(1.0, len(weights) + 1)
    linear = sum(
        g * (values[nodes[0]] - (values[nodes[1]] if len(nodes) == 2 else 0.0))
        for _, nodes, g in paired(weights)
    )
    assert linear == pytest.approx(np.dot(given_weights, values), abs=1e-9)


def test_equal_and_opposite_weights_share_one_pair():
    assert list(paired([("a", 1, 2.0), ("b", 2, -2.0)])) == [("b", (1, 2), 2.0)]
    assert list(paired([("a", 1, -2.0), ("b", 2, 2.0)])) == [("b", (2, 1), 2.0)]
    assert list(paired([("a", 1, 2.0), ("b", 2, 2.0)])) == [("a", (1,), 2.0), ("b", (2,), 2.0)]


# ---- the circuit ---------------------------------------------------------------------------------


@pytest.mark.slow
def test_transconductors_without_curvature_or_leak_settle_at_the_optimum():
    assert error("car", 1e5) < 1e-7  # where the probe run ended


def test_curvature_costs_the_square_and_leak_the_first_power():
    """tanh v = v - v^3/3: a share of full scale over the linear range, squared."""
    assert error("car", 100.0) / error("car", 200.0) == pytest.approx(4, rel=0.02)
    assert error("car", 1e5, 1e5) / error("car", 1e5, 1e6) == pytest.approx(10, rel=0.02)


@pytest.mark.sampled(1)
@needs_ngspice
@pytest.mark.parametrize(
    "name", ["car", "double_integrator", pytest.param("van_der_pol", marks=pytest.mark.slow)]
)
def test_ngspice_does_what_the_emulation_says(name):
    level = ota_c(linear_range=10.0, a0=1e5)
    run = SpiceBackend(level=level).run(network(name))
    meaning = predict(run.circuit, level, run.probe)
    assert run.control_error == pytest.approx(meaning.control_error, rel=0.03)
    assert run.settling_time() == pytest.approx(meaning.settling_time, rel=0.03)


@needs_ngspice
def test_weights_that_are_off_move_both_alike():
    circuit, probe = prepared("double_integrator")
    off = {"r_m_x_0": 0.02, "c_q_x": 0.1, "r_u_a_0": -0.03}
    level = ota_c(linear_range=20.0)
    meaning = predict(circuit, level, probe, off)
    run = simulate(SpiceBackend(level=level), circuit, probe, off)
    assert run.control_error == pytest.approx(meaning.control_error, rel=0.02)
    assert run.settling_time() == pytest.approx(meaning.settling_time, rel=0.03)


def test_what_is_not_known_is_refused():
    circuit, _ = prepared("double_integrator")
    emulation = emulate(circuit, ota_c())
    x = equilibrium(emulation.network, emulation.network.start_state)
    with pytest.raises(NetworkError, match="op amps with resistors"):
        sensitivity(emulation, x)
    coordinated = design(
        synthesize(SUITE["double_integrator"].problem),
        preconditioner=PreconditionerKind.MULTILEVEL,
    ).network
    coupled, _ = SpiceBackend(level=macro(differential=True)).prepare(coordinated)
    with pytest.raises(NetworkError, match="cannot build a multilevel"):
        emulate(coupled, ota_c())
    with pytest.raises(NetworkError, match="not a network in continuous time"):
        emulate(circuit, switched_capacitor(step=0.1))
