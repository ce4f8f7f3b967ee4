"""How long a step may be, how long it is, and what remembering the last ones brings."""

import warnings

import numpy as np
import pytest
import torch
from designs import designed, small
from hypothesis import given, settings
from hypothesis import strategies as st

from ann_dc.analysis.spectra import stability_limit
from ann_dc.backends.recurrent.acceleration import Anderson
from ann_dc.backends.recurrent.cell.layer import CellLayer
from ann_dc.backends.recurrent.layer import RecurrentLayer
from ann_dc.backends.recurrent.loop import DIVERGED, OVERFLOW, SETTLED
from ann_dc.backends.recurrent.orders import SIMULTANEOUS, STAGE_BY_STAGE
from ann_dc.backends.recurrent.steps import (
    AdaptiveStep,
    FixedStep,
    Pace,
    dual_limit,
)
from ann_dc.backends.settling import Settling
from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.gains import apply_gains, hand_gains
from ann_dc.network.cell import Cell, Connection, Neuron, Template
from ann_dc.network.network import Network


def limit_of(network: Network) -> float:
    return float(dual_limit(CellLayer(network).flow()))


def wire(source: str, target: str, weight=1.0, template=Template.SELF) -> Connection:
    return Connection(source=source, target=target, weight=weight, template=template)


# ---- fixed steps -------------------------------------------------------------------------------


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


@pytest.mark.parametrize("step", [0.0, -1.0, float("nan"), float("inf")])
def test_a_step_is_positive(step):
    with pytest.raises(NetworkError, match="step: expected a positive number, got"):
        FixedStep(step=step)


# ---- the limit of the duals --------------------------------------------------------------------


def test_the_dual_limit_is_rho_tau():
    network = small("car")
    slow = hand_gains(
        network, rho={"mu": 0.1, "beta": 0.2, "mu.phi": 0.04}, tau={"beta": 0.3, "mu.phi": 0.5}
    )
    assert limit_of(apply_gains(network, slow)) == pytest.approx(0.02, rel=1e-12)
    slow = hand_gains(network, rho={"mu": 0.1, "beta": 0.2}, tau={"beta": 0.3})
    assert limit_of(apply_gains(network, slow)) == pytest.approx(0.06, rel=1e-12)


@pytest.mark.parametrize("k", [0.5, 40.0])
def test_without_duals_the_fastest_mode_is_the_limit(k):
    assert limit_of(leaky(k)) == pytest.approx(2 / k, rel=1e-9)


def test_plain_duals_do_not_count():
    """rho = 0 has no proportional path, so nothing that could be too slow for a step."""
    network = small("double_integrator")
    plain = apply_gains(network, hand_gains(network))
    assert limit_of(plain) > 0.5


# ---- adaptive steps ----------------------------------------------------------------------------

LONGEST = 4.0
"""2 / k of the leak that the invented energies pretend to come from."""


def paces(rule: AdaptiveStep, energies) -> list[tuple[Pace, torch.Tensor]]:
    """Paces and cuts after each of the energies (steps, B) on a network of limit `LONGEST`."""
    energies = torch.as_tensor(np.array(energies, float))
    energies = energies[:, None] if energies.ndim == 1 else energies
    pace = rule.begin(CellLayer(leaky(2 / LONGEST)).flow(), energies)
    meaning = []
    for energy in energies:
        pace, cut = rule.update(pace, energy)
        meaning.append((pace, cut))
    return meaning


def step_lengths(rule: AdaptiveStep, energies) -> np.ndarray:
    return np.array([pace.step.numpy() for pace, _ in paces(rule, energies)]).squeeze()


def test_steps_grow_while_the_energy_falls():
    rule = AdaptiveStep()
    found = step_lengths(rule, 0.9 ** np.arange(100))
    expected = rule.first * LONGEST * rule.growth ** np.arange(1, 101)
    np.testing.assert_allclose(found, np.minimum(expected, rule.share * LONGEST), rtol=1e-12)
    assert found[-1] == rule.share * LONGEST


def test_a_step_that_doubles_the_energy_is_the_last_of_its_length():
    rule = AdaptiveStep()
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


@given(st.lists(st.floats(0.01, 0.999), min_size=1, max_size=30))
def test_after_a_cut_length_is_earned(shares):
    """However the energy falls from e_0 to e_1, the step gains (e_0 / e_1)^earned by it."""
    rule = AdaptiveStep(share=1e6)
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


def test_begins_with_shares_of_the_limit_of():
    network, rule = designed("car").network, AdaptiveStep(share=0.5, first=0.1)
    pace = rule.begin(CellLayer(network).flow(), torch.zeros(3, 2, 5, dtype=torch.float64))
    unit = limit_of(network)
    np.testing.assert_allclose(pace.step, np.full(5, 0.1 * unit))
    np.testing.assert_allclose(pace.longest, np.full(5, 0.5 * unit))


