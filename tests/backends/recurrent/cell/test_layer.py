"""The cell layer: the network's own numbers in torch, and gradients through them."""

import io
from dataclasses import replace

import numpy as np
import pytest
import torch
from designs import coordinated, designed, near_start, small
from hypothesis import given, settings, strategies as st
from problems import SUITE

from ann_dc.backends.recurrent import FixedStep, RecurrentLayer
from ann_dc.backends.recurrent.cell import CellLayer
from ann_dc.decomposition import PRINTED, SWITCHES
from ann_dc.errors import NetworkError
from ann_dc.evaluation import CompiledEvaluator, evaluator
from ann_dc.network import FUNCTIONS, Cell, Connection, Limiter, Network, Neuron, Sum, Template


def assert_close(actual, expected, relative=1e-12) -> None:
    expected = np.asarray(expected)
    scale = np.abs(expected).max(initial=0.0)
    np.testing.assert_allclose(actual, expected, rtol=relative, atol=relative * scale)


def assert_is_the_reference(network: Network, x: np.ndarray, relative=1e-12, **options) -> None:
    """Drives, move, residuals and Jacobian of states (B, n), against NumPy and the kernel."""
    cell, kernel = CellLayer(network, **options), CompiledEvaluator(network)
    flow = cell.flow()
    state = cell.fill(torch.as_tensor(x).to(cell.start.rows), flow.inputs)
    drives = flow.read(state).drives
    assert_close(drives.permute(2, 0, 1), evaluator(network).drives(x), relative)
    assert_close(cell.pack(flow.move(drives, state)), evaluator(network).rhs(x), relative)
    residuals = [kernel.residuals(sample) for sample in x]
    assert_close(flow.residuals(state, drives).T, residuals, relative)
    entries = [kernel.jacobian_entries(sample) for sample in x]
    assert_close(flow.jacobian_entries(state).T, entries, relative)


@pytest.mark.parametrize("wired", [small, coordinated])
@pytest.mark.parametrize("name", SUITE)
class TestEveryProblem:
    def test_is_the_reference(self, name, wired):
        network = wired(name)
        assert_is_the_reference(network, near_start(network, 1, count=3))

    def test_in_single_precision(self, name, wired):
        network = wired(name)
        assert_is_the_reference(network, near_start(network, 2, count=3), 1e-4, dtype=torch.float32)

    def test_a_step_is_forward_euler(self, name, wired):
        network = wired(name)
        x = near_start(network, 3, count=3)
        after = CellLayer(network)(torch.as_tensor(x), step=0.2)
        assert_close(after, x + 0.2 * evaluator(network).rhs(x))


@pytest.mark.parametrize("form", [*SWITCHES.values(), PRINTED], ids=str)
def test_every_form_of_the_car(form):
    network = small("car", form)
    assert_is_the_reference(network, near_start(network, 4, count=3))


def test_constants_of_their_own_in_every_stage():
    network, rng = coordinated("car"), np.random.default_rng(5)
    stages = network.stages
    cell = network.cell
    connections = tuple(
        replace(c, weight=np.asarray(c.weight) * rng.uniform(0.5, 2.0, stages))
        for c in cell.connections
    )
    neurons = tuple(
        replace(n, tau=np.asarray(n.tau) * rng.uniform(0.5, 2.0, stages)) for n in cell.neurons
    )
    network = replace(network, cell=replace(cell, connections=connections, neurons=neurons))
    assert_is_the_reference(network, near_start(network, 5, count=3))


@pytest.mark.parametrize("size", [0.0, 1e-6, 1e-2])
def test_residuals_have_a_floor(size):
    """Near zero they are no longer relative: where and how is the kernel's to say."""
    network = small("double_integrator").with_inputs({"q_d.x": size})
    x = size * near_start(network, 17, count=3)
    assert_is_the_reference(network, x)


@pytest.mark.parametrize("block", FUNCTIONS, ids=lambda block: block.name)
def test_function_blocks_and_their_slopes(block):
    low, high = np.clip(block.domain, -2.0, 2.0)
    x = low + (high - low) * np.array([0.03, 0.21, 0.47, 0.64, 0.98])
    values = block.value(torch.as_tensor(x), torch)
    np.testing.assert_allclose(values, block.value(x), rtol=1e-14)
    slopes = block.slope(torch.as_tensor(x), values, torch)
    np.testing.assert_allclose(slopes, block.slope(x, block.value(x)), rtol=1e-14)


