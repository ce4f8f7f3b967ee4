"""Points of a study: combinations in order, samples within ranges, seeds that stay."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from ann_dc.errors import StudyError
from ann_dc.study.sampling import Sampling, Span
from ann_dc.study.study import Study

METRICS = ("settling_time",)


def study(**given) -> Study:
    return Study(subject="double_integrator", metrics=METRICS, **given)


def column(points, name) -> list:
    return [point.setting[name] for point in points]


def test_every_combination_the_last_setting_quickest():
    points = list(study(vary={"problem.N": [5, 9], "gains.rho": np.array([1.0, 2.0])}).points())
    assert [point.number for point in points] == [0, 1, 2, 3]
    assert column(points, "problem.N") == [5, 5, 9, 9]
    assert column(points, "gains.rho") == [1.0, 2.0, 1.0, 2.0]


@pytest.mark.parametrize("sampling", Sampling)
def test_ranges_are_filled_and_kept(sampling):
    vary = {"input.q_d.x": (1, 3), "gains.tau.u": Span(0.01, 100.0, is_log=True)}
    points = list(study(vary=vary, samples=64, sampling=sampling, seed=3).points())
    x, tau = (np.array(column(points, name)) for name in vary)
    assert x.min() >= 1
    assert x.max() <= 3
    assert tau.min() >= 0.01
    assert tau.max() <= 100
    quarters = np.histogram(np.log10(tau), np.linspace(-2, 2, 5))[0]
    if sampling is Sampling.RANDOM:
        assert quarters.min() > 4
    else:
        assert (quarters == 16).all()
    assert points == list(study(vary=vary, samples=64, sampling=sampling, seed=3).points())
    assert points != list(study(vary=vary, samples=64, sampling=sampling, seed=4).points())


def test_combinations_share_samples_and_seeds():
    vary = {"gains.rho": [1.0, 2.0], "input.q_d.x": (1, 3)}
    points = list(study(vary=vary, samples=5).points())
    assert column(points[:5], "input.q_d.x") == column(points[5:], "input.q_d.x")
    assert [p.seed for p in points[:5]] == [p.seed for p in points[5:]]
    assert len({p.seed for p in points[:5]}) == 5


@pytest.mark.slow
@given(st.integers(1, 200), st.integers(0, 200))
def test_first_seeds_stay_when_there_are_more(count, more):
    chips = {"nonideal.mismatch": [0.01]}
    few, many = (list(study(vary=chips, samples=n).points()) for n in (count, count + more))
    assert [p.seed for p in few] == [p.seed for p in many[:count]]
    assert all(0 <= p.seed < 2**53 for p in many)


def test_a_seed_can_be_said():
    vary = {"seed": [5, 6], "input.q_d.x": (1, 3)}
    points = list(study(vary=vary, samples=2).points())
    assert [p.seed for p in points] == [5, 5, 6, 6]
    assert all("seed" not in p.setting for p in points)


@pytest.mark.parametrize(
    ("vary", "said"),
    [
        ({"problem.N": []}, "problem.N: expected"),
        ({"input.q_d.x": (3, 3)}, "empty"),
        ({"input.q_d.x": (3, float("nan"))}, "empty or not finite"),
        ({"input.q_d.x": Span(0, 1, is_log=True)}, "above zero"),
        ({"input.q_d.x": (1, 2, 3, 4)}, r"a range is \(low, high\)"),
        ({"problem.N": range(4_000), "gains.rho": range(1, 4_000)}, "more than"),
    ],
)
def test_empty_designs_are_refused(vary, said):
    with pytest.raises(StudyError, match=said):
        study(vary=vary)


def test_what_is_fixed_is_not_varied():
    with pytest.raises(StudyError, match=r"gains\.rho is varied as well"):
        study(vary={"gains.rho": [1.0]}, fixed={"gains.rho": 2.0})


def test_a_span_is_a_range():
    assert Span(1, 100, is_log=True).at(0.5) == pytest.approx(10)
    assert Span(1, 100).at(0.5) == 50.5
