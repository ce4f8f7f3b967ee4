"""Bad disks, bad folders and bad files: a sentence that says so, and nothing stored is lost."""

import os
import pickle
import sqlite3
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from ann_dc.errors import StoreError
from ann_dc.study.records import Finished
from ann_dc.study.store import Store

COLUMNS = ("point", "note", "outcome")


def begun(folder):
    return Store.begin(folder, {"seed": 0}, COLUMNS)


def row(point):
    return Finished({"point": point, "note": "x" * 100, "outcome": "settled"})


def script(text, *arguments, **options):
    head = "import sys, filelock\nfrom ann_dc.errors import StoreError\n"
    head += "from ann_dc.study.records import Finished\nfrom ann_dc.study.store import Store\n"
    return subprocess.run(
        [sys.executable, "-c", head + text, *map(str, arguments)],
        capture_output=True, text=True, timeout=60, **options,
    )  # fmt: skip


FILLING = """
{limit}
store = Store.begin(sys.argv[1], {{"seed": 0}}, ["point", "note", "outcome"])
kept = 0
try:
    for point in range(1000000):
        done = {{"point": point, "note": "x" * 100, "outcome": "settled"}}
        store.append([Finished(done, b"y" * 1000)])
        kept += 1
except StoreError as error:
    print(error)
assert len(store) == kept, (len(store), kept)
store.close()
print(kept)
"""


def check_full(folder, done):
    assert done.returncode == 0, done.stderr
    sentence, kept = done.stdout.splitlines()
    assert (
        "the disk may be full, or a limit of file sizes reached; earlier records are stored"
        in sentence
    )
    assert int(kept) > 10
    with Store.open(folder) as store:
        assert store.finished() == {*range(int(kept))}


def test_a_file_that_must_not_grow(tmp_path):
    limit = "import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (500_000, 500_000))"
    check_full(tmp_path, script(FILLING.format(limit=limit), tmp_path))
    with begun(tmp_path) as store:  # there is room again
        last = len(store)
        store.append([row(point) for point in range(last, last + 10_000)])
        assert len(store) == last + 10_000


def test_a_full_disk(tmp_path):
    small = tmp_path / "small"
    small.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=500k", "tmpfs", str(small)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no disk may be mounted here")
    try:
        check_full(small / "study", script(FILLING.format(limit=""), small / "study"))
    finally:
        subprocess.run(["umount", small], check=True)


READING = """
import os
if os.geteuid() == 0:
    os.setgroups([]), os.setgid(65534), os.setuid(65534)
try:
    Store.begin(sys.argv[1], {"seed": 0}, ["point", "note", "outcome"])
except StoreError as error:
    print(error)
with Store.open(sys.argv[1]) as store:
    print(len(store))
"""


def test_a_folder_that_may_only_be_read():
    with tempfile.TemporaryDirectory() as outer:
        folder = Path(outer, "study")
        with begun(folder) as store:
            store.append([row(0), row(1)])
        Path(outer).chmod(0o755)
        folder.chmod(0o555)
        (folder / "lock").chmod(0o444)
        done = script(READING, folder)
        folder.chmod(0o755)
    assert done.returncode == 0, done.stderr
    sentence, number = done.stdout.splitlines()
    assert "Permission denied; use a writable folder" in sentence
    assert number == "2"


def test_a_file_stands_where_the_folder_should(tmp_path):
    (tmp_path / "taken").write_text("kept")
    with pytest.raises(StoreError, match="a file has the name of the folder"):
        begun(tmp_path / "taken")
    with pytest.raises(StoreError, match="expected a study"):
        Store.open(tmp_path / "taken")


@pytest.mark.parametrize("name", ["empty", "none"])
def test_no_study(tmp_path, name):
    (tmp_path / "empty").mkdir()
    with pytest.raises(StoreError, match=r"expected a study \(study\.sqlite is missing\)"):
        Store.open(tmp_path / name)


