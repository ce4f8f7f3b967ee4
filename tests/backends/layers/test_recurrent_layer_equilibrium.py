"""The settled point as a function of the inputs, differentiated."""

import numpy as np
import pytest
import torch
from problems import SUITE
from recurrent_runs import short, suited, wire
from reference import ipopt

from ann_dc import design
from ann_dc.backends.layers.recurrent_layer import RecurrentLayer
from ann_dc.backends.settling import Settling
from ann_dc.network.cell import Cell, Limiter, Neuron
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind

EXACT = Settling(tolerance=1e-11, confirm=0.5)


def jacobian(outputs: torch.Tensor, given: torch.Tensor) -> np.ndarray:
    """d outputs / d given, (n, m) for outputs (n,) and given (m,)."""
    rows = [torch.autograd.grad(value, given, retain_graph=True)[0] for value in outputs]
    return torch.stack(rows).numpy()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["double_integrator", pytest.param("car", marks=pytest.mark.slow)])
@pytest.mark.parametrize("which", ["q_0.{}", pytest.param("q_d.{}", marks=pytest.mark.slow)])
def test_the_derivative_of_the_settled_point(name, which):
    """Against central differences of networks that were settled again."""
    network = suited(name).network
    layer, which = RecurrentLayer(network), which.format(SUITE[name].problem.states[0])
    at, eps = float(network.inputs[which][0]), 1e-3
    goal = torch.tensor([at], dtype=torch.float64, requires_grad=True)
    found = jacobian(layer.equilibrium({which: goal}, settling=EXACT)[0], goal)[:, 0]
    ends = layer.settle(inputs={which: [at - eps, at + eps]}, settling=EXACT)
    assert ends.settled.all()
    expected = (ends.states[1] - ends.states[0]).numpy() / (2 * eps)
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["double_integrator", pytest.param("car", marks=pytest.mark.slow)])
@pytest.mark.parametrize("which", ["q_d", "q_0"])
def test_the_derivative_of_the_optimal_controls(name, which):
    """Against IPOPT, which solves the problem again on either side."""
    problem, network = SUITE[name].problem, suited(name).network
    layer, neurons = RecurrentLayer(network), network.neuron_index
    at = getattr(problem, which)
    goal = torch.tensor([float(at[0])], dtype=torch.float64, requires_grad=True)
    settled = layer.equilibrium({f"{which}.{problem.states[0]}": goal}, settling=EXACT)[0]
    slopes = network.unpack(jacobian(settled, goal)[:, 0])
    units = [network.neuron(f"u.{u}").scale.factor for u in problem.controls]
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


@pytest.mark.slow
def test_gains_do_not_move_the_optimum():
    """The derivative by every gain is zero, whatever they do to the way there."""
    layer = RecurrentLayer(short("car"), trainable=True)
    settled = layer.equilibrium(settling=EXACT)
    settled.square().sum().backward()
    np.testing.assert_allclose(layer.cell.log_gain.rows.grad, 0.0, atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["double_integrator", pytest.param("car", marks=pytest.mark.slow)])
def test_unrolled_long_enough_the_derivative_is_the_same(name):
    network = design(SUITE[name].problem, preconditioner=PreconditionerKind.MULTILEVEL).network
    layer, first = RecurrentLayer(network), SUITE[name].problem.states[0]
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


@pytest.mark.slow
def test_samples_that_did_not_settle_are_no_numbers():
    layer, goals = RecurrentLayer(short("car")), torch.tensor([5.0, float("nan"), 4.5])
    settled = layer.equilibrium({"q_d.x": goals}, limit=2000)
    assert settled.isnan().all(1).tolist() == [False, True, False]
    assert layer.equilibrium({"q_d.x": goals}, limit=3).isnan().all()


@pytest.mark.slow
def test_a_sample_that_did_not_settle_leaves_the_others_their_derivatives():
    """Of what all samples share, too."""
    layer = RecurrentLayer(short("car"))
    start = torch.tensor(0.0, dtype=torch.float64, requires_grad=True)
    alone = layer.equilibrium({"q_0.y": start, "q_d.x": [5.0]}, limit=2000)
    (expected,) = torch.autograd.grad(alone.sum(), start)
    both = layer.equilibrium({"q_0.y": start, "q_d.x": [5.0, np.nan]}, limit=2000)
    (found,) = torch.autograd.grad(both[0].sum(), start)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


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
