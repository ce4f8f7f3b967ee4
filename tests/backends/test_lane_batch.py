"""Many networks at once in generated code: as one by one, whatever runs beside them."""

from dataclasses import replace

import numpy as np
import pytest
from designs import designed
from recurrent_runs import suited

import ann_dc
from ann_dc.backends.batch import BatchRun
from ann_dc.backends.ode import BATCHES
from ann_dc.backends.recurrent import backend as recurrent_backend
from ann_dc.backends.status import Outcome
from ann_dc.backends.step_rules import ORDERS
from ann_dc.errors import NetworkError
from ann_dc.network.cell import Cell, Connection, Function, Neuron
from ann_dc.network.ends import FixedNeuron
from ann_dc.network.network import Network
from ann_dc.progress import Stopped

RNG = np.random.default_rng(3)
TARGETS = RNG.uniform(0.5, 2.0, 150)


def integrators(count: int = 150) -> tuple[Network, dict[str, np.ndarray]]:
    network = designed("double_integrator").network
    return network, {"q_d.x": TARGETS[:count]}


def same(a: BatchRun, b: BatchRun, of=slice(None)) -> None:
    """Bit for bit, of some samples of the first."""
    for name in ("states", "steps", "settling_steps", "settling_times", "residuals"):
        np.testing.assert_array_equal(getattr(a, name)[of], getattr(b, name), err_msg=name)


def test_a_sample_settles_as_alone():
    network = designed("car").network
    inputs = {"q_d.x": np.array([4.0, 4.5, 5.5]), "q_0.phi": np.array([0.0, 0.1, -0.1])}
    batch = ann_dc.OdeBackend().run_batch(network, inputs)
    assert batch.settled.all()
    for sample in range(3):
        starts = ann_dc.OdeBackend(curves=1).run_batch(network, inputs).trajectory(sample).states
        alone = batch.network_of(sample)
        backend = ann_dc.OdeBackend(method=BATCHES, verify=False)
        alone = backend.run(alone.with_start(starts[0]))
        assert batch.settling_times[sample] == pytest.approx(alone.settling_time, rel=1e-4)
        scale = np.abs(alone.trajectory.final).max()
        np.testing.assert_allclose(batch.states[sample], alone.trajectory.final, atol=1e-7 * scale)


def test_the_bits_of_a_sample_depend_on_nothing_beside_it():
    network, inputs = integrators()
    whole = ann_dc.OdeBackend(threads=1).run_batch(network, inputs)
    same(whole, ann_dc.OdeBackend(threads=2).run_batch(network, inputs))
    same(whole, ann_dc.OdeBackend().run_batch(network, {"q_d.x": TARGETS[40:53]}), slice(40, 53))
    same(
        whole,
        ann_dc.OdeBackend().run_batch(network, {"q_d.x": TARGETS[::-1]}),
        slice(None, None, -1),
    )


def test_a_sample_that_fails_costs_itself_only():
    network, inputs = integrators(20)
    spoiled = {"q_d.x": inputs["q_d.x"].copy()}
    spoiled["q_d.x"][[3, 11]] = np.nan, np.inf
    good = np.setdiff1d(np.arange(20), [3, 11])
    for backend in (ann_dc.OdeBackend(), ann_dc.RecurrentBackend()):
        batch = backend.run_batch(network, spoiled)
        assert not batch.settled[[3, 11]].any()
        assert np.isnan(batch.settling_times[[3, 11]]).all()
        np.testing.assert_array_equal(
            batch.states[good], backend.run_batch(network, inputs).states[good]
        )


def pole(source: str = "pull") -> Network:
    """x' = pull - x - 0.01 / x settles from above zero and runs into the pole from below."""
    cell = Cell(
        neurons=(Neuron(name="x"),),
        inputs=(source,),
        blocks=(Function(name="g", function="reciprocal", x="x"),),
        connections=(
            Connection(source="g", target="x", weight=-0.01),
            Connection(source="x", target="x", weight=-1.0),
            Connection(source=source, target="x", weight=1.0),
        ),
    )
    return Network(cell=cell, stages=2, inputs={source: 1.0}, start={"x": 0.5})