def wire(source: str, target: str, weight=1.0, template=Template.SELF) -> Connection:
    return Connection(source=source, target=target, weight=weight, template=template)


def test_neighbours_and_the_left_end():
    """As `test_reference.test_sources_in_neighbours_and_ends`, without the multiplier."""
    cell = Cell(
        neurons=(Neuron(name="x", tau=2.0), Neuron(name="y")),
        inputs=("edge",),
        blocks=(Sum(name="s"),),
        connections=(
            wire("x", "s", 3.0, Template.PREVIOUS),
            wire("s", "y"),
            wire("y", "x", [1.0, 10.0, 100.0], Template.NEXT),
            wire("one", "x", 0.5),
        ),
    )
    network = Network(cell=cell, stages=3, inputs={"edge": 7.0}, left={"x": "edge"})
    x, y = np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0])
    layer, state = CellLayer(network), torch.as_tensor(np.stack([x, y]))[:, :, None]
    flow = layer.flow()
    move = flow.move(flow.read(state).drives, state)[:, :, 0]
    np.testing.assert_allclose(move[0], (np.array([1, 10, 100]) * [5, 6, 0] + 0.5) / 2)
    np.testing.assert_allclose(move[1], 3 * np.array([7, 1, 2]))


# ---- rails -------------------------------------------------------------------------------------


def railed(network: Network, size: float) -> Network:
    """The same network with every neuron between -size and size."""
    rails = Limiter(low=-size, high=size)
    neurons = tuple(replace(n, limiter=rails) for n in network.cell.neurons)
    return replace(network, cell=replace(network.cell, neurons=neurons))


@pytest.mark.parametrize("name", ["car", "double_integrator", "van_der_pol"])
def test_rails_are_the_reference_too(name):
    network = railed(small(name), 0.5)
    x = near_start(network, 6, count=3).clip(-0.5, 0.5)
    assert 0 < (np.abs(x) == 0.5).sum() < x.size
    assert_is_the_reference(network, x)


def between_rails(network: Network, size: float) -> np.ndarray:
    """States (5, n) between -size and size, about half of them at one of the two."""
    return (
        np.random.default_rng(7).uniform(-2 * size, 2 * size, (5, network.size)).clip(-size, size)
    )


@pytest.mark.parametrize("wired", [small, coordinated])
def test_a_step_stops_at_the_rails(wired):
    network = railed(wired("car"), 0.5)
    x = between_rails(network, 0.5)
    after = CellLayer(network)(torch.as_tensor(x), step=0.3)
    assert_close(after, (x + 0.3 * evaluator(network).rhs(x)).clip(-0.5, 0.5))


def test_coordinators_stop_at_the_rails():
    network = railed(coordinated("car"), 0.5)
    assert_is_the_reference(network, between_rails(network, 0.5))


@pytest.mark.parametrize("drive", [-1.0, 1.0])
def test_a_rail_stops_what_pushes_outward(drive):
    cell = Cell(
        neurons=(Neuron(name="x", limiter=Limiter(low=-2.0, high=3.0)),),
        inputs=("drive",),
        connections=(wire("drive", "x"),),
    )
    network = Network(cell=cell, stages=5, inputs={"drive": drive})
    x = np.array([-2.5, -2.0, 0.0, 3.0, 3.5])
    flow = CellLayer(network).flow()
    state = torch.as_tensor(x)[None, :, None]
    drives = flow.read(state).drives
    expected = np.where((x <= -2) & (drive < 0) | (x >= 3) & (drive > 0), 0.0, drive)
    np.testing.assert_array_equal(flow.move(drives, state)[0, :, 0], expected)


# ---- names in a state_dict ---------------------------------------------------------------------


