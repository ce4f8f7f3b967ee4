"""The rule of rails, for all evaluators: moves are the projection of M d on what the rails allow.

The right values come from an outside solver of bounded least squares, from states at which today's
rule and the projection agree, and along runs from the NumPy evaluator. An evaluator joins the suite
by a line in `EVALUATORS`.
"""

import ctypes
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
from clamped_runs import (
    COUPLED,
    OF_RUNS,
    at_limits,
    rails_of,
    resting_at_rails,
    run_with_changes,
    unrailed,
    with_limits,
)
from designs import wired_with
from hypothesis import given, settings, strategies as st
from random_networks import random_network
from random_preconditioners import random_preconditioner, rows
from torch_evaluator import TorchEvaluator

from ann_dc.evaluation.codegen.evaluator import GeneratedEvaluator
from ann_dc.evaluation.codegen.lanes import Lanes
from ann_dc.evaluation.codegen.plan import Axis
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import ReferenceEvaluator, evaluator
from ann_dc.evaluation.rules import projected
from ann_dc.network.preconditioners.base import ArrayLayout, Preconditioner, PreconditionerKind

CODE = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * 3)
EVALUATORS = (ReferenceEvaluator, InterpretedEvaluator, GeneratedEvaluator, TorchEvaluator)
every_evaluator = pytest.mark.parametrize("kind", EVALUATORS, ids=lambda kind: kind.__name__)
every_coupled = pytest.mark.parametrize(
    "preconditioner", COUPLED, ids=lambda kind: kind.name.lower()
)


def inverse_of(preconditioner: Preconditioner, row: ArrayLayout) -> np.ndarray:
    """M^{-1} (n, n)."""
    return np.linalg.inv(preconditioner.derivatives(row, np.eye(len(row.state_rates))))


def least_squares_moves(inverse, drive, x, low, high) -> np.ndarray:
    """argmin 1/2 v' M^{-1} v - d'v within the rails, by another solver: |R v - R'^{-1} d|^2."""
    R = scipy.linalg.cholesky(0.5 * (inverse + inverse.T))
    least, most = np.where(x <= low, 0.0, -np.inf), np.where(x >= high, 0.0, np.inf)
    free = least < most
    target = scipy.linalg.solve_triangular(R, drive, trans=1)
    derivatives = np.zeros(len(x))
    bounds = least[free], most[free]
    found = scipy.optimize.lsq_linear(R[:, free], target, bounds, method="bvls", tol=1e-15)
    derivatives[free] = found.x
    return derivatives


def assert_close(actual, expected, relative=1e-12) -> None:
    scale = np.abs(expected).max(initial=0.0)
    np.testing.assert_allclose(actual, expected, rtol=relative, atol=relative * scale)


# ---- the projection ------------------------------------------------------------------------------


@every_coupled
@settings(max_examples=40, deadline=None)
@given(row=rows(), seed=st.integers(0, 2**32 - 1))
def test_projection_at_random_rails_is_bounded_least_squares(preconditioner, row, seed):
    rng, n = np.random.default_rng(seed), len(row.state_rates)
    if not n or not (row.rates[row.primal] > 0).any():
        return
    found = random_preconditioner(preconditioner, row, rng)
    coupled = np.isin(row.places[0], np.flatnonzero(found.reach(row)))
    low, high = np.where(rng.random((2, n)) < 0.7, [[-1.0], [1.0]], [[-np.inf], [np.inf]])
    x, drive = rng.choice([-1.0, 0.3, 1.0], n), rng.standard_normal(n)
    low[~coupled], high[~coupled] = -np.inf, np.inf
    derivatives = projected(lambda held: found.clamp(row, held), drive, x, low, high, coupled)
    expected = least_squares_moves(inverse_of(found, row), drive, x, low, high)
    assert_close(derivatives, expected, 1e-9)


@every_coupled
def test_clamp_of_no_neuron_is_the_preconditioner(preconditioner):
    network = wired_with("car", preconditioner)
    drive = np.random.default_rng(1).standard_normal(network.size)
    clamp = network.preconditioner.clamp(network.layout, np.zeros(network.size, bool))
    derivatives, currents = clamp(drive)
    assert_close(derivatives, network.preconditioner.derivatives(network.layout, drive))
    assert not currents.any()


# ---- every evaluator -----------------------------------------------------------------------------


@pytest.mark.sampled
@every_evaluator
@every_coupled
@pytest.mark.parametrize("populations", [(), ("u",), ("q", "u")], ids=str)
@pytest.mark.parametrize("name", ["car", "double_integrator", "van_der_pol"])
def test_moves_at_rails_are_bounded_least_squares(name, populations, preconditioner, kind):
    network = with_limits(wired_with(name, preconditioner), 0.5, *populations)
    ours, low_high = kind(network), rails_of(network)
    inverse = inverse_of(network.preconditioner, network.layout)
    for seed in range(5):
        x = at_limits(network, seed)
        drive = network.pack(evaluator(unrailed(network)).drives(x))
        expected = least_squares_moves(inverse, drive, x, *low_high)
        assert_close(ours.rhs(x), expected, 1e-9)