class Bomb:
    def __reduce__(self):
        return os._exit, (1,)


@pytest.mark.parametrize(
    "content",
    [b"", b"not a database, but longer than the head of one " * 30, pickle.dumps(Bomb()),
     b"SQLite format 3\0" + bytes(2000)],
)  # fmt: skip
def test_a_file_that_is_no_store(tmp_path, content):
    (tmp_path / "study.sqlite").write_bytes(content)
    calls = [Store.open] if not content else [Store.open, begun]
    for call in calls:
        with pytest.raises(StoreError, match=r"not a study database"):
            call(tmp_path)
    assert (tmp_path / "study.sqlite").read_bytes() == content


def test_a_database_of_somebody_else(tmp_path):
    database = sqlite3.connect(tmp_path / "study.sqlite")
    database.execute("CREATE TABLE rows (point)")
    database.commit()
    before = (tmp_path / "study.sqlite").read_bytes()
    for call in (begun, Store.open):
        with pytest.raises(StoreError, match="not a study database"):
            call(tmp_path)
    database.close()
    assert (tmp_path / "study.sqlite").read_bytes() == before


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            "UPDATE meta SET value = '99' WHERE name = 'layout'",
            "the database has layout 99, this ver",
        ),
        ("DELETE FROM meta WHERE name = 'layout'", "the database has layout None"),
        ("UPDATE meta SET value = '{' WHERE name = 'identity'", "the database is damaged"),
        ("UPDATE meta SET value = '5' WHERE name = 'columns'", "the database is damaged"),
        ("UPDATE meta SET value = '[[]]' WHERE name = 'columns'", "expected printable names"),
        ("UPDATE meta SET value = '[]' WHERE name = 'kinds'", "the database is damaged"),
        ("UPDATE meta SET value = '{\"note\": 5}' WHERE name = 'kinds'", "the database is damaged"),
        ("UPDATE meta SET value = '5' WHERE name = 'identity'", "the database is damaged"),
        ("DELETE FROM meta WHERE name = 'kinds'", "the database is damaged"),
        ("ALTER TABLE rows DROP COLUMN note", "columns of its rows are missing"),
        ("DROP TABLE curves", "not a study database"),
        (
            "CREATE TRIGGER t AFTER INSERT ON rows BEGIN DELETE FROM rows; END",
            "not a study database",
        ),
        ("CREATE VIEW v AS SELECT 1", "not a study database"),
    ],
)
def test_a_store_of_another_version_or_damaged(tmp_path, change, message):
    with begun(tmp_path) as store:
        store.append([row(0)])
    database = sqlite3.connect(tmp_path / "study.sqlite", isolation_level=None)
    database.execute(change)
    database.close()
    for call in (begun, Store.open):
        with pytest.raises(StoreError, match=message):
            call(tmp_path)
    database = sqlite3.connect(tmp_path / "study.sqlite")
    assert database.execute("SELECT count(*) FROM rows").fetchone() == (1,)
    database.close()


def test_bytes_that_are_no_text(tmp_path):
    with begun(tmp_path) as store:
        store.append([row(0)])
    file = tmp_path / "study.sqlite"
    for before, after in ((b"CREATE TABLE rows", b"CREATE TABLE r\xffws"), (b"x" * 9, b"\xff" * 9)):
        content = file.read_bytes()
        file.write_bytes(content.replace(before, after))
        with pytest.raises(StoreError, match=r"damaged|decode"), Store.open(tmp_path) as store:
            list(store.rows())
        file.write_bytes(content)


def test_pages_that_are_damaged(tmp_path):
    with begun(tmp_path) as store:
        store.append([row(point) for point in range(1000)])
    file = tmp_path / "study.sqlite"
    content = bytearray(file.read_bytes())
    content[5 * 4096 :] = b"\xa5" * (len(content) - 5 * 4096)
    file.write_bytes(content)
    with pytest.raises(StoreError, match="damaged"), Store.open(tmp_path) as store:
        list(store.rows())