def test_a_state_dict_speaks_the_networks_names():
    network = coordinated("car")
    state = CellLayer(network).state_dict()
    neurons = [neuron.name for neuron in network.cell.neurons]
    expected = [f"weight.{name}" for name in evaluator(network).edges]
    expected += [f"{group}.{name}" for group in ("tau", "start") for name in neurons]
    expected += [f"input.{name}" for name in network.cell.inputs]
    expected += [f"coordinator.level_{j}" for j in range(len(network.metric.gains))]
    assert sorted(state) == sorted(expected)
    assert {"tau.mu.phi", "start.q.x", "input.q_d.x", "coordinator.level_0"} <= set(state)
    np.testing.assert_array_equal(state["input.q_d.x"], [5.0] * 4)
    np.testing.assert_array_equal(state["coordinator.level_0"], network.metric.gains[0])
    for connection in network.cell.connections:
        weight = np.broadcast_to(connection.weight, 4)
        np.testing.assert_array_equal(state[f"weight.{connection.name}"], weight)


def test_trainable_factors_have_names_too():
    network = coordinated("double_integrator")
    fixed = set(CellLayer(network).state_dict())
    added = set(CellLayer(network, trainable=True).state_dict()) - fixed
    neurons = [neuron.name for neuron in network.cell.neurons]
    duals = [dual.neuron for dual in network.cell.duals]
    levels = [f"level_{j}" for j in range(len(network.metric.gains))]
    assert added == {
        *(f"log_gain.tau.{name}" for name in neurons),
        *(f"log_gain.rho.{name}" for name in duals),
        *(f"log_gain.coordinator.{name}" for name in levels),
    }


def through_a_file(state: dict) -> dict:
    file = io.BytesIO()
    torch.save(state, file)
    file.seek(0)
    return torch.load(file, weights_only=True)


@pytest.mark.parametrize("wired", [small, coordinated])
def test_a_state_dict_survives_a_file(wired):
    """Loaded into a layer with other constants, it moves as the one that was saved."""
    network, rng = wired("car"), np.random.default_rng(8)
    saved, loaded = (CellLayer(network, trainable=True) for _ in range(2))
    with torch.no_grad():
        for tensor in (*saved.parameters(), saved.weight.rows, saved.tau.rows, saved.input.rows):
            tensor *= torch.as_tensor(rng.uniform(0.5, 2.0, tensor.shape))
        saved.log_gain.rows += 0.1
        saved.start.rows += 1.0
    x = torch.as_tensor(near_start(network, 8, count=3))
    assert not torch.equal(loaded(x, step=0.1), saved(x, step=0.1))
    loaded.load_state_dict(through_a_file(saved.state_dict()))
    assert torch.equal(loaded(x, step=0.1), saved(x, step=0.1))
    assert torch.equal(loaded.start_vector(), saved.start_vector())


def test_a_saved_layer_is_a_copy():
    layer = CellLayer(small("double_integrator"))
    state = layer.state_dict()
    state["tau.q.x"] *= 7.0
    assert float(layer.tau["q.x"][0]) == 1.0


def test_what_does_not_fit_is_reported():
    layer = CellLayer(small("car"))
    state = layer.state_dict()
    del state["tau.mu.phi"]
    state["weight.nowhere<-nothing"] = torch.zeros(4)
    state["start.q.x"] = torch.zeros(5)
    with pytest.raises(RuntimeError) as error:
        layer.load_state_dict(state)
    message = str(error.value)
    assert '"tau.mu.phi"' in message.partition("Missing key(s)")[2]
    assert '"weight.nowhere<-nothing"' in message.partition("Unexpected key(s)")[2]
    assert "start.q.x: expected the shape (4,), got (5,)" in message


def test_keys_of_another_network_are_told_without_an_error():
    layer, state = CellLayer(small("car")), {"tau.q.z": torch.ones(4)}
    meaning = layer.load_state_dict(state, strict=False)
    assert meaning.unexpected_keys == ["tau.q.z"]
    assert sorted(meaning.missing_keys) == sorted(layer.state_dict())


def test_neurons_may_be_called_as_methods_of_torch_are():
    names = ("q.train", "forward", "rows", "q.state_dict")
    cell = Cell(
        neurons=tuple(Neuron(name=name) for name in names),
        connections=tuple(wire(name, name, -1.0) for name in names),
    )
    network = Network(cell=cell, stages=2, start=dict.fromkeys(names, 1.0))
    layer = CellLayer(network, trainable=True)
    layer.load_state_dict(through_a_file(layer.state_dict()))
    np.testing.assert_allclose(
        layer(layer.start_vector(), step=0.25).detach(), np.full((1, 8), 0.75)
    )


