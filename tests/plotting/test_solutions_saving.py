"""Pictures as files: same bytes, and folders that are none."""

from dataclasses import replace

import numpy as np
import pytest

from ann_dc import plotting
from ann_dc.errors import OutputError


@pytest.mark.slow
def test_save_all_names_creates_and_repeats_the_bytes(car, tmp_path):
    first = plotting.save_all(car, tmp_path / "a" / "b")
    again = plotting.save_all(car, str(tmp_path / "c"))
    assert [path.name for path in first] == [
        "trajectory.png",
        "controls.png",
        "settling.png",
        "spectrum.png",
    ]
    assert [p.read_bytes() for p in first] == [p.read_bytes() for p in again]


@pytest.mark.slow
def test_states_that_are_not_finite_are_left_out(car, tmp_path):
    states = car.trajectory.states.copy()
    states[-1] = np.nan
    states[-2, 0] = np.inf
    residuals = car.trajectory.residuals.copy()
    residuals[-1] = np.inf
    trajectory = replace(car.trajectory, states=states, residuals=residuals)
    lost = replace(car, run=replace(car.run, trajectory=trajectory))
    assert len(plotting.save_all(lost, tmp_path)) == 4


@pytest.mark.parametrize("inside", ["", "deeper"])
def test_a_folder_that_is_a_file_is_an_error(car, tmp_path, inside):
    taken = tmp_path / "taken"
    taken.write_text("not a folder")
    with pytest.raises(OutputError, match=r"taken.*a file has the name.*use a path in"):
        plotting.save_all(car, taken / inside)
