"""The ODE backend: six methods, one answer, and outcomes that are data."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from costates import costates
from designs import designed, slower
from hypothesis import given, settings, strategies as st
from problems import SUITE
from reference import ipopt

import ann_dc.progress
from ann_dc.backends import ode
from ann_dc.backends.ode import METHODS, OdeBackend
from ann_dc.backends.run import Run
from ann_dc.backends.settling import Settling
from ann_dc.backends.status import Outcome
from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import PRINTED, SWITCHES
from ann_dc.errors import UnknownNameError
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.gain_design.gains import apply_gains, manual_gains
from ann_dc.network.cell import Cell, Connection, Function, Neuron, Product
from ann_dc.network.network import COORDINATION, Network
from ann_dc.problem import plants
from ann_dc.problem.initial_guess import InitialGuess, interpolated_guess
from ann_dc.solver import synthesize
from ann_dc.synthesis.row import start_values

QUICK = OdeBackend(verify=False)


@cache
def reference_of(name: str) -> Run:
    return QUICK.run(designed(name).network)


@pytest.fixture(scope="module")
def reference() -> Run:
    return reference_of("car")


@pytest.mark.sampled(5)
@pytest.mark.parametrize("method", METHODS.values(), ids=lambda m: m.name)
@pytest.mark.parametrize("name", ["double_integrator", pytest.param("car", marks=pytest.mark.slow)])
def test_methods_agree(method, name):
    reference = reference_of(name)
    run = replace(QUICK, method=method).run(designed(name).network)
    assert run.status.outcome is Outcome.SETTLED
    np.testing.assert_allclose(run.settling_time, reference.settling_time, rtol=0.02)
    scale = np.abs(reference.trajectory.final).max()
    np.testing.assert_allclose(run.trajectory.final, reference.trajectory.final, atol=1e-6 * scale)


def test_settled_where_ipopt_is(reference):
    problem = plants.car()
    found = ipopt(problem)
    mu, beta = costates(problem, found.q, found.u)
    expected = start_values(
        designed("car").network, InitialGuess(q=found.q, u=found.u, mu=mu, beta=beta)
    )
    scale = np.abs(expected).max()
    np.testing.assert_allclose(reference.trajectory.final, expected, atol=1e-6 * scale)


def test_settling_time_is_read_off_the_residuals(reference):
    trajectory = reference.trajectory
    time, kkt = trajectory.residual_time, trajectory.kkt
    after = time > reference.settling_time
    assert (kkt[after] < 1e-6).all()
    assert kkt[~after][-1] >= 1e-6
    assert kkt[-1] < 0.005 * 1e-6
    assert len(time) == reference.steps + 1
    assert reference.evaluations > reference.steps


def test_trajectory_speaks_the_users_units(reference):
    network = designed("car").network
    trajectory = reference.trajectory
    nu = trajectory["u.nu"]
    assert nu.shape == (len(trajectory.time), 9)
    line = interpolated_guess(plants.car())
    np.testing.assert_allclose(nu[0], line.u[0], rtol=1e-12)
    assert (trajectory["t.x"][:, -1] == 5.0).all()  # pinned to q_d
    assert (trajectory["beta.x"][:, 0] == 0.0).all()  # absent
    np.testing.assert_array_equal(trajectory.states[0], network.start_state)
    with pytest.raises(UnknownNameError, match=r"neuron 'u.speed' does not exist"):
        trajectory["u.speed"]


def test_a_verified_run_says_so():
    run = OdeBackend().run(designed("car").network)
    figures = re.search(
        r"decreased to 0.005 of it; a run at 100 times tighter tolerances agrees "
        r"\(([\d.]+) against ([\d.]+)\)$",
        run.verified,
    )
    tight, loose = map(float, figures.groups())
    np.testing.assert_allclose(loose, run.settling_time, rtol=1e-4)
    np.testing.assert_allclose(tight, loose, rtol=0.02)


def test_tighter_tolerances():
    method = ode.RK45.tighter(10.0)
    assert method.solver is ode.RK45.solver
    np.testing.assert_allclose((method.rtol, method.atol), (1e-7, 1e-11))
    assert ode.RK45.tighter(1e12).rtol == 3e-14  # what floating point can do


def test_controls_may_be_asked_for_too(reference):
    share = 1e-9
    settling = Settling(controls=share)
    run = replace(QUICK, settling=settling).run(designed("car").network)
    values = np.stack([run.trajectory["u.nu"], run.trajectory["u.eta"]], axis=1)
    error = np.abs(values - values[-1]).max(axis=(1, 2)) / np.abs(values[-1]).max()
    assert (error[run.trajectory.time > run.settling_time] < share).all()
    assert run.settling_time > reference.settling_time
    loose = replace(QUICK, settling=Settling(controls=0.5)).run(designed("car").network)
    assert loose.settling_time == reference.settling_time


def test_a_gain_is_a_rate_of_targets_and_couplings():
    """Without coordinators a constant gain of 2 is half the time constant of t and beta."""
    network = designed("double_integrator").network
    network = apply_gains(network, manual_gains(network, rho=1.0))
    fast = apply_gains(network, manual_gains(network, rho=1.0, tau={"t": 0.5, "beta": 0.5}))
    slow, own = network.of_population(*COORDINATION), InterpretedEvaluator(network).rhs
    by_gain = QUICK.follow(network, lambda x: np.where(slow, 2.0, 1.0) * own(x))
    by_tau = replace(QUICK, method=ode.DOP853).run(fast)
    assert by_tau.status.settled
    np.testing.assert_allclose(by_gain.settling_time, by_tau.settling_time, rtol=1e-6)


def test_runs_repeat_exactly(reference):
    again = QUICK.run(designed("car").network)
    np.testing.assert_array_equal(again.trajectory.states, reference.trajectory.states)


@settings(max_examples=5, deadline=None)
@given(c=st.floats(0.01, 100.0))
def test_slower_neurons_settle_later(c, reference):
    run = QUICK.run(slower(designed("car").network, c))
    np.testing.assert_allclose(run.settling_time, c * reference.settling_time, rtol=0.01)


# ---- outcomes ----------------------------------------------------------------------------------


def test_not_settled():
    """x' = -x / 4: the limit counts in fastest time constants, and e^-5 is not settled."""
    cell = Cell(
        neurons=(Neuron(name="x", tau=4.0),),
        connections=(Connection(source="x", target="x", weight=-1.0),),
    )
    run = replace(QUICK, limit=5.0).run(Network(cell=cell, stages=2, start={"x": 1.0}))
    assert run.status.outcome is Outcome.NOT_SETTLED
    bound = "not settled within 5 tau_min (limit) (s = 20): "
    assert str(run.status).startswith(bound)
    np.testing.assert_allclose(run.status.time, 20.0, rtol=1e-12)
    np.testing.assert_allclose(run.trajectory.final, np.exp(-5), rtol=1e-5)
    assert np.isnan(run.settling_time)
    assert run.verified == "not settled"


