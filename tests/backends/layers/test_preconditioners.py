"""Every kind of preconditioner in torch: batches, two precisions, gradients, orders, compiled
graphs.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch
from designs import near_start, wired_with
from random_preconditioners import random_preconditioner, with_stiffness

import ann_dc
from ann_dc.backends.layers.cell_layer import CellLayer
from ann_dc.backends.layers.preconditioners import EliminationLayer
from ann_dc.backends.layers.recurrent_layer import RecurrentLayer
from ann_dc.backends.settling import Settling
from ann_dc.backends.step_rules import TWO_PHASE, FixedStep
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind

every_kind = pytest.mark.parametrize("kind", PreconditionerKind, ids=lambda kind: kind.name.lower())
stiff = pytest.mark.parametrize(
    "kind",
    [PreconditionerKind.RESISTIVE_GRID, PreconditionerKind.CYCLIC_REDUCTION],
    ids=["grid", "tree"],
)


def assert_close(actual, expected, relative=1e-12) -> None:
    expected = np.asarray(expected)
    np.testing.assert_allclose(actual, expected, atol=relative * np.abs(expected).max(), rtol=0)


def moves_of(cell: CellLayer, drives: np.ndarray) -> np.ndarray:
    """M d (B, n) of the layer, for drives (B, n)."""
    layout, constants = cell.layout, cell.constants()
    flat = torch.zeros(layout.live.numel(), len(drives), dtype=cell.start.rows.dtype)
    given = torch.as_tensor(drives.T).to(flat)
    state = flat.index_copy(0, layout.places, given).reshape(*layout.live.shape[:2], -1)
    return cell.pack(layout.preconditioner(constants, state)).detach().numpy()


@every_kind
@pytest.mark.parametrize(("dtype", "relative"), [(torch.float64, 1e-12), (torch.float32, 2e-5)])
def test_a_batch_moves_by_the_preconditioner(kind, dtype, relative):
    network = wired_with("car", kind)
    drives = np.random.default_rng(0).standard_normal((5, network.size))
    derivatives = moves_of(CellLayer(network, dtype=dtype), drives)
    assert_close(derivatives, drives @ evaluator(network).preconditioner.toarray(), relative)


@pytest.mark.sampled(8)
@stiff
@pytest.mark.parametrize("stages", [1, 2, 3, 5, 6, 16, 17])
def test_rows_of_any_length(stages, kind):
    network = with_stiffness(ann_dc.synthesize(ann_dc.plants.car(N=stages)), kind)
    drives = np.random.default_rng(1).standard_normal((2, network.size))
    assert isinstance(CellLayer(network).layout.preconditioner, EliminationLayer)
    assert_close(
        moves_of(CellLayer(network), drives), drives @ evaluator(network).preconditioner.toarray()
    )


@pytest.mark.sampled(5)
@pytest.mark.parametrize(
    "kind", [PreconditionerKind.MULTILEVEL, PreconditionerKind.COUPLED_MULTILEVEL]
)
@pytest.mark.parametrize("stages", [127, 128, 129, 200])
def test_long_pyramids(stages, kind):
    """Every point of the finest level hears the positions under its hat, however many."""
    network = ann_dc.synthesize(ann_dc.plants.double_integrator(N=stages))
    preconditioner = random_preconditioner(kind, network.layout, np.random.default_rng(8))
    network = replace(network, preconditioner=preconditioner)
    drives = np.random.default_rng(9).standard_normal((2, network.size))
    expected = drives @ evaluator(network).preconditioner.toarray()
    assert_close(moves_of(CellLayer(network), drives), expected, 1e-11)


@every_kind
def test_random_numbers(kind):
    network = wired_with("unicycle", PreconditionerKind.DIAGONAL)
    preconditioner = random_preconditioner(kind, network.layout, np.random.default_rng(2))
    network = replace(network, preconditioner=preconditioner)
    drives = np.random.default_rng(3).standard_normal((2, network.size))
    expected = drives @ evaluator(network).preconditioner.toarray()
    assert_close(moves_of(CellLayer(network), drives), expected, 1e-11)


def trained_a_little(network: Network, seed: int = 4) -> CellLayer:
    cell = CellLayer(network, trainable=True)
    rng = np.random.default_rng(seed)
    with torch.no_grad():
        rows = cell.log_gain.rows
        rows += torch.as_tensor(0.2 * rng.standard_normal(rows.shape))
    return cell


@every_kind
def test_a_trained_network_has_the_preconditioner_of_the_layer(kind):
    """Time constants are trained, S stays: what comes back moves as the layer does."""
    cell = trained_a_little(wired_with("car", kind))
    network = cell.trained()
    assert network.preconditioner.kind is kind
    drives = np.random.default_rng(5).standard_normal((2, network.size))
    assert_close(
        moves_of(cell, drives), drives @ evaluator(network).preconditioner.toarray(), 1e-11
    )
    again = CellLayer(network)
    assert_close(moves_of(again, drives), moves_of(cell, drives), 1e-11)


@pytest.mark.sampled(2)
@every_kind
def test_gradients_in_the_gains(kind):
    network = wired_with("unicycle", kind)
    cell = trained_a_little(network)
    x = torch.as_tensor(near_start(network, 12, count=2))

    def after(factors: torch.Tensor) -> torch.Tensor:
        return torch.func.functional_call(cell, {"log_gain.rows": factors}, (x,), {"step": 0.2})

    assert torch.autograd.gradcheck(after, cell.log_gain.rows.detach().requires_grad_())


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "kind",
    [
        *(PreconditionerKind.DIAGONAL, PreconditionerKind.CYCLIC_REDUCTION),
        *(
            pytest.param(k, marks=pytest.mark.slow)
            for k in (
                PreconditionerKind.MULTILEVEL,
                PreconditionerKind.COUPLED_MULTILEVEL,
                PreconditionerKind.RESISTIVE_GRID,
            )
        ),
    ],
)
def test_gradients_through_unrolled_steps(kind):
    network = wired_with("double_integrator", kind)
    layer = RecurrentLayer(network, step=FixedStep(step=0.1))
    x = torch.as_tensor(near_start(network, 13, count=2)).requires_grad_()
    q_d = torch.tensor([1.0, 1.5], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda x, q_d: layer(x, {"q_d.x": q_d}, steps=3), (x, q_d))


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "kind",
    [
        *(PreconditionerKind.MULTILEVEL, PreconditionerKind.CYCLIC_REDUCTION),
        *(
            pytest.param(kind, marks=pytest.mark.slow)
            for kind in (PreconditionerKind.COUPLED_MULTILEVEL, PreconditionerKind.RESISTIVE_GRID)
        ),
    ],
    ids=lambda kind: kind.name.lower(),
)
def test_the_settled_point_and_its_slope_do_not_depend_on_the_kind(kind):
    """Implicit differentiation, of a batch whose samples settle at different steps."""
    exact = Settling(tolerance=1e-11, confirm=0.5)
    found = []
    for chosen in (PreconditionerKind.DIAGONAL, kind):
        layer = RecurrentLayer(wired_with("double_integrator", chosen), order=TWO_PHASE)
        goal = torch.tensor([1.0, 3.0, 0.2], dtype=torch.float64, requires_grad=True)
        states = layer.equilibrium({"q_d.x": goal}, settling=exact)
        weights = torch.linspace(-1, 1, states.shape[1], dtype=torch.float64)
        (slope,) = torch.autograd.grad((states @ weights).sum(), goal)
        found.append((states.detach().numpy(), slope.numpy()))
    for ours, plain in zip(found[1], found[0]):
        assert_close(ours, plain, 1e-7)


@pytest.mark.parametrize(
    "kind",
    [
        PreconditionerKind.RESISTIVE_GRID,
        pytest.param(PreconditionerKind.CYCLIC_REDUCTION, marks=pytest.mark.slow),
    ],
    ids=["grid", "tree"],
)
@pytest.mark.slow
def test_a_batch_settles_as_each_sample_does(kind):
    """Those that are done leave the batch; the others go on as if alone."""
    network = wired_with("double_integrator", kind)
    goals = np.array([1.0, 3.0, 0.2, 5.0])
    layer = RecurrentLayer(network, order=TWO_PHASE)
    together = layer.settle(inputs={"q_d.x": goals}, check=5)
    assert together.settled.all()
    for sample, goal in enumerate(goals):
        alone = layer.settle(inputs={"q_d.x": [goal]}, check=5)
        assert alone.settling_steps[0] == together.settling_steps[sample]
        assert_close(alone.states[0], together.states[sample], 1e-9)


@pytest.mark.parametrize(
    "kind",
    [
        PreconditionerKind.CYCLIC_REDUCTION,
        *(
            pytest.param(k, marks=pytest.mark.slow)
            for k in PreconditionerKind
            if k is not PreconditionerKind.CYCLIC_REDUCTION
        ),
    ],
)
@pytest.mark.slow
def test_one_graph_without_breaks(kind):
    """`torch.compile` sees the whole of it: no Python in between, whatever the batch."""
    network = wired_with("car", kind)
    cell = CellLayer(network)
    compiled = torch.compile(
        cell.layout.preconditioner, backend="eager", fullgraph=True, dynamic=True
    )
    for samples in (2, 5):
        shape = *cell.layout.live.shape[:2], samples
        drives = torch.as_tensor(np.random.default_rng(samples).standard_normal(shape))
        drives = drives * cell.layout.live
        expected = cell.layout.preconditioner(cell.constants(), drives)
        assert_close(compiled(cell.constants(), drives), expected)


@pytest.mark.slow
@every_kind
def test_with_compiled_blocks(kind):
    network = wired_with("double_integrator", kind)
    cell = CellLayer(network)
    x = torch.as_tensor(near_start(network, 6, count=3))
    expected = cell(x, step=0.1)
    cell.compile_blocks()
    assert_close(cell(x, step=0.1), expected, 1e-12)
