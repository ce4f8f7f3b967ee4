"""A stiffness in generated code: rows of any length, from both ends to the middle and back."""

import ctypes
from dataclasses import replace

import numpy as np
import pytest
from random_preconditioners import random_preconditioner, with_stiffness
from seeds import seeds

from ann_dc import plants, synthesize
from ann_dc.evaluation.codegen.lanes import Lanes
from ann_dc.evaluation.codegen.plan import Axis
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.cell import Cell, Connection, Neuron, Role
from ann_dc.network.ends import FixedNeuron, Omitted
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.network.preconditioners.resistive_grid import ResistiveGrid

CODE = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * 2)
WHOLE = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * 3)
LENGTHS = [*range(1, 14), 32, 33, 1000, 1001]
every_axis = pytest.mark.parametrize("axis", Axis, ids=lambda axis: axis.name.lower())


def assert_moves_by_the_preconditioner(network: Network, axis: Axis) -> None:
    """Of random drives, whatever lies where the moves will be."""
    lanes = Lanes(evaluator(network).tape, axis)
    samples = 1 if axis is Axis.STAGES else lanes.lanes
    drives = np.random.default_rng(3).standard_normal((samples, network.size))
    places = lanes.components + np.arange(samples)[:, None]
    lanes.tables["drives"][places] = drives
    derivatives = np.full(lanes.spare, np.nan)
    CODE(lanes.entry.preconditioner)(lanes.entry.table.ctypes.data, derivatives.ctypes.data)
    row, table = network.layout, np.zeros((samples, *network.layout.rates.shape))
    table[:, *network.places.T] = drives
    reached = network.preconditioner.reach(row)[network.places[:, 0]]
    expected = network.pack(network.preconditioner.apply(row, table))[:, reached]
    found = derivatives[places][:, reached]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def tied_at_random(network: Network, seed: int) -> Network:
    """With a stiffness whose every number is random."""
    preconditioner = random_preconditioner(
        PreconditionerKind.RESISTIVE_GRID, network.layout, np.random.default_rng(seed)
    )
    return replace(network, preconditioner=preconditioner)


@every_axis
@pytest.mark.parametrize("stages", LENGTHS)
@pytest.mark.sampled
def test_rows_of_any_length(stages, axis):
    plain = synthesize(plants.double_integrator(N=stages))
    assert_moves_by_the_preconditioner(
        with_stiffness(plain, PreconditionerKind.RESISTIVE_GRID), axis
    )
    assert_moves_by_the_preconditioner(tied_at_random(plain, stages), axis)


def lacking_some(seed: int) -> Network:
    """Neurons that are pinned or not there anywhere in the row, the middle included."""
    rng, stages = np.random.default_rng(seed), 8 + seed % 2
    names = "a", "b", "c"
    lacking = rng.permutation(3 * stages)[:7].tolist()
    ends = [(names[i % 3], i // 3) for i in lacking]
    cell = Cell(
        neurons=tuple(Neuron(name=n, role=Role.PRIMAL, tau=0.5) for n in names),
        inputs=("held",),
        connections=tuple(Connection(source=n, target=n, weight=-1.0) for n in names),
    )
    network = Network(
        cell=cell,
        stages=stages,
        inputs={"held": 2.0},
        fixed=tuple(FixedNeuron(neuron=n, stage=k, input="held") for n, k in ends[:3]),
        omitted=tuple(Omitted(neuron=n, stage=k) for n, k in ends[3:]),
    )
    return tied_at_random(network, seed)


@every_axis
@seeds(6)
def test_cells_that_lack_neurons(seed, axis):
    assert_moves_by_the_preconditioner(lacking_some(seed), axis)


@every_axis
@seeds(4)
def test_where_no_neuron_is_nothing_moves(seed, axis):
    """Not even from drives that are no numbers: the next sample of that lane would find them."""
    network = lacking_some(seed)
    lanes = Lanes(evaluator(network).tape, axis)
    samples = np.arange(1 if axis is Axis.STAGES else lanes.lanes)[:, None]
    state = lanes.state(np.full(network.size, np.nan))
    entry, derivatives = lanes.entry, np.zeros(lanes.spare)
    WHOLE(entry.rhs)(entry.table.ctypes.data, state.ctypes.data, derivatives.ctypes.data)
    assert np.isnan(derivatives[lanes.components + samples]).any()
    assert not np.delete(derivatives[: lanes.reserve], lanes.components + samples).any()


@every_axis
def test_the_code_depends_on_who_is_tied_alone(axis):
    """Not on how firmly, nor on the length of the row, nor on zeros among the numbers."""
    networks = [tied_at_random(synthesize(plants.car(N=9)), seed) for seed in (0, 1)]
    networks.append(tied_at_random(synthesize(plants.car(N=90)), 2))
    own, following = (
        getattr(networks[0].preconditioner, name).copy() for name in ("own", "following")
    )
    own[:, 0, 1:] = own[:, 1:, 0] = 0.0
    following[:, 2, 3] = 0.0
    networks.append(
        replace(networks[0], preconditioner=ResistiveGrid(own=own, following=following))
    )
    keys = {Lanes(evaluator(network).tape, axis).plan.key for network in networks}
    assert len(keys) == 1
    ties_less = replace(networks[0], preconditioner=ResistiveGrid(own=own, following=0 * following))
    assert Lanes(evaluator(ties_less).tape, axis).plan.key not in keys


@pytest.mark.sampled(2)
@every_axis
def test_a_number_is_stored_once(axis):
    """The tables of a long row come from afar: of the two triangles of M^{-1} they have one."""
    network = with_stiffness(synthesize(plants.car(N=400)), PreconditionerKind.RESISTIVE_GRID)
    lanes = Lanes(evaluator(network).tape, axis)
    m, entry = len(network.layout.primal), lanes.entry
    within, ahead = m * (m + 1) // 2, len(network.layout.chains) ** 2
    assert entry.preconditioner
    assert lanes.tables["factor"].size <= (400 + 2) * (within + ahead)
