"""Random problems under a time limit: every call returns in time, with a status that is true."""

import time

import numpy as np
import pytest
from random_problems import FAMILIES, problem
from reference import ipopt
from seeds import seeds

import ann_dc
from ann_dc.backends.status import Outcome
from ann_dc.solution.solution import certificate_of

GRACE = 5.0
"""Seconds of this process over the limit within which a call returns."""


def returned(family: str, seed: int, limit: float, grace: float = GRACE):
    given = problem(family, seed)
    begin = time.process_time()
    solution = ann_dc.solve(given, time_limit=limit)
    assert time.process_time() - begin < limit + grace
    assert isinstance(solution.status.outcome, Outcome)
    assert str(solution)
    if solution.status.outcome is Outcome.INFEASIBLE:
        assert not ipopt(given).success
    if solution.certified:
        found = ipopt(given, guess=(solution["q"].T, solution["u"].T))
        off = 3 * solution.certificate.newton_step
        np.testing.assert_allclose(solution.objective, found.objective, rtol=1e-5 + off, atol=1e-7)
        state = ann_dc.equilibrium(solution.network, solution.trajectory.final)
        exact = certificate_of(given, solution.network, state)
        np.testing.assert_allclose(exact.objective, found.objective, rtol=1e-5, atol=1e-7)
    return solution


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "family",
    [
        *("saturated", "indefinite"),
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("unstable", "polynomial")),
    ],
)
def test_one_of_a_family(family):
    returned(family, 0, limit=2.0, grace=60.0)  # on a machine that has other work to do


@pytest.mark.slow
@seeds(25, first=1)
@pytest.mark.parametrize("family", FAMILIES)
def test_two_hundred(family, seed):
    returned(family, seed, limit=20.0)
