"""Inequalities that an end breaks already: refused by name before anything runs."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

import ann_dc
from ann_dc.errors import ProblemError
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.step_length import StepLength

x, y, a, w = sp.symbols("x y a w")
DISC = (x - 1) ** 2 + (y - 1) ** 2 >= 1


def problem(**changes) -> OptimalControlProblem:
    fields = {
        "states": (x, y),
        "controls": (a,),
        "dynamics": (y, a),
        "cost": a**2,
        "horizon": 3,
        "q_0": (0, 0),
        "q_d": (3, 0),
        "inputs": {w: (2.0, 3.0, 4.0)},
    }
    return OptimalControlProblem(**{**fields, **changes})


REFUSED = [
    (
        {"constraints": {"disc": DISC}, "q_0": (0.5, 1)},
        "constraints[disc]: q_0 (x = 0.5, y = 1) violates it for all controls: "
        "-(x - 1)**2 - (y - 1)**2 + 1 <= 0 is required, but it is 0.75 there; move q_0, free one",
    ),
    (
        {"constraints": [x <= 3, x >= w]},
        "constraints[g2]: q_0 (x = 0) violates it for all controls: w - x <= 0 is required, but it "
        "is 2 there; move q_0",
    ),
    (
        {"terminal_constraints": {"near": x <= w - 1.5}},
        "terminal_constraints[near]: q_d (x = 3) violates it for all controls: -w + x + 1.5 <= 0 "
        "is required, but it is 0.5 there; move q_d",
    ),
    (
        {"constraints": [sp.log(x) <= 1]},
        "constraints[g1]: q_0 (x = 0) violates it for all controls: log(x) - 1 <= 0 is required, "
        "but "
        "it has no finite value there",
    ),
    ({"constraints": [sp.sqrt(x - 1) <= 1]}, "constraints[g1]: q_0 (x = 0) violates it"),
]


@pytest.mark.parametrize(("changes", "reported"), REFUSED, ids=lambda given: str(given)[:40])
def test_what_an_end_breaks_is_refused(changes, reported):
    with pytest.raises(ProblemError, match=f"^{re.escape(reported)}"):
        problem(**changes)


@pytest.mark.parametrize(
    "changes",
    [
        {"constraints": [DISC], "q_0": (0.5, None)},  # y may be chosen
        {"constraints": [x + a >= 1]},  # a may be
        {"constraints": [DISC], "q_d": (1, 1)},  # rows of the stages end before q_N
        {"terminal_constraints": [x >= 1]},  # nor do those of the end begin before it
        {"constraints": [x <= w - 2], "q_d": (9, 0)},  # 2 is its value in stage 0
        {"terminal_constraints": [x + y >= 9], "q_d": (3, None)},
    ],
    ids=str,
)
def test_what_may_hold_is_taken(changes):
    assert problem(**changes).functions


def test_an_end_may_lie_on_the_boundary_to_rounding():
    angle = np.linspace(0, 2 * math.pi, 40)
    for q_0 in zip(1 + np.cos(angle), 1 + np.sin(angle)):
        assert problem(constraints=[DISC], q_0=q_0).inequalities
    with pytest.raises(ProblemError, match="it is 2e-08 there"):
        problem(constraints=[DISC], q_0=(1e-8, 1))


def test_other_ends_and_inputs_are_looked_at_again():
    given = problem(constraints=[DISC, x <= w])
    with pytest.raises(ProblemError, match=r"^constraints\[g1\]: q_0"):
        given.with_inputs(q_0=(1, 1))
    with pytest.raises(ProblemError, match=r"^constraints\[g2\]: q_0 \(x = 0\)"):
        given.with_inputs(w=-1.0)


def test_a_step_length_that_is_chosen_is_not_fixed():
    h = sp.Symbol("h")
    step = StepLength(low=0.1, high=0.5)
    assert problem(dt=step, constraints=[x + h >= 0.3]).inequalities


def test_a_start_in_the_middle_of_a_distance_is_refused_by_name():
    """The slope of a distance has no value at its centre."""
    given = problem(constraints={"disc": sp.sqrt((x - 1) ** 2 + y**2) >= 0.3})
    with pytest.raises(ProblemError, match=r"^initial_guess: the inequality disc or its slope"):
        ann_dc.synthesize(given)
    line = ann_dc.interpolated_guess(given)
    assert ann_dc.synthesize(given, initial_guess=replace(line, q=line.q + np.array([[0], [0.1]])))
