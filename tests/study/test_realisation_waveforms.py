"""Studies of a network whose inputs change over time: no constant optimum."""

import numpy as np

import ann_dc
from ann_dc.network import Cell, Connection, Network, Neuron, Waveform


def low_pass():
    """x' = load - x, with a load that rises."""
    wires = (
        Connection(source="x", target="x", weight=-1.0),
        Connection(source="load", target="x"),
    )
    cell = Cell(neurons=(Neuron(name="x"),), inputs=("load",), connections=wires)
    ramp = Waveform(times=[0.0, 10.0], values=[0.5, 1.0])
    return Network(cell=cell, stages=1, inputs={"load": 0.5}).with_inputs({"load": ramp})


def row_of(fixed):
    study = ann_dc.Study(
        subject=low_pass(),
        vary={"nonideal.offset": [0.0]},
        fixed=fixed,
        metrics=["control_error", "tracking_error"],
    )
    [row] = study.run(workers=0).rows()
    return row


def test_control_error_says_that_there_is_no_constant_optimum():
    row = row_of({"run.duration": 10.0})
    assert row["outcome"] == "completed"
    assert np.isnan(row["control_error"])
    assert "control_error: inputs load change over time" in row["message"]
    assert "not constant; use tracking_error" in row["message"]
    assert 0.01 < row["tracking_error"] < 0.2


def test_constant_input_of_the_study_has_an_optimum():
    row = row_of({"run.duration": 10.0, "input.load": 0.5})
    assert row["control_error"] < 1e-3  # exp(-10)
    assert "optimum" not in row["message"]
