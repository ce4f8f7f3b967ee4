"""Where the time goes: phases add up, and nobody pays who does not ask."""

import threading
import time

import pytest

import ann_dc
from ann_dc.timing import REST, Seconds, Stopwatch, phase


@phase("inner")
def wait(seconds):
    time.sleep(seconds)
    return seconds


def test_the_time_of_a_phase_is_its_own_and_all_of_them_add_up():
    began = time.perf_counter()
    with Stopwatch() as watch:
        within = time.perf_counter()
        with phase("outer"):
            time.sleep(0.01)
            assert wait(0.03) == 0.03
        wait(0.02)
        held = time.perf_counter() - within
    passed = time.perf_counter() - began
    assert [*watch.phases] == [REST, "outer", "inner"]
    assert 0.05 <= watch.phases["inner"].wall < passed - 0.01
    assert 0.01 <= watch.phases["outer"].wall < passed - 0.05
    assert held - 1e-9 < sum(spent.wall for spent in watch.phases.values()) < passed + 1e-9


def test_waiting_takes_no_cpu_and_work_does():
    with Stopwatch() as watch:
        wait(0.05)
        with phase("work"):
            end = time.process_time() + 0.03
            while time.process_time() < end:
                pass
    assert watch.phases["inner"].cpu < 0.03 <= watch.phases["work"].cpu


def test_a_phase_that_fails_ends_too():
    with Stopwatch() as watch:
        with pytest.raises(ZeroDivisionError), phase("broken"):
            _ = 1 / 0
        wait(0.01)
    assert watch.phases["inner"].wall >= 0.01 > watch.phases["broken"].wall


def test_nobody_is_told_who_holds_no_stopwatch():
    with Stopwatch() as watch:
        other = threading.Thread(target=wait, args=(0.0,))
        other.start()
        other.join()
    wait(0.0)
    assert [*watch.phases] == [REST]


def test_an_inner_stopwatch_takes_the_time_while_it_is_held():
    with Stopwatch() as outer:
        with Stopwatch() as inner:
            wait(0.0)
        with phase("after"):
            pass
    assert "inner" in inner.phases
    assert [*outer.phases] == [REST, "after"]


def test_a_table_has_a_row_a_phase_and_their_sum():
    watch = Stopwatch()
    watch.phases = {"run": Seconds(0.25, 0.125), REST: Seconds(0.5, 0.25), "last": Seconds()}
    rows = [line.rsplit(maxsplit=2) for line in str(watch).splitlines()]
    assert rows == [
        ["ms", "wall", "CPU"],
        ["run", "250.0", "125.0"],
        ["last", "0.0", "0.0"],
        [REST, "500.0", "250.0"],
        ["together", "750.0", "375.0"],
    ]


def test_a_process_is_older_than_what_it_does():
    before = Seconds.since_start()
    assert before.wall > 0
    assert before.cpu > 0
    assert Seconds.since_start().wall > before.wall


def test_a_solve_is_told_apart():
    with Stopwatch() as watch:
        ann_dc.solve(ann_dc.plants.double_integrator(N=4))
    reported = [
        "stage equations",
        "network",
        "gain-scheduled run",
        "gains",
        "trial runs",
        "run",
        "certificate",
    ]
    assert [name for name in watch.phases if name != REST] == reported
