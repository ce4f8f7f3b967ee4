"""A cluster of Dask's does a study as processes of our own do: started by its two commands."""

import os
import signal
import time

import pytest
import small_work
from dask_cluster import Cluster
from small_work import COLUMNS, points, tasks

from ann_dc.study.execution import execute
from ann_dc.study.records import CIRCUMSTANCES
from ann_dc.study.store import Store

distributed = pytest.importorskip("distributed")
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::ResourceWarning")]


@pytest.fixture
def cluster(tmp_path):
    cluster = Cluster(tmp_path)
    try:
        yield cluster
    finally:
        cluster.end()


@pytest.fixture
def client(cluster):
    with distributed.Client(scheduler_file=str(cluster.file), timeout=60) as client:
        client.wait_for_workers(2, timeout=60)
        yield client


@pytest.fixture
def store(tmp_path):
    with Store.begin(tmp_path / "study", {}, COLUMNS) as store:
        yield store


def table(store):
    rows = [{k: v for k, v in row.items() if k not in CIRCUMSTANCES} for row in store.rows()]
    return [(repr(row), repr(store.curves(row["point"]))) for row in rows]


def undisturbed(tmp_path, asked):
    with Store.begin(tmp_path / "undisturbed", {}, COLUMNS) as store:
        store.append(small_work.work(tasks(asked, len(asked))[0]))
        return table(store)


def worker_processes(client):
    """Processes that do tasks; the commands are their nannies."""
    return list(client.run(os.getpid).values())


def test_a_worker_is_killed_and_one_added(cluster, client, store, tmp_path):
    asked = points(*["slow", "good"] * 100)
    done = []

    def disturb(line):
        done.append(line)
        if len(done) == 2:
            os.kill(worker_processes(client)[0], signal.SIGKILL)  # its nanny starts another
        if len(done) == 4:
            os.killpg(cluster.workers[0].pid, signal.SIGKILL)  # and now nobody does
            cluster.worker()

    tally = execute(
        tasks(asked), small_work.work, store, executor=client.get_executor(), progress=disturb
    )
    assert len(done) > 4
    assert tally.outcomes == {"settled": 200}
    assert table(store) == undisturbed(tmp_path, asked)
    assert len({row["worker"] for row in store.rows()}) >= 3


@pytest.mark.parametrize("limit", [None, 2.0])
def test_a_point_that_kills_and_one_that_hangs(client, store, tmp_path, limit):
    asked = points("good", "kill", "raise", "good", *(["native"] if limit else []), "good")
    execute(tasks(asked, 2), small_work.work, store, executor=client.get_executor(), limit=limit)
    found = {row["point"]: (row["outcome"], row["message"]) for row in store.rows()}
    assert found[1][0] == "worker lost"
    assert found[2] == ("failed", "ZeroDivisionError: division by zero")
    if limit:
        assert found[1][1] == "its process was ended by signal 9 (Killed)"
        assert found[4] == ("timed out", "the time limit of 2 s expired")
    assert [found[point.number][0] for point in asked if point.setting["does"] == "good"] == [
        "settled"
    ] * 3


def test_overhead_of_a_task(client, store):
    asked = points(*["good"] * 300)
    began = time.monotonic()
    execute(tasks(asked), small_work.work, store, executor=client.get_executor())
    assert (time.monotonic() - began) / 300 < 0.2