def test_the_number_of_steps_is_limited():
    run = replace(QUICK, most_steps=7).run(designed("car").network)
    assert run.status.outcome is Outcome.NOT_SETTLED
    assert run.steps == 7


def growing(rate: float) -> Network:
    """x' = rate x in the last of three cells, x' = -x in the others."""
    cell = Cell(
        neurons=(Neuron(name="x"),),
        connections=(Connection(source="x", target="x", weight=[-1.0, -1.0, rate]),),
    )
    return Network(cell=cell, stages=3, start={"x": 1.0})


@pytest.mark.parametrize("rate", [0.5, 2.0])
def test_diverged_where_and_when(rate):
    run = QUICK.run(growing(rate))
    assert run.status.outcome is Outcome.DIVERGED
    assert run.status.neuron == "x[2]"
    assert "neuron x[2] reached " in run.status.message
    earliest = np.log(ode.OVERFLOW) / rate  # x = exp(rate s)
    assert earliest <= run.status.time < 1.2 * earliest
    assert np.isnan(run.settling_time)


def test_escape_in_finite_time():
    """x' = x^2 from 1 is 1 / (1 - s)."""
    cell = Cell(
        neurons=(Neuron(name="x"),),
        blocks=(Product(name="p", a="x", b="x"),),
        connections=(Connection(source="p", target="x"),),
    )
    run = QUICK.run(Network(cell=cell, stages=1, start={"x": 1.0}))
    assert run.status.outcome is Outcome.DIVERGED
    np.testing.assert_allclose(run.status.time, 1.0, rtol=1e-6)


def frozen(form, name: str = "car") -> Network:
    network = synthesize(decompose(SUITE[name].problem, form))
    return apply_gains(network, designed(name).gains)


