"""Ranges, lists and samplers of inputs: what they draw, and what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from ann_dc import plants, synthesize
from ann_dc.errors import ProblemError, UnknownNameError
from ann_dc.evaluation.populations import neuron_values
from ann_dc.families.family import Family, family_of

PROBLEM = plants.double_integrator(N=5)
NETWORK = synthesize(PROBLEM)


def family(ranges) -> Family:
    return family_of(PROBLEM, NETWORK, ranges)


@settings(max_examples=30, deadline=None)
@given(
    low=st.floats(-1e6, 1e6), width=st.floats(1e-3, 1e6), count=st.integers(1, 40),
    seed=st.integers(0, 100),
)  # fmt: skip
def test_samples_lie_in_the_ranges_and_come_again(low, width, count, seed):
    drawn = family({"q_d.x": (low, low + width), "q_0.v": (-1, 1)})
    samples = drawn.samples(count, seed=seed)
    assert len(samples) == count
    for sample, again in zip(samples, drawn.samples(count, seed=seed), strict=True):
        assert low <= sample["q_d.x"][0] <= low + width
        assert -1 <= sample["q_0.v"][0] <= 1
        assert all((sample[name] == again[name]).all() for name in sample)


def test_samples_fill_the_ranges():
    values = [s["q_d.x"][0] for s in family({"q_d.x": (0.0, 8.0)}).samples(64, seed=1)]
    counts, _ = np.histogram(values, bins=8, range=(0, 8))
    assert (counts == 8).all()


def test_a_list_is_what_is_drawn():
    listed = family([{"q_d.x": 2.0}, {"q_d.x": [1.0, 1.0, 1.0, 1.0, 3.0]}])
    assert listed.is_listed
    assert listed.ranges == {"q_d.x": (1.0, 3.0)}
    assert [s["q_d.x"][-1] for s in listed.samples(7, seed=3)] == [2.0, 3.0]


def test_a_sampler_draws_with_its_generator():
    def draw(rng, count):
        return [{"q_d.x": x} for x in rng.normal(size=count)]

    drawn = family(draw)
    assert not drawn.is_listed
    first = [s["q_d.x"][0] for s in drawn.samples(5, seed=1)]
    assert first == [s["q_d.x"][0] for s in drawn.samples(5, seed=1)]
    assert first != [s["q_d.x"][0] for s in drawn.samples(5, seed=2)]


def test_every_sample_starts_on_its_own_line():
    sample = {"q_d.x": np.full(5, 4.0), "q_0.x": np.full(5, 2.0)}
    network = family({"q_d.x": (3, 5), "q_0.x": (1, 3)}).network_of(sample)
    values = neuron_values(network, network.start_state)
    np.testing.assert_allclose(values["q"][:, 0], [2.0, 2.4, 2.8, 3.2, 3.6])


def test_the_problem_of_a_sample_has_its_inputs():
    sample = {"q_d.x": np.full(5, 4.0), "q_0.v": np.full(5, 0.5)}
    problem = family({"q_d.x": (3, 5), "q_0.v": (0, 1)}).problem_of(sample)
    assert problem.q_d == (4.0, 0.0)
    assert problem.q_0 == (0.0, 0.5)


@pytest.mark.parametrize(
    ("over", "message"),
    [
        ({}, "expected one input or more, got none"),
        ({"q_d.x": (5, 3)}, r"ranges\[q_d.x\]: the range from 5 to 3 is empty"),
        ({"q_d.x": (3, 3)}, "is empty"),
        ({"q_d.x": (0, float("inf"))}, "not finite"),
        ({"q_d.x": (float("nan"), 1)}, "not finite"),
        ({"q_d.x": 3}, r"expected its lowest and highest value"),
        ({"q_d.x": (1, 2, 3)}, "expected its lowest and highest value"),
        ([], "ranges: expected"),
        ("q_d.x=3:7", "ranges: expected"),
        ([{"q_d.x": float("nan")}], r"ranges\[0\]\[q_d.x\]: nan is not finite"),
        ([{"q_d.x": "far"}], "expected one number or 5 of them"),
        ([{"q_d.x": 1.0}, {"q_d.v": 1.0}], "expected the same inputs"),
    ],
)
def test_what_is_no_family_is_refused(over, message):
    with pytest.raises(ProblemError, match=message):
        family(over)


MISSING = r"input 'q_d.z' does not exist; choose one of.*q_d\.v"


@pytest.mark.parametrize("over", [{"q_d.z": (0, 1)}, [{"q_d.z": 1.0}]])
def test_an_input_that_there_is_not_is_named(over):
    with pytest.raises(UnknownNameError, match=MISSING):
        family(over)
