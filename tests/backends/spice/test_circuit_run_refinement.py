"""Settling times in ngspice with steps fine enough for the digits that are shown."""

from dataclasses import replace
from functools import cache
from inspect import unwrap as unwrapped

import numpy as np
import pytest
import sympy as sp
from simulator import needs_ngspice

from ann_dc import Study
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.circuit_run import CircuitRun, refined
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.errors import SpiceTimeoutError
from ann_dc.fidelity.circuit_study import measured_runs
from ann_dc.fidelity.prediction import predict
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.parts.levels import macro, switched_capacitor
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.report.tables import measured
from ann_dc.solver import synthesize

BACKEND = SpiceBackend(level=macro(), simulator=Ngspice(timeout=300.0))


def river() -> OptimalControlProblem:
    """A boat in a current that grows across the river."""
    x, y, s, th = sp.symbols("x y s th")
    return OptimalControlProblem(
        states=[x, y],
        controls=[s, th],
        dynamics=[s * sp.cos(th) + y / 2, s * sp.sin(th)],
        cost=s**2 / 2 + th**2 / 20,
        dt=0.2,
        horizon=10,
        q_0=(0, 0),
        q_d=(2, 1),
    )


def lander() -> OptimalControlProblem:
    """A lander that burns its own mass: slow, because its final mass is free."""
    h, v, m, thrust = sp.symbols("h v m T")
    return OptimalControlProblem(
        states=[h, v, m],
        controls=[thrust],
        dynamics=[v, thrust / m - 1, -thrust / 5],
        cost=thrust**2 / 2 + v**2 / 10,
        dt=0.15,
        horizon=12,
        q_0=(1, -0.4, 1),
        q_d=(0, 0, None),
    )


PROBLEMS = {
    "double_integrator": lambda: plants.double_integrator(N=5),
    "river": river,
    "car": lambda: plants.get("car")(),
    "cstr": plants.cstr,
    "lander": lander,
}
QUICK = ("double_integrator", "river")
CASES = [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in PROBLEMS]


@cache
def prepared(name: str):
    return BACKEND.prepare(
        design(synthesize(PROBLEMS[name]()), preconditioner=(PreconditionerKind.DIAGONAL,)).network
    )


@cache
def fine(name: str):
    circuit, probe = prepared(name)
    coarse = BACKEND.measure(circuit, BACKEND.deck(circuit, probe, {}), probe)
    return coarse, refined(coarse, BACKEND.simulator, BACKEND.level.datasheet)


@pytest.mark.sampled(1)
@needs_ngspice
@pytest.mark.parametrize("name", CASES)
def test_the_emulator_agrees_with_what_finer_steps_find(name):
    circuit, probe = prepared(name)
    found = predict(circuit, BACKEND.level, probe)
    assert fine(name)[1].settling_time() == pytest.approx(found.settling_time, rel=0.01)


@needs_ngspice
@pytest.mark.parametrize("name", CASES)
def test_steps_a_fourth_as_long_move_it_by_less_than_the_last_digit(name):
    _, run = fine(name)
    shown = measured(1e6 * run.settling_time(), 1e6 * run.settling_error)
    last = 10.0 ** -len(shown.partition(".")[2])
    if "." not in shown:
        last = 10.0 ** (len(shown) - len(shown.rstrip("0")))
    more = 4 * (4 if name in QUICK else 16)
    again = refined(run, BACKEND.simulator, BACKEND.level.datasheet, finer=more)
    assert 1e6 * abs(again.settling_time() - run.settling_time()) < last


@needs_ngspice
def test_it_ends_where_the_longer_run_does():
    coarse, run = fine("river")
    assert run.control_error == coarse.control_error
    assert run.trajectory.time[-1] == coarse.trajectory.time[-1]
    assert (np.diff(run.trajectory.time) > 0).all()
    early = run.trajectory.time < run.settling_time() / run.deck.timing.unit
    assert early.sum() > 2 * (coarse.trajectory.time < run.settling_time()).sum()


