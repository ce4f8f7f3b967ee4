"""The recurrent backend: where the ODE settles it settles too, alone and in batches."""

import re
from dataclasses import replace

import numpy as np
import pytest
from designs import designed
from problems import SUITE
from recurrent_runs import (
    QUICK,
    RECURRENT,
    TIGHT,
    assert_same_end,
    ode,
    short,
    suited,
    targets,
)

from ann_dc import solve
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.status import Outcome
from ann_dc.backends.step_rules import SIMULTANEOUS, STAGE_BY_STAGE, TWO_PHASE, Anderson, FixedStep
from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import SWITCHES
from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.gains import apply_gains, manual_gains
from ann_dc.network.inputs import moved_starts
from ann_dc.network.network import Network
from ann_dc.problem import plants
from ann_dc.solution.solution import certificate_of
from ann_dc.solver import synthesize


def marked(name: str):
    return pytest.param(name, marks=pytest.mark.slow) if name not in QUICK else name


@pytest.mark.parametrize("name", [marked(name) for name in SUITE if name != "car_g3"])
def test_settles_where_the_ode_does(name):
    assert ode(name).status.settled
    assert_same_end(RECURRENT.run(suited(name).network), ode(name).trajectory.final)


@pytest.mark.slow
@pytest.mark.parametrize("order", [SIMULTANEOUS, TWO_PHASE, STAGE_BY_STAGE], ids=repr)
def test_of_many_optima_it_settles_at_one_or_says_that_it_does_not(order):
    """Rougher steps than those of the ODE lead elsewhere, or out of the domain of tan."""
    network = designed("car_g3").network
    run = replace(RECURRENT, order=order).run(network)
    certificate = certificate_of(SUITE["car_g3"].problem, network, run.trajectory.final)
    assert run.status.settled == certificate.certified
    assert run.status.outcome in (Outcome.SETTLED, Outcome.STALLED, Outcome.LEFT_DOMAIN)


@pytest.mark.parametrize("name", QUICK)
def test_in_two_phases(name):
    run = replace(RECURRENT, order=TWO_PHASE).run(designed(name).network)
    assert_same_end(run, ode(name).trajectory.final)


@pytest.mark.parametrize("name", ["car", "unicycle"])
def test_stage_by_stage(name):
    network = short(name)
    expected = OdeBackend(verify=False, settling=TIGHT).run(network).trajectory.final
    assert_same_end(replace(RECURRENT, order=STAGE_BY_STAGE).run(network), expected)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["double_integrator", "car"])
def test_a_solution_is_certified(name):
    solution = solve(SUITE[name].problem, backend=RecurrentBackend())
    assert solution.certified
    np.testing.assert_allclose(solution.objective, SUITE[name].optima[0], rtol=1e-5)


def test_a_trajectory_counts_network_time():
    network = short("unicycle")
    run = replace(RECURRENT, step=FixedStep(step=0.25)).run(network)
    trajectory = run.trajectory
    np.testing.assert_allclose(trajectory.residual_time, 0.25 * np.arange(run.steps + 1))
    np.testing.assert_array_equal(trajectory.states[0], network.start_state)
    first = network.start_state + 0.25 * evaluator(network).rhs(network.start_state)
    np.testing.assert_allclose(trajectory.states[1], first, rtol=1e-12, atol=1e-12)
    assert len(trajectory.kkt) == run.steps + 1 == run.evaluations + 1
    assert (trajectory.kkt[trajectory.residual_time > run.settling_time] < 1e-8).all()
    assert trajectory.kkt[run.settling_steps - 1] >= 1e-8


def test_of_thousands_of_steps_only_some_are_taken_down_but_all_are_counted():
    network, backend = short("double_integrator"), replace(RECURRENT, step=FixedStep(step=2e-3))
    run, batch = backend.run(network), backend.run_batch(network, {})
    taken = len(run.trajectory.residual_time)
    assert run.steps > 4 * taken
    between = np.ceil(run.steps / (taken - 1)) + 5  # the batch looks at every fifth step
    np.testing.assert_allclose(run.settling_steps, batch.settling_steps[0], atol=between)


def test_one_run_is_a_batch_of_one():
    network = short("car")
    run, end = RECURRENT.run(network), RECURRENT.layer(network).settle(settling=TIGHT)
    np.testing.assert_allclose(run.trajectory.final, end.states[0], rtol=1e-12, atol=1e-12)
    assert end.steps.tolist() == [run.steps]
    assert end.settling_steps.tolist() == [run.settling_steps]