def test_every_sample_keeps_its_side_of_a_pole():
    network, starts = pole(), np.array([[0.5, 2.0], [-0.5, -2.0], [3.0, 3.0]])
    batch = ann_dc.OdeBackend().run_batch(network, {"pull": [1.0, 1.0, 0.5]}, starts)
    expected = [Outcome.SETTLED, Outcome.LEFT_DOMAIN, Outcome.SETTLED]
    assert list(batch.outcomes) == expected
    rest = [0.5 * (pull + np.sqrt(pull**2 - 0.04)) for pull in (1.0, 0.5)]
    np.testing.assert_allclose(batch.states[[0, 2]], np.repeat(rest, 2).reshape(2, 2), atol=1e-6)


def test_a_side_is_that_of_the_samples_own_pins():
    """x_0 is pinned, and the sample's pin lies on the other side of the pole than the network's."""
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="y")),
        inputs=("first",),
        blocks=(Function(name="g", function="reciprocal", x="x"),),
        connections=(
            Connection(source="g", target="y", weight=1.0),
            Connection(source="y", target="y", weight=-1.0),
            Connection(source="x", target="x", weight=-1.0),
            Connection(source="first", target="x", weight=1.0),
        ),
    )
    network = Network(
        cell=cell, stages=2, inputs={"first": 1.0}, start={"x": 1.0},
        fixed=(FixedNeuron(neuron="x", stage=0, input="first"),),
    )  # fmt: skip
    starts = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    for backend in (ann_dc.OdeBackend(), ann_dc.RecurrentBackend()):
        batch = backend.run_batch(network, {"first": [1.0, -2.0]}, starts)
        assert batch.settled.all()
        np.testing.assert_allclose(np.sort(batch.states[1]), [-2.0, -0.5, -0.5], atol=1e-6)


def test_a_large_angle_costs_its_own_sample_only():
    network = designed("pendulum").network
    name = "q_d.theta"
    near = network.inputs[name][0] * np.array([1.0, 0.9, 0.8])
    alone = ann_dc.OdeBackend().run_batch(network, {name: near})
    beside = ann_dc.OdeBackend(most_steps=300).run_batch(network, {name: [*near, 4e5]})
    np.testing.assert_array_equal(beside.states[:3], alone.states)


def test_what_overflows_and_what_takes_too_long():
    cell = Cell(
        neurons=(Neuron(name="x"),),
        inputs=("rate",),
        connections=(
            Connection(source="x", target="x", weight=1.0),
            Connection(source="rate", target="x", weight=1.0),
        ),
    )
    network = Network(cell=cell, stages=1, inputs={"rate": 0.0}, start={"x": 1.0})
    batch = ann_dc.OdeBackend().run_batch(network, {"rate": [1.0, 2.0]})
    assert set(batch.outcomes) == {Outcome.DIVERGED}
    few = ann_dc.OdeBackend(most_steps=3).run_batch(network, {"rate": [1.0]})
    assert few.outcomes == (Outcome.NOT_SETTLED,)
    assert few.steps.tolist() == [3]


def test_curves_are_kept_with_their_ends():
    network, inputs = integrators(12)
    batch = ann_dc.OdeBackend(curves=6).run_batch(network, inputs)
    same(batch, ann_dc.OdeBackend().run_batch(network, inputs))
    for sample in range(12):
        curve = batch.trajectory(sample)
        assert 3 <= len(curve.time) <= 7
        assert (np.diff(curve.time) > 0).all()
        np.testing.assert_array_equal(curve.final, batch.states[sample])
        np.testing.assert_array_equal(curve.residuals[-1], batch.residuals[sample])


def test_a_batch_can_be_ended():
    network, inputs = integrators(20)

    def enough(_: str) -> None:
        raise Stopped("enough")

    slow = ann_dc.Settling(tolerance=1e-290, confirm=0.5)
    batch = ann_dc.OdeBackend(
        settling=slow, progress=enough, limit=1e300, most_steps=10**9, curves=5
    )
    batch = batch.run_batch(network, inputs)
    assert Outcome.STOPPED in batch.outcomes
    assert np.isfinite(batch.states).all()
    ended = [outcome is Outcome.STOPPED for outcome in batch.outcomes]
    assert np.isnan(batch.settling_times[ended]).all()
    assert (batch.settling_steps[ended] == -1).all()
    for sample in range(len(batch)):
        np.testing.assert_array_equal(batch.trajectory(sample).final, batch.states[sample])


