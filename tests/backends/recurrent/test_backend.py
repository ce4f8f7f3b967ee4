"""The recurrent backend: where the ODE settles it settles too, alone, in batches, and as a map."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from designs import designed
from problems import CAR_G3, SUITE
from reference import ipopt
from scipy.integrate import solve_ivp

from ann_dc import solve
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.recurrent import layer as layer_module
from ann_dc.backends.recurrent.acceleration import Anderson
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.recurrent.layer import RecurrentLayer
from ann_dc.backends.recurrent.orders import SIMULTANEOUS, STAGE_BY_STAGE, TWO_PHASE
from ann_dc.backends.recurrent.steps import FixedStep
from ann_dc.backends.settling import Settling
from ann_dc.backends.status import Outcome
from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import SWITCHES
from ann_dc.errors import FormError, NetworkError, UnknownNameError
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.gains import apply_gains, hand_gains
from ann_dc.gain_design.procedure import design
from ann_dc.network.cell import Cell, Connection, Function, Limiter, Neuron, Product
from ann_dc.network.inputs import moved_starts
from ann_dc.network.network import Network
from ann_dc.problem import plants
from ann_dc.solution import certificate_of
from ann_dc.solver import synthesize

TIGHT = Settling(tolerance=1e-8, confirm=0.1)
RECURRENT = RecurrentBackend(settling=TIGHT)

SLOW = (
    *("cart_pole", "two_link_arm", "unicycle_obstacle", "lq_unst", "lq_unst_nc"),
    *("car_D.5", "car_g2", "car_N18", "car_N36", "car_N72", "car_T5", "pendulum_state_cost"),
)
QUICK = ("car", "double_integrator", "van_der_pol", "cstr")


def wire(source: str, target: str, weight=1.0) -> Connection:
    return Connection(source=source, target=target, weight=weight)


@cache
def ode(name: str):
    return OdeBackend(verify=False, settling=TIGHT).run(designed(name).network)


@cache
def short(name: str, stages: int = 6) -> Network:
    """A problem of the suite, designed over a few stages."""
    return design(synthesize(SUITE[name].problem.with_horizon(stages))).network


def assert_same_end(run, expected: np.ndarray, relative=1e-7) -> None:
    assert run.status.outcome is Outcome.SETTLED
    scale = np.abs(expected).max()
    np.testing.assert_allclose(run.trajectory.final, expected, atol=relative * scale)


# ---- conformance -------------------------------------------------------------------------------


def marked(name: str):
    return pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name


@pytest.mark.parametrize("name", [marked(name) for name in SUITE if name != "car_g3"])
def test_settles_where_the_ode_does(name):
    assert ode(name).status.settled
    assert_same_end(RECURRENT.run(designed(name).network), ode(name).trajectory.final)


@pytest.mark.slow
def test_of_several_optima_it_settles_at_one():
    """From the same start, rougher steps lead to another one of the optima of car_g3."""
    network = designed("car_g3").network
    run = RECURRENT.run(network)
    proof = certificate_of(SUITE["car_g3"].problem, network, run.trajectory.final)
    assert run.status.settled
    assert proof.certified
    assert np.isclose(proof.objective, CAR_G3, rtol=1e-6).any()


@pytest.mark.parametrize("name", QUICK)
def test_in_two_phases(name):
    run = replace(RECURRENT, order=TWO_PHASE).run(designed(name).network)
    assert_same_end(run, ode(name).trajectory.final)


@pytest.mark.parametrize("name", ["car", "unicycle"])
def test_stage_by_stage(name):
    network = short(name)
    expected = OdeBackend(verify=False, settling=TIGHT).run(network).trajectory.final
    assert_same_end(replace(RECURRENT, order=STAGE_BY_STAGE).run(network), expected)


@pytest.mark.parametrize("order", [SIMULTANEOUS, TWO_PHASE], ids=repr)
@pytest.mark.parametrize("name", QUICK)
def test_accelerated(name, order):
    """From nearby: what remembers may jump to another optimum."""
    network, end = designed(name).network, ode(name).trajectory.final
    near = network.with_start(end + 0.1 * (network.start_state - end))
    run = replace(RECURRENT, order=order, acceleration=Anderson()).run(near)
    assert_same_end(run, end)
    assert run.steps < replace(RECURRENT, order=order).run(near).steps


def test_with_fixed_steps():
    network = designed("car").network
    run = replace(RECURRENT, step=FixedStep(step=0.3)).run(network)
    assert_same_end(run, ode("car").trajectory.final)
    np.testing.assert_allclose(run.status.time, 0.3 * run.steps, rtol=1e-9)


def test_in_single_precision():
    network = designed("car").network
    end = RecurrentLayer(network, dtype=torch.float32).settle()
    assert end.settled.tolist() == [True]
    expected = ode("car").trajectory.final
    np.testing.assert_allclose(end.states[0], expected, atol=3e-3 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["double_integrator", "car"])
def test_a_solution_is_certified(name):
    solution = solve(SUITE[name].problem, backend=RecurrentBackend())
    assert solution.certified
    np.testing.assert_allclose(solution.objective, SUITE[name].optima[0], rtol=1e-5)


def test_the_oracle_gain_is_continuous():
    with pytest.raises(FormError, match=r"S16: .* acts in continuous time; use the ODE backend"):
        solve(plants.car(), form=SWITCHES["S16"], backend=RecurrentBackend())


# ---- the way there -----------------------------------------------------------------------------


@pytest.mark.parametrize("order", [SIMULTANEOUS, TWO_PHASE, STAGE_BY_STAGE], ids=repr)
@pytest.mark.parametrize("name", ["double_integrator", "car"])
def test_half_the_step_half_the_error(name, order):
    network, end = short(name, 4), 2.0
    exact = solve_ivp(
        lambda _, x: evaluator(network).rhs(x), (0, end), network.start_state,
        method="DOP853", rtol=1e-11, atol=1e-11,
    ).y[:, -1]  # fmt: skip

    def error(steps: int) -> float:
        layer = RecurrentLayer(network, order=order, step=FixedStep(step=end / steps))
        return np.abs(layer(steps=steps)[0].numpy() - exact).max()

    assert 1.8 < error(100) / error(200) < 2.2


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


def test_one_run_is_a_batch_of_one():
    network = short("car")
    run, end = RECURRENT.run(network), RECURRENT.layer(network).settle(settling=TIGHT)
    np.testing.assert_array_equal(run.trajectory.final, end.states[0])
    assert end.steps.tolist() == [run.steps]
    assert end.settling_steps.tolist() == [run.settling_steps]


def test_progress_is_told(monkeypatch):
    times = iter(np.arange(0.0, 1e6))
    monkeypatch.setattr(layer_module.clock, "monotonic", lambda: next(times))
    meaning = []
    replace(RECURRENT, progress=meaning.append).run(short("unicycle"))
    assert len(meaning) > 3
    assert all(re.fullmatch(r"step \d+: 1 of 1 samples run on", line) for line in meaning)


# ---- outcomes ----------------------------------------------------------------------------------


def test_the_number_of_steps_is_limited():
    run = replace(RECURRENT, limit=7).run(designed("car").network)
    assert run.status.outcome is Outcome.NOT_SETTLED
    assert run.steps == 7
    assert re.search(r"not settled .* when 7 steps were done \(limit\)", run.status.message)
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
    network = apply_gains(network, hand_gains(network))
    values = network.unpack(network.start_state)
    values[network.neuron_index["q.varphi"], 4] = np.pi / 2 - 1e-3
    values[network.neuron_index["u.nu"], 4] = 0.0
    values[network.neuron_index["beta.varphi"], 4] = -1e4
    return network.with_start(network.pack(values))


def test_left_the_domain_of_tan():
    run = RECURRENT.run(steered_out(designed("car").network))
    assert run.status.outcome is Outcome.LEFT_DOMAIN
    assert run.status.neuron == "tan(varphi) [4]"
    assert run.status.message.startswith("left the domain of tan(varphi) in cell 4 at network time")
    assert run.status.time < 1e-3


def pole() -> Network:
    """x' = 1 / x - pull from 3."""
    cell = Cell(
        neurons=(Neuron(name="x"),),
        inputs=("pull",),
        blocks=(Function(name="r", function="reciprocal", x="x"),),
        connections=(wire("r", "x"), wire("pull", "x", -1.0)),
    )
    return Network(cell=cell, stages=1, inputs={"pull": 2.0}, start={"x": 3.0})