@pytest.mark.sampled(6)
@every_evaluator
@pytest.mark.parametrize("preconditioner", PreconditionerKind, ids=lambda kind: kind.name.lower())
def test_no_move_points_outward_at_a_rail(preconditioner, kind):
    network = with_limits(wired_with("car", preconditioner), 0.5)
    low, high = rails_of(network)
    for seed in range(20):
        x = at_limits(network, seed)
        derivatives = kind(network).rhs(x)
        assert not derivatives[(x <= low)].min(initial=0.0) < 0.0
        assert not derivatives[(x >= high)].max(initial=0.0) > 0.0


@every_evaluator
@pytest.mark.parametrize("name", ["car", "double_integrator", "van_der_pol"])
def test_moves_of_time_constants_are_those_of_cut_drives_bit_for_bit(name, kind):
    network = with_limits(wired_with(name, PreconditionerKind.DIAGONAL), 0.5)
    ours = kind(network)
    for seed in range(5):
        x = at_limits(network, seed)
        expected = network.layout.state_rates * network.pack(ours.drives(x))
        assert (expected == 0).any()
        np.testing.assert_array_equal(ours.rhs(x), expected)


@every_evaluator
@every_coupled
def test_neurons_that_no_preconditioner_couples_keep_their_rule_bit_for_bit(preconditioner, kind):
    network = with_limits(wired_with("car", preconditioner), 0.5)
    alone = ~network.preconditioner.reach(network.layout)[network.places[:, 0]]
    ours = kind(network)
    for seed in range(5):
        x = at_limits(network, seed)
        expected = network.layout.state_rates * network.pack(ours.drives(x))
        np.testing.assert_array_equal(ours.rhs(x)[alone], expected[alone])


@pytest.mark.sampled(8)
@every_evaluator
@every_coupled
def test_a_neighbour_pulls_a_neuron_off_its_rail_against_its_drive(preconditioner, kind):
    """And holds another one there that its own drive would take off."""
    network = with_limits(wired_with("car", preconditioner), 0.5)
    low, high = rails_of(network)
    ours, drives, off, held = kind(network), evaluator(unrailed(network)), 0, 0
    for seed in range(20):
        x = at_limits(network, seed)
        drive, derivatives = network.pack(drives.drives(x)), ours.rhs(x)
        inward = np.where(x <= low, 1.0, np.where(x >= high, -1.0, 0.0))
        off += int(((inward * drive < 0) & (derivatives != 0)).sum())
        held += int(((inward * drive > 0) & (derivatives == 0)).sum())
    assert off
    assert held


@pytest.mark.sampled(4)
@every_evaluator
@every_coupled
@pytest.mark.parametrize("population", ["q", "u"])
@pytest.mark.parametrize("name", ["lq_unst", "pendulum", "unicycle"])
def test_equilibria_at_rails_are_those_of_time_constants(name, population, preconditioner, kind):
    size, x = resting_at_rails(name, population)
    network = with_limits(wired_with(name, preconditioner), size, population)
    ours = kind(network)
    saturated = ours.saturated(x, ours.drives(x))
    assert saturated.any()
    assert np.abs(ours.rhs(x)).max() < 1e-9
    assert not ours.rhs(x)[saturated].any()
    assert max(ours.residuals(x)) < 1e-9


@every_evaluator
@every_coupled
def test_drives_are_cut_by_their_own_signs(preconditioner, kind):
    network = with_limits(wired_with("car", preconditioner), 0.5)
    low, high = rails_of(network)
    x = at_limits(network, 3)
    raw = network.pack(evaluator(unrailed(network)).drives(x))
    cut = ((x <= low) & (raw < 0)) | ((x >= high) & (raw > 0))
    assert cut.any()
    ours = kind(network)
    ours.rhs(x)
    assert_close(network.pack(ours.drives(x)), np.where(cut, 0.0, raw))


@pytest.mark.sampled(15)
@every_evaluator
@every_coupled
@pytest.mark.parametrize("population", ["q", "u"])
def test_derivatives_of_the_flow_hold_neurons_that_rest(population, preconditioner, kind):
    size, x = resting_at_rails("pendulum", population)
    network = with_limits(wired_with("pendulum", preconditioner), size, population)
    reference = evaluator(network)
    saturated = reference.saturated(x, reference.drives(x))
    assert saturated.any()
    stepped = reference.rhs(x + 1e-30j * np.eye(len(x))).imag.T / 1e-30
    assert_close(reference.jacobian(x), stepped, 1e-10)
    ours, push = kind(network), np.random.default_rng(3).standard_normal(len(x))
    expected = network.preconditioner.clamp(network.layout, saturated)(push)[0]
    assert_close(ours.clamped(saturated)(push)[~saturated], expected[~saturated])
    v = np.random.default_rng(0).standard_normal(len(x))
    for _ in range(20):
        v = stepped @ (v / np.linalg.norm(v))
    assert ours.fastest_rate(x) == pytest.approx(np.linalg.norm(v), rel=1e-9)


