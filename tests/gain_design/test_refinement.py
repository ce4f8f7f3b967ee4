"""Refinement of a design's gains."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.analysis.objectives import SETTLING_TIME, STEPS, TWO_PHASE_STEPS
from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.step_rules import SIMULTANEOUS, TWO_PHASE, FixedStep
from ann_dc.gain_design.gain_rule import GainRule
from ann_dc.gain_design.gains import apply_gains
from ann_dc.gain_design.grid_gains import SettledPoint
from ann_dc.gain_design.procedure import design
from ann_dc.gain_design.refinement import Freedom, Variation, best_step, refined
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.network.preconditioners.multilevel import Multilevel
from ann_dc.problem import plants
from ann_dc.progress import silent
from ann_dc.solver import synthesize

SHORT = 2.0
"""Seconds of processor time."""


@cache
def plain(kind: PreconditionerKind = PreconditionerKind.MULTILEVEL):
    return design(synthesize(plants.double_integrator(N=6)), gain_rule=GainRule(kind=kind))


def paper():
    """The paper's example with a pyramid."""
    return design(synthesize(plants.car()), gain_rule=GainRule())


def better(found, *, seconds=SHORT, progress=silent, **options):
    settled = SettledPoint(Linearisation(found.network).at(found.state), found.state)
    return refined(settled, found.best, progress, seconds=seconds, **options)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("freedom", Freedom)
@pytest.mark.parametrize(
    "kind",
    [
        PreconditionerKind.DIAGONAL,
        pytest.param(PreconditionerKind.MULTILEVEL, marks=pytest.mark.slow),
        pytest.param(PreconditionerKind.COUPLED_MULTILEVEL, marks=pytest.mark.slow),
    ],
)
def test_it_gets_faster_with_the_same_wires(kind, freedom):
    found = plain(kind)
    faster = better(found, freedom=freedom)
    assert faster.ratio < 0.8 * found.best.ratio
    assert faster.gains.preconditioner.kind is found.gains.preconditioner.kind
    network = apply_gains(found.network, faster.gains)
    assert spectrum(network, found.state).stiffness_ratio == pytest.approx(faster.ratio, rel=1e-6)


def test_no_equilibrium_moves():
    found = plain()
    network = apply_gains(found.network, better(found).gains)
    run = OdeBackend(verify=False).run(network)
    assert run.status.settled
    np.testing.assert_allclose(run.trajectory.final, found.state, atol=1e-5)


def test_without_time_nothing_changes():
    found = plain()
    assert better(found, seconds=0.0) is found.best


@pytest.mark.slow
def test_never_worse_where_nothing_settles(monkeypatch):
    lost = lambda settled, candidate: replace(candidate, settling=np.inf)  # noqa: E731
    monkeypatch.setattr("ann_dc.gain_design.refinement.with_trial_run", lost)
    found, lines = plain(), []
    assert better(found, progress=lines.append) is found.best
    assert lines[-1] == "refine: no better candidate settles from the initial guess"


def test_a_large_network_is_left_as_it_is(monkeypatch):
    monkeypatch.setattr("ann_dc.gain_design.refinement.DENSE_LIMIT", 10)
    found, lines = plain(), []
    assert better(found, progress=lines.append) is found.best
    assert f"{found.network.size} neurons exceed the limit 10" in lines[0]


@pytest.mark.slow
def test_progress_tells_the_best_so_far(monkeypatch):
    monkeypatch.setattr("ann_dc.progress.SECONDS", 0.0)
    monkeypatch.setattr("ann_dc.gain_design.refinement.ITERATIONS", 15)
    lines = []
    better(paper(), progress=lines.append)
    ratios = [float(line.removeprefix("refine: ratio ")) for line in lines]
    assert ratios[-1] < ratios[0]


@pytest.mark.parametrize("freedom", Freedom)
@pytest.mark.parametrize(
    "kind",
    [
        PreconditionerKind.DIAGONAL,
        PreconditionerKind.MULTILEVEL,
        PreconditionerKind.COUPLED_MULTILEVEL,
    ],
)
@pytest.mark.parametrize("objective", [SETTLING_TIME, TWO_PHASE_STEPS], ids=["time", "steps"])
def test_gains_at_x_are_those_of_the_flow(kind, freedom, objective):
    found = plain(kind)
    around = Variation.of(found.network, found.state, found.gains, freedom, objective)
    x = 0.2 * np.random.default_rng(0).standard_normal(around.share.shape[1])
    network = apply_gains(found.network, around.gains_at(x))
    expected = np.sort_complex(spectrum(network, found.state).eigenvalues)
    J = around.flow.jacobian(around.at(x), SETTLING_TIME)
    modes = np.sort_complex(np.linalg.eigvals(J))
    np.testing.assert_allclose(modes, expected, atol=1e-6 * np.abs(expected).max())
    same = around.gains_at(0 * x)
    np.testing.assert_allclose(same.rate, found.gains.rate)
    np.testing.assert_allclose(same.rho, found.gains.rho)


@pytest.mark.slow
def test_one_number_a_neuron_stays_one():
    found = plain()
    network = apply_gains(found.network, better(found).gains)
    assert all(np.ndim(neuron.tau) == 0 for neuron in network.cell.neurons)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:step .* is above the stability limit")  # simultaneous order's
@pytest.mark.parametrize(
    ("objective", "order"), [(STEPS, SIMULTANEOUS), (TWO_PHASE_STEPS, TWO_PHASE)]
)
def test_fewer_steps_at_the_best_one(objective, order):
    torch.set_num_threads(1)
    found = plain()
    gains = better(found, objective=objective).gains

    def steps(gains):
        network = apply_gains(found.network, gains)
        h = best_step(network, found.state, gains, objective)
        run = RecurrentBackend(order=order, step=FixedStep(step=h)).run(network)
        assert run.status.settled
        assert run.settling_steps is not None
        return run.settling_steps

    assert steps(gains) < 0.8 * steps(found.gains)


@pytest.mark.slow
def test_the_car():
    """In 20 s, and with errors of 5 % in all gains."""
    found = paper()
    gains = better(found, seconds=20.0).gains
    network = apply_gains(found.network, gains)

    def settling(network):
        run = OdeBackend(verify=False).run(network)
        assert run.status.settled
        assert run.settling_time is not None
        return run.settling_time * spectrum(network, found.state).radius

    assert settling(network) <= 75
    rng = np.random.default_rng(7)

    def off(values):
        return values * (1 + 0.05 * rng.standard_normal(values.shape))

    times, pyramid = [], gains.preconditioner
    assert isinstance(pyramid, Multilevel)
    for _ in range(50):
        preconditioner = replace(pyramid, gains=tuple(off(S) for S in pyramid.gains))
        copy = replace(
            gains, rho=off(gains.rho), rate=off(gains.rate), preconditioner=preconditioner
        )
        times.append(settling(apply_gains(found.network, copy)))
    assert np.median(times) < 130
