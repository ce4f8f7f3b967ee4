"""Settling against the number of stages: horizons, exponents, refusals."""

import dataclasses

import pytest

import ann_dc
from ann_dc.errors import StudyError
from ann_dc.study.library.settling import median_rho, settling_against_horizon


def test_stages_get_shorter_as_there_are_more():
    studies = settling_against_horizon("car", sizes=[9, 18], duration=1.8)
    for N, study in studies.items():
        problem = study.subject.declared({"N": N, "dt": study.fixed["problem.dt"]})
        assert problem.horizon * problem.dt == pytest.approx(1.8)


def test_a_penalty_is_the_same_for_every_number_of_stages():
    plant = ann_dc.plants.double_integrator()
    studies = settling_against_horizon(plant, sizes=[4, 6], preconditioner="diagonal", rho=0.7)
    for study in studies.values():
        names = {name.partition(".")[2]: value for name, value in study.fixed.items()}
        problem = study.subject.declared({"N": names["N"], "dt": names["dt"]})
        own = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
        assert names["rho"] * median_rho(own) == pytest.approx(0.7)


def test_a_step_length_that_is_none_or_in_the_map_is_refused():
    with pytest.raises(StudyError, match="no fixed dt"):
        settling_against_horizon(
            dataclasses.replace(ann_dc.plants.car(), dt=ann_dc.StepLength(low=0.02, high=0.5))
        )
    network = ann_dc.synthesize(ann_dc.plants.double_integrator(N=3))
    with pytest.raises(StudyError, match="expected a problem"):
        settling_against_horizon(network)
