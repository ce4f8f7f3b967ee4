"""Whether there is anything to be found: asked seldom, answered once."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hopeless import INFEASIBLE, UNBOUNDED

from ann_dc.optimality import Hopeless, Infeasible, Prospect, Unbounded
from ann_dc.problem import plants, straight_line


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
    looks = []
    monkeypatch.setattr(prospect, "look", lambda q, u: looks.append(prospect.asked))
    for _ in range(20):
        prospect.doubt(q, u)
    assert looks == [1, 2, 4, 8, 16]


def test_states_that_are_no_numbers_say_nothing_new():
    prospect, q, u = prospect_of(INFEASIBLE["twins"][0])
    assert isinstance(prospect.look(np.full_like(q, np.nan), u), Infeasible)


def test_a_cost_that_bounds_hold_is_not_called_bottomless():
    free = UNBOUNDED["a control is rewarded"]
    assert isinstance(prospect_of(free)[0].look(*prospect_of(free)[1:]), Unbounded)
    held = replace(free, bounds={"a": (-1, 1)})
    assert prospect_of(held)[0].look(*prospect_of(held)[1:]) is None
