"""Levels of operations take the steps of the reference evaluator, from the program alone."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from random_networks import far_wired, free_of_coupled_limits, random_network
from random_preconditioners import with_stiffness

import ann_dc
from ann_dc.evaluation.reference import evaluator
from ann_dc.lowering.levels import depths_of, levels_of, words_of
from ann_dc.lowering.program import PRODUCT, SUMS, UPDATE, Program
from ann_dc.lowering.stiffness_sums import StiffnessSolve, reduction, substitution
from ann_dc.lowering.writing import program_of
from ann_dc.network.network import Network
from ann_dc.solver import synthesize

PLANTS = ann_dc.plants
x, v = (free := PLANTS.double_integrator(N=9)).states
(a,) = free.controls
PROBLEMS = {
    "car": PLANTS.car(),
    "double integrator": PLANTS.double_integrator(N=7),
    "reactor": PLANTS.cstr(),
    "soft obstacle": PLANTS.unicycle_soft_obstacle(),
    "pendulum": PLANTS.pendulum(),
    "inequality and bounds": replace(
        free, constraints={"pace": v <= 0.9 + x / 4}, bounds={a: (-40, 40)}
    ),
    "soft inequality": replace(free, constraints={"pace": v <= 0.9}, soft={"pace": 30}),
    "two objectives": replace(free, objectives={"effort": a**2 / 2, "haste": (x - 1) ** 2}),
}
KINDS = ann_dc.PreconditionerKind
SOLVES = st.sampled_from((substitution, reduction))
STIFF = (KINDS.RESISTIVE_GRID, KINDS.CYCLIC_REDUCTION)
COUPLED = ("inequality and bounds", "two objectives")
"""Problems with saturation limits or objectives, which a stiffness does not carry."""
CASES = [(n, k) for n in PROBLEMS for k in KINDS if not (n in COUPLED and k in STIFF)]


def step_of(program: Program, state: np.ndarray) -> np.ndarray:
    """State one step after ``state``, level by level."""
    levels, following = levels_of(program), state.copy()
    words = words_of(program, levels, state)
    for level in levels:
        if level.kind == UPDATE:
            at, (low, high) = level.neurons, program.limits[level.neurons].T
            following[at] = np.clip(state[at] + level.results(words), low, high)
    return following


def error_of_step(
    network: Network, state: np.ndarray, solve: StiffnessSolve = substitution, step: float = 1e-2
) -> float:
    """Error of one step against forward Euler, relative to the largest increment."""
    program = program_of(network, step, solve)
    low, high = program.limits.T
    state = np.clip(state, low, high)
    expected = np.clip(state + step * evaluator(network).rhs(state), low, high)
    found = step_of(program, state)
    largest = np.abs(expected - state).max(initial=np.finfo(float).tiny)
    return float(np.abs(found - expected).max(initial=0.0) / largest)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("name", "kind"), CASES)
def test_levels_of_a_design_take_the_reference_step(name, kind):
    network = ann_dc.design(PROBLEMS[name], preconditioner=kind).network
    noise = np.random.default_rng(0).standard_normal(network.size)
    for solve in (substitution, reduction):
        assert error_of_step(network, network.start_state + 0.3 * noise, solve) < 1e-12


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(KINDS), SOLVES, st.booleans())
def test_levels_of_a_random_network_take_the_reference_step(seed, kind, solve, far):
    network = free_of_coupled_limits(random_network(seed, kind))
    if far and kind is KINDS.DIAGONAL:
        network = far_wired(seed)
    noise = np.random.default_rng(seed).standard_normal(network.size)
    assert error_of_step(network, network.start_state + 0.1 * noise, solve) < 1e-12


@given(st.integers(0, 2**32 - 1), st.sampled_from(KINDS), SOLVES)
def test_a_level_reads_only_words_of_earlier_levels(seed, kind, solve):
    program = program_of(free_of_coupled_limits(random_network(seed, kind)), 0.1, solve)
    written = set(np.flatnonzero(~np.isin(np.arange(len(program.words)), _targets(program))))
    seen = 0
    for level in levels_of(program):
        read = level.operands if level.kind == PRODUCT else level.operands[1]
        assert set((level.sources if level.kind in SUMS else read).ravel().tolist()) <= written
        written |= set(level.targets.tolist()) if level.kind != UPDATE else set()
        seen += len(level.targets)
    assert seen == len(program.operations)


def _targets(program) -> np.ndarray:
    kinds, targets = program.operations[:, :2].T
    return targets[kinds != UPDATE]


@pytest.mark.parametrize("kind", STIFF)
def test_sequential_sums_of_a_reduction_grow_with_the_logarithm_of_the_horizon(kind):
    problem = PLANTS.double_integrator
    depths = [
        depths_of(program_of(with_stiffness(synthesize(problem(N=n)), kind), 0.1, reduction)).max()
        for n in (4, 8, 16, 32)
    ]
    np.testing.assert_array_equal(np.diff(depths), 2)
