"""Work that is ended before its end: by time, by an interrupt, by whoever is told."""

import signal
import threading
import time
from dataclasses import replace
from itertools import count

import pytest
from command_line import run

import ann_dc
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.status import Outcome
from ann_dc.errors import ArgumentTypeError, ArgumentValueError
from ann_dc.problem import plants
from ann_dc.progress import Deadline, Paced, Stopped, silent

TINY = 1e-9


def test_a_deadline_hands_lines_on_until_it_is_over():
    reported = []
    deadline = Deadline(reported.append, seconds=60.0)
    deadline("one")
    assert reported == ["one"]
    deadline.end = time.monotonic() - 1
    with pytest.raises(Stopped, match="the time limit of 60 s expired"):
        deadline("two")
    assert reported == ["one"]


@pytest.mark.usefixtures("interruptible")
def test_a_first_interrupt_is_noted_and_a_second_one_interrupts():
    before = signal.getsignal(signal.SIGINT)
    with Deadline(silent) as deadline:
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(Stopped, match="interrupted"):
            deadline("on")
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.usefixtures("interruptible")
def test_the_outer_of_two_deadlines_takes_the_interrupt():
    with Deadline(silent) as outer, Deadline(outer) as inner:
        signal.raise_signal(signal.SIGINT)
        assert outer.interrupted
        with pytest.raises(Stopped):
            inner("on")


def test_in_a_thread_signals_are_left_alone():
    before, seen = signal.getsignal(signal.SIGINT), []

    def work():
        with Deadline(silent):
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [before]


@pytest.mark.parametrize("backend", [None, OdeBackend(), RecurrentBackend()])
def test_solve_returns_what_is_there_when_time_is_up(backend):
    solution = ann_dc.solve(plants.car(), backend=backend, time_limit=TINY)
    assert solution.status.outcome is Outcome.STOPPED
    assert "1e-09 s) expired" in str(solution.status)
    assert not solution.certified
    assert solution["x"].shape == (10,)
    assert solution.as_dict()["status"] == "stopped"


def test_time_that_is_up_in_the_freeze_leaves_a_network():
    def until_frozen(line):
        if line.startswith(("candidates", "trial run")):
            raise Stopped("that is enough")

    designed = ann_dc.design(plants.double_integrator(N=5), progress=until_frozen)
    assert designed.settled
    assert len(designed.candidates) == 1
    assert OdeBackend(verify=False).run(designed.network).status.settled


@pytest.mark.parametrize("backend", [OdeBackend(verify=False), RecurrentBackend()])
def test_a_run_that_is_stopped_keeps_its_curves(backend, monkeypatch):
    seen = []

    def enough(line):
        seen.append(line)
        if len(seen) > 3:
            raise Stopped("that is enough")

    network = ann_dc.design(plants.double_integrator(N=5)).network
    monkeypatch.setattr(Paced.__init__, "__defaults__", (0.0,))  # a line a call,
    monkeypatch.setattr("ann_dc.backends.integration.steppers.LOGGED", 1)  # and a step a call
    monkeypatch.setattr("ann_dc.backends.lane_batch.ATTEMPTS", 1)
    run = replace(backend, progress=enough).run(network)
    assert run.status.outcome is Outcome.STOPPED
    assert "that is enough" in str(run.status)
    assert run.steps >= 3
    assert run.settling_time != run.settling_time


@pytest.mark.parametrize("limit", [0.0, -1.0, float("nan")])
def test_a_limit_that_is_none(limit):
    with pytest.raises(ArgumentValueError, match=r"time_limit: expected a (positive )?number"):
        ann_dc.solve(plants.double_integrator(N=5), time_limit=limit)


@pytest.mark.usefixtures("interruptible")
def test_ctrl_c_on_the_command_line_prints_what_is_there(monkeypatch):
    check, calls = Deadline.check, count()

    def interrupted_at_last(deadline):
        if next(calls) == 20:
            signal.raise_signal(signal.SIGINT)
        check(deadline)

    with monkeypatch.context() as patched:
        patched.setattr(Deadline, "check", interrupted_at_last)
        code, text = run("solve", "cart_pole", "--no-verify", "--quiet")
    assert code == 130
    assert next(calls) > 20
    code, text = run("solve", "cart_pole", "--no-verify", "--time-limit", "0.1")
    assert code == 1
    assert "the time limit of 0.1 s expired" in text


def test_a_time_limit_that_is_none():
    code, text = run("solve", "car", "--time-limit", "-1")
    assert code == 2
    assert "--time-limit: expected a positive number, got -1" in text


def test_early_deadline_tells_its_own_seconds():
    with pytest.raises(Stopped, match=r"^the time limit of 5e-10 s \(part of 1e-09 s\) expired"):
        Deadline(silent, 1e-9).early(0.5).check()
    assert Deadline(silent, 60.0).early(0.7).seconds == pytest.approx(42.0)
    assert Deadline(silent).early(0.7).seconds == float("inf")


def test_former_name_of_the_time_limit_warns_and_is_refused_beside_the_present_one():
    problem = plants.double_integrator(N=5)
    with pytest.warns(DeprecationWarning, match="limit: former name.*use time_limit"):
        solution = ann_dc.solve(problem, limit=TINY)
    assert solution.status.outcome is Outcome.STOPPED
    with pytest.raises(ArgumentTypeError, match="limit: expected time_limit alone, got both"):
        ann_dc.solve(problem, limit=TINY, time_limit=TINY)
