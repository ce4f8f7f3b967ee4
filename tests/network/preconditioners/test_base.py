"""One contract, every kind of preconditioner, over rows with ends, time constants and sizes of any
sort.
"""

from dataclasses import replace

import numpy as np
import pytest
from designs import near_start, small, wired_with
from hypothesis import given, settings, strategies as st
from problems import SUITE
from random_preconditioners import random_preconditioner, rows, with_errors
from scipy import sparse

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.backends import ode
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.settling import Settling
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import (
    ArrayLayout,
    Factors,
    Preconditioner,
    PreconditionerKind,
)
from ann_dc.network.preconditioners.cyclic_reduction import CyclicReduction
from ann_dc.network.preconditioners.resistive_grid import ResistiveGrid

every_kind = pytest.mark.parametrize("kind", PreconditionerKind, ids=lambda kind: kind.name.lower())
seeds = st.integers(0, 2**32 - 1)


@st.composite
def cases(draw) -> tuple[ArrayLayout, np.random.Generator]:
    """A row with a neuron at least, and where random numbers come from."""
    row = draw(rows().filter(lambda row: (row.rates > 0).any()))
    return row, np.random.default_rng(draw(seeds))


def dense(preconditioner: Preconditioner, row: ArrayLayout) -> np.ndarray:
    """M (n, n) over the neurons that there are, column by column of `apply`."""
    live = row.rates.T > 0
    units = np.zeros((len(row.state_rates), *row.rates.shape))
    stage, neuron = np.nonzero(live)
    units[np.arange(len(stage)), neuron, stage] = 1.0
    return preconditioner.apply(row, units)[:, neuron, stage].T


def assert_close(actual, expected, relative=1e-10) -> None:
    scale = np.abs(expected).max(initial=1e-300)
    np.testing.assert_allclose(actual, expected, rtol=0, atol=relative * scale)


@every_kind
@settings(max_examples=30, deadline=None)
@given(case=cases())
def test_symmetric_and_positive_definite(kind, case):
    row, rng = case
    M = dense(random_preconditioner(kind, row, rng), row)
    assert_close(M, M.T, 1e-12)
    root = 1 / np.sqrt(np.diag(M))
    assert np.linalg.eigvalsh(M * root[:, None] * root).min() > 0


@pytest.mark.sampled(2)
@every_kind
@settings(max_examples=30, deadline=None)
@given(case=cases())
def test_factors_say_what_apply_does(kind, case):
    row, rng = case
    preconditioner = random_preconditioner(kind, row, rng)
    M, factors = dense(preconditioner, row), preconditioner.factors(row)
    assert_close(factors.matrix().toarray(), M)
    spread, stiffness = factors.spread.toarray(), factors.stiffness.toarray()
    assert_close(spread @ np.linalg.solve(stiffness, spread.T), M)
    assert np.linalg.eigvalsh(stiffness).min() > 0
    v = rng.standard_normal(len(M))
    assert_close(M @ factors.inverse()(v), v, 1e-7)
    assert_close(factors.inverse()(M @ v), v, 1e-7)
    assert_close(preconditioner.inverse(row)(M @ v), v, 1e-7)


def test_a_full_stiffness_is_told_from_a_diagonal_one():
    between = sparse.csr_array(np.array([[2.0, 1.0], [1.0, 2.0]]))
    factors = Factors(spread=sparse.csr_array(np.eye(2)), stiffness=between)
    assert_close(factors.matrix().toarray(), np.array([[2.0, -1.0], [-1.0, 2.0]]) / 3)


@every_kind
@settings(max_examples=20, deadline=None)
@given(case=cases())
def test_drives_may_have_axes_before_them_and_be_complex(kind, case):
    row, rng = case
    preconditioner = random_preconditioner(kind, row, rng)
    M = dense(preconditioner, row)
    stage, neuron = np.nonzero(row.rates.T > 0)
    drives = rng.standard_normal((2, 3, *row.rates.shape)) * (row.rates > 0)
    drives = drives + 1j * rng.standard_normal(drives.shape) * (row.rates > 0)
    derivatives = preconditioner.apply(row, drives)
    assert derivatives.shape == drives.shape
    assert_close(derivatives[..., neuron, stage], drives[..., neuron, stage] @ M.T, 1e-11)
    assert not derivatives[..., row.rates == 0].any()
    assert_close(preconditioner.apply(row, drives.real), derivatives.real, 1e-12)


@every_kind
@settings(max_examples=20, deadline=None)
@given(case=cases())
def test_no_kind_spreads_what_it_does_not_reach(kind, case):
    """Neurons beyond `reach`, the duals among them, move with their own drive alone."""
    row, rng = case
    preconditioner = random_preconditioner(kind, row, rng)
    reach, M = preconditioner.reach(row), dense(preconditioner, row)
    assert not np.setdiff1d(np.flatnonzero(reach), row.primal).size
    alone = ~reach[np.nonzero(row.rates.T > 0)[1]]
    np.testing.assert_array_equal(M[alone], np.diag(row.state_rates)[alone])


@every_kind
@settings(max_examples=20, deadline=None)
@given(case=cases())
def test_time_scales_the_preconditioner(kind, case):
    """Rates c times as fast make a stiffness' moves c times as fast: S has no unit."""
    row, rng = case
    preconditioner = random_preconditioner(kind, row, rng)
    faster = replace(row, rates=3 * row.rates)
    added = dense(preconditioner, faster) - dense(preconditioner, row)
    if kind in (
        PreconditionerKind.MULTILEVEL,
        PreconditionerKind.COUPLED_MULTILEVEL,
    ):  # whose gains are rates of their own
        assert_close(added, np.diag(2 * row.state_rates))
    else:
        assert_close(added, 2 * dense(preconditioner, row))


