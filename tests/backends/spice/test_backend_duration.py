"""Circuits of networks that never settle, simulated for a given network time."""

import numpy as np
import pytest
from oscillators import chua, cycle, lorenz, lorenz_96, reference, van_der_pol
from simulator import needs_ngspice

import ann_dc
from ann_dc.backends.status import Outcome
from ann_dc.errors import NetworkError

MACRO = ann_dc.levels.macro()
LEVELS = pytest.mark.parametrize("level", [ann_dc.levels.BEHAVIOURAL, MACRO], ids=lambda v: v.name)


@pytest.mark.sampled(1)
@needs_ngspice
@LEVELS
def test_the_limit_cycle_has_its_period_and_amplitude(level):
    run = ann_dc.SpiceBackend(level=level, duration=60.0).run(van_der_pol())
    time = np.linspace(0, 60, 100_001)
    wanted = cycle(time, reference(van_der_pol(), 60.0)(time)[0], after=30)
    found = cycle(run.trajectory.time, run.trajectory["x"][:, 0], after=30)
    np.testing.assert_allclose(found, wanted, rtol=5e-4)
    assert str(run).startswith("ran for ")


@needs_ngspice
@pytest.mark.sampled(2)
@LEVELS
@pytest.mark.parametrize(
    ("network", "duration"),
    [(chua(), 8.7), (lorenz(), 2.2), (lorenz_96(), 1.0)],
    ids=lambda value: getattr(value, "title", ""),
)
def test_chaos_is_right_over_two_lyapunov_times(network, duration, level):
    run = ann_dc.SpiceBackend(level=level, duration=duration).run(network)
    found = run.trajectory
    assert found.time[-1] == pytest.approx(duration, rel=1e-6)
    wanted = reference(network, duration)(np.minimum(found.time, duration)).T
    assert np.abs(found.states - wanted).max() < 1e-2 * np.abs(wanted).max()


@needs_ngspice
def test_the_error_falls_as_the_bandwidth_margin_rises():
    errors = [
        ann_dc.SpiceBackend(level=MACRO, duration=20.0, bandwidth_margin=margin)
        .run(van_der_pol())
        .mean_square_error
        for margin in (1e2, 1e3, 1e4)
    ]
    assert errors[0] > 10 * errors[1] > 100 * errors[2]


def test_without_a_duration_an_oscillator_has_no_circuit():
    with pytest.raises(NetworkError, match=r"settle for scaling; .* set the duration of its run"):
        ann_dc.SpiceBackend().prepare(van_der_pol())


def test_a_settling_network_is_scaled_by_its_run_of_that_duration():
    network = ann_dc.design(
        ann_dc.plants.double_integrator(N=5), preconditioner=ann_dc.PreconditionerKind.DIAGONAL
    ).network
    circuit, probe = ann_dc.SpiceBackend(duration=500.0).prepare(network)
    assert probe.time[-1] == 500.0
    usual, _ = ann_dc.SpiceBackend().prepare(network)
    assert circuit.scaling.bandwidth_margin == usual.scaling.bandwidth_margin
    assert circuit.scaling.time == pytest.approx(usual.scaling.time, rel=1e-6)


@needs_ngspice
def test_a_study_runs_both_for_the_duration():
    study = ann_dc.Study(
        subject=van_der_pol(),
        vary={"run.backend": ["ode", "spice"]},
        fixed={"run.duration": 20.0, "circuit.level": "macro"},
        metrics=["neurons"],
        curves=100,
    )
    table = study.run(workers=0)
    assert table["outcome"].tolist() == 2 * [Outcome.COMPLETED.name.lower()]
    ends = {case.tolist()[0]: times for case, times in _ends(table)}
    assert ends["ode"] == 20.0
    assert ends["spice"] == pytest.approx(20.0, rel=1e-6)


def _ends(table):
    curves = table.curves()
    for point in np.unique(curves["point"]):
        rows = curves["point"] == point
        yield np.unique(curves["run.backend"][rows]), curves["time"][rows].max()