def test_a_reciprocal_keeps_its_side_of_the_pole():
    """A step of 2 would lead from 3 to -1/3; short ones settle at 1/2."""
    run = replace(RECURRENT, step=FixedStep(step=0.2)).run(pole())
    assert_same_end(run, np.array([0.5]))
    run = replace(RECURRENT, step=FixedStep(step=2.0)).run(pole())
    assert run.status.outcome is Outcome.LEFT_DOMAIN
    assert run.status.neuron == "r [0]"
    assert run.steps == 1
    np.testing.assert_allclose(run.trajectory.final, -1 / 3, rtol=1e-12)


def leak() -> Cell:
    """x' = -x."""
    return Cell(neurons=(Neuron(name="x"),), connections=(wire("x", "x", -1.0),))


def test_the_last_step_counts_too():
    """1e-9 lies between 2^-29 and 2^-30."""
    network, step = Network(cell=leak(), stages=1, start={"x": 1.0}), FixedStep(step=0.5)
    backend = replace(RECURRENT, step=step)
    assert backend.run(network).steps == 30
    assert not replace(backend, limit=29).run(network).status.settled
    assert replace(backend, limit=30).run(network).status.settled


# ---- batches -----------------------------------------------------------------------------------


def targets(name: str, count: int) -> dict[str, np.ndarray]:
    """Targets and starts around those of a problem of the suite."""
    rng, problem = np.random.default_rng(1), SUITE[name].problem
    first = problem.states[0]
    return {
        f"q_d.{first}": problem.q_d[0] * rng.uniform(0.8, 1.2, count),
        f"q_0.{first}": problem.q_0[0] + rng.uniform(-0.2, 0.2, count),
    }


