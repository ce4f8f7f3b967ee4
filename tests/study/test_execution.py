"""Whoever does a study, and whatever happens to them, its rows are the same."""

import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from types import ModuleType

import numpy as np
import pytest
import small_study
import small_work
from small_work import COLUMNS, points, tasks

from ann_dc.errors import StoreError, StudyError
from ann_dc.progress import Stopped
from ann_dc.study.execution import FIRST, Here, execute
from ann_dc.study.processes import pickled
from ann_dc.study.records import CIRCUMSTANCES, Finished
from ann_dc.study.store import Store
from ann_dc.study.worker import Script, loaded, own_script


@pytest.fixture
def store(tmp_path):
    with Store.begin(tmp_path / "study", {}, COLUMNS) as store:
        yield store


@pytest.fixture
def soon(monkeypatch):
    """Little patience with processes that have just begun."""
    monkeypatch.setattr("ann_dc.study.processes.FIRST", 0.3)
    monkeypatch.setattr("ann_dc.study.execution.SLACK", 0.2)


def table(store):
    """What has to be the same from run to run: rows without circumstances, and curves."""
    rows = [{k: v for k, v in row.items() if k not in CIRCUMSTANCES} for row in store.rows()]
    return [(repr(row), repr(store.curves(row["point"]))) for row in rows]


def undisturbed(tmp_path, asked):
    """The table of points that are done here and now."""
    with Store.begin(tmp_path / "undisturbed", {}, COLUMNS) as store:
        store.append(small_work.work(tasks(asked, len(asked))[0]))
        return table(store)


def outcomes(store):
    return [row["outcome"] for row in store.rows()]


def messages(store):
    return [row["message"] for row in store.rows()]


MAKERS = {
    "own processes": lambda: None,
    "threads": lambda: ThreadPoolExecutor(3),
    "processes": lambda: ProcessPoolExecutor(2, mp_context=get_context("spawn")),
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize("limit", [None, 60.0])
def test_rows_are_the_same_whoever_does_them(store, tmp_path, name, limit):
    asked = points(*["good"] * 7, "slow", "good")
    executor = MAKERS[name]()
    tally = execute(tasks(asked, 2), small_work.work, store, executor=executor, limit=limit)
    if executor is not None:
        executor.shutdown()
    assert tally.outcomes == {"settled": 9}
    assert tally.stopped == ""
    assert table(store) == undisturbed(tmp_path, asked)
    for row in store.rows():
        assert row["wall_time"] > 0
        assert int(row["worker"]) > 1
        assert row["host"]


def test_what_raises_is_a_row_that_says_why(store):
    asked = points("good", "raise", "leave", "good", "memory")
    tally = execute(tasks(asked, 5), small_work.work, store, workers=1, common={"versions": "7"})
    assert tally.outcomes == {"settled": 2, "failed": 2, "worker lost": 1}
    rows = list(store.rows())
    assert [row["outcome"] for row in rows] == ["settled", *["failed"] * 2, *outcomes(store)[3:]]
    assert rows[1]["message"] == "ZeroDivisionError: division by zero"
    assert rows[2]["message"] == "SystemExit: enough"
    assert rows[4]["message"] == "MemoryError"
    assert rows[1]["seed"] == 1001
    assert rows[1]["rho"] == 1.5
    assert rows[1]["peak"] is None
    assert [row["versions"] for row in rows] == ["1", "7", "7", "1", "7"]  # its own first


@pytest.mark.parametrize(
    ("work", "message"),
    [
        (small_work.nonsense, "the task returned records of other cases: []"),
        (small_work.odd, "peak: expected a number of at most 64 bits, a text, true, false or none"),
    ],
)
def test_work_that_gives_nonsense(store, work, message):
    execute(tasks(points("good", "good"), 2), work, store, workers=1)
    assert outcomes(store) == ["failed"] * 2
    assert all(found.startswith(message) for found in messages(store))


@pytest.mark.usefixtures("soon")
def test_a_point_that_hangs_is_ended_alone(store):
    asked = points("good", "spin", "good", "native", "good", "good")
    began = time.monotonic()
    tally = execute(tasks(asked, 3), small_work.work, store, workers=2, limit=0.2)
    assert tally.outcomes == {"settled": 4, "timed out": 2}
    assert outcomes(store)[1] == outcomes(store)[3] == "timed out"
    assert messages(store)[1] == "the time limit of 0.2 s expired"
    assert list(store.rows())[1]["wall_time"] > 0.2
    assert time.monotonic() - began < 30


@pytest.mark.usefixtures("soon")
def test_a_thread_of_somebody_elses_is_not_stuck_with_a_point_that_hangs(store):
    with ThreadPoolExecutor(2) as executor:
        asked = points("native", "good", "kill", "good")
        execute(tasks(asked), small_work.work, store, executor=executor, limit=0.2)
    assert outcomes(store) == ["timed out", "settled", "worker lost", "settled"]


def test_a_worker_that_dies_is_replaced_and_only_the_guilty_is_charged(store, tmp_path):
    once = [f"once:{tmp_path / str(number)}" for number in range(3)]
    asked = points(once[0], "good", "kill", "good", once[1], "exit", once[2], "good")
    tally = execute(tasks(asked, 4), small_work.work, store, workers=2)
    assert tally.outcomes == {"settled": 6, "worker lost": 2}
    found = messages(store)
    assert found[2] == "its process was ended by signal 9 (Killed)"
    assert found[5] == "its process ended with exit code 3"
    good = [row for row in table(store) if "worker lost" not in row[0]]
    asked = [point for point in asked if point.setting["does"] not in ("kill", "exit")]
    assert good == undisturbed(tmp_path, asked)


def test_worker_that_exits_with_code_zero_in_its_task_is_lost(store):
    """A pool that looks at exit codes for failures would wait for its record for ever."""
    tally = execute(tasks(points("good", "vanish", "good")), small_work.work, store, workers=1)
    assert tally.outcomes == {"settled": 2, "worker lost": 1}
    assert messages(store)[1] == "its process ended with exit code 0"


@pytest.mark.slow
def test_workers_that_are_killed_while_they_work(store, tmp_path):
    """From outside, at any moment: a row says so only where it met the same task twice."""
    asked = points(*["slow"] * 40)
    killed = []

    def shoot(line):
        workers = multiprocessing.active_children()
        if len(killed) < 2 and workers:
            killed.append(workers[0].pid)
            os.kill(workers[0].pid, signal.SIGKILL)

    tally = execute(tasks(asked), small_work.work, store, workers=2, progress=shoot)
    assert killed
    assert tally.outcomes == {"settled": 40}
    assert table(store) == undisturbed(tmp_path, asked)


def test_no_process_is_left(store):
    execute(tasks(points(*["good"] * 4)), small_work.work, store)
    for row in store.rows():
        with pytest.raises(ProcessLookupError):
            os.kill(int(row["worker"]), 0)
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("study")]


