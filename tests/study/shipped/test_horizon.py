"""Settling against the number of stages: horizons, exponents, refusals."""

import dataclasses
import math

import numpy as np
import pytest

import ann_dc
from ann_dc.errors import StudyError
from ann_dc.study.shipped import exponent_of, median_rho, settling_against_horizon


def test_stages_get_shorter_as_there_are_more():
    studies = settling_against_horizon("car", sizes=[9, 18], duration=1.8)
    for N, study in studies.items():
        problem = study.subject.declared({"N": N, "dt": study.fixed["problem.dt"]})
        assert problem.horizon * problem.dt == pytest.approx(1.8)


def test_a_penalty_is_the_same_for_every_number_of_stages():
    plant = ann_dc.plants.double_integrator()
    studies = settling_against_horizon(plant, sizes=[4, 6], kind="time-constants", rho=0.7)
    for study in studies.values():
        names = {name.partition(".")[2]: value for name, value in study.fixed.items()}
        problem = study.subject.declared({"N": names["N"], "dt": names["dt"]})
        own = ann_dc.design(problem, kinds=[ann_dc.Kind.TIME_CONSTANTS]).network
        assert names["rho"] * median_rho(own) == pytest.approx(0.7)


def test_a_step_length_that_is_none_or_in_the_map_is_refused():
    with pytest.raises(StudyError, match="no fixed dt"):
        settling_against_horizon(
            dataclasses.replace(ann_dc.plants.car(), dt=ann_dc.StepLength(low=0.02, high=0.5))
        )
    network = ann_dc.synthesize(ann_dc.plants.double_integrator(N=3))
    with pytest.raises(StudyError, match="give the problem"):
        settling_against_horizon(network)


def test_the_exponent_of_a_power_law_lies_in_its_interval():
    sizes = np.array([9, 18, 36, 72, 144])
    exact = exponent_of(sizes, 3 * sizes**2.0)
    assert exact == pytest.approx((2, 2, 2), abs=1e-9)
    noise = np.random.default_rng(0)
    inside = 0
    for _ in range(400):
        found = exponent_of(sizes, 3 * sizes**1.5 * np.exp(0.1 * noise.standard_normal(5)))
        inside += found.low < 1.5 < found.high
    assert 0.92 < inside / 400 < 0.98  # 95 % by Student's t


def test_what_did_not_settle_is_left_out_of_an_exponent():
    found = exponent_of([1, 2, 4, 8], [1, 2, 4, math.nan])
    assert found.value == pytest.approx(1)
    assert math.isnan(exponent_of([1, 2, 4], [1, 2, math.nan]).value)