@pytest.mark.sampled(2)
@every_coupled
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_moves_at_rails_of_random_networks_are_those_of_numpy(preconditioner, seed):
    network = random_network(seed, preconditioner)
    low, high = rails_of(network)
    spread = np.random.default_rng(seed).uniform(-2.0, 2.0, (3, network.size))
    for x in (network.start_state + spread).clip(low, high):
        with np.errstate(all="ignore"):
            expected = evaluator(network).rhs(x)
        for kind in (InterpretedEvaluator, TorchEvaluator):
            found = kind(network).rhs(x)
            if np.isfinite(expected).all():
                assert_close(found, expected, 1e-11)


# ---- runs ----------------------------------------------------------------------------------------


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", EVALUATORS[1:], ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("preconditioner", OF_RUNS, ids=lambda kind: kind.name.lower())
def test_evaluators_agree_along_a_run_whose_held_set_changes_a_hundred_times(preconditioner, kind):
    network, states, changes = run_with_changes(preconditioner)
    assert changes >= 100
    ours, reference = kind(network), evaluator(network)
    for x in states:
        assert_close(ours.rhs(x), reference.rhs(x))


@pytest.mark.sampled(4)
@every_evaluator
@every_coupled
def test_moves_do_not_depend_on_the_calls_before(preconditioner, kind):
    network, states, _ = run_with_changes(preconditioner)
    ours = kind(network)
    forth = [ours.rhs(x) for x in states[::20]]
    back = [ours.rhs(x) for x in states[::-20][: len(forth)]]
    fresh = [kind(network).rhs(x) for x in states[::20]]
    assert_close(forth, fresh, 1e-13)
    assert_close(back, [ours.rhs(x) for x in states[::-20][: len(forth)]], 1e-13)


# ---- a sample in every lane ----------------------------------------------------------------------


def moves_of_lanes(lanes: Lanes, states: np.ndarray) -> np.ndarray:
    """Moves (W, n) of as many states, and the drives that are left."""
    table, out = lanes.state(states[0]), np.zeros(lanes.spare)
    for lane, x in enumerate(states):
        table.reshape(-1, lanes.lanes)[:, lane] = lanes.state(x).reshape(-1, lanes.lanes)[:, lane]
    CODE(lanes.entry.rhs)(lanes.entry.table.ctypes.data, table.ctypes.data, out.ctypes.data)
    return out[lanes.components[None] + np.arange(lanes.lanes)[:, None]]


@every_coupled
def test_every_lane_holds_neurons_of_its_own(preconditioner):
    network, states, _ = run_with_changes(preconditioner)
    lanes, own = Lanes(evaluator(network).tape, Axis.SAMPLES), InterpretedEvaluator(network)
    for first in range(0, len(states) - 7 * lanes.lanes, 40):
        group = states[first :: lanes.lanes][: lanes.lanes]
        derivatives = moves_of_lanes(lanes, group)
        assert_close(derivatives, [own.rhs(x) for x in group])
        left = lanes.tables["drives"][lanes.components[None] + np.arange(lanes.lanes)[:, None]]
        assert_close(left, [network.pack(own.drives(x)) for x in group])


@pytest.mark.sampled(2)
@every_coupled
def test_lanes_with_time_constants_of_their_own_hold_neurons(preconditioner):
    network, states, _ = run_with_changes(preconditioner)
    lanes, rng = Lanes(evaluator(network).tape, Axis.VARIANTS), np.random.default_rng(8)
    rates = lanes.tables["rates"].reshape(network.stages, -1, lanes.lanes)
    for first in range(0, 400, 100):  # a lane takes over sample after sample
        factors = rng.uniform(0.5, 2.0, (lanes.lanes, *network.live.shape))
        group, expected = states[first :: lanes.lanes][: lanes.lanes], []
        for lane, (factor, x) in enumerate(zip(factors, group)):
            rates[:, :, lane] = (network.layout.rates * factor).T
            if "roots" in lanes.tables:
                roots = lanes.tables["roots"][: lanes.size].reshape(rates.shape)
                roots[:, :, lane] = np.sqrt(factor).T
            neurons = tuple(
                replace(n, tau=np.asarray(n.tau) / f) for n, f in zip(network.cell.neurons, factor)
            )
            sample = replace(network, cell=replace(network.cell, neurons=neurons))
            expected.append(evaluator(sample).rhs(x))
        assert_close(moves_of_lanes(lanes, group), expected)
