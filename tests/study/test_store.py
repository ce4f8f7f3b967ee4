"""Rows that went into a store come out of it: whole, once, in order, and nobody mixes studies."""

import math
import os
import signal
import sqlite3
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from ann_dc.errors import StoreError
from ann_dc.study.columns import plain_row
from ann_dc.study.records import FAILED, LOST, TIMED_OUT, Finished
from ann_dc.study.store import Store
from ann_dc.study.stored_trajectories import packed

COLUMNS = ("point", "seed", "input.q_d.x", 'odd "name"; DROP TABLE rows --', "peak", "outcome")
IDENTITY = {"title": "a study", "vary": {"input.q_d.x": [0.5, 1.0]}, "seed": 3}


def row(point, **cells):
    return Finished({"point": point, "seed": point + 7, "outcome": "settled", **cells})


def begun(folder, identity=IDENTITY, columns=COLUMNS):
    return Store.begin(folder, identity, columns)


CELLS = st.one_of(
    st.none(), st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(), st.text(),
    st.floats(width=32).map(np.float32), st.integers(0, 255).map(np.uint8),
    st.booleans().map(np.bool_),
)  # fmt: skip
NAMES = st.text(
    st.characters(categories=["L", "N", "P", "S"], include_characters=" "), min_size=1, max_size=8
).filter(str.isprintable)


@st.composite
def tables(draw):
    """Columns, and rows for some points in some order, in parts."""
    names = draw(st.lists(NAMES, max_size=5, unique=True))
    columns = ("point", *(name for name in names if name not in ("point", "outcome")), "outcome")
    points = draw(st.lists(st.integers(0, 50), max_size=8, unique=True))
    rows = [
        {"point": point} | {name: draw(CELLS) for name in columns[1:] if draw(st.booleans())}
        for point in points
    ]
    curves = [draw(st.binary(max_size=20)) for _ in rows]
    cut = draw(st.integers(0, len(rows)))
    finished = [Finished(*pair) for pair in zip(rows, curves)]
    return columns, [finished[:cut], finished[cut:]]


@given(tables())
@settings(max_examples=40)
def test_append_and_reopen_is_the_identity(table):
    columns, parts = table
    with tempfile.TemporaryDirectory() as folder:
        for part in parts:
            with begun(folder, columns=columns) as store:
                store.append(part)
        every = sorted((one for part in parts for one in part), key=lambda one: one.row["point"])
        expected = [dict.fromkeys(columns) | plain_row(one.row) for one in every]
        with Store.open(folder) as store:
            found = list(store.rows())
            assert found == expected
            assert [[*one] for one in found] == [[*columns]] * len(found)
            signs = [[*map(repr, one.values())] for one in expected if "-0.0" in repr(one)]
            kept = [[*map(repr, one.values())] for one in found if "-0.0" in repr(one)]
            assert len(signs) == len(kept)
            assert store.finished() == {one.row["point"] for one in every}
            assert len(store) == len(every)
            assert store.columns == columns


def test_true_and_false_come_back_as_such(tmp_path):
    with begun(tmp_path) as store:
        store.append([row(0, peak=True), row(1, peak=None)])
    with begun(tmp_path) as store:
        store.append([row(2, peak=False)])
        assert [one["peak"] for one in store.rows()] == [True, None, False]
        assert type(next(store.rows())["peak"]) is bool


def test_infinities_stay_and_nan_is_none(tmp_path):
    with begun(tmp_path) as store:
        store.append([row(0, peak=math.inf), row(1, peak=-math.inf), row(2, peak=math.nan)])
        assert [one["peak"] for one in store.rows()] == [math.inf, -math.inf, None]


def test_rows_come_in_the_order_of_points_some_at_a_time(tmp_path, monkeypatch):
    monkeypatch.setattr("ann_dc.study.store.PIECE", 3)
    with begun(tmp_path) as store:
        store.append([row(point) for point in (5, 0, 9, 3, 7, 1, 8)])
        found = []
        for one in store.rows():
            if not found:
                store.append([row(6)])  # while somebody reads
            found.append(one["point"])
        assert found == [0, 1, 3, 5, 6, 7, 8, 9]


def test_a_table_is_one_of_sqlite(tmp_path):
    with begun(tmp_path) as store:
        store.append([row(0, **{"input.q_d.x": 0.5, COLUMNS[3]: "k"}), row(1, peak=2.0)])
        database = sqlite3.connect(tmp_path / "study.sqlite")
        query = """SELECT point, "input.q_d.x" FROM rows WHERE "input.q_d.x" < 1"""
        assert database.execute(query).fetchall() == [(0, 0.5)]
        database.close()


def test_names_that_differ_in_case_alone(tmp_path):
    columns = ("point", "K", "k", "k~2", "Outcome", "outcome")
    with begun(tmp_path, columns=columns) as store:
        done = {"point": 0, "K": 1.0, "k": 2.0, "k~2": 3.0, "Outcome": "no", "outcome": FAILED}
        store.append([Finished(done)])
        assert list(store.rows()) == [done]
        assert store.failed() == {0}


def test_points_without_result_are_known_and_can_be_done_again(tmp_path):
    with begun(tmp_path) as store:
        outcomes = ["settled", FAILED, TIMED_OUT, LOST, "diverged"]
        store.append(
            [Finished({"point": n, "outcome": word}, b"x") for n, word in enumerate(outcomes)]
        )
        assert store.failed() == {1, 2, 3}
        assert [row["outcome"] for row in store.rows()] == [*outcomes]
        store.discard(store.failed())
        assert store.finished() == {0, 4}
        store.append([row(1), row(2), row(3)])
        assert store.failed() == set()
        assert store.curves(1) == {}