BACKENDS = {
    "simultaneous": RECURRENT,
    "two-phase": replace(RECURRENT, order=TWO_PHASE),
    "accelerated": replace(RECURRENT, acceleration=Anderson()),
}


@pytest.mark.parametrize("backend", BACKENDS.values(), ids=BACKENDS)
@pytest.mark.parametrize("name", ["double_integrator", "car"])
def test_a_batch_is_its_samples(name, backend):
    network = designed(name).network
    run = backend.run_batch(network, targets(name, 32))
    assert run.settled.all()
    starts = moved_starts(network, run.inputs)
    for sample in (0, 31):
        alone = backend.run(run.network_of(sample).with_start(starts[sample]))
        assert_same_end(alone, run.states[sample])
        assert 0.8 < run.steps[sample] / alone.steps < 1.25  # it looks at every fifth step only


def test_samples_count_their_steps_as_if_alone():
    layer = RecurrentLayer(short("unicycle"), step=FixedStep(step=0.3))
    inputs = targets("unicycle", 6)
    together = layer.settle(inputs=inputs)
    assert len(set(together.steps.tolist())) > 1
    for sample in range(6):
        alone = layer.settle(inputs={name: value[[sample]] for name, value in inputs.items()})
        assert abs(int(together.steps[sample] - alone.steps[0])) <= 1  # rounding
        assert abs(int(together.settling_steps[sample] - alone.settling_steps[0])) <= 1
        np.testing.assert_allclose(together.states[sample], alone.states[0], atol=1e-7)


def test_samples_keep_their_places():
    """Those that start settled leave first; the others move up, and come back to their places."""
    network = short("unicycle")
    x = np.repeat(network.start_state[None], 9, axis=0)
    goals = np.linspace(1.5, 2.5, 9)
    done = RECURRENT.run_batch(network, {"q_d.x": goals}).states
    early = [0, 2, 3, 6, 7, 8]
    x[early] = done[early]
    run = RECURRENT.run_batch(network, {"q_d.x": goals}, x)
    assert run.settled.all()
    assert (run.steps[early] == 0).all()
    assert (np.delete(run.steps, early) > 100).all()
    np.testing.assert_allclose(run.states, done, atol=1e-6)
    t = network.neuron_index["t.x"]
    ends = [run.network_of(i).unpack(x)[t, -1] for i, x in enumerate(run.states)]
    np.testing.assert_array_equal(ends, goals)


