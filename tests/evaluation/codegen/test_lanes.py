"""A lane is a sample: every lane says what the loops say of its state, whatever lies beside it."""

import ctypes

import numpy as np
import pytest
from designs import near_start, wired_with
from random_networks import far_wired

from ann_dc.evaluation.codegen.lanes import Lanes
from ann_dc.evaluation.codegen.memory import LINE
from ann_dc.evaluation.codegen.plan import WRITTEN_OUT, Axis
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.preconditioners.base import PreconditionerKind

CODE = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * 3)
KINDS = (
    PreconditionerKind.MULTILEVEL,
    PreconditionerKind.COUPLED_MULTILEVEL,
    PreconditionerKind.RESISTIVE_GRID,
    PreconditionerKind.DIAGONAL,
)


def of_every_lane(lanes: Lanes, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Right-hand sides (W, n) and residuals (W, 2) of as many states."""
    table, out = lanes.state(states[0]), np.zeros(lanes.spare)
    for lane, x in enumerate(states):
        table.reshape(-1, lanes.lanes)[:, lane] = lanes.state(x).reshape(-1, lanes.lanes)[:, lane]
    entry = lanes.entry
    CODE(entry.rhs)(entry.table.ctypes.data, table.ctypes.data, out.ctypes.data)
    CODE(entry.residuals)(entry.table.ctypes.data, table.ctypes.data, entry.found.ctypes.data)
    slopes = out[lanes.components[None] + np.arange(lanes.lanes)[:, None]]
    return slopes, entry.found.reshape(3, -1)[:2].T


@pytest.mark.parametrize("most", [WRITTEN_OUT, 0], ids=["written out", "in loops"])
@pytest.mark.parametrize("kind", KINDS, ids=str)
@pytest.mark.parametrize("name", ["car", "two_link_arm", "double_integrator"])
@pytest.mark.sampled
def test_every_lane_is_a_state_of_its_own(monkeypatch, name, kind, most):
    monkeypatch.setattr("ann_dc.evaluation.codegen.plan.WRITTEN_OUT", most)
    network = wired_with(name, kind)
    loops, lanes = (
        InterpretedEvaluator(network),
        Lanes(InterpretedEvaluator(network).tape, Axis.SAMPLES),
    )
    assert bool(lanes.plan.straight) == bool(lanes.plan.chains and most)
    states = near_start(network, 4, lanes.lanes)
    slopes, residuals = of_every_lane(lanes, states)
    expected = np.array([loops.rhs(x) for x in states])
    np.testing.assert_allclose(slopes, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    np.testing.assert_allclose(residuals, [loops.residuals(x) for x in states], rtol=1e-11)


def test_a_drive_that_is_no_number_is_no_small_residual():
    network = wired_with("car", PreconditionerKind.MULTILEVEL)
    lanes = Lanes(InterpretedEvaluator(network).tape, Axis.SAMPLES)
    states = near_start(network, 4, lanes.lanes)
    states[2, 5], states[6, 0] = np.nan, np.inf
    _, residuals = of_every_lane(lanes, states)
    bad = np.isin(np.arange(lanes.lanes), (2, 6))
    assert np.isinf(residuals.max(axis=1)).tolist() == bad.tolist()


def test_tables_begin_at_a_line_of_the_cache():
    lanes = Lanes(
        InterpretedEvaluator(wired_with("car", PreconditionerKind.MULTILEVEL)).tape, Axis.SAMPLES
    )
    assert {table.ctypes.data % LINE for table in lanes.tables.values()} == {0}


@pytest.mark.sampled(8)
@pytest.mark.parametrize("axis", [Axis.SAMPLES, Axis.VARIANTS])
@pytest.mark.parametrize("seed", range(6))
def test_every_lane_with_far_wires_is_the_reference(axis, seed):
    network = far_wired(seed)
    own = evaluator(network)
    lanes = Lanes(own.tape, axis)
    noise = np.random.default_rng(seed).standard_normal((lanes.lanes, network.size))
    states = network.start_state + 0.1 * noise
    slopes, residuals = of_every_lane(lanes, states)
    expected = own.rhs(states)
    np.testing.assert_allclose(slopes, expected, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_allclose(residuals, [own.residuals(x) for x in states], rtol=1e-10)
