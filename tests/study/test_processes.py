"""A thread's own process: replaced when it is gone, and told why when there can be none."""

import contextlib
import multiprocessing
import os
import pickle
import signal
import threading

import pytest
import small_work
from small_work import points, tasks

from ann_dc.errors import StudyError
from ann_dc.study.execution import execute
from ann_dc.study.processes import Apart, pickled
from ann_dc.study.store import Store


class Unknown:
    """Whose place nobody finds."""

    def __reduce__(self):
        return pickle.loads, (b"nonsense",)

    def __call__(self, task):
        return []


@pytest.fixture
def store(tmp_path):
    with Store.begin(tmp_path / "study", {}, small_work.COLUMNS) as store:
        yield store


def kill_first_children(number):
    """Kill so many processes of ours as soon as they are there."""
    killed: set[int] = set()
    while len(killed) < number:
        for child in multiprocessing.active_children():
            with contextlib.suppress(ProcessLookupError):  # the driver may have waited for it
                os.kill(child.pid, signal.SIGKILL)
                killed.add(child.pid)
            child.join()


@pytest.mark.parametrize("kills", [1, 3])
def test_a_process_that_is_killed_before_it_has_begun(store, kills):
    thread = threading.Thread(target=kill_first_children, args=[kills])
    thread.start()
    if kills == 1:
        execute(tasks(points("good")), small_work.work, store, workers=1)
        assert len(store) == 1
    else:
        with pytest.raises(
            StudyError, match=r"no process can run the tasks: a process was ended by sig"
        ):
            execute(tasks(points("good")), small_work.work, store, workers=1)
    thread.join()


def test_work_that_no_process_can_load(store):
    with pytest.raises(StudyError, match="no process can run the tasks: UnpicklingError"):
        execute(tasks(points("good")), Unknown(), store, workers=1)


def test_a_process_that_left_meanwhile_is_replaced_and_nobody_charged():
    """As one does that has had nothing to do for long."""
    apart = Apart(pickled(small_work.work))
    try:
        first, second, third = tasks(points("good", "good", "good"))
        workers = [int(apart(task, None).circumstances["worker"]) for task in (first, second)]
        assert workers[0] == workers[1]
        (child,) = multiprocessing.active_children()
        child.kill()
        child.join()
        attempt = apart(third, None)
        assert attempt.outcome == ""
        assert attempt.finished[0].row["point"] == 2
        assert int(attempt.circumstances["worker"]) != workers[0]
    finally:
        apart.close()
    assert multiprocessing.active_children() == []