@every_kind
@settings(max_examples=20, deadline=None)
@given(case=cases())
def test_wires_are_between_what_there_is(kind, case):
    row, rng = case
    wires = random_preconditioner(kind, row, rng).wires(row)
    n = len(row.state_rates)
    assert wires.weights.shape[0] == n
    assert wires.count == wires.weights.count_nonzero()
    assert wires.per_cell(row.stages) == wires.count / row.stages
    if kind is PreconditionerKind.DIAGONAL:
        assert (wires.count, wires.nodes) == (0, 0)
    if kind in (PreconditionerKind.RESISTIVE_GRID, PreconditionerKind.CYCLIC_REDUCTION):
        assert wires.weights.shape == (n, n)
        touched = np.unique(np.concatenate(wires.weights.nonzero()))
        primal = row.component[row.primal].ravel()
        assert not np.setdiff1d(touched, primal).size


@every_kind
@pytest.mark.parametrize("name", SUITE)
@pytest.mark.sampled
def test_every_problem(name, kind):
    """Real matrices: the evaluators' moves are M d, with M from the factors."""
    network = wired_with(name, kind)
    assert network.preconditioner.kind is kind
    M = evaluator(network).preconditioner.toarray()
    assert_close(M, dense(network.preconditioner, network.layout))
    assert np.linalg.eigvalsh(M).min() > 0
    drive = np.random.default_rng(3).standard_normal(network.size)
    for ours in (evaluator(network), InterpretedEvaluator(network)):
        assert_close(ours.derivative(drive), M @ drive)
    back = network.preconditioner.factors(network.layout).inverse()(M @ drive)
    assert_close(back, drive, 1e-7)


@pytest.mark.slow
def test_a_grid_and_a_tree_are_the_same_preconditioner():
    for name in SUITE:
        network = wired_with(name, PreconditionerKind.RESISTIVE_GRID)
        grid, row = network.preconditioner, network.layout
        tree = CyclicReduction(own=grid.own, following=grid.following)
        assert_close(dense(tree, row), dense(grid, row))
        assert tree.wires(row).both_ways
        assert not grid.wires(row).both_ways


@every_kind
def test_it_is_named_in_the_summary(kind):
    assert kind.value in str(wired_with("car", kind))


# ---- where a network settles ---------------------------------------------------------------------

EXACT = Settling(tolerance=1e-9)


def settled(network: Network) -> np.ndarray:
    run = OdeBackend(method=ode.BDF.tighter(), settling=EXACT, verify=False, limit=1e6).run(network)
    assert run.status.settled, run.status
    return run.trajectory.final


@pytest.mark.sampled(2)
@every_kind
@pytest.mark.parametrize(
    "name",
    ["double_integrator", *(pytest.param(n, marks=pytest.mark.slow) for n in ("car", "unicycle"))],
)
def test_the_equilibrium_never_depends_on_the_preconditioner(name, kind):
    """Nor does where a run ends: from the same start, at the same state."""
    network = small(name, rho=4.0)
    rng = np.random.default_rng(11)
    plain = equilibrium(network, settled(network))
    scale = np.abs(plain).max()
    preconditioner = random_preconditioner(kind, network.layout, rng)
    for chosen in (preconditioner, with_errors(preconditioner, network.layout, rng, 0.2)):
        wired = replace(network, preconditioner=chosen)
        np.testing.assert_array_equal(equilibrium(wired, plain), equilibrium(network, plain))
        np.testing.assert_allclose(settled(wired), plain, atol=1e-6 * scale)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "kind",
    [
        PreconditionerKind.RESISTIVE_GRID,
        PreconditionerKind.CYCLIC_REDUCTION,
        PreconditionerKind.MULTILEVEL,
    ],
)
def test_nor_do_errors_of_the_time_constants_move_it(kind):
    network = replace(small("car", rho=4.0), preconditioner=wired_with("car", kind).preconditioner)
    rng = np.random.default_rng(12)
    at = settled(network)
    neurons = tuple(
        replace(n, tau=np.asarray(n.tau) * rng.uniform(0.8, 1.2, network.stages))
        for n in network.cell.neurons
    )
    off = replace(
        network,
        cell=replace(network.cell, neurons=neurons),
        preconditioner=with_errors(network.preconditioner, network.layout, rng, 0.02),
    )
    np.testing.assert_allclose(settled(off), at, atol=1e-6 * np.abs(at).max())


@every_kind
@settings(max_examples=15, deadline=None)
@given(seed=seeds)
def test_nothing_rests_but_what_has_no_drive(kind, seed):
    """M d = 0 only where d = 0: and a move is no smaller than M allows."""
    rng = np.random.default_rng(seed)
    network = small("car")
    wired = replace(network, preconditioner=random_preconditioner(kind, network.layout, rng))
    x = near_start(network, seed % 1000)
    drive = network.pack(evaluator(network).drives(x))
    smallest = np.linalg.eigvalsh(evaluator(wired).preconditioner.toarray())[0]
    derivative = evaluator(wired).rhs(x)
    assert np.linalg.norm(derivative) >= (1 - 1e-9) * smallest * np.linalg.norm(drive)
    assert derivative @ drive > 0


def test_a_preconditioner_is_not_shared_by_accident():
    """Numbers of a preconditioner cannot be written to after it was made."""
    network = wired_with("car", PreconditionerKind.RESISTIVE_GRID)
    assert isinstance(network.preconditioner, ResistiveGrid)
    for array in (network.preconditioner.own, network.preconditioner.following):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
