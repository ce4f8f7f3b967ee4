"""Update orders and steps: the limit of the spectrum, and the steps that are shares of it."""

import numpy as np
import pytest

import ann_dc
from ann_dc.study.library.settling import settling_against_steps

PLANT = ann_dc.plants.double_integrator(N=5)


def test_steps_are_shares_of_the_spectrums_limit():
    studies = settling_against_steps(
        PLANT, vary={"input.q_d.x": (0.5, 2.0)}, samples=3, shares=[0.5, 1.0]
    )
    design = ann_dc.design(PLANT, preconditioner=ann_dc.PreconditionerKind.MULTILEVEL)
    assert studies.limit == pytest.approx(design.spectrum.largest_step, rel=1e-6)
    assert studies.fixed.vary["run.step"] == [0.5 * studies.limit, studies.limit]
    assert len(studies.adaptive) == 3 * 3
    assert len(studies.fixed) == 3 * 2 * 3


def test_a_linear_plant_settles_below_its_limit_and_not_above():
    studies = settling_against_steps(
        PLANT, vary={"input.q_d.x": (0.5, 2.0)}, samples=2, shares=[0.97]
    )
    table = studies.fixed.run(workers=0).by("run.order")["simultaneous"]
    assert set(table["outcome"]) == {"settled"}
    time = table["settling_steps"] * table["run.step"]  # seen every five steps
    np.testing.assert_allclose(table["settling_time"], time, rtol=0.05)
    with pytest.warns(UserWarning, match="above the stability limit"):
        above = settling_against_steps(
            PLANT, vary={"input.q_d.x": (0.5, 2.0)}, samples=2, shares=[1.06]
        ).fixed.run(workers=0)
    limits = studies.adaptive.run(workers=0)["largest_step"]  # of a linear plant, everywhere alike
    np.testing.assert_allclose(limits, studies.limit, rtol=1e-6)
    assert "settled" not in set(above.by("run.order")["simultaneous"]["outcome"])
