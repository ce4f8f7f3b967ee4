"""Starts around the straight line: by seed, further and further, inside every domain."""

import re

import numpy as np
import pytest

from ann_dc.errors import ArgumentError, ProblemError
from ann_dc.families.seeded_starts import checked_starts, seeded_starts
from ann_dc.problem import plants
from ann_dc.problem.initial_guess import InitialGuess, interpolated_guess

PROBLEM = plants.double_integrator(N=5)
LINE = interpolated_guess(PROBLEM)


def test_the_first_is_the_line_and_the_others_go_further_and_further():
    starts = seeded_starts(PROBLEM, 200)
    away = np.array([np.abs(start.q - LINE.q).max() for start in starts])
    assert away[0] == 0.0
    assert np.median(away[1:60]) < 0.5 * np.median(away[140:])
    for start in starts:  # the ends are the problem's
        np.testing.assert_allclose(start.q[:, [0, -1]], LINE.q[:, [0, -1]])


def test_a_seed_says_it_all():
    one, again, other = (seeded_starts(PROBLEM, 4, seed=seed) for seed in (3, 3, 4))
    for a, b, c in zip(one[1:], again[1:], other[1:]):
        assert a.q.tobytes() == b.q.tobytes()
        assert a.u.tobytes() == b.u.tobytes()
        assert not np.array_equal(a.q, c.q)


@pytest.mark.parametrize("name", ["orbit_transfer", "cstr", "car"])
def test_a_network_can_start_at_each(name):
    problem = plants.get(name)()
    starts = seeded_starts(problem, 16)
    assert len(checked_starts(problem, starts)) == 16


@pytest.mark.parametrize("count", [0, -1, 2.5, True, "64", None])
def test_a_count_is_positive(count):
    with pytest.raises(ProblemError, match="starts: expected a whole number of at least 1"):
        seeded_starts(PROBLEM, count)


@pytest.mark.parametrize("seed", [-1, 0.5, None])
def test_a_seed_is_not_negative(seed):
    with pytest.raises(ProblemError, match="seed: expected a whole number of at least 0"):
        seeded_starts(PROBLEM, 2, seed=seed)


LONGER = interpolated_guess(plants.double_integrator(N=6))


def with_a_nan(array: np.ndarray) -> np.ndarray:
    array = array.copy()
    array[1, 2] = np.nan
    return array


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (InitialGuess(q=LINE.q, u=LINE.u + np.inf), "starts[1].u: "),
        (LONGER, "starts[1].q: expected an array of shape (2, 6), got (2, 7)"),
        (LINE.q, "starts[1]: expected an InitialGuess, got array"),
        (None, "starts[1]: expected an InitialGuess, got None"),
    ],
)
def test_starts_that_are_refused(bad, message):
    with pytest.raises(ProblemError, match=re.escape(message)):
        checked_starts(PROBLEM, [LINE, bad])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"q": with_a_nan(LINE.q)}, "q: expected numbers, none of them nan"),
        ({"q": LINE.q[:, 1:]}, "u: expected an array of shape (m, N) = (1, 4)"),
        ({"u": LINE.u[0]}, "u: expected an array of shape (m, N) = (m, 5), got an array of shape"),
        ({"mu": LINE.u}, "mu: expected an array of shape (n, N) = (2, 5)"),
        ({"q": "far"}, "q: expected a NumPy array of numbers, got the text 'far'"),
    ],
)
def test_a_start_contradicts_itself(given, message):
    with pytest.raises(ArgumentError, match=re.escape(message)):
        InitialGuess(**{"q": LINE.q, "u": LINE.u, **given})


def test_no_start_at_all():
    with pytest.raises(ProblemError, match="got an empty list"):
        checked_starts(PROBLEM, [])


def test_a_start_outside_a_domain_is_named():
    problem = plants.orbit_transfer()
    line = interpolated_guess(problem)
    with pytest.raises(ProblemError, match=re.escape("starts[0]: initial_guess: the map f")):
        checked_starts(problem, [InitialGuess(q=0 * line.q, u=line.u)])