def test_the_number_of_steps_is_limited():
    run = replace(RECURRENT, limit=7).run(designed("car").network)
    assert run.status.outcome is Outcome.NOT_SETTLED
    assert run.steps == 7
    assert re.search(r"not settled within 7 steps \(limit\)", run.status.message)
    assert "check that the target is within reach" in run.status.message
    assert np.isnan(run.settling_time)


def test_a_wrong_sign_diverges():
    problem = plants.double_integrator()
    network = synthesize(decompose(problem, SWITCHES["S1"]))
    network = apply_gains(network, designed("double_integrator").gains)
    run = replace(RECURRENT, step=FixedStep(step=0.3)).run(network)
    assert run.status.outcome is Outcome.DIVERGED
    assert re.fullmatch(r"(q|u|t|mu|beta)\[\d+\]\.\w+", run.status.neuron)
    assert f"neuron {run.status.neuron} reached" in run.status.message
    assert f"(after {run.steps} steps)" in run.status.message


def steered_out(network: Network) -> Network:
    """Steering just inside a right angle, and a multiplier that pushes it outward."""
    network = apply_gains(network, manual_gains(network))
    values = network.unpack(network.start_state)
    values[network.neuron_index["q.varphi"], 4] = np.pi / 2 - 1e-3
    values[network.neuron_index["u.nu"], 4] = 0.0
    values[network.neuron_index["beta.varphi"], 4] = -1e4
    return network.with_start(network.pack(values))


def test_left_the_domain_of_tan():
    run = RECURRENT.run(steered_out(designed("car").network))
    assert run.status.outcome is Outcome.LEFT_DOMAIN
    assert run.status.neuron == "tan(varphi) [4]"
    assert run.status.message.startswith("left the domain of tan(varphi) in cell 4 after ")
    assert run.status.time < 1e-3


BACKENDS = {
    "simultaneous": RECURRENT,
    "two-phase": replace(RECURRENT, order=TWO_PHASE),
    "accelerated": replace(RECURRENT, acceleration=Anderson()),
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("backend", BACKENDS.values(), ids=BACKENDS)
@pytest.mark.parametrize("name", ["double_integrator", "car"])
def test_a_batch_is_its_samples(name, backend):
    network = suited(name).network
    run = backend.run_batch(network, targets(name, 16))
    lost = 2 if backend.acceleration and name == "car" else 0  # Anderson leaves the basin twice
    assert run.settled.sum() >= 16 - lost
    starts = moved_starts(network, run.inputs)
    for sample in np.flatnonzero(run.settled)[[0, -1]]:
        alone = backend.run(run.network_of(sample).with_start(starts[sample]))
        assert_same_end(alone, run.states[sample])
        assert 0.8 < run.steps[sample] / alone.steps < 1.25  # it looks at every fifth step only


def test_one_set_of_inputs_and_many_starts():
    network = short("unicycle")
    starts = network.start_state + 0.1 * np.random.default_rng(3).standard_normal((3, network.size))
    run = RECURRENT.run_batch(network, {"q_d.x": 1.5}, starts)
    assert run.settled.all()
    assert len(run) == 3
    np.testing.assert_allclose(run.states, np.repeat(run.states[:1], 3, axis=0), atol=1e-6)


REFUSED = {
    "sizes": (
        {"q_d.x": [1.0, 2.0], "q_0.x": [1.0, 2.0, 3.0]},
        NetworkError,
        "differ: q_d.x has 2, q_0.x has 3 samples",
    ),
    "names": ({"q_d.z": 1.0}, UnknownNameError, "input 'q_d.z' does not exist; choose one of: "),
    "stages": ({"q_d.x": np.zeros((2, 5))}, NetworkError, r"q_d.x.*\(B, 6\).*shape \(2, 5\)"),
    "nothing": ({"q_d.x": []}, NetworkError, r"inputs\[q_d.x\]: the batch is empty"),
}


@pytest.mark.parametrize(("inputs", "error", "message"), REFUSED.values(), ids=REFUSED)
def test_batches_that_are_refused(inputs, error, message):
    with pytest.raises(error, match=message):
        RECURRENT.run_batch(short("double_integrator"), inputs)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ((3, -1), "x: sizes of the batch differ: 3 states, inputs of 2 samples"),
        ((2, 5), r"x: expected state vectors of \d+ neurons, got .*5"),
    ],
)
def test_starts_that_are_refused(shape, message):
    network = short("double_integrator")
    x = np.zeros((shape[0], network.size if shape[1] < 0 else shape[1]))
    with pytest.raises(NetworkError, match=message):
        RECURRENT.run_batch(network, {"q_d.x": [1.0, 2.0]}, x)
