"""Diode neurons: what a row says, where it is absent, and what it presses on whom."""

import numpy as np
import pytest
import sympy as sp
from constrained import CONSTRAINED, x
from numpy.testing import assert_allclose

from ann_dc import OptimalControlProblem, apply_gains, manual_gains, synthesize
from ann_dc.evaluation.reference import evaluator
from ann_dc.problem.scales import Scales
from ann_dc.scale import Scale

SMOOTH = ("car_disc1", "corridor", "lander", "power", "end_disc", "tank_level", "free_start")


def at_random(network, seed=0):
    """A state near the start; diode neurons near the edge on either side."""
    return network.start_state + 0.1 * np.random.default_rng(seed).standard_normal(network.size)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", SMOOTH)
def test_the_drives_are_slopes_of_the_augmented_lagrangian(name):
    """-dL/dx and +dL/dz of L = l + mu' c + rho/2 c'c + sum (max(0, z + w g)^2 - z^2) / 2w."""
    problem = CONSTRAINED[name].problem
    network = synthesize(problem, scales=Scales.none(problem), rho=0.7)
    own, state = evaluator(network), at_random(network)
    index, nodes = network.neuron_index, network.node_index

    def lagrangian(state):
        values, neurons = own.values(state)[:, 1:-1], network.unpack(state)
        q, u, t = (
            np.array([neurons[index[n.name]] for n in network.cell.neurons if n.population == p])
            for p in ("q", "u", "t")
        )
        total = problem.functions.cost(q, u).sum() + problem.functions.terminal(t[:, -1])[0]
        for dual in network.cell.duals:
            row = index[dual.neuron]
            c, live = values[nodes[dual.residual]], network.live[row]
            total = total + ((neurons[row] + 0.35 * c) * c)[live].sum()
        for diode in network.cell.inequality_duals:
            row = index[diode.neuron]
            pressed = np.maximum(neurons[row] + 0.7 * values[nodes[diode.residual]], 0.0)
            both = (pressed**2 - neurons[row] ** 2) / 1.4
            total = total + both[network.live[row]].sum()
        return total

    drives, step = network.pack(own.drives(state)), 1e-6
    signs = np.where([index_is_dual(network, i) for i in range(network.size)], 1.0, -1.0)
    found = [
        (lagrangian(state + step * e) - lagrangian(state - step * e)) / (2 * step)
        for e in np.eye(network.size)
    ]
    assert_allclose(drives, signs * np.array(found), atol=2e-5 * max(np.abs(drives).max(), 1))


def index_is_dual(network, component):
    return network.label(component).partition("[")[0] in ("mu", "beta", "z", "z_end")


def test_a_row_has_a_gradient_of_one_on_its_boundary():
    """In the network's scales: R on a disc's boundary wherever the start is, also at the end."""
    disc = CONSTRAINED["car_disc1"].problem
    network = synthesize(disc, scales=Scales.none(disc))
    assert network.neuron("z.g1").scale.factor == pytest.approx(1.0, rel=1e-6)  # cost by distance
    end = CONSTRAINED["end_disc"].problem
    network = synthesize(end, scales=Scales.none(end))
    assert network.neuron("z_end.near").scale.factor == pytest.approx(1 / 0.4, rel=1e-6)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_a_row_that_is_flat_along_the_start_has_a_scale_in_any_units(unit):
    """a v <= 1 has no slope at rest, from where the line does not move v."""
    v, a = sp.symbols("v a")
    problem = OptimalControlProblem(
        states=(x, v), controls=(a,), dynamics=(v, a), dt=0.1, horizon=6, cost=(a / unit) ** 2,
        q_0=(0, 0), q_d=(0, 0), constraints={"power": a * v <= unit**2},
    )  # fmt: skip
    scales = Scales(states=(Scale(unit), Scale(unit)), controls=(Scale(unit),), cost=1.0)
    network = synthesize(problem, scales=scales)
    # from (1, 1), on the boundary, where the gradient is (1, 1)
    assert network.neuron("z.power").scale.factor * unit**2 == pytest.approx(2**-0.5)


def test_limits_of_controls_are_rails_and_clip_the_start():
    u = sp.Symbol("u")
    problem = OptimalControlProblem(
        states=(x,), controls=(u,), map=(x + u,), cost=u**2, horizon=4, q_0=(0,), q_d=(4,),
        bounds={u: (-3, 0.5)},
    )  # fmt: skip
    network = synthesize(problem)
    neuron = network.neuron("u.u")
    assert neuron.scale.user(neuron.limiter.high) == pytest.approx(0.5)
    assert neuron.scale.user(neuron.limiter.low) == pytest.approx(-3)
    start = network.unpack(network.start_state)[network.neuron_index["u.u"]]
    assert_allclose(neuron.scale.user(start), 0.5)  # a line would need 1
    assert not network.cell.inequality_duals


def test_rows_that_q_0_fixes_and_those_of_the_end_have_no_neuron_elsewhere():
    held = synthesize(CONSTRAINED["dint_v"].problem)
    assert held.live[held.neuron_index["z.v_high"]].tolist() == [False, *[True] * 29]
    free = synthesize(CONSTRAINED["free_start"].problem)
    assert free.live[free.neuron_index["z.x_low"]].all()
    end = synthesize(CONSTRAINED["end_disc"].problem)
    assert end.live[end.neuron_index["z_end.near"]].tolist() == [*[False] * 19, True]


def test_penalties_of_diode_neurons_move_all_their_weights():
    network = synthesize(CONSTRAINED["dint_v"].problem)
    frozen = apply_gains(network, manual_gains(network, rho={"z": 4.0, "mu": 2.0}))
    (diode,) = frozen.cell.inequality_duals
    weights = {c.name: c.weight for c in frozen.cell.connections}
    assert weights[diode.path] == 4.0
    assert weights["z.v_high<-zeta.v_high"] == 0.25 == -weights["z.v_high<-z.v_high"]


def test_problems_without_inequalities_have_no_diodes_and_no_rails():
    from ann_dc import plants

    network = synthesize(plants.car())
    assert not network.cell.inequality_duals
    assert not any(np.isfinite((n.limiter.low, n.limiter.high)).any() for n in network.cell.neurons)
