"""How long a step may be, and how long it is."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
import torch
from designs import designed, small
from hypothesis import given, settings, strategies as st
from problems import SUITE
from recurrent_runs import RECURRENT, assert_same_end, ode, wire

from ann_dc.analysis.spectra import stability_limit
from ann_dc.backends.batched.step_control import StepLengths, StepState, next_step
from ann_dc.backends.integration.integrator import DIVERGED, SETTLED
from ann_dc.backends.layers.fixed_order import LIBRARY
from ann_dc.backends.layers.recurrent_layer import RecurrentLayer
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.settling import Settling
from ann_dc.backends.status import OVERFLOW, Outcome
from ann_dc.backends.step_rules import AdaptiveStep, FixedStep, StepLimits, StepRule, lengths_of
from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import SWITCHES
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.gains import apply_gains, manual_gains
from ann_dc.gain_design.procedure import design
from ann_dc.network.cell import Cell, Neuron
from ann_dc.network.network import Network
from ann_dc.solver import synthesize


def test_with_fixed_steps():
    network = designed("car").network
    run = replace(RECURRENT, step=FixedStep(step=0.3)).run(network)
    assert_same_end(run, ode("car").trajectory.final)
    np.testing.assert_allclose(run.status.time, 0.3 * run.steps, rtol=1e-9)


@pytest.mark.slow
def test_a_flow_that_only_grows_diverges_however_short_the_steps():
    """The rule may cut a step as often as it likes, but not to nothing."""
    problem = SUITE["double_integrator"].problem
    gains = design(synthesize(problem)).gains
    network = apply_gains(synthesize(decompose(problem, SWITCHES["S1"])), gains)
    assert RecurrentBackend().run(network).status.outcome is Outcome.DIVERGED


def limit_of(network: Network) -> float:
    return StepLimits(network).dual


def leaky(k: float) -> Network:
    """x' = -k x from 1."""
    cell = Cell(neurons=(Neuron(name="x", tau=1 / k),), connections=(wire("x", "x", -1.0),))
    return Network(cell=cell, stages=1, start={"x": 1.0}, title="leak")


def oscillator(a: float, b: float) -> Network:
    """x' = -a x - b y, y' = b x - a y: eigenvalues -a +- ib."""
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="y")),
        connections=(wire("x", "x", -a), wire("y", "x", -b), wire("x", "y", b), wire("y", "y", -a)),
    )
    return Network(cell=cell, stages=1, start={"x": 1.0})


def spring(stiffness: float, ratio: float) -> Network:
    """x' = v, v' = -stiffness x - damping v: a pair with a damping ratio, far from normal."""
    damping = 2 * ratio * np.sqrt(stiffness)
    wires = wire("v", "x", 1.0), wire("x", "v", -stiffness), wire("v", "v", -damping)
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="v")), connections=wires)
    return Network(cell=cell, stages=1, start={"x": 0.8}, title="spring")


@pytest.mark.parametrize("stiffness", [1.0, 100.0, 1e4])
@pytest.mark.parametrize("ratio", [0.1, 0.2, 0.4, 0.7])
def test_adaptive_steps_of_an_underdamped_mode_settle(stiffness, ratio):
    """At half the stability limit, the best, a mode falls by sqrt(1 - ratio^2) a step."""
    network, best = spring(stiffness, ratio), np.log(1e-8) / np.log(np.sqrt(1 - ratio**2))
    run = RecurrentBackend().run(network)
    assert run.status.settled
    assert run.steps < 10 * best + 500
    np.testing.assert_allclose(run.trajectory.final, 0.0, atol=1e-7)


def test_layers_take_the_adaptive_steps_of_generated_code_when_a_mode_swings():
    network = spring(100.0, 0.4)
    end, run = RecurrentLayer(network).settle(), RecurrentBackend().run(network)
    assert (int(end.steps), int(end.settling_steps)) == (run.steps, run.settling_steps)
    np.testing.assert_allclose(end.states[0], run.trajectory.final, rtol=1e-6)
    rest = RecurrentLayer(network).equilibrium({}).detach()
    np.testing.assert_allclose(rest, [[0.0, 0.0]], atol=1e-9)


@pytest.mark.parametrize("k", [0.5, 1.0, 40.0])
@pytest.mark.parametrize("share", [0.1, 0.9])
def test_below_its_limit_a_leak_settles_as_a_power(k, share):
    """x_j = (1 - hk)^j, whose drive is -x_j, so steps can be counted by logarithms."""
    layer = RecurrentLayer(leaky(k), step=FixedStep(step=2 * share / k))
    end = layer.settle(settling=Settling(tolerance=1e-6, confirm=0.01))
    factor = abs(1 - 2 * share)
    assert end.codes.tolist() == [SETTLED]
    assert end.settling_steps.tolist() == [np.ceil(np.log(1e-6) / np.log(factor))]
    assert end.steps.tolist() == [np.ceil(np.log(1e-8) / np.log(factor))]
    np.testing.assert_allclose(end.states, (1 - 2 * share) ** int(end.steps[0]), rtol=1e-9)