def test_samples_keep_their_inputs():
    """x' = push - x settles at its own push, whoever has left before it."""
    cell = Cell(
        neurons=(Neuron(name="x"),),
        inputs=("push",),
        connections=(wire("x", "x", -1.0), wire("push", "x")),
    )
    network, push = Network(cell=cell, stages=2, inputs={"push": 0.0}), np.linspace(1.0, 2.0, 9)
    x = np.where(np.isin(np.arange(9), [0, 2, 3, 6, 7, 8]), push, 0.0)
    backend = replace(RECURRENT, step=FixedStep(step=0.5))
    run = backend.run_batch(network, {"push": push}, np.stack([x, x], axis=1))
    assert (run.steps > 0).tolist() == (x == 0).tolist()
    np.testing.assert_allclose(run.states, np.stack([push, push], axis=1), atol=1e-8)


def test_a_sample_that_is_no_number_costs_itself_alone():
    network, goals = designed("car").network, np.full((5, 9), 5.0)
    whole = RECURRENT.run_batch(network, {"q_d.x": goals})
    goals[1, -1], goals[3] = np.nan, np.nan
    run = RECURRENT.run_batch(network, {"q_d.x": goals})
    assert run.settled.tolist() == [True, False, True, False, True]
    np.testing.assert_allclose(run.states[[0, 2, 4]], whole.states[[0, 2, 4]], atol=1e-9)
    for sample in (1, 3):
        assert run.message(sample) == f"sample {sample}: input q_d.x is not a finite number"
        assert run.message(sample) in str(run)
        with pytest.raises(NetworkError, match=r"q_d.x.* is not finite"):
            run.network_of(sample)


def test_a_batch_tells_how_it_ended():
    network, rng = short("unicycle"), np.random.default_rng(2)
    goals = rng.uniform(1.5, 2.5, 20)
    run = RECURRENT.run_batch(network, {"q_d.x": goals})
    steps = run.settling_steps
    said = f"20 of 20 samples settled, in {int(np.median(steps))} steps (median), at most "
    assert str(run) == said + str(steps.max())
    assert len(run) == 20
    goals[:13] = np.nan
    lines = str(RECURRENT.run_batch(network, {"q_d.x": goals})).splitlines()
    assert lines[0].startswith("7 of 20 samples settled, in ")
    assert [line.strip().partition(":")[0] for line in lines[1:-1]] == [
        f"sample {i}" for i in range(10)
    ]
    assert lines[-1] == "  and 3 more"


def test_a_batch_that_did_not_settle():
    run = replace(RECURRENT, limit=8).run_batch(short("car"), {"q_d.x": [5.0, 4.0]})
    assert run.outcomes == (Outcome.NOT_SETTLED,) * 2
    assert run.steps.tolist() == [8, 8]
    assert run.settling_steps.tolist() == [-1, -1]
    said = r"sample 1: not settled within the time given, after 8 steps, KKT residual \d.\de[+-]\d+"
    assert re.fullmatch(said, run.message(1))
    assert str(run).startswith("0 of 2 samples settled\n  sample 0: not settled")


def growing() -> Network:
    """x' = x + push in the last of three cells, x' = -x + push in the others."""
    cell = Cell(
        neurons=(Neuron(name="x"),),
        inputs=("push",),
        connections=(wire("x", "x", [-1.0, -1.0, 1.0]), wire("push", "x")),
    )
    return Network(cell=cell, stages=3, inputs={"push": 0.0})


def test_a_sample_that_diverges_is_told_by_name():
    run = replace(RECURRENT, step=FixedStep(step=0.5)).run_batch(growing(), {"push": [0.0, 1.0]})
    assert run.outcomes == (Outcome.SETTLED, Outcome.DIVERGED)
    said = r"sample 1: diverged, after \d+ steps: neuron x\[2\] reached \S+"
    assert re.fullmatch(said, run.message(1))


def test_a_large_sample_does_not_hide_that_another_diverges():
    """Divergence is told from a sample's own start."""
    backend, x = replace(RECURRENT, step=FixedStep(step=0.5)), np.array([[0.0] * 3, [1e30] * 3])
    alone = backend.run_batch(growing(), {"push": [1.0]}, x[:1])
    both = backend.run_batch(growing(), {"push": [1.0, 0.0]}, x)
    assert alone.outcomes[0] is both.outcomes[0] is Outcome.DIVERGED
    assert both.steps[0] == alone.steps[0]


