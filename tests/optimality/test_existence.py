"""Whether there is anything to be found: asked seldom, answered once."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hopeless import INFEASIBLE, UNBOUNDED, a, x

from ann_dc.optimality.boundedness import Unbounded
from ann_dc.optimality.existence import Hopeless, Prospect
from ann_dc.optimality.feasibility import Infeasible
from ann_dc.problem import plants
from ann_dc.problem.scales import straight_line


def prospect_of(problem):
    line = straight_line(problem)
    return Prospect(problem=problem), line.q, line.u


def test_a_problem_with_a_solution_is_not_doubted():
    prospect, q, u = prospect_of(plants.double_integrator(N=5))
    for _ in range(5):
        prospect.doubt(q, u)
    assert prospect.feasible is not None
    assert prospect.asked == 5


@pytest.mark.parametrize(
    ("problem", "kind"),
    [(INFEASIBLE["twins"][0], Infeasible), (UNBOUNDED["a product"], Unbounded)],
)
def test_a_hopeless_one_is_told(problem, kind):
    prospect, q, u = prospect_of(problem)
    with pytest.raises(Hopeless) as caught:
        prospect.doubt(q, u)
    assert isinstance(caught.value.found, kind)
    assert str(caught.value) == caught.value.found.message
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def test_it_looks_less_and_less_often(monkeypatch):
    prospect, q, u = prospect_of(plants.double_integrator(N=5))
    checks = []
    monkeypatch.setattr(prospect, "look", lambda q, u: checks.append(prospect.asked))
    for _ in range(20):
        prospect.doubt(q, u)
    assert checks == [1, 2, 4, 8, 16]


def test_states_that_are_no_numbers_say_nothing_new():
    prospect, q, u = prospect_of(INFEASIBLE["twins"][0])
    assert isinstance(prospect.look(np.full_like(q, np.nan), u), Infeasible)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("held", "falls"),
    [
        ({}, True),
        ({"bounds": {"a": (-1, 1)}}, False),
        ({"bounds": {"a": (-1, None)}}, True),
        ({"bounds": {"x": (-1, 1)}}, False),
        ({"constraints": {"up": a <= x + 2}}, True),
        ({"constraints": {"both": a**2 <= 4}}, False),
    ],
)
def test_a_cost_that_inequalities_hold_is_not_called_bottomless(held, falls):
    prospect, q, u = prospect_of(replace(UNBOUNDED["a control is rewarded"], **held))
    assert isinstance(prospect.look(q, u), Unbounded) is falls


def test_the_cost_is_followed_once():
    prospect, q, u = prospect_of(UNBOUNDED["a control is rewarded"])
    found = prospect.look(q, u)
    assert isinstance(found, Unbounded)
    assert prospect.look(q, u) is found
