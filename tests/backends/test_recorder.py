"""A run taken down: every residual, states in bounded memory, and its ends."""

import numpy as np
import pytest

from ann_dc.backends import recorder as recorder_module
from ann_dc.backends.recorder import Recorder
from ann_dc.backends.run import Run
from ann_dc.backends.settling import Settling
from ann_dc.backends.status import not_settled, settled
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network

CELL = Cell(
    neurons=(Neuron(name="x"),),
    connections=(Connection(source="x", target="x", weight=-1.0),),
)
LEAK = Network(cell=CELL, stages=1, start={"x": 1.0})


def recorded(steps: int, *, done: bool = True) -> Run:
    """x = exp(-s) at steps of one, whose residual is x."""
    recorder = Recorder(LEAK)
    for now in range(steps + 1):
        x = np.array([np.exp(-now)])
        recorder.record(float(now), x, (0.0, float(x[0])))
    end = float(steps)
    status = settled(np.exp(-end), end) if done else not_settled((0.0, 1.0), end, "time was up")
    return recorder.run(end, x, status, Settling(tolerance=1e-3), evaluations=3 * steps)


def test_everything_is_kept_of_a_short_run():
    run = recorded(20)
    np.testing.assert_array_equal(run.trajectory.time, np.arange(21))
    np.testing.assert_array_equal(run.trajectory.residual_time, np.arange(21))
    np.testing.assert_array_equal(run.trajectory.states[:, 0], run.trajectory.kkt)
    assert (run.steps, run.evaluations) == (20, 60)
    assert run.settling_time == pytest.approx(np.log(1e3))
    assert run.settling_steps == 7


@pytest.mark.parametrize("steps", [20, 21, 100, 257])
def test_states_of_a_long_run_are_thinned_and_residuals_are_not(monkeypatch, steps):
    monkeypatch.setattr(recorder_module, "SAMPLES", 10)
    run, trajectory = recorded(steps), recorded(steps).trajectory
    assert len(trajectory.time) <= 11
    assert (trajectory.time[0], trajectory.time[-1]) == (0.0, steps)
    assert (np.diff(trajectory.time) > 0).all()
    np.testing.assert_allclose(trajectory.states[:, 0], np.exp(-trajectory.time))
    assert len(trajectory.residuals) == steps + 1 == run.steps + 1


def test_a_run_that_did_not_settle_has_no_settling_time():
    run = recorded(20, done=False)
    assert np.isnan(run.settling_time)
    assert run.settling_steps is None
    assert run.verified == "not settled"
