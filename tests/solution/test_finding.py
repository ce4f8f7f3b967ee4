"""Searches of a problem for the settled point of its design."""

import pytest
import sympy as sp

import ann_dc
from ann_dc.progress import Stopped
from ann_dc.solution import Search

x, a = sp.symbols("x a")

PROBLEM = ann_dc.OptimalControlProblem(
    states=(x,), controls=(a,), dynamics=(x**2 + a,), dt=0.1, cost=x**2 + a**2, horizon=10,
    q_0=(1,), bounds={a: (-2, 2)},
)  # fmt: skip


def ends_after(lines):
    """A progress that ends the work."""
    left = iter(range(lines))

    def told(line):
        if next(left, None) is None:
            raise Stopped("it was interrupted")

    return told


def test_search_that_is_ended_keeps_the_optimum_from_the_line():
    network = ann_dc.synthesize(PROBLEM)
    search = Search(PROBLEM, network)
    (optimum,) = search.from_line(ends_after(100))
    found = search.find(network.start_state, ends_after(0))
    assert found.state == pytest.approx(optimum.state)


def test_search_that_is_ended_with_nothing_found_says_so():
    network = ann_dc.synthesize(PROBLEM)
    with pytest.raises(Stopped, match="interrupted"):
        Search(PROBLEM, network).find(network.start_state, ends_after(0))