# ---- gains that learn --------------------------------------------------------------------------


def with_factors(network: Network, seed: int) -> CellLayer:
    """A layer whose gains have random factors between a half and two."""
    layer = CellLayer(network, trainable=True)
    with torch.no_grad():
        factors = np.random.default_rng(seed).uniform(-0.7, 0.7, len(layer.log_gain.rows))
        layer.log_gain.rows += torch.as_tensor(factors)
    return layer


@settings(max_examples=25, deadline=None)
@given(theta=st.floats(-100, 100))
def test_gains_are_positive_whatever_the_parameters(theta):
    network = coordinated("double_integrator")
    layer = CellLayer(network, trainable=True)
    torch.nn.init.constant_(layer.log_gain.rows, theta)
    weights, rates, grids = (tensor.detach() for tensor in layer.constants())
    factor = np.exp(theta)
    assert_close(rates[:, :, 0], evaluator(network).tape.rates / factor)
    assert_close(grids, evaluator(network).tape.grids * factor)
    for connection, row in evaluator(network).edges.items():
        trained = connection in [f"{d.multiplier}<-{d.residual}" for d in network.cell.duals]
        expected = evaluator(network).tape.weights[row] * (factor if trained else 1.0)
        assert_close(weights[row, :, 0], expected)
        assert not trained or (expected > 0).all()


def test_one_factor_one_gain():
    """Doubling what the logarithm says of one tau halves the moves of that neuron alone."""
    network = small("double_integrator")
    layer, x = CellLayer(network, trainable=True), near_start(network, 9)
    with torch.no_grad():
        layer.log_gain["tau.mu.v"].copy_(torch.tensor(np.log(2.0)))
    moves = layer(torch.as_tensor(x)[None], step=1.0)[0].detach().numpy() - x
    ours = network.places[:, 0] == network.neuron_index["mu.v"]
    assert_close(moves, np.where(ours, 0.5, 1.0) * evaluator(network).rhs(x), 1e-10)


@pytest.mark.parametrize("wired", [small, coordinated])
@pytest.mark.parametrize("seed", [None, 10])
def test_the_trained_network_moves_as_the_layer(wired, seed):
    network = wired("car")
    layer = CellLayer(network, trainable=True) if seed is None else with_factors(network, seed)
    trained, x = layer.trained(), near_start(network, 10, count=3)
    flow = layer.flow()
    state = layer.fill(torch.as_tensor(x), flow.inputs)
    drives = flow.read(state).drives
    assert_close(evaluator(trained).rhs(x), layer.pack(flow.move(drives, state)).detach())
    if seed is None:
        assert_close(evaluator(trained).rhs(x), evaluator(network).rhs(x))
        assert_close(evaluator(trained).jacobian(x[0]), evaluator(network).jacobian(x[0]))
    else:
        assert np.abs(evaluator(trained).rhs(x) - evaluator(network).rhs(x)).max() > 1e-3


def test_trained_keeps_penalties_of_every_stage():
    network = small("double_integrator")
    paths = [f"{dual.multiplier}<-{dual.residual}" for dual in network.cell.duals]
    connections = tuple(
        replace(c, weight=c.weight * np.arange(1.0, 5.0)) if c.name in paths else c
        for c in network.cell.connections
    )
    network = replace(network, cell=replace(network.cell, connections=connections))
    x = near_start(network, 10)
    assert_close(
        evaluator(CellLayer(network, trainable=True).trained()).rhs(x), evaluator(network).rhs(x)
    )


def test_a_layer_without_trainable_gains_has_nothing_to_train():
    assert list(CellLayer(small("car")).parameters()) == []


def test_training_lowers_the_residual():
    network = coordinated("double_integrator")
    layer = RecurrentLayer(network, step=FixedStep(step=0.4), trainable=True)

    def loss() -> torch.Tensor:
        flow = layer.cell.flow()
        state = layer.cell.fill(layer(steps=10), flow.inputs)
        return flow.residuals(state, flow.read(state).drives).square().sum()

    optimiser = torch.optim.Adam(layer.parameters(), lr=0.05)
    losses = []
    for _ in range(8):
        optimiser.zero_grad()
        losses.append(loss())
        losses[-1].backward()
        optimiser.step()
    assert loss() < 0.9 * losses[0]


