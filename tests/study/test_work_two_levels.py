"""Studies of the two-level algorithm beside the network alone."""

import numpy as np
import pytest

import ann_dc
from ann_dc.errors import StudyError


def test_two_levels_find_the_controls_of_the_network_in_outer_iterations():
    study = ann_dc.Study(
        subject=ann_dc.plants.double_integrator(N=4),
        vary={"run.two_level": ["none", "newton", "gradient"]},
        metrics=["settling_steps", "control_error", "certified"],
    )
    alone, newton, gradient = study.run(workers=0).rows()
    assert {row["outcome"] for row in (alone, newton, gradient)} == {"settled"}
    assert newton["settling_steps"] < 10 < gradient["settling_steps"]
    assert newton["control_error"] < 1e-9
    assert gradient["control_error"] < 1e-5
    assert newton["certified"]


def test_two_levels_have_no_network_time():
    study = ann_dc.Study(
        subject=ann_dc.plants.double_integrator(N=3),
        vary={"run.two_level": ["newton"]},
        metrics=["settling_time"],
    )
    [row] = study.run(workers=0).rows()
    assert np.isnan(row["settling_time"])
    assert "no network time" in row["message"]


def test_another_coordinator_is_refused_by_name():
    with pytest.raises(StudyError, match="steepest"):
        ann_dc.Study(subject="car", vary={"run.two_level": ["steepest"]}, metrics=["steps"])


@pytest.mark.parametrize("vary", ["run.two_level", "run.duration"])
def test_outer_iterations_have_no_duration(vary):
    settings = {"run.two_level": "newton", "run.duration": 10.0}
    fixed = {name: value for name, value in settings.items() if name != vary}
    with pytest.raises(StudyError, match=r"run\.duration is a network time, which run.two_level"):
        ann_dc.Study(subject="car", vary={vary: [settings[vary]]}, fixed=fixed, metrics=["steps"])