def test_who_is_told_may_end_it(store):
    reported = []

    def enough(line):
        reported.append(line)
        if len(reported) == 3:
            raise Stopped("that is enough")

    asked = points(*["slow"] * 500)
    tally = execute(tasks(asked), small_work.work, store, workers=2, progress=enough)
    assert tally.stopped == "that is enough"
    assert 0 < tally.outcomes["settled"] < 500
    assert len(store) == tally.outcomes["settled"]
    assert " of 500 points, " in reported[2]
    assert " a second, " in reported[2]
    assert " left; settled " in reported[2]


@pytest.mark.usefixtures("interruptible")
def test_ctrl_c_keeps_what_is_finished(store):
    timer = threading.Timer(1.5, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    began = time.monotonic()
    tally = execute(tasks(points(*["slow"] * 1000)), small_work.work, store, workers=2)
    assert tally.stopped == "interrupted"
    assert time.monotonic() - began < 10
    assert len(store) == tally.outcomes["settled"] > 0


@pytest.mark.sampled(1)
@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("moment", [0.05, 0.3])
def test_ctrl_c_reaches_the_workers_too_and_they_say_nothing(tmp_path, moment):
    with driver(
        tmp_path, ["slow"] * 300, stderr=subprocess.PIPE, start_new_session=True
    ) as process:
        time.sleep(moment)
        os.killpg(process.pid, signal.SIGINT)
        assert process.stderr.read() == b""
        assert process.wait() == 0


def test_first_line_of_a_run_says_that_it_compiles(store):
    reported = []

    def slowly(task):
        time.sleep(1.0)
        return [Finished({"point": p.number, "outcome": "settled"}) for p in task.points]

    with ThreadPoolExecutor(1) as executor:
        execute(tasks(points("a")), slowly, store, executor=executor, progress=reported.append)
    assert reported[0] == "0 of 1 points; designing and compiling"
    assert reported[-1].startswith("1 of 1 points, ")


def test_large_task_is_divided_by_the_duration_of_its_cases(store):
    sizes, asked = [], points(*["slow"] * 200)

    def counted(task):
        sizes.append(len(task.points))
        return [Finished({"point": p.number, "outcome": "settled"}) for p in task.points]

    execute(tasks(asked, 200), counted, store, executor=Here())
    assert (sizes[0], sum(sizes)) == (FIRST, 200)
    assert len(store) == 200


def test_task_of_long_cases_is_divided_into_portions(store, monkeypatch):
    monkeypatch.setattr("ann_dc.study.execution.PORTION", 0.1)
    sizes, asked = [], points(*["slow"] * 60)

    def slowly(task):
        sizes.append(len(task.points))
        time.sleep(0.02 * len(task.points))
        return [Finished({"point": p.number, "outcome": "settled"}) for p in task.points]

    execute(tasks(asked, 60), slowly, store, executor=Here(), workers=1)
    assert sizes[0] == FIRST
    assert max(sizes[2:]) <= 5  # two tasks are submitted before the first duration is known
    assert sum(sizes) == 60


def test_nothing_to_do(store):
    assert execute([], small_work.work, store).outcomes == {}


def test_a_full_disk_ends_it_and_keeps_what_is_there(store, monkeypatch):
    kept = store.append

    def full(finished):
        if len(store) >= 5:
            raise StoreError("is the disk full?")
        kept(finished)

    monkeypatch.setattr(store, "append", full)
    with pytest.raises(StoreError, match="is the disk full"):
        execute(tasks(points(*["good"] * 20)), small_work.work, store, workers=1)
    assert len(store) >= 5


@pytest.mark.parametrize("words", [{"limit": 0.0}, {"limit": float("nan")}, {"workers": 0}])
def test_limits_that_are_none(store, words):
    with pytest.raises(StudyError, match="expected a positive number"):
        execute([], small_work.work, store, **words)


def test_an_executor_that_breaks(store):
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        asked = points("good", "good", "kill", "good")
        with pytest.raises(
            StudyError, match=r"accepts no more tasks \(BrokenProcessPool.* run the"
        ):
            execute(tasks(asked), small_work.work, store, executor=executor)
    assert {*outcomes(store)} == {"settled"}


def test_work_that_cannot_be_sent(store, monkeypatch):
    monkeypatch.setitem(sys.modules, "cloudpickle", None)
    with pytest.raises(StudyError, match="cannot be sent to other processes"):
        execute(tasks(points("good")), lambda task: [], store)


def test_work_of_no_name_goes_with_cloudpickle(store):
    execute(tasks(points("good")), lambda task: small_work.work(task), store, workers=1)
    assert outcomes(store) == ["settled"]


SCRIPT = """
import sys
from ann_dc.study import Metric, Study
def stages(sample):
    return float(sample.network.stages)
own = Metric(name="own", value=stages)
study = Study(subject="double_integrator", vary={"problem.N": [3, 4]}, metrics=[own])
print(study.run(sys.argv[1], workers=1)["own"].tolist())
"""


@pytest.mark.slow
def test_study_in_a_plain_script_runs_once_and_prints_no_traceback(tmp_path):
    """The script has no guard, and the study needs a function that it defines."""
    script = tmp_path / "script.py"
    script.write_text(SCRIPT, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, script, tmp_path / "study"],
        capture_output=True, text=True, timeout=120, encoding="utf-8",
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "[3.0, 4.0]\n"


def test_worker_given_a_function_of_a_notebook_tells_where_to_define_it(monkeypatch):
    notebook = ModuleType("__main__")
    exec("def work(task): return []", vars(notebook))
    monkeypatch.setitem(sys.modules, "__main__", notebook)
    sent = pickled(notebook.work)
    assert own_script() == Script("", None)
    del notebook.work
    with pytest.raises(StudyError, match="define its functions in a module"):
        loaded(sent, own_script())


# ---- a driver that is killed -------------------------------------------------------------------


@contextlib.contextmanager
def driver(folder, doings, **options):
    """A process that does a study, from when it has begun."""
    command = [sys.executable, small_study.__file__, str(folder), *doings]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment, **options) as process:
        process.stdout.readline()
        yield process


