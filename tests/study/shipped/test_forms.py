"""Printed forms: what became of one is told by outcome, certificate and controls."""

import numpy as np
import pytest

import ann_dc
from ann_dc.decomposition.form import SWITCHES
from ann_dc.study.shipped.forms import FORMS, FormEnd, end_of, settling_of_forms


def test_all_forms_are_there():
    assert set(FORMS) == {"corrected", "printed", *SWITCHES}
    assert len(settling_of_forms("car")) == len(FORMS)


@pytest.mark.parametrize(
    ("outcome", "certified", "error", "end"),
    [
        ("settled", 1.0, 1e-9, FormEnd.OPTIMUM),
        ("settled", 0.0, 1e-9, FormEnd.CONTROLS),
        ("settled", 0.0, 0.3, FormEnd.ELSEWHERE),
        ("settled", np.nan, np.nan, FormEnd.ELSEWHERE),
        ("diverged", 0.0, 1e-9, FormEnd.NEVER),
        ("failed", np.nan, np.nan, FormEnd.NEVER),
    ],
)
def test_the_end_of_a_form(outcome, certified, error, end):
    row = {"outcome": outcome, "certified": certified, "control_error": error}
    assert end_of(row) is end


def test_controls_of_a_slip_are_compared_with_the_corrected_networks():
    study = settling_of_forms(
        ann_dc.plants.double_integrator(N=5), forms=["corrected", "S7"], kind="diagonal"
    )
    corrected, slip = study.run(workers=0).rows()
    assert corrected["control_error"] < 1e-6
    assert slip["outcome"] == "settled"
    assert slip["control_error"] > 1e-3
