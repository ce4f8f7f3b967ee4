"""White noise at every neuron, drawn from the seed of the case, against its closed form."""

import numpy as np
import pytest

import ann_dc
from ann_dc.errors import StudyError
from ann_dc.network import Cell, Connection, Network, Neuron
from ann_dc.study.realisation import noisy


def low_pass(stages):
    """x' = u - x in every cell."""
    wires = Connection(source="x", target="x", weight=-1.0), Connection(source="u", target="x")
    cell = Cell(neurons=(Neuron(name="x"),), inputs=("u",), connections=wires)
    return Network(cell=cell, stages=stages, inputs={"u": 1.0}, title="low-pass")


def test_the_variance_of_a_low_pass_is_half_the_squared_density():
    study = ann_dc.Study(
        subject=low_pass(60),
        vary={"nonideal.noise": [0.0, 0.01, 0.1]},
        fixed={"run.duration": 30.0},
        metrics=["tracking_error"],
        curves=150,
    )
    table = study.run(workers=0)
    assert (np.diff(table["tracking_error"]) > 0).all()
    curves = table.curves("x")
    for density in (0.01, 0.1):
        late = (curves["nonideal.noise"] == density) & (curves["time"] > 5)
        values = np.array([curves[f"x[{k}]"][late] for k in range(60)])
        assert values.std() == pytest.approx(density / np.sqrt(2), rel=0.05)


def test_noise_is_that_of_its_seed():
    first, again, other = (noisy(low_pass(2), 0.1, seed, 10.0) for seed in (1, 1, 2))
    name = "noise.x"
    values = [network.waveforms[name].values for network in (first, again, other)]
    np.testing.assert_array_equal(values[0], values[1])
    assert not np.array_equal(values[0], values[2])


def test_noise_lasts_as_long_as_a_run():
    with pytest.raises(StudyError, match=r"set run.duration"):
        ann_dc.Study(subject="car", vary={"nonideal.noise": [0.1]}, metrics=["steps"])
    with pytest.raises(StudyError, match=r"use a shorter run\.duration"):
        noisy(low_pass(1), 0.1, 0, 1e6)