def test_a_sample_that_leaves_a_domain():
    backend = replace(RECURRENT, step=FixedStep(step=0.2))
    run = backend.run_batch(pole(), {"pull": [2.0, 40.0, 1.0]})
    assert run.outcomes == (Outcome.SETTLED, Outcome.LEFT_DOMAIN, Outcome.SETTLED)
    np.testing.assert_allclose(run.states[[0, 2]], [[0.5], [1.0]], rtol=1e-7)
    assert run.message(1).startswith("sample 1: left the domain of a function block, after ")


def swinging_out() -> Network:
    """A damped swing of x around zero that is beyond a right angle for three steps of 0.3."""
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="y")),
        blocks=(Function(name="g", function="tan", x="x"),),
        connections=(
            wire("x", "x", -0.3), wire("y", "x"), wire("x", "y", -1.0), wire("y", "y", -0.3),
            wire("g", "x", 0.0),
        ),
    )  # fmt: skip
    return Network(cell=cell, stages=1, start={"x": 1.4, "y": 1.4})


def test_a_batch_sees_what_a_run_sees():
    """Also between two looks at who has settled."""
    backend = replace(RECURRENT, step=FixedStep(step=0.3))
    assert backend.run(swinging_out()).status.outcome is Outcome.LEFT_DOMAIN
    assert backend.run_batch(swinging_out(), {}).outcomes == (Outcome.LEFT_DOMAIN,)


def test_network_of_a_sample():
    network, goals = short("car"), targets("car", 3)
    run = RECURRENT.run_batch(network, goals)
    own = run.network_of(2)
    assert own.cell is network.cell
    for name in network.cell.inputs:
        expected = goals[name][2] if name in goals else network.inputs[name]
        np.testing.assert_array_equal(own.inputs[name], np.broadcast_to(expected, 6))
    np.testing.assert_allclose(evaluator(own).rhs(run.states[2]), 0.0, atol=1e-6)


def test_one_set_of_inputs_and_many_starts():
    network = short("unicycle")
    starts = network.start_state + 0.1 * np.random.default_rng(3).standard_normal((3, network.size))
    run = RECURRENT.run_batch(network, {"q_d.x": 1.5}, starts)
    assert run.settled.all()
    assert len(run) == 3
    np.testing.assert_allclose(run.states, np.repeat(run.states[:1], 3, axis=0), atol=1e-6)


def test_every_sample_of_one_set_of_inputs_has_a_network():
    network = short("unicycle")
    run = RECURRENT.run_batch(network, {"q_d.x": 1.5}, np.repeat([network.start_state], 3, axis=0))
    assert all(run.network_of(sample).inputs["q_d.x"][0] == 1.5 for sample in range(3))
    assert run.message(2).startswith("sample 2: settled")


def test_an_infinite_input_costs_its_sample_alone():
    run = RECURRENT.run_batch(short("unicycle"), {"q_d.x": [1.5, np.inf]})
    assert run.settled.tolist() == [True, False]
    assert run.message(1) == "sample 1: input q_d.x is not a finite number"


REFUSED = {
    "sizes": (
        {"q_d.x": [1.0, 2.0], "q_0.x": [1.0, 2.0, 3.0]},
        NetworkError,
        "do not agree: q_d.x has 2, q_0.x has 3 samples",
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
        ((3, -1), "x: sizes of the batch do not agree: 3 states, inputs of 2 samples"),
        ((2, 5), r"x: expected state vectors of \d+ neurons, got .*5"),
    ],
)
def test_starts_that_are_refused(shape, message):
    network = short("double_integrator")
    x = np.zeros((shape[0], network.size if shape[1] < 0 else shape[1]))
    with pytest.raises(NetworkError, match=message):
        RECURRENT.run_batch(network, {"q_d.x": [1.0, 2.0]}, x)


@pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has CUDA")
def test_cuda_where_there_is_none():
    with pytest.raises(NetworkError, match="no CUDA device; use device='cpu'"):
        replace(RECURRENT, device="cuda").run(short("double_integrator"))


def test_an_unknown_device():
    with pytest.raises(NetworkError, match="device: 'abacus' is no device"):
        replace(RECURRENT, device="abacus").run(short("double_integrator"))


