"""Searches of a problem for the settled point of its design."""

import pytest
import sympy as sp
from reference import ipopt

import ann_dc
from ann_dc.progress import Stopped, silent
from ann_dc.solution.knowledge import Search

x, v, a = sp.symbols("x v a")

PROBLEM = ann_dc.OptimalControlProblem(
    states=(x,), controls=(a,), dynamics=(x**2 + a,), dt=0.1, cost=x**2 + a**2, horizon=10,
    q_0=(1,), bounds={a: (-2, 2)},
)  # fmt: skip


def chain_that_swings():
    """Three masses between springs; the first is pushed, the last is to end where it swings to."""
    places, speeds = sp.symbols("x1:4"), sp.symbols("v1:4")
    pulls = [0, 0, 0, 0]
    for i, ahead in enumerate(places):
        stretch = ahead - (places[i - 1] if i else 0)
        force = 1.3 * stretch + 0.19 * stretch**3
        pulls[i] -= force
        pulls[i - 1] += force
    push = a, 0, 0
    motion = [pull - 0.4 * speed + own for pull, speed, own in zip(pulls, speeds, push)]
    cost = 0.052 * a**2 + 0.0074 * (1.21 * speeds[0] + 0.35) ** 2 + 0.055 * (speeds[1] + 0.28) ** 2
    return ann_dc.OptimalControlProblem(
        states=(*places, *speeds), controls=(a,), dynamics=(*speeds, *motion), dt=0.0484,
        horizon=42, cost=cost, q_0=(0.67, 0.106, -0.079, 0, 0, 0),
        q_d=(None, None, 0.284, None, None, None), bounds={places[2]: (None, 0.285)},
        terminal_constraints={"end": (places[1] + 0.0026) ** 2 <= 0.0077},
    )  # fmt: skip


def ends_after(lines):
    """A progress that ends the work."""
    left = iter(range(lines))

    def reported(line):
        if next(left, None) is None:
            raise Stopped("interrupted")

    return reported


@pytest.mark.slow
def test_search_is_not_led_astray_by_a_chain_that_swings_by_itself():
    """Its third mass is hardly moved by the force, whose natural unit is 5000 times too large."""
    problem = chain_that_swings()
    network = ann_dc.synthesize(problem)
    (optimum,) = Search(problem, network).from_line(silent)
    assert optimum.certificate.objective == pytest.approx(ipopt(problem).objective, rel=1e-6)


@pytest.mark.slow
def test_search_that_the_line_leads_nowhere_is_repeated_with_caution():
    """An oscillator in minimum time, to which none of six starts of IPOPT leads."""
    h = sp.Symbol("h")
    problem = ann_dc.OptimalControlProblem(
        states=(x, v), controls=(a,), dynamics=(v, a - x), horizon=40, cost=h,
        dt=ann_dc.StepLength(low=0.01, high=0.4), q_0=(2, 1), q_d=(0, 0), bounds={a: (-1, 1)},
    )  # fmt: skip
    network = ann_dc.synthesize(problem)
    (optimum,) = Search(problem, network).from_line(silent)
    assert optimum.certificate.certified


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