def wait_until(condition, seconds=30):
    """Until something holds; fails when that takes too long."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def check_killed_often(tmp_path, kills, each, seed):
    """Kill the driver so often at random moments; the table is that of an undisturbed run.

    Until it is killed it does about so many points.
    """
    rng, size = np.random.default_rng(seed), 0
    doings = ["slow", "good"] * (2 * each * kills)
    for _ in range(kills):
        with driver(tmp_path / "study", doings) as process, Store.open(tmp_path / "study") as store:
            enough = size + rng.integers(2 * each)
            wait_until(lambda: len(store) >= enough)  # noqa: B023
            time.sleep(rng.uniform(0.0, 0.1))
            process.kill()
            process.wait()
            assert size <= enough <= len(store) < len(doings)
            size = len(store)
    with driver(tmp_path / "study", doings) as process:
        assert process.wait() == 0
    with Store.open(tmp_path / "study") as store:
        assert len(store) == len(doings)
        assert table(store) == undisturbed(tmp_path, points(*doings))


@pytest.mark.slow
def test_a_driver_that_is_killed_at_random_moments(tmp_path):
    check_killed_often(tmp_path, 1, each=5, seed=1)


@pytest.mark.slow
def test_a_driver_that_is_killed_a_hundred_times(tmp_path):
    check_killed_often(tmp_path, 100, each=8, seed=2)


def is_running(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_driver_that_is_killed_takes_its_workers_along(tmp_path):
    """Also those that hang in code that lets no thread of Python's run."""
    files = [tmp_path / str(number) for number in range(2)]
    doings = [f"hang:{files[0]}", "good", "good", f"hang:{files[1]}"]
    with driver(tmp_path / "study", doings) as process:
        wait_until(lambda: all(file.exists() and file.read_text() for file in files))
        workers = [int(file.read_text()) for file in files]
        assert all(map(is_running, workers))
        process.kill()
    wait_until(lambda: not any(map(is_running, workers)))
