"""Records of studies: a million stored, read and exported, and the overhead of a task.

Rows have 22 columns: six of a setting, eight of metrics. They are kept in a process of its own, so
that its largest resident size is told too; that must not grow with the rows. A task here does
nothing that takes time: what is measured is the way there and back, and keeping its row.
"""

import argparse
import contextlib
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import small_work
from bench.figure import Figure, show
from dask_cluster import Cluster

from ann_dc.study.execution import execute
from ann_dc.study.records import HEAD, TAIL, Finished
from ann_dc.study.store import Store

ROWS = 1_000_000
FEWER = 100_000
AT_ONCE = 1000
"""Rows a transaction."""
SETTINGS = tuple(f"setting_{number}" for number in range(6))
METRICS = tuple(f"metric_{number}" for number in range(8))
COLUMNS = (*HEAD, *SETTINGS, *METRICS, *TAIL)
FEW, TASKS = 10, 1000
BAR = 5000
"""Rows kept a second."""
MORE_MEMORY = 50
"""MB that ten times the rows may take more."""


def finished(first: int, number: int) -> list[Finished]:
    """Rows of so many points."""
    reported = {
        "outcome": "settled", "message": "it settled to a residual of 1e-6", "wall_time": 0.01,
        "worker": "4711", "host": "host", "versions": "ann_dc 0.1.0, numpy 2.0.0, scipy 1.15.0",
    }  # fmt: skip
    return [
        Finished(
            {"point": point, "seed": point}
            | dict.fromkeys(SETTINGS, point / 3)
            | dict.fromkeys(METRICS, point / 7)
            | reported
        )
        for point in range(first, first + number)
    ]


def seconds(call) -> float:
    """That a call takes."""
    began = time.perf_counter()
    call()
    return time.perf_counter() - began


def kept(rows: int, folder: Path) -> list[float]:
    """Seconds of keeping, of keeping one by one, of all that reads; the peak in MB."""
    import pyarrow.parquet  # noqa: F401  is there before anything is measured

    with Store.begin(folder, {}, COLUMNS) as store:
        keep = 0.0
        for first in range(0, rows, AT_ONCE):
            piece = finished(first, AT_ONCE)
            keep += seconds(lambda: store.append(piece))  # noqa: B023
        single = 0.0
        for point in range(rows, rows + AT_ONCE):
            piece = finished(point, 1)
            single += seconds(lambda: store.append(piece))  # noqa: B023
        read = [
            seconds(store.finished),
            seconds(lambda: [None for _ in store.rows() if False]),
            seconds(lambda: store.to_csv(folder / "rows.csv")),
            seconds(lambda: store.to_parquet(folder / "rows.parquet")),
        ]
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6
        return [keep, single, *read, peak, seconds(store.to_frame)]


def measured(rows: int) -> list[float]:
    """The same, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "bench.store", str(rows), folder]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return [float(word) for word in done.stdout.split()]


def stored() -> Iterator[Figure]:
    """Keeping and reading a million rows."""
    keep, single, points, read, table, parquet, peak, frame = measured(ROWS)
    *_, less, _ = measured(FEWER)
    yield Figure(
        name=f"records stored, {AT_ONCE} at a time, {ROWS} in all",
        value=f"{ROWS / keep:.0f} a second",
        remark=f"{len(COLUMNS)} columns; at least {BAR}",
        good=ROWS / keep >= BAR,
    )
    yield Figure(name="records stored one by one", value=f"{AT_ONCE / single:.0f} a second")
    for name, taken in (
        ("numbers of the finished points", points),
        ("all rows, one after the other", read),
        ("CSV file", table),
        ("Parquet file", parquet),
        ("data frame", frame),
    ):
        yield Figure(name=f"{name}, of {ROWS} records", value=f"{taken:.2f} s")
    yield Figure(
        name=f"memory while {ROWS} records are stored, read and written to files",
        value=f"{peak:.0f} MB",
        remark=f"{less:.0f} MB with {FEWER} records; includes the set of finished cases",
        good=peak - less <= MORE_MEMORY,
    )


def duration(executor: Executor | None, tasks: int) -> float:
    """Seconds of a study of so many tasks."""
    asked = small_work.tasks(small_work.points(*["good"] * tasks))
    with (
        tempfile.TemporaryDirectory() as folder,
        Store.begin(folder, {}, small_work.COLUMNS) as store,
    ):
        return seconds(lambda: execute(asked, small_work.work, store, executor=executor, workers=2))


def overhead(executor: Executor | None) -> float:
    """Milliseconds of a task beside its work, without the start of the workers."""
    start = duration(executor, FEW)
    return 1e3 * (duration(executor, FEW + TASKS) - start) / TASKS


@contextlib.contextmanager
def dask() -> Iterator[Executor]:
    """An executor of a cluster of two workers."""
    import distributed

    with tempfile.TemporaryDirectory() as folder:
        cluster = Cluster(Path(folder))
        try:
            with distributed.Client(scheduler_file=str(cluster.file), timeout=60) as client:
                client.wait_for_workers(2, timeout=60)
                yield client.get_executor()
        finally:
            cluster.end()


def figures() -> Iterator[Figure]:
    """Rows, and then tasks."""
    yield from stored()
    remark = "two workers, one point a task, its row kept"
    name = "overhead of a task, "
    yield Figure(name=f"{name}own processes", value=f"{overhead(None):.2f} ms", remark=remark)
    with ProcessPoolExecutor(2, get_context("spawn")) as executor:
        yield Figure(name=f"{name}ProcessPoolExecutor", value=f"{overhead(executor):.2f} ms")
    with dask() as executor:
        yield Figure(
            name=f"{name}Dask", value=f"{overhead(executor):.2f} ms",
            remark="a scheduler and two workers on this machine",
        )  # fmt: skip


def main() -> int:
    """Measure the store alone in this process, or show every figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", nargs="?", type=int, help="measure so many rows alone")
    parser.add_argument("folder", nargs="?", type=Path)
    options = parser.parse_args()
    if options.rows is None:
        return show(figures())
    print(*kept(options.rows, options.folder / "study"))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