def test_a_wrong_sign_diverges():
    """A linear plant has no pole on its way."""
    run = QUICK.run(frozen(SWITCHES["S1"], "double_integrator"))
    assert run.status.outcome is Outcome.DIVERGED
    assert re.fullmatch(r"[qut]\[\d\]\.\w+|(mu|beta)\[\d\]\.\w+", run.status.neuron)
    assert run.status.neuron in run.status.message
    assert f"after {run.status.time:.4g} unit time constants" in run.status.message


def test_the_printed_form_diverges():
    """On its way out the steering passes a right angle, where its tangent ends the run."""
    run = QUICK.run(frozen(PRINTED))
    assert run.status.outcome in (Outcome.DIVERGED, Outcome.LEFT_DOMAIN)
    assert run.trajectory.kkt[-1] > 1.0


def test_left_the_domain_of_tan():
    """Steering just inside a right angle, and a multiplier that pushes it outward."""
    network = apply_gains(designed("car").network, manual_gains(designed("car").network))
    values = network.unpack(network.start_state)
    values[network.neuron_index["q.varphi"], 4] = np.pi / 2 - 1e-3
    values[network.neuron_index["u.nu"], 4] = 0.0
    values[network.neuron_index["beta.varphi"], 4] = -1e4
    run = QUICK.run(network.with_start(network.pack(values)))
    assert run.status.outcome is Outcome.LEFT_DOMAIN
    assert run.status.neuron == "tan(varphi) [4]"
    assert run.status.message.startswith("left the domain of tan(varphi) in cell 4 after ")
    assert run.status.time < 1e-3


@pytest.mark.parametrize("stages", [1, 40])
def test_an_implicit_step_with_a_jacobian_that_is_not_finite_ends_the_run(stages):
    """x' = -1 - sqrt(x) leaves the domain within a step; LU of nan, dense or sparse, raises."""
    ends = (("one", "x"), ("root", "x"))
    cell = Cell(
        neurons=(Neuron(name="x"),),
        blocks=(Function(name="root", function="sqrt", x="x"),),
        connections=tuple(Connection(source=s, target=t, weight=-1.0) for s, t in ends),
    )
    network = Network(stages=stages, cell=cell, start={"x": 0.3})
    run = OdeBackend(method=ode.BDF, verify=False).run(network)
    assert run.status.outcome is Outcome.DIVERGED
    left = 2 * (np.sqrt(0.3) - np.log1p(np.sqrt(0.3)))
    assert run.trajectory.time[-1] == pytest.approx(left, rel=1e-3)


def test_a_reciprocal_keeps_its_side_of_the_pole():
    """x' = 1/x - 2 from -1 falls away from the pole; x' = -1/x from 1 falls into it."""
    cell = Cell(
        neurons=(Neuron(name="x"),),
        blocks=(Function(name="r", function="reciprocal", x="x"),),
        connections=(Connection(source="r", target="x", weight=-1.0),),
    )
    run = QUICK.run(Network(cell=cell, stages=1, start={"x": 1.0}))
    assert run.status.outcome in (Outcome.LEFT_DOMAIN, Outcome.DIVERGED)
    np.testing.assert_allclose(run.status.time, 0.5, rtol=1e-3)  # x = sqrt(1 - 2 s)


# ---- samples -----------------------------------------------------------------------------------


def test_long_runs_are_thinned(reference, monkeypatch):
    monkeypatch.setattr("ann_dc.backends.recorder.SAMPLES", 20)
    run = QUICK.run(designed("car").network)
    full, kept = reference.trajectory, run.trajectory
    assert len(kept.time) <= 21
    assert (np.diff(kept.time) > 0).all()
    assert kept.time[0] == 0.0
    assert kept.time[-1] == full.time[-1]
    assert np.isin(kept.time, full.time).all()
    np.testing.assert_array_equal(kept.residuals, full.residuals)
    np.testing.assert_array_equal(kept.final, full.final)


def test_a_thinned_run_ends_where_it_diverged(monkeypatch):
    monkeypatch.setattr("ann_dc.backends.recorder.SAMPLES", 4)
    run = QUICK.run(growing(1.0))
    assert run.trajectory.time[-1] == run.status.time


def test_progress_is_told(monkeypatch):
    times = iter(np.arange(0.0, 1e6))
    monkeypatch.setattr(ann_dc.progress.clock, "monotonic", lambda: next(times))
    monkeypatch.setattr("ann_dc.backends.integration.steppers.LOGGED", 1)  # a step a call
    meaning = []
    replace(QUICK, progress=meaning.append).run(designed("double_integrator").network)
    assert len(meaning) > 3
    assert all(re.fullmatch(r"\S+ unit time constants, KKT residual \S+", line) for line in meaning)