def test_curves_are_kept_beside_their_row(tmp_path):
    curves = {"time": np.array([0.0, 1.0]), "residual": np.array([1.0, np.inf])}
    with begun(tmp_path) as store:
        store.append([row(0)._replace(curves=packed(curves)), row(1)])
    with Store.open(tmp_path) as store:
        found = store.curves(0)
        assert [*found] == [*curves]
        np.testing.assert_array_equal(found["residual"], curves["residual"])
        assert store.curves(1) == store.curves(2) == {}


# ---- what is refused, and leaves everything as it was ------------------------------------------


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"point": 0}, "a case has one record; discard the old one first"),
        ({"point": 2, "no such": 1.0}, r"row of point 2: unknown columns 'no such'; there are: po"),
        ({"point": 2, "peak": [1.0]}, r"peak: expected a number of at most 64 bits.*got \[1.0\]"),
        ({"point": 2, "peak": 2**63}, "peak: expected a number of at most 64 bits"),
        ({"point": 2, "peak": b"raw"}, "peak: expected a number"),
        ({"point": -1}, "point: expected a whole number of at least 0, got -1"),
        ({"point": 1.0}, r"point: expected a whole number of at least 0, got 1\.0"),
        ({"seed": 1}, "point: expected a whole number of at least 0, got None"),
    ],
)
def test_a_row_that_cannot_be_kept(tmp_path, wrong, message):
    with begun(tmp_path) as store:
        store.append([row(0)])
        with pytest.raises(StoreError, match=message):
            store.append([row(1)._replace(curves=b"x"), Finished(wrong)])
        assert store.finished() == {0}
        assert store.curves(1) == {}
        store.append([row(1)])


def test_a_changed_study_says_what_changed(tmp_path):
    with begun(tmp_path) as store:
        store.append([row(0)])
    changed = {"title": "a study", "vary": {"input.q_d.x": [0.5, 2.0]}, "seed": 4}
    with pytest.raises(StoreError, match=r"seed: 3 -> 4; vary.input.q_d.x\[1\]: 1.0 -> 2.0"):
        begun(tmp_path, changed)
    with pytest.raises(StoreError, match=r'columns\[4\]: "peak" -> "outcome"; columns\[5\]: "out'):
        begun(tmp_path, columns=(*COLUMNS[:4], "outcome"))
    with begun(tmp_path) as store:  # nothing of it was written, and nobody holds the lock
        assert store.finished() == {0}
        assert store.identity == IDENTITY


def test_an_identity_may_hold_tuples_and_infinity(tmp_path):
    with begun(tmp_path, {"vary": {"rho": (1.0, math.inf), "N": 9}}) as store:
        assert store.identity == {"vary": {"rho": [1.0, math.inf], "N": 9}}
    begun(tmp_path, {"vary": {"rho": [1.0, math.inf], "N": 9}}).close()


def test_two_drivers(tmp_path):
    with begun(tmp_path) as store:
        with pytest.raises(StoreError, match=rf"process {os.getpid()} on \S+ is writing to this"):
            begun(tmp_path)
        store.append([row(0)])
        with Store.open(tmp_path) as reader:  # meanwhile
            assert len(reader) == 1
            store.append([row(1)])
            assert len(reader) == 2
    with begun(tmp_path) as store:
        assert len(store) == 2


def test_who_reads_writes_nothing(tmp_path):
    begun(tmp_path).close()
    with Store.open(tmp_path) as reader, pytest.raises(StoreError, match="readonly"):
        reader.append([row(0)])


WRITER = """
import sys
from ann_dc.study.records import Finished
from ann_dc.study.store import Store
from ann_dc.study.stored_trajectories import packed
store = Store.begin(sys.argv[1], {}, ["point", "outcome"])
first = max(store.finished(), default=-1) + 1
for point in range(first, 10**9, 3):
    store.append([Finished({"point": point + i, "outcome": "settled"}, b"x") for i in range(3)])
    print(point + 2, flush=True)
"""


def test_a_killed_driver_loses_nothing_that_was_kept(tmp_path):
    command = [sys.executable, "-c", WRITER, tmp_path]
    for _ in range(3):
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
            for _ in range(5):
                writer.stdout.readline()
            writer.send_signal(signal.SIGKILL)
            reported = writer.stdout.read().split("\n")[:-1]  # whole lines
        with Store.open(tmp_path) as store:
            points = store.finished()
        assert points == {*range(len(points))}
        assert len(points) % 3 == 0
        assert max(map(int, reported), default=0) in points


def test_a_killed_driver_that_had_just_begun(tmp_path):
    (tmp_path / "study.sqlite").touch()  # as SQLite leaves it before the first transaction
    (tmp_path / "lock").touch()
    with begun(tmp_path) as store:
        store.append([row(0)])


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # threads of others do not matter here
def test_a_forked_process_does_not_hold_the_lock(tmp_path):
    store = begun(tmp_path)
    ready, end = os.pipe(), os.pipe()
    child = os.fork()
    if child == 0:
        os.close(end[1])
        os.write(ready[1], b"!")
        os.read(end[0], 1)  # until the parent is done
        os._exit(0)
    try:
        os.read(ready[0], 1)
        store.close()
        begun(tmp_path).close()
    finally:
        for handle in (*ready, *end):
            os.close(handle)
        os.waitpid(child, 0)


def test_a_path_is_a_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a?b#c%20", "ä ö"):
        with begun(Path(name) / "deeper") as store:
            store.append([row(0)])
        with Store.open(Path(name) / "deeper") as store:
            assert len(store) == 1