@needs_ngspice
def test_a_run_that_did_not_settle_stays_as_it_is():
    coarse, _ = fine("river")
    moving = replace(coarse, trajectory=replace(coarse.trajectory, states=-_ramp(coarse)))
    assert refined(moving, BACKEND.simulator, BACKEND.level.datasheet) is moving
    assert moving.unsettled.startswith("the controls still change")


@needs_ngspice
def test_a_run_that_is_cut_short_is_not_settled_however_quiet():
    coarse, _ = fine("river")
    cut = replace(coarse, deck=replace(coarse.deck, cut="its slowest pole asks for more"))
    assert coarse.settled()
    assert not coarse.unsettled
    assert cut.settled()
    assert cut.unsettled == "the run is too short to decide: its slowest pole asks for more"


@needs_ngspice
def test_settling_time_by_the_python_line_is_that_of_finer_steps():
    """`run` takes the steps of errors; its settling time takes finer ones, once."""
    coarse, found = fine("double_integrator")
    once = replace(coarse, finer=None)
    network = coarse.trajectory.network
    run = SpiceBackend(level=BACKEND.level).run(network)
    assert run.settling_time() == found.settling_time() != once.settling_time()
    assert run.timed is run.timed
    assert run.timed.settling_error == found.settling_error
    assert run.control_error == run.timed.control_error


@needs_ngspice
def test_errors_and_settled_take_no_finer_steps():
    coarse, _ = fine("double_integrator")

    def refuse(run: CircuitRun) -> CircuitRun:
        raise AssertionError("finer steps")

    lazy = replace(coarse, finer=refuse)
    assert lazy.settled()
    assert lazy.control_error == coarse.control_error
    assert "us by coarse steps, " in str(lazy)
    with pytest.raises(AssertionError, match="finer steps"):
        lazy.settling_time()
    timed = replace(coarse, finer=lambda run: replace(run, finer=None))
    timed.settling_time()
    assert "coarse" not in str(timed)


class Failing:
    """A simulator whose runs fail after some of them."""

    def __init__(self, good: int) -> None:
        self.good = good

    def run(self, *given, **named):
        self.good -= 1
        if self.good < 0:
            raise SpiceTimeoutError("ngspice took longer than 1 s")
        return BACKEND.simulator.run(*given, **named)


@needs_ngspice
@pytest.mark.parametrize("good", [0, 1])
def test_finer_run_that_fails_is_told_with_an_unknown_settling_error(good, monkeypatch):
    coarse, _ = fine("double_integrator")
    monkeypatch.setattr("ann_dc.backends.spice.circuit_run.ENOUGH", 0.0)
    with pytest.warns(UserWarning, match=r"took longer than 1 s; .* coarser steps"):
        run = unwrapped(refined)(coarse, Failing(good), BACKEND.level.datasheet)
    assert np.isnan(run.settling_error)
    assert np.isfinite(run.settling_time())


@needs_ngspice
def test_sampled_circuits_and_studies_are_timed_by_finer_steps():
    circuit, probe = prepared("double_integrator")
    expected = fine("double_integrator")[1].settling_time()
    backend = SpiceBackend(level=BACKEND.level)
    (run,) = measured_runs(backend, circuit, probe, [backend.deck(circuit, probe, {})])
    assert run is not None
    assert run.settling_time() == expected
    study = Study(
        subject=PROBLEMS["double_integrator"](),
        vary={"run.backend": ["emulation", "spice"]},
        fixed={"circuit.level": "macro", "design.preconditioner": "diagonal"},
        metrics=["seconds", "control_settling_time"],
    )
    emulated, simulated = study.run(workers=0)["seconds"]
    assert simulated == pytest.approx(emulated, rel=0.01)


def _ramp(run) -> np.ndarray:
    return run.trajectory.time[:, None] * run.trajectory.final


@needs_ngspice
@pytest.mark.slow
def test_a_clocked_circuit_is_good_to_a_period():
    level = switched_capacitor(step=0.1)
    backend = SpiceBackend(level=level)
    network = design(
        synthesize(plants.double_integrator(N=2)), preconditioner=(PreconditionerKind.DIAGONAL,)
    ).network
    run = refined(backend.run(network), BACKEND.simulator, level.datasheet)
    assert run.settling_error == pytest.approx(1 / level.technology.clock)