# ---- gradients ---------------------------------------------------------------------------------


def unrolled(layer: CellLayer, x, q_0, q_d, steps: int = 3) -> torch.Tensor:
    for _ in range(steps):
        x = layer(x, {"q_0.x": q_0, "q_d.x": q_d}, step=0.2)
    return x


@pytest.mark.parametrize("wired", [small, coordinated])
def test_gradients_in_states_and_inputs(wired):
    network = wired("unicycle")
    layer = CellLayer(network)
    x = torch.as_tensor(near_start(network, 11, count=2)).requires_grad_()
    q_0 = torch.tensor([0.1, -0.1], dtype=torch.float64, requires_grad=True)
    q_d = torch.rand(2, network.stages, dtype=torch.float64).requires_grad_()
    assert torch.autograd.gradcheck(lambda *given: unrolled(layer, *given), (x, q_0, q_d))


def test_gradients_in_the_gains():
    network = coordinated("unicycle")
    layer = with_factors(network, 12)
    x = torch.as_tensor(near_start(network, 12, count=2))

    def after(factors: torch.Tensor) -> torch.Tensor:
        return torch.func.functional_call(layer, {"log_gain.rows": factors}, (x,), {"step": 0.2})

    assert torch.autograd.gradcheck(after, layer.log_gain.rows.detach().requires_grad_())


def test_gradients_through_a_layer():
    network = small("double_integrator")
    layer = RecurrentLayer(network, step=FixedStep(step=0.2))
    x = torch.as_tensor(near_start(network, 13, count=2)).requires_grad_()
    q_d = torch.tensor([1.0, 1.5], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda x, q_d: layer(x, {"q_d.x": q_d}, steps=3), (x, q_d))


# ---- a batch of inputs -------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["corrected", "S14"])
def test_samples_with_inputs_of_their_own(form):
    network = coordinated("car") if form == "corrected" else small("car", SWITCHES[form])
    rng = np.random.default_rng(14)
    x = near_start(network, 14, count=3)
    inputs = {
        "q_0.y": rng.standard_normal(3),
        "q_d.x": rng.standard_normal((3, network.stages)),
        "q_d.phi": 0.3,
        "q_0.phi": torch.as_tensor(rng.standard_normal(3)),
    }
    after = CellLayer(network)(torch.as_tensor(x), inputs, step=0.2)
    for sample in range(3):
        own = {
            name: value if np.ndim(value) == 0 else np.asarray(value)[sample]
            for name, value in inputs.items()
        }
        assert_close(
            after[sample], x[sample] + 0.2 * evaluator(network.with_inputs(own)).rhs(x[sample])
        )


def test_one_input_for_all_samples():
    network = small("car")
    layer, x = CellLayer(network), near_start(network, 15, count=3)
    after = layer(torch.as_tensor(x), {"q_d.x": 4.0}, step=0.2)
    assert_close(after, x + 0.2 * evaluator(network.with_inputs({"q_d.x": 4.0})).rhs(x))


# ---- where a layer lives -----------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.int64, torch.complex128])
def test_two_precisions(dtype):
    with pytest.raises(NetworkError, match=r"^dtype: expected torch.float32 or torch.float64"):
        CellLayer(small("car"), dtype=dtype)


def test_an_unknown_device():
    with pytest.raises(NetworkError, match="device: 'abacus' is no device that torch knows"):
        CellLayer(small("car"), device="abacus")


@pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has CUDA")
def test_cuda_where_there_is_none():
    with pytest.raises(NetworkError, match=r"no CUDA device; use device='cpu', or install"):
        CellLayer(small("car"), device="cuda")


@pytest.mark.skipif(not torch.cuda.is_available(), reason="this machine has no CUDA")
def test_cuda_is_the_reference_too():
    network = designed("car").network
    x = near_start(network, 16, count=3)
    after = CellLayer(network, device="cuda")(torch.as_tensor(x, device="cuda"), step=0.2)
    assert_close(after.cpu(), x + 0.2 * evaluator(network).rhs(x))
