"""Records travel by their fields: through pickles, copies and other processes, also when used."""

import copy
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest
from network_files import assert_same

import ann_dc
from ann_dc import evaluator, plants
from ann_dc.families.family_design import design_family

BACKEND = ann_dc.OdeBackend(verify=False)


def through_a_pickle(record):
    return pickle.loads(pickle.dumps(record))


@pytest.fixture(scope="module")
def used():
    """A solution that was asked for everything that it keeps."""
    solution = ann_dc.solve(plants.double_integrator(N=4), backend=BACKEND)
    assert solution["x"].shape == (5,)
    assert len(solution.spectrum.eigenvalues) == solution.network.size
    assert set(solution.populations) == {"q", "u", "t", "mu", "beta"}
    assert solution.trajectory is not None
    assert evaluator(solution.network) is evaluator(solution.network)
    assert str(solution)
    return solution


TRAVELLED = {
    "solution": lambda solution: solution,
    "run": lambda solution: solution.run,
    "design": lambda solution: solution.design,
    "problem": lambda solution: solution.problem,
    "batch": lambda solution: ann_dc.RecurrentBackend().run_batch(
        solution.network, {"q_d.x": [0.5, float("nan")]}
    ),
    "family": lambda solution: design_family(solution.problem, [{"q_d.x": 0.5}, {"q_d.x": 1.0}]),
}


@pytest.mark.parametrize("name", TRAVELLED)
def test_used_records_arrive_as_they_were(used, name):
    record = TRAVELLED[name](used)
    for travel in (through_a_pickle, copy.deepcopy, copy.copy):
        arrived = travel(record)
        assert arrived is not record
        assert_same(arrived, record, name)


def test_what_was_shared_is_shared_on_arrival(used):
    arrived = through_a_pickle(used)
    assert arrived.equations.problem is arrived.problem
    assert arrived.run.trajectory.network is arrived.network
    assert arrived.design.gains is arrived.design.best.gains


def test_what_was_kept_stays_behind(used):
    fresh = ann_dc.synthesize(used.problem)
    length = len(pickle.dumps(fresh))
    evaluator(fresh)
    assert fresh.start_state.size == fresh.size
    assert len(pickle.dumps(fresh)) == length


def test_arrays_that_were_for_reading_still_are():
    problem = through_a_pickle(plants.cstr(N=3))
    arrays = [*problem.inputs.values(), *ann_dc.synthesize(problem).inputs.values()]
    assert arrays
    assert not any(array.flags.writeable for array in arrays)


def test_other_inputs_of_a_problem_travel_too():
    problem = plants.double_integrator(N=3).with_inputs(q_d=(2, 0))
    arrived = through_a_pickle(problem)
    q, u = np.zeros((2, 3)), np.ones((1, 3))
    np.testing.assert_array_equal(arrived.functions.map(q, u), problem.functions.map(q, u))
    assert arrived.q_d == (2.0, 0.0)


@pytest.mark.slow
def test_a_pool_of_fresh_processes_solves(used):
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=1, mp_context=spawn) as pool:
        there = pool.submit(ann_dc.solve, used.problem, backend=BACKEND).result()
    np.testing.assert_array_equal(there.trajectory.states, used.trajectory.states)
    assert (there.certified, there.verdict) == (used.certified, used.verdict)
