"""A declaration with a step length that is chosen: what is added, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

from ann_dc import OptimalControlProblem, StepLength
from ann_dc.errors import ProblemError, UnknownNameError

x, v, a, h = sp.symbols("x v a h")
STEP = StepLength(low=0.02, high=0.5)


def mass(**changes) -> OptimalControlProblem:
    given = {
        "states": (x, v), "controls": (a,), "dynamics": (v, a), "dt": STEP,
        "cost": h * (1 + a**2 / 2), "horizon": 4, "q_0": (0, 0), "q_d": (1, None),
    }  # fmt: skip
    return OptimalControlProblem(**given | changes)


def test_one_state_more_is_handed_on_and_free_at_both_ends():
    problem = mass()
    assert [str(s) for s in problem.states] == ["x", "v", "h_free"]
    assert (problem.q_0, problem.q_d) == ((0, 0, None), (1, None, None))
    assert problem.f[-1] == problem.states[-1] == problem.handed_on[0]
    assert not (problem.l.free_symbols | problem.f[0].free_symbols) & {h}
    assert "stages of 0.02 to 0.5 s, free at the end: v" in str(problem)


def test_a_stage_is_an_euler_step_of_the_length_that_the_state_says():
    functions = mass().functions
    q, u = np.array([[1.0], [2.0], [0.7]]), np.array([[3.0]])
    length = float(STEP.length(0.7))
    assert functions.map(q, u)[:, 0] == pytest.approx([1 + 2 * length, 2 + 3 * length, 0.7])
    assert functions.cost(q, u) == pytest.approx([length * 5.5])


def test_a_map_and_a_terminal_cost_may_name_it():
    problem = mass(dynamics=None, map=(x + h * v, v + h * a), cost=a**2, terminal_cost=4 * h)
    assert problem.f == mass().f
    value, slope, _ = problem.functions.terminal(np.array([0.0, 0.0, 0.7]))
    assert value == pytest.approx(4 * float(STEP.length(0.7)))
    assert slope[2] != 0


def test_a_completed_declaration_is_left_as_it_is():
    problem = mass()
    for other in (
        replace(problem, name="again"),
        problem.with_inputs(q_0=(0, 0)),
        problem.with_inputs(q_0=problem.q_0),
        problem.with_horizon(4),
    ):
        assert (other.states, other.q_0, other.f, other.l) == (
            problem.states, problem.q_0, problem.f, problem.l,
        )  # fmt: skip


def test_other_bounds_are_other_formulas():
    problem, wider = mass(), replace(mass(), dt=StepLength(low=0.02, high=5.0))
    assert wider.cost == problem.cost
    assert wider.l != problem.l


def test_it_has_the_unit_of_time():
    problem = mass(units={"x": "m", "time": "min"})
    assert (problem.unit("h"), problem.unit("h_free")) == ("min", "1")
    with pytest.raises(UnknownNameError, match="h"):
        mass().unit("g")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"q_0": (0, 0, 1)}, r"q_0: 2 values expected, one for each of x, v, but got"),
        ({"q_0": (0,)}, r"q_0: 2 values expected"),
        ({"q_d": (0, 0, 1)}, r"q_d: 2 values expected"),
        ({"dynamics": (v, a, a)}, r"dynamics: 2 expressions expected, one for each state \(x, v\)"),
        ({"dt": StepLength(low=0.1, symbol="V")}, r"dt\.symbol: V is a symbol of the problem"),
        ({"dt": StepLength(low=0.1, symbol="g")}, r"cost: unknown symbol h in"),
        ({"dt": (0.1, 0.2)}, r"dt: expected a positive finite number, got \(0\.1, 0\.2\)"),
        ({"dt": 0.1}, r"cost: unknown symbol h in"),
    ],
)
def test_what_does_not_fit_is_refused_in_the_users_own_names(changes, message):
    with pytest.raises(ProblemError, match=message):
        mass(**changes)


def test_a_problem_that_chooses_takes_no_number_afterwards():
    with pytest.raises(ProblemError, match=r"dt: got 0\.1, but the step length of this problem is"):
        replace(mass(), dt=0.1)