# ---- Anderson ----------------------------------------------------------------------------------


def leaky_line(stages: int) -> Network:
    """A line of leaky nodes with time constants of their own, driven by a current."""
    taus = 1.0 + 0.3 * np.cos(np.arange(stages))
    cell = Cell(
        neurons=(Neuron(name="v", tau=taus),),
        inputs=("current",),
        connections=(
            wire("v", "v", -2.2),
            wire("v", "v", template=Template.PREVIOUS),
            wire("v", "v", template=Template.NEXT),
            wire("current", "v"),
        ),
    )
    return Network(cell=cell, stages=stages, inputs={"current": np.sin(np.arange(stages) + 1.0)})


@pytest.mark.parametrize("order", [SIMULTANEOUS, STAGE_BY_STAGE], ids=repr)
@pytest.mark.parametrize("stages", [1, 2, 3, 4, 5])
def test_on_a_linear_flow_as_many_steps_as_neurons(order, stages):
    """It is GMRES: n differences span the space, and the next state is the solution."""
    network = leaky_line(stages)
    layer = RecurrentLayer(
        network, order=order, step=FixedStep(step=0.3), acceleration=Anderson(memory=8)
    )
    end = layer.settle(settling=Settling(tolerance=1e-6, confirm=0.1), limit=60)
    assert end.codes.tolist() == [SETTLED]
    assert end.steps[0] <= stages + 2
    matrix = evaluator(network).jacobian(np.zeros(stages))
    expected = np.linalg.solve(-matrix, evaluator(network).rhs(np.zeros(stages)))
    np.testing.assert_allclose(end.states[0], expected, atol=1e-6)


class Secant:
    """One neuron, m(x) = 2 - x, accelerated by hand with steps of a tenth."""

    def __init__(self, acceleration: Anderson) -> None:
        self.acceleration, self.slot = acceleration, 0
        self.memory = acceleration.begin(self.shaped(0.0))
        self.x = 0.0

    @staticmethod
    def shaped(value: float) -> torch.Tensor:
        return torch.full((1, 1, 1), value, dtype=torch.float64)

    def step(self, *, energy=1.0, rejected=False, cut=False) -> float:
        one = torch.ones(1, dtype=torch.float64)
        self.memory, state = self.acceleration.next(
            self.memory,
            self.slot % self.acceleration.memory,
            self.shaped(self.x),
            self.shaped(2.0 - self.x),
            0.1 * one,
            self.shaped(1.0),
            energy * one,
            one.bool() & rejected,
            one.bool() & cut,
        )
        self.slot, self.x = self.slot + 1, float(state)
        return self.x

    def rejects(self, energy: float) -> bool:
        return bool(self.acceleration.rejects(self.memory, torch.tensor([energy])))


def test_in_one_dimension_it_is_the_secant():
    run = Secant(Anderson(memory=3))
    assert run.step() == pytest.approx(0.2)  # nothing remembered: a plain step
    assert run.step() == pytest.approx(2.0, rel=1e-8)


def test_only_accelerated_steps_are_taken_back():
    run = Secant(Anderson(rise=1.2))
    run.step(energy=1.0)
    assert not run.rejects(float("inf"))
    run.step(energy=1.0)
    assert not run.rejects(1.19)
    assert run.rejects(1.21)
    assert run.rejects(float("inf"))


def test_a_step_taken_back_goes_on_from_the_last_state():
    run = Secant(Anderson())
    run.step()
    before = run.x
    run.step()  # the secant's, to 2
    run.x = 50.0  # as if it had led astray
    assert run.step(energy=100.0, rejected=True) == pytest.approx(before + 0.1 * (2 - before))
    for forgotten in (run.memory.states, run.memory.moves, run.memory.gram):
        assert not forgotten.any()
    assert not run.rejects(float("inf"))  # the next one is plain
    x = run.x
    assert run.step() == pytest.approx(x + 0.1 * (2 - x))
    assert run.step() == pytest.approx(2.0, rel=1e-8)


def test_after_a_cut_it_waits_until_the_energy_is_halved():
    run = Secant(Anderson(resume=0.5))
    run.step(energy=1.0)
    for energy, cut in ((1.0, True), (0.9, False), (0.51, False)):
        x = run.x
        assert run.step(energy=energy, cut=cut) == pytest.approx(x + 0.1 * (2 - x))
        assert not run.rejects(float("inf"))
    assert run.step(energy=0.49) == pytest.approx(2.0, rel=1e-6)