@pytest.mark.parametrize("k", [0.5, 40.0])
def test_above_its_limit_a_leak_diverges(k):
    layer = RecurrentLayer(leaky(k), step=FixedStep(step=2.2 / k))
    with pytest.warns(UserWarning, match=rf"above the stability limit {2 / k:.3g} of leak"):
        end = layer.settle()
    assert end.codes.tolist() == [DIVERGED]
    assert end.steps.tolist() == [np.ceil(np.log(OVERFLOW) / np.log(1.2))]
    assert end.settling_steps.tolist() == [-1]


@settings(max_examples=25, deadline=None)
@given(st.floats(0.01, 10.0), st.floats(0.0, 10.0))
def test_stability_limit_of_an_oscillator(a, b):
    network = oscillator(a, b)
    np.testing.assert_allclose(stability_limit(network, np.zeros(2)), 2 * a / (a**2 + b**2))


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("share", "code"), [(0.8, SETTLED), (1.25, DIVERGED)])
def test_the_limit_is_the_border(share, code):
    network = oscillator(0.5, 2.0)
    layer = RecurrentLayer(network, step=FixedStep(step=share * 2 * 0.5 / (0.5**2 + 2.0**2)))
    with warnings.catch_warnings(action="ignore" if share > 1 else "error"):
        assert layer.settle(limit=5000).codes.tolist() == [code]


def test_no_step_is_stable_where_nothing_attracts():
    network = oscillator(-0.5, 2.0)
    assert stability_limit(network, np.zeros(2)) == 0.0
    end = RecurrentLayer(network, step=FixedStep(step=0.1)).settle()
    assert end.codes.tolist() == [DIVERGED]


def test_at_the_limit_of_a_design_one_mode_stands():
    network, x = designed("car").network, designed("car").state
    step = np.eye(network.size) + stability_limit(network, x) * evaluator(network).jacobian(x)
    np.testing.assert_allclose(np.abs(np.linalg.eigvals(step)).max(), 1.0, rtol=1e-9)


def test_the_dual_limit_is_rho_tau():
    network = small("car")
    slow = manual_gains(
        network, rho={"mu": 0.1, "beta": 0.2, "mu.phi": 0.04}, tau={"beta": 0.3, "mu.phi": 0.5}
    )
    assert limit_of(apply_gains(network, slow)) == pytest.approx(0.02, rel=1e-12)
    slow = manual_gains(network, rho={"mu": 0.1, "beta": 0.2}, tau={"beta": 0.3})
    assert limit_of(apply_gains(network, slow)) == pytest.approx(0.06, rel=1e-12)


@pytest.mark.parametrize("k", [0.5, 40.0])
def test_without_duals_the_fastest_mode_is_the_limit(k):
    assert limit_of(leaky(k)) == pytest.approx(2 / k, rel=1e-9)


def test_plain_duals_do_not_count():
    """rho = 0 has no proportional path, so nothing that could be too slow for a step."""
    network = small("double_integrator")
    plain = apply_gains(network, manual_gains(network))
    assert limit_of(plain) > 0.5


LONGEST = 4.0
"""Limit of the network that the invented energies pretend to come from."""


def started(lengths: StepLengths, row: torch.Tensor) -> StepState:
    """The state of as many samples as a row has, before their first step."""
    return StepState(*(torch.full_like(row, number) for number in lengths.start))


def paces(rule: StepRule, energies, turn=1.0) -> list[tuple[StepState, torch.Tensor]]:
    """Paces and cuts after each of the energies (steps, B) on a network of limit `LONGEST`."""
    energies = torch.as_tensor(np.array(energies, float))
    energies = energies[:, None] if energies.ndim == 1 else energies
    lengths = rule.lengths(LONGEST)
    pace = started(lengths, energies[0])
    meaning = []
    for energy in energies:
        pace, cut = next_step(LIBRARY, lengths, pace, energy, torch.full_like(energy, turn))
        meaning.append((pace, cut))
    return meaning


def step_lengths(rule: StepRule, energies) -> np.ndarray:
    return np.array([pace.step.numpy() for pace, _ in paces(rule, energies)]).squeeze()


def test_steps_grow_while_the_energy_falls():
    rule = AdaptiveStep()
    found = step_lengths(rule, 0.9 ** np.arange(100))
    expected = rule.first * LONGEST * rule.growth ** np.arange(1, 101)
    np.testing.assert_allclose(found, np.minimum(expected, rule.share * LONGEST), rtol=1e-12)
    assert found[-1] == rule.share * LONGEST


