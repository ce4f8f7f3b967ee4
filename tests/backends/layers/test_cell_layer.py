"""The cell layer: the network's own numbers in torch, and gradients through them."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from cell_layers import assert_close, wire, with_factors
from clamped_runs import COUPLED, OF_RUNS, rails_of, run_with_changes, with_limits
from designs import coordinated, designed, near_start, small, wired_with
from problems import SUITE

from ann_dc.backends.layers.cell_layer import CellLayer
from ann_dc.backends.layers.fixed_order import LIBRARY
from ann_dc.backends.layers.recurrent_layer import RecurrentLayer
from ann_dc.backends.step_rules import FixedStep
from ann_dc.decomposition.form import PRINTED, SWITCHES
from ann_dc.errors import NetworkError
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.cell import Cell, Limiter, Neuron, Sum, Template
from ann_dc.network.functions import FUNCTIONS
from ann_dc.network.network import Network

every_coupled = pytest.mark.parametrize("kind", COUPLED, ids=lambda kind: kind.name.lower())


def assert_is_the_reference(network: Network, x: np.ndarray, relative=1e-12, **options) -> None:
    """Drives, move, residuals and Jacobian of states (B, n), against NumPy and the kernel."""
    cell, kernel = CellLayer(network, **options), InterpretedEvaluator(network)
    flow = cell.flow()
    state = cell.fill(torch.as_tensor(x).to(cell.start.rows), flow.inputs)
    reading = flow.read(state)
    drives = reading.drives
    assert_close(drives.permute(2, 0, 1), evaluator(network).drives(x), relative)
    assert_close(
        cell.pack(flow.derivative(reading.arriving, state)), evaluator(network).rhs(x), relative
    )
    residuals = [kernel.residuals(sample) for sample in x]
    assert_close(flow.residuals(state, drives).T, residuals, relative)
    entries = [kernel.jacobian_entries(sample) for sample in x]
    assert_close(flow.jacobian_entries(state).T, entries, relative)


@pytest.mark.parametrize("wired", [small, coordinated])
@pytest.mark.parametrize("name", SUITE)
class TestEveryProblem:
    @pytest.mark.sampled
    def test_is_the_reference(self, name, wired):
        network = wired(name)
        assert_is_the_reference(network, near_start(network, 1, count=3))

    @pytest.mark.sampled
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
    values = block.value(torch.as_tensor(x), LIBRARY)
    np.testing.assert_allclose(values, block.value(x), rtol=1e-14)
    slopes = block.slope(torch.as_tensor(x), values, LIBRARY)
    np.testing.assert_allclose(slopes, block.slope(x, block.value(x)), rtol=1e-14)


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
    network = Network(cell=cell, stages=3, inputs={"edge": 7.0}, left_boundary={"x": "edge"})
    x, y = np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0])
    layer, state = CellLayer(network), torch.as_tensor(np.stack([x, y]))[:, :, None]
    flow = layer.flow()
    derivative = flow.derivative(flow.read(state).arriving, state)[:, :, 0]
    np.testing.assert_allclose(derivative[0], (np.array([1, 10, 100]) * [5, 6, 0] + 0.5) / 2)
    np.testing.assert_allclose(derivative[1], 3 * np.array([7, 1, 2]))


# ---- rails -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["car", "double_integrator", "van_der_pol"])
def test_rails_are_the_reference_too(name):
    network = with_limits(small(name), 0.5)
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
    network = with_limits(wired("car"), 0.5)
    x = between_rails(network, 0.5)
    after = CellLayer(network)(torch.as_tensor(x), step=0.3)
    assert_close(after, (x + 0.3 * evaluator(network).rhs(x)).clip(-0.5, 0.5))


def test_coordinators_stop_at_the_rails():
    network = with_limits(coordinated("car"), 0.5)
    assert_is_the_reference(network, between_rails(network, 0.5))


@pytest.mark.sampled(1)
@every_coupled
def test_samples_at_rails_have_the_same_bits_alone_and_in_a_batch(kind):
    network, states, _ = run_with_changes(kind)
    layer, x = CellLayer(network), torch.as_tensor(states[::7])
    batch = layer(x, step=0.1)
    expected = [evaluator(network).rhs(sample) for sample in states[::7]]
    low, high = rails_of(network)
    assert_close(batch, (states[::7] + 0.1 * np.array(expected)).clip(low, high))
    for sample in range(0, len(x), 5):
        assert torch.equal(layer(x[sample], step=0.1)[0], batch[sample])


@pytest.mark.sampled(2)
@every_coupled
def test_samples_at_rails_in_single_precision_move_as_in_double(kind):
    network, states, _ = run_with_changes(kind)
    single = CellLayer(network, dtype=torch.float32)(torch.as_tensor(states).float(), step=0.1)
    assert_close(single, CellLayer(network)(torch.as_tensor(states), step=0.1), 1e-4)


@pytest.mark.sampled(2)
@every_coupled
def test_trained_time_constants_at_rails_move_as_those_of_the_trained_network(kind):
    network, states, _ = run_with_changes(kind)
    layer, flow = with_factors(network, 12), with_factors(network, 12).flow()
    state = layer.fill(torch.as_tensor(states[::20]), flow.inputs)
    with torch.no_grad():
        derivatives = layer.pack(flow.derivative(flow.read(state).arriving, state))
    trained = evaluator(layer.trained())
    assert_close(derivatives, [trained.rhs(x) for x in states[::20]])


@pytest.mark.slow
@pytest.mark.parametrize("kind", OF_RUNS, ids=lambda kind: kind.name.lower())
def test_gradients_at_rails_are_those_of_the_neurons_that_are_free(kind):
    """In states beyond their rails, where a small change of them holds the same neurons."""
    network = with_limits(wired_with("double_integrator", kind), 0.2)
    layer = with_factors(network, 12)
    x = np.random.default_rng(7).uniform(-0.4, 0.4, (2, network.size))
    x = torch.as_tensor(x).requires_grad_()
    q_d = torch.tensor([1.0, -1.0], dtype=torch.float64, requires_grad=True)
    factors = layer.log_gain.rows.detach().requires_grad_()

    def derivatives(x: torch.Tensor, q_d: torch.Tensor, factors: torch.Tensor) -> torch.Tensor:
        given = x, {"q_d.x": q_d}
        return torch.func.functional_call(
            Derivatives(layer), {"layer.log_gain.rows": factors}, given
        )

    assert (derivatives(x, q_d, factors) == 0).any()
    assert torch.autograd.gradcheck(derivatives, (x, q_d, factors))


class Derivatives(torch.nn.Module):
    """The moves (B, n) of a layer, as a module."""

    def __init__(self, layer: CellLayer) -> None:
        super().__init__()
        self.layer = layer

    def forward(self, x: torch.Tensor, inputs: dict) -> torch.Tensor:
        flow = self.layer.flow(inputs)
        state = self.layer.fill(x, flow.inputs)
        return self.layer.pack(flow.derivative(flow.read(state).arriving, state))


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
    np.testing.assert_array_equal(flow.derivative(drives, state)[0, :, 0], expected)


# ---- gradients ---------------------------------------------------------------------------------


def unrolled(layer: CellLayer, x, q_0, q_d, steps: int = 3) -> torch.Tensor:
    for _ in range(steps):
        x = layer(x, {"q_0.x": q_0, "q_d.x": q_d}, step=0.2)
    return x


@pytest.mark.sampled(1)
@pytest.mark.parametrize("wired", [small, coordinated])
def test_gradients_in_states_and_inputs(wired):
    network = wired("unicycle")
    layer = CellLayer(network)
    x = torch.as_tensor(near_start(network, 11, count=2)).requires_grad_()
    q_0 = torch.tensor([0.1, -0.1], dtype=torch.float64, requires_grad=True)
    generator = torch.Generator().manual_seed(0)
    q_d = torch.rand(2, network.stages, dtype=torch.float64, generator=generator)
    q_d.requires_grad_()
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
    with pytest.raises(NetworkError, match="device: 'abacus' is unknown to torch"):
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