# ---- the settled point as a function -----------------------------------------------------------

EXACT = Settling(tolerance=1e-11, confirm=0.5)


def jacobian(outputs: torch.Tensor, given: torch.Tensor) -> np.ndarray:
    """d outputs / d given, (n, m) for outputs (n,) and given (m,)."""
    rows = [torch.autograd.grad(value, given, retain_graph=True)[0] for value in outputs]
    return torch.stack(rows).numpy()


@pytest.mark.parametrize("name", ["double_integrator", "car"])
@pytest.mark.parametrize("which", ["q_d.{}", "q_0.{}"])
def test_the_derivative_of_the_settled_point(name, which):
    """Against central differences of networks that were settled again."""
    network = designed(name).network
    layer, which = RecurrentLayer(network), which.format(SUITE[name].problem.states[0])
    at, eps = float(network.inputs[which][0]), 1e-3
    goal = torch.tensor([at], dtype=torch.float64, requires_grad=True)
    found = jacobian(layer.equilibrium({which: goal}, settling=EXACT)[0], goal)[:, 0]
    ends = layer.settle(inputs={which: [at - eps, at + eps]}, settling=EXACT)
    assert ends.settled.all()
    expected = (ends.states[1] - ends.states[0]).numpy() / (2 * eps)
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["double_integrator", "car"])
@pytest.mark.parametrize("which", ["q_d", "q_0"])
def test_the_derivative_of_the_optimal_controls(name, which):
    """Against IPOPT, which solves the problem again on either side."""
    problem, network = SUITE[name].problem, designed(name).network
    layer, neurons = RecurrentLayer(network), network.neuron_index
    at = getattr(problem, which)
    goal = torch.tensor([float(at[0])], dtype=torch.float64, requires_grad=True)
    settled = layer.equilibrium({f"{which}.{problem.states[0]}": goal}, settling=EXACT)[0]
    slopes = network.unpack(jacobian(settled, goal)[:, 0])
    units = [network.neuron(f"u.{u}").unit for u in problem.controls]
    found = slopes[[neurons[f"u.{u}"] for u in problem.controls]] * np.array(units)[:, None]

    eps, here = 1e-3, ipopt(problem)
    values = network.unpack(settled.detach().numpy())
    ours = values[[neurons[f"u.{u}"] for u in problem.controls]] * np.array(units)[:, None]
    np.testing.assert_allclose(ours, here.u, atol=1e-6 * np.abs(here.u).max())
    sides = [problem.with_inputs(**{which: (at[0] + e, *at[1:])}) for e in (-eps, eps)]
    below, above = (ipopt(side, guess=(here.q, here.u)) for side in sides)
    assert below.success
    assert above.success
    expected = (above.u - below.u) / (2 * eps)
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())


def test_gains_do_not_move_the_optimum():
    """The derivative by every gain is zero, whatever they do to the way there."""
    layer = RecurrentLayer(short("car"), trainable=True)
    settled = layer.equilibrium(settling=EXACT)
    settled.square().sum().backward()
    np.testing.assert_allclose(layer.cell.log_gain.rows.grad, 0.0, atol=1e-7)


@pytest.mark.parametrize("name", ["double_integrator", "car"])
def test_unrolled_long_enough_the_derivative_is_the_same(name):
    network, first = designed(name).network, SUITE[name].problem.states[0]
    layer = RecurrentLayer(network)
    at = [0.9 * SUITE[name].problem.q_d[0], SUITE[name].problem.q_d[0]]
    weights = torch.as_tensor(np.random.default_rng(4).standard_normal((2, network.size)))
    slopes = []
    for run in (
        lambda goal: layer.equilibrium({f"q_d.{first}": goal}, settling=EXACT),
        lambda goal: layer(inputs={f"q_d.{first}": goal}, steps=500),
    ):
        goal = torch.tensor(at, dtype=torch.float64, requires_grad=True)
        (weights * run(goal)).sum().backward()
        slopes.append(goal.grad.numpy())
    np.testing.assert_allclose(slopes[1], slopes[0], rtol=1e-5)


def test_samples_that_did_not_settle_are_no_numbers():
    layer, goals = RecurrentLayer(short("car")), torch.tensor([5.0, float("nan"), 4.5])
    settled = layer.equilibrium({"q_d.x": goals}, limit=2000)
    assert settled.isnan().all(1).tolist() == [False, True, False]
    assert layer.equilibrium({"q_d.x": goals}, limit=3).isnan().all()