def test_a_step_that_doubles_the_energy_is_the_last_of_its_length():
    rule = AdaptiveStep(turn=1.0)
    lengths = step_lengths(rule, [1.0, 1.9, 2.1, 2.1])
    assert lengths[1] == lengths[0]  # a rise, but no doubling
    np.testing.assert_allclose(lengths[2], rule.cut * lengths[1], rtol=1e-12)
    assert lengths[3] == lengths[2]
    assert [bool(cut) for _, cut in paces(rule, [1.0, 1.9, 2.1, 2.1])] == [
        False,
        False,
        True,
        False,
    ]


@pytest.mark.parametrize(("angle", "turn"), [(np.pi, 2), (np.pi / 8, 11)])
def test_rise_is_measured_from_the_lowest_peak_of_a_turn(angle, turn):
    """Energies that fall by half each turn but rise fivefold in between, then peaks that grow."""
    swing = np.concatenate([[5.0], np.ones(turn - 1)])
    energies = np.concatenate([0.5**k * swing for k in range(4)] + [0.5**3 * 11.0 * swing])
    found = [bool(cut) for _, cut in paces(AdaptiveStep(), energies, np.sin(angle / 2))]
    assert found.index(True) == 4 * turn
    assert not any(cut for _, cut in paces(AdaptiveStep(), energies, 0.0))  # moves straight on


@given(st.lists(st.floats(0.01, 0.999), min_size=1, max_size=30))
def test_after_a_cut_length_is_earned(shares):
    """However the energy falls from e_0 to e_1, the step gains (e_0 / e_1)^earned by it."""
    rule = AdaptiveStep(share=1e6, turn=1.0)
    energies = np.concatenate([[1.0, 3.0], 3.0 * np.cumprod(shares)])
    lengths = step_lengths(rule, energies)
    gained = (energies[1] / energies[-1]) ** rule.earned
    np.testing.assert_allclose(lengths[-1] / lengths[1], gained, rtol=1e-9)


def test_an_idle_window_cuts_and_lengthens_the_next():
    """Windows of 4, 6 and 9 steps, after a first one that has nothing to compare with."""
    rule = AdaptiveStep(window=4)
    meaning = paces(rule, np.ones(24))
    cuts = [step for step, (_, cut) in enumerate(meaning, 1) if cut]
    assert cuts == [8, 14, 23]
    assert [float(meaning[step - 1][0].window) for step in cuts] == [6.0, 9.0, 13.5]
    first = rule.first * LONGEST * rule.growth
    lengths = [float(meaning[step - 1][0].step) for step in cuts]
    np.testing.assert_allclose(lengths, first * rule.cut ** np.arange(1, 4), rtol=1e-12)


def test_a_window_with_progress_is_not_idle():
    rule = AdaptiveStep(window=4)
    meaning = paces(rule, 0.96 ** np.arange(40))  # 0.85 in a window
    assert not any(cut for _, cut in meaning)
    assert {float(pace.window) for pace, _ in meaning} == {4.0}


ENERGIES = st.lists(st.floats(1e-9, 1e9), min_size=1, max_size=60)


@given(ENERGIES)
def test_no_step_is_longer_than_its_share(energies):
    rule = AdaptiveStep(window=5)
    lengths = step_lengths(rule, energies)
    assert (lengths > 0).all()
    assert (lengths <= rule.share * LONGEST).all()


@given(st.lists(st.tuples(*[st.floats(1e-3, 1e3)] * 3), min_size=1, max_size=30))
def test_samples_have_a_pace_each(energies):
    rule, energies = AdaptiveStep(window=5), np.array(energies)
    together = np.array([pace.step.numpy() for pace, _ in paces(rule, energies)])
    alone = [np.atleast_1d(step_lengths(rule, column)) for column in energies.T]
    np.testing.assert_array_equal(together, np.transpose(alone))


@given(st.lists(st.floats(0.0, float("inf")), min_size=1, max_size=30))
def test_a_fixed_step_stays_whatever_the_energy(energies):
    meaning = paces(FixedStep(step=0.3), energies)
    assert {float(pace.step) for pace, _ in meaning} == {0.3}
    assert not any(cut for _, cut in meaning)


def test_begins_with_shares_of_the_limit_of_the_flow():
    network, rule = designed("car").network, AdaptiveStep(share=0.5, first=0.1)
    lengths = lengths_of(rule, StepLimits(network))
    pace = started(lengths, torch.zeros(5, dtype=torch.float64))
    unit = limit_of(network)
    np.testing.assert_allclose(pace.step, np.full(5, 0.1 * unit))
    np.testing.assert_allclose(pace.longest, np.full(5, 0.5 * unit))