def test_methods_of_scipy_run_no_batch():
    network, inputs = integrators(2)
    backend = ann_dc.OdeBackend(method=ann_dc.ode.RK45)
    with pytest.raises(NetworkError, match="method: batches run in compiled code, and RK45"):
        backend.run_batch(network, inputs)


def test_tighter_tolerances_give_the_same_times():
    network = designed("unicycle").network
    times = [
        ann_dc.OdeBackend(method=method).run_batch(network, {}).settling_times[0]
        for method in (BATCHES, BATCHES.tighter(1000.0))
    ]
    assert times[0] == pytest.approx(times[1], rel=1e-3)


# ---- recurrent steps -----------------------------------------------------------------------------


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "step",
    [None, pytest.param(ann_dc.FixedStep(step=0.05), marks=pytest.mark.slow)],
    ids=["adaptive", "fixed"],
)
@pytest.mark.parametrize("order", ORDERS.values(), ids=str)
@pytest.mark.parametrize(
    "name", ["double_integrator", pytest.param("unicycle", marks=pytest.mark.slow)]
)
def test_recurrent_steps_are_those_of_the_layers(monkeypatch, name, order, step):
    network = suited(name).network
    inputs = {"q_d.x": network.inputs["q_d.x"][0] * np.array([[1.0], [1.1], [0.9]])}
    backend = ann_dc.RecurrentBackend(order=order, step=step, curves=5, limit=400)
    code = backend.run_batch(network, inputs)
    monkeypatch.setattr(recurrent_backend, "refusal", lambda *_: "no code")
    layers = backend.run_batch(network, inputs)
    assert code.outcomes == layers.outcomes
    np.testing.assert_array_equal(code.steps, layers.steps)
    np.testing.assert_array_equal(code.settling_steps, layers.settling_steps)
    np.testing.assert_allclose(code.settling_times, layers.settling_times, rtol=1e-7)
    scale = np.abs(layers.states).max()
    np.testing.assert_allclose(code.states, layers.states, rtol=1e-9, atol=1e-11 * scale)
    for sample in range(3):
        ours, theirs = code.trajectory(sample), layers.trajectory(sample)
        np.testing.assert_allclose(ours.time, theirs.time, rtol=1e-7)


def test_every_step_is_that_of_the_layers_to_rounding(monkeypatch):
    """Forty steps from afar, before anything settles."""
    network = suited("car").network
    backend = ann_dc.RecurrentBackend(limit=40)
    code = backend.run_batch(network, {})
    monkeypatch.setattr(recurrent_backend, "refusal", lambda *_: "no code")
    layers = backend.run_batch(network, {})
    scale = np.abs(layers.states).max()
    np.testing.assert_allclose(code.states, layers.states, rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("limit", [3, 13, 15])
def test_the_last_step_is_looked_at_wherever_it_falls(monkeypatch, limit):
    """More samples than lanes, so that some begin when others are done."""
    network = suited("double_integrator").network
    backend, inputs = ann_dc.RecurrentBackend(limit=limit), {"q_d.x": TARGETS[:20]}
    code = backend.run_batch(network, inputs)
    monkeypatch.setattr(recurrent_backend, "refusal", lambda *_: "no code")
    layers = backend.run_batch(network, inputs)
    assert set(code.outcomes) == {Outcome.NOT_SETTLED} == set(layers.outcomes)
    assert set(code.steps) == {limit} == set(layers.steps)
    np.testing.assert_allclose(code.residuals, layers.residuals, rtol=1e-10)
    np.testing.assert_allclose(code.states, layers.states, rtol=1e-11, atol=1e-13)


@pytest.mark.slow
def test_rails_hold_recurrent_steps(monkeypatch):
    network = designed("double_integrator").network
    row = network.neuron_index["u.a"]
    neurons = list(network.cell.neurons)
    neurons[row] = replace(neurons[row], limiter=ann_dc.network.Limiter(low=-0.2, high=0.2))
    network = replace(network, cell=replace(network.cell, neurons=tuple(neurons)))
    for order in ORDERS.values():
        backend = ann_dc.RecurrentBackend(order=order, limit=200)
        code = backend.run_batch(network, {})
        with monkeypatch.context() as patched:
            patched.setattr(recurrent_backend, "refusal", lambda *_: "no code")
            layers = backend.run_batch(network, {})
        np.testing.assert_allclose(code.states, layers.states, rtol=1e-9, atol=1e-11)
        assert np.abs(network.unpack(code.states[0])[row]).max() <= 0.2
