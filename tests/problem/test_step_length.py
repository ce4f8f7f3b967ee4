"""Bounds hold by construction, and those that contradict each other are refused by name."""

import copy
import math
import pickle

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, strategies as st

from ann_dc import StepLength
from ann_dc.errors import ProblemError
from ann_dc.problem.step_length import mean_length, stage_times

LOW = st.floats(1e-4, 10.0)
WIDER = st.none() | st.floats(1.01, 1e4)
ANYWHERE = st.floats(-1e6, 1e6)


def step_of(low: float, wider: float | None) -> StepLength:
    return StepLength(low=low, high=None if wider is None else low * wider)


@given(low=LOW, wider=WIDER, z=ANYWHERE)
def test_no_coordinate_leaves_the_bounds(low, wider, z):
    step = step_of(low, wider)
    high = math.inf if wider is None else low * wider
    rounding = 1e-12 * (1.0 + abs(z)) * low * (wider or 1.0)
    assert low - rounding <= step.length(z) <= high + rounding


@given(low=LOW, wider=WIDER)
def test_a_network_starts_at_the_guess_which_is_no_bound(low, wider):
    step = step_of(low, wider)
    assert step.length(0.0) == pytest.approx(step.guess)
    slope = sp.lambdify(step.coordinate, step.expression.diff(step.coordinate))
    assert slope(0.0) > 1e-3 * (step.guess - low)


@given(low=LOW, wider=WIDER, z=st.floats(-10.0, 10.0))
def test_the_formula_is_what_length_computes(low, wider, z):
    step = step_of(low, wider)
    formula = sp.lambdify(step.coordinate, step.expression)
    assert formula(z) == pytest.approx(float(step.length(z)), rel=1e-9)


@pytest.mark.parametrize("high", [None, 0.5])
def test_every_length_between_the_bounds_is_reached(high):
    step = StepLength(low=0.1, high=high, guess=0.2)
    lengths = step.length(np.linspace(-5.0, 5.0, 100_001))
    assert lengths.min() == pytest.approx(0.1, abs=1e-9)
    assert lengths.max() == pytest.approx(0.5, abs=1e-9) if high else lengths.max() > 0.5


@pytest.mark.parametrize("high", [None, 0.5])
def test_at_a_bound_the_slope_is_zero_and_the_curvature_is_not(high):
    """So that an optimum at a bound is a strict one in z."""
    step = StepLength(low=0.1, high=high, guess=0.2)
    slope = step.expression.diff(step.coordinate)
    z = float(sp.nsolve(slope, step.coordinate, -1.5))
    assert step.bound_at(float(step.length(z))) == "lower"
    assert float(slope.diff(step.coordinate).subs(step.coordinate, z)) > 0.01


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"low": 0.0}, r"dt\.low: expected a positive finite number, got 0"),
        ({"low": -0.1, "high": 1.0}, r"dt\.low: .* got -0\.1"),
        ({"low": math.nan}, r"dt\.low: .* got nan"),
        ({"low": "0.1"}, r"dt\.low: .* got '0\.1'"),
        ({"low": True}, r"dt\.low: .* got True"),
        ({"low": 0.1, "high": math.inf}, r"dt\.high: .* got inf"),
        ({"low": 0.1, "high": math.nan}, r"dt\.high: .* got nan"),
        ({"low": 0.5, "high": 0.1}, r"dt\.low, dt\.high: the lower bound 0\.5 is not below"),
        ({"low": 0.5, "high": 0.5}, r"dt\.low, dt\.high: .* use low < high"),
        ({"low": 0.1, "high": 0.5, "guess": 0.5}, r"dt\.guess: 0\.5 is not between .*0\.1 to 0\.5"),
        ({"low": 0.1, "guess": 0.1}, r"dt\.guess: 0\.1 is not between .*at least 0\.1"),
        ({"low": 0.1, "guess": math.nan}, r"dt\.guess: .* got nan"),
        ({"low": 0.1, "symbol": 3}, r"dt\.symbol: expected a name"),
        ({"low": 0.1, "symbol": "two words"}, "no? plain identifier|not a plain identifier"),
        ({"low": 0.1, "symbol": "sin"}, "'sin' is reserved"),
    ],
)
def test_what_contradicts_itself_is_refused_by_name(given, message):
    with pytest.raises(ProblemError, match=message):
        StepLength(**given)


def test_copies_keep_the_state_that_is_handed_on():
    step = StepLength(low=0.1, high=0.4, symbol="tick")
    for copied in (pickle.loads(pickle.dumps(step)), copy.deepcopy(step)):
        assert copied.coordinate == step.coordinate
        assert copied.expression == step.expression
    assert step.coordinate != sp.Symbol("tick_free"), "a user's state is told from it"


def test_times_are_sums_of_lengths():
    step = StepLength(low=0.1, high=0.4)
    q = np.array([[5.0, 5.0, 5.0], [0.0, 0.3, 9.0]])  # q_N tells of no stage
    lengths = step.length([0.0, 0.3])
    assert stage_times(step, q) == pytest.approx([0.0, lengths[0], lengths.sum()])
    assert mean_length(step, q) == pytest.approx(lengths.mean())
    assert mean_length(0.1, q) == 0.1
    assert stage_times(0.1, q).tolist() == [0.0, 0.1, 0.2]