def test_a_sample_that_did_not_settle_leaves_the_others_their_derivatives():
    """Of what all samples share, too."""
    layer = RecurrentLayer(short("car"))
    start = torch.tensor(0.0, dtype=torch.float64, requires_grad=True)
    alone = layer.equilibrium({"q_0.y": start, "q_d.x": [5.0]}, limit=2000)
    (expected,) = torch.autograd.grad(alone.sum(), start)
    both = layer.equilibrium({"q_0.y": start, "q_d.x": [5.0, np.nan]}, limit=2000)
    (found,) = torch.autograd.grad(both[0].sum(), start)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_the_unrolled_derivative_knows_where_it_starts():
    """Without x, a layer starts on a line between the ends: that moves with the inputs too."""
    layer = RecurrentLayer(short("unicycle"), step=FixedStep(step=0.3))
    goal = torch.tensor([1.0], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda goal: layer(inputs={"q_d.x": goal}, steps=2), goal)


# ---- corners -----------------------------------------------------------------------------------


def test_a_flow_that_only_grows_diverges_however_short_the_steps():
    """The rule may cut a step as often as it likes, but not to nothing."""
    problem = SUITE["double_integrator"].problem
    gains = design(synthesize(problem)).gains
    network = apply_gains(synthesize(decompose(problem, SWITCHES["S1"])), gains)
    assert RecurrentBackend().run(network).status.outcome is Outcome.DIVERGED


def test_a_neuron_at_its_rail_has_no_derivative_and_costs_the_others_none():
    cell = Cell(
        neurons=(Neuron(name="x", limiter=Limiter(high=1.0)), Neuron(name="y")),
        inputs=("g",),
        connections=(wire("g", "x"), wire("x", "x", -1.0), wire("g", "y"), wire("y", "y", -2.0)),
    )
    layer = RecurrentLayer(Network(cell=cell, stages=1, inputs={"g": 3.0}))
    g = torch.tensor([3.0], dtype=torch.float64, requires_grad=True)
    x, y = layer.equilibrium({"g": g})[0]
    assert float(x.detach()) == 1.0
    assert float(torch.autograd.grad(x, g, retain_graph=True)[0]) == 0.0
    assert float(torch.autograd.grad(y, g)[0]) == pytest.approx(0.5)


def test_a_reciprocal_of_zero_is_outside_its_domain():
    cell = Cell(
        neurons=(Neuron(name="x"),),
        blocks=(Function(name="r", function="reciprocal", x="x"),),
        connections=(wire("r", "x"), wire("one", "x", -1.5)),
    )
    network = Network(cell=cell, stages=1, start={"x": 1.0})
    run = RecurrentBackend(step=FixedStep(step=2.0)).run(network)
    assert run.status.outcome is Outcome.LEFT_DOMAIN


# ---- acceleration and saddles ------------------------------------------------------------------


def double_well(start: float) -> Network:
    """x' = x - x^3: rests at -1 and 1, and stands on the hill between them at 0."""
    cell = Cell(
        neurons=(Neuron(name="x"),),
        blocks=(Product(name="xx", a="x", b="x"), Product(name="xxx", a="xx", b="x")),
        connections=(wire("x", "x"), wire("xxx", "x", -1.0)),
    )
    return Network(cell=cell, stages=1, start={"x": start})


@pytest.mark.parametrize("start", [-0.2, 0.01, 0.3])
def test_acceleration_does_not_rest_on_a_hill(start):
    run = RecurrentBackend(acceleration=Anderson()).run(double_well(start))
    assert run.status.settled
    assert run.trajectory.final == pytest.approx(np.sign(start))


@pytest.mark.parametrize("name", ["pendulum", "pendulum_state_cost"])
def test_acceleration_does_not_settle_at_a_saddle_of_the_kkt_conditions(name):
    """Alone it would: Anderson finds any root of the drives."""
    network = designed(name).network
    end = RecurrentLayer(network, acceleration=Anderson()).settle()
    assert end.settled.tolist() == [True]
    assert certificate_of(SUITE[name].problem, network, end.states[0].numpy()).certified
