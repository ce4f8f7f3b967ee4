"""Update orders: what each of them is equal to, and what they have in common."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from clamped_runs import COUPLED, rails_of, with_limits
from designs import coordinated, designed, near_start, small, wired_with

from ann_dc.analysis.spectra import stability_limit
from ann_dc.backends.layers.cell_layer import CellLayer
from ann_dc.backends.layers.loop import derivative_of
from ann_dc.backends.layers.tape import TorchTape
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.settling import Settling
from ann_dc.backends.step_rules import (
    ORDERS,
    SIMULTANEOUS,
    STAGE_BY_STAGE,
    TWO_PHASE,
    FixedStep,
    Order,
    StepLimits,
)
from ann_dc.decomposition.form import CORRECTED, PRINTED, SWITCHES
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.tape import DUAL
from ann_dc.network.cell import Cell, Connection, Limiter, Neuron, Sum, Template
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind

NAMES = ("double_integrator", "car", "van_der_pol", "cstr")


def assert_close(actual, expected, relative=1e-12) -> None:
    expected = np.asarray(expected)
    scale = np.abs(expected).max(initial=0.0)
    np.testing.assert_allclose(actual, expected, rtol=relative, atol=relative * scale)


def moved(order: Order, network: Network, x: np.ndarray, step: float) -> np.ndarray:
    """The move m (B, n) of an order at states (B, n)."""
    layer = CellLayer(network)
    flow = layer.flow()
    state = layer.fill(torch.as_tensor(x), flow.inputs)
    _, derivative = derivative_of(
        order, flow, state, torch.full((len(x),), step, dtype=torch.float64)
    )
    return layer.pack(derivative).numpy()


def recurrence(order: Order, network: Network, x: np.ndarray, step: float, steps: int):
    """States (steps + 1, B, n) from x (B, n) on."""
    states = [x]
    for _ in range(steps):
        states.append(states[-1] + step * moved(order, network, states[-1], step))
    return np.array(states)


# ---- two-phase ---------------------------------------------------------------------------------


def integrated_ahead(network: Network, step: float) -> Network:
    """The network with rho + h / tau instead of rho, in every stage of every dual."""
    tau = {neuron.name: np.asarray(neuron.tau) for neuron in network.cell.neurons}
    paths = {f"{d.multiplier}<-{d.residual}": step / tau[d.neuron] for d in network.cell.duals}
    connections = tuple(
        replace(c, weight=c.weight + paths[c.name]) if c.name in paths else c
        for c in network.cell.connections
    )
    return replace(network, cell=replace(network.cell, connections=connections))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("wired", [small, coordinated], ids=["alone", "coordinated"])
@pytest.mark.parametrize("name", NAMES)
def test_two_phases_are_one_with_more_penalty(name, wired):
    """x+ = x - hT g(x, mu + rho c(x)), mu+ = mu + k c(x+) with k = h / tau.

    With nu_0 = mu_0 - k c(x_0), nu+ = nu + k c(x) and rho + k, the primal neurons read
    nu_j + (rho + k) c(x_j) = mu_j + rho c(x_j): the same states, and nu_{j+1} = mu_j.
    """
    network = wired(name)
    step, steps = 0.3 * StepLimits(network).dual, 30
    x = near_start(network, 1, count=2)
    dual = evaluator(network).tape.roles[network.places[:, 0]] == DUAL
    ahead = integrated_ahead(network, step)
    gap = step * network.pack(
        evaluator(network).drives(x) * evaluator(network).tape.rates
    )  # k c(x_0)
    one = recurrence(SIMULTANEOUS, ahead, np.where(dual, x - gap, x), step, steps)
    two = recurrence(TWO_PHASE, network, x, step, steps)
    assert_close(two[..., ~dual], one[..., ~dual])
    assert_close(two[:-1][..., dual], one[1:][..., dual])
    assert np.abs(two[-1] - x).max() > 0.1  # it went somewhere


def test_the_two_phase_identity_needs_the_penalty():
    network = small("double_integrator")
    x, step = near_start(network, 1, count=1), 0.2
    primal = evaluator(network).tape.roles[network.places[:, 0]] != DUAL
    one, two = (recurrence(order, network, x, step, 10) for order in (SIMULTANEOUS, TWO_PHASE))
    assert np.abs(two[-1] - one[-1])[:, primal].max() > 1e-3


@pytest.mark.parametrize("form", [CORRECTED, SWITCHES["S15"]], ids=str)
def test_primal_neurons_move_first(form):
    """Phase 1 is that of all at once, phase 2 reads the residual of what came out of it.

    In S15 duals read duals: those of before the step.
    """
    network, step = small("car", form), 0.2
    x = near_start(network, 2, count=2)
    dual = evaluator(network).tape.roles[network.places[:, 0]] == DUAL
    between = x + step * np.where(dual, 0.0, evaluator(network).rhs(x))
    expected = np.where(dual, evaluator(network).rhs(between), evaluator(network).rhs(x))
    assert_close(moved(TWO_PHASE, network, x, step), expected)


# ---- stage by stage ----------------------------------------------------------------------------


def gauss_seidel(network: Network, x: np.ndarray, step: float) -> np.ndarray:
    """x (n,) after one sweep, in plain Python, from the drives of the whole row each time."""
    program, values = evaluator(network), network.unpack(x)
    seen = np.zeros_like(values)
    for k in range(network.stages):
        drives = program.drives(network.pack(values))
        seen[:, k] = drives[:, k]
        values[:, k] += step * drives[:, k] * program.tape.rates[:, k]
    if network.preconditioner.kind is PreconditionerKind.DIAGONAL:
        return network.pack(values)
    return x + step * (program.preconditioner @ network.pack(seen))


def assert_is_gauss_seidel(network: Network, seed: int, step: float = 0.2) -> None:
    x = near_start(network, seed, count=2)
    after = x + step * moved(STAGE_BY_STAGE, network, x, step)
    assert_close(after, [gauss_seidel(network, sample, step) for sample in x])


@pytest.mark.parametrize("wired", [small, coordinated], ids=["alone", "coordinated"])
@pytest.mark.parametrize("name", NAMES)
def test_a_sweep_is_gauss_seidel(name, wired):
    assert_is_gauss_seidel(wired(name), 3)


@pytest.mark.parametrize(
    "kind",
    [
        PreconditionerKind.COUPLED_MULTILEVEL,
        PreconditionerKind.RESISTIVE_GRID,
        PreconditionerKind.CYCLIC_REDUCTION,
    ],
)
@pytest.mark.parametrize("name", NAMES)
def test_a_sweep_ends_with_the_preconditioner_of_any_kind(name, kind):
    assert_is_gauss_seidel(wired_with(name, kind), 3)


@pytest.mark.parametrize("form", [*SWITCHES.values(), PRINTED], ids=str)
def test_a_sweep_of_every_form(form):
    assert_is_gauss_seidel(small("car", form), 4)


def passed_on(times: int, template: Template) -> Network:
    """x follows the neuron that many cells away, through sums that pass it on."""
    wires = [("x", "s0"), *((f"s{j}", f"s{j + 1}") for j in range(times - 2))]
    wires += [(f"s{times - 2}", "x")]
    cell = Cell(
        neurons=(Neuron(name="x", tau=2.0),),
        inputs=("edge",),
        blocks=tuple(Sum(name=f"s{j}") for j in range(times - 1)),
        connections=(
            *(Connection(source=a, target=b, template=template) for a, b in wires),
            Connection(source="x", target="x", weight=-1.0),
        ),
    )
    start = np.cos(np.arange(8.0))
    left = {"x": "edge"} if template is Template.PREVIOUS else {}
    return Network(
        cell=cell, stages=8, inputs={"edge": 3.0}, left_boundary=left, start={"x": start}
    )


@pytest.mark.parametrize("template", [Template.PREVIOUS, Template.NEXT])
@pytest.mark.parametrize("times", [2, 3, 5, 8])
def test_a_sweep_looks_as_far_as_the_wiring_reaches(times, template):
    network = passed_on(times, template)
    assert TorchTape.of(network).reach == times
    assert_is_gauss_seidel(network, 5)


def test_a_sweep_ends_at_the_rails():
    """Cell 1 reads cell 0 where its rail stopped it, not where its drive would have taken it."""
    cell = Cell(
        neurons=(Neuron(name="x", limiter=Limiter(high=1.0)),),
        inputs=("push",),
        connections=(
            Connection(source="push", target="x", weight=[1.0, 0.0]),
            Connection(source="x", target="x", template=Template.PREVIOUS, weight=0.5),
        ),
    )
    network = Network(cell=cell, stages=2, inputs={"push": 10.0}, start={"x": 0.0})
    derivative = moved(STAGE_BY_STAGE, network, network.start_state[None], 0.5)
    np.testing.assert_allclose(derivative, [[10.0, 0.5]])


# ---- all of them -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def settled():
    """Where the ODE settles, as exactly as it can."""
    backend = OdeBackend(verify=False, settling=Settling(tolerance=1e-9, confirm=0.1))
    return {name: backend.run(designed(name).network).trajectory.final for name in ("car", "cstr")}


@pytest.mark.parametrize("name", ["car", "cstr"])
@pytest.mark.parametrize("order", ORDERS.values(), ids=repr)
def test_nothing_moves_where_the_network_settled(order, name, settled):
    network, x = designed(name).network, settled[name]
    derivative = moved(order, network, x[None], 0.3)
    assert (
        np.abs(derivative).max() < 1e-8 * np.abs(evaluator(network).rhs(network.start_state)).max()
    )


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("order", [TWO_PHASE, STAGE_BY_STAGE], ids=repr)
def test_short_steps_follow_the_flow(order, name):
    """m = M d + O(h): half the step, half the difference."""
    network = coordinated(name)
    x = near_start(network, 6, count=1)
    away = [
        np.abs(moved(order, network, x, h) - evaluator(network).rhs(x)).max() for h in (2e-4, 1e-4)
    ]
    assert away[1] > 0
    np.testing.assert_allclose(away[0] / away[1], 2.0, rtol=0.02)


@pytest.mark.parametrize("name", NAMES)
def test_all_at_once_is_the_flow_itself(name):
    network = coordinated(name)
    x = near_start(network, 7, count=2)
    for step in (1e-3, 1.0):
        assert_close(moved(SIMULTANEOUS, network, x, step), evaluator(network).rhs(x))


@pytest.mark.parametrize("order", ORDERS.values(), ids=repr)
def test_samples_have_steps_of_their_own(order):
    network = coordinated("car")
    x, steps = near_start(network, 8, count=3), [0.05, 0.1, 0.2]
    layer = CellLayer(network)
    flow = layer.flow()
    state = layer.fill(torch.as_tensor(x), flow.inputs)
    _, derivative = derivative_of(order, flow, state, torch.as_tensor(steps, dtype=torch.float64))
    alone = [moved(order, network, x[[i]], step)[0] for i, step in enumerate(steps)]
    assert_close(layer.pack(derivative), alone)


# ---- rails of coupled neurons ------------------------------------------------------------------


@pytest.mark.sampled(4)
@pytest.mark.parametrize("order", ORDERS.values(), ids=str)
@pytest.mark.parametrize("kind", COUPLED, ids=lambda kind: kind.name.lower())
def test_layers_at_rails_take_the_steps_of_generated_code(kind, order):
    network = with_limits(wired_with("double_integrator", kind), 0.3, "u", "q", "t")
    low, high = rails_of(network)
    noise = 0.4 * np.random.default_rng(3).standard_normal((5, network.size))
    starts = (network.start_state + noise).clip(low, high)
    step = FixedStep(step=0.2 * stability_limit(network, network.start_state))
    backend = RecurrentBackend(order=order, step=step, limit=10)
    in_code = backend.run_batch(network, {}, starts).states
    at_limit = (starts == low) | (starts == high)
    assert (in_code == starts)[at_limit].any()
    assert (in_code != starts)[at_limit].any()
    end = backend.layer(network).settle(torch.as_tensor(starts), limit=10)
    assert_close(end.states, in_code)
