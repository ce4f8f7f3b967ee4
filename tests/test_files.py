"""Whole files: the old one stays until the new one is complete; links stay links; one writer."""

import contextlib
import os
import signal
import subprocess
import sys
import tracemalloc
from pathlib import Path

import pytest

from ann_dc.errors import FileFormatError, OutputError, StoreError
from ann_dc.files import Lock, make_folder, read_whole, write_folder, write_whole, writing_whole

HOLD = "import sys, time; from pathlib import Path; from ann_dc.files import Lock; " \
       "lock = Lock(Path(sys.argv[1])); print('held', flush=True); time.sleep(60)"  # fmt: skip


def test_write_and_read_is_the_identity(tmp_path):
    for content in (b"", b"\x00\r\n\xff", b"again"):
        write_whole(tmp_path / "file", content)
        assert read_whole(tmp_path / "file", limit=5, remedy="") == content
    assert [file.name for file in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_what_was_there_survives_a_failed_write(tmp_path, monkeypatch, call):
    def full(*_):
        raise OSError(28, "No space left on device")

    (tmp_path / "file").write_bytes(b"old")
    monkeypatch.setattr(os, call, full)
    with pytest.raises(OutputError, match=r"file' cannot be written \(No space.*; use a path"):
        write_whole(tmp_path / "file", b"new")
    assert (tmp_path / "file").read_bytes() == b"old"
    assert [file.name for file in tmp_path.iterdir()] == ["file"]


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "target").write_bytes(b"old")
    (tmp_path / "link").symlink_to(tmp_path / "target")
    write_whole(tmp_path / "link", b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_bytes() == b"new"


@pytest.mark.skipif(not os.path.exists("/dev/fd"), reason="needs pipes with a path")
def test_a_pipe_is_written_to_directly():
    reading, writing = os.pipe()
    write_whole(f"/dev/fd/{writing}", b"through")
    os.close(writing)
    with open(reading, "rb") as stream:
        assert stream.read() == b"through"


def test_a_file_where_a_folder_is_needed(tmp_path):
    (tmp_path / "taken").write_bytes(b"kept")
    for folder in (tmp_path / "taken", tmp_path / "taken" / "deeper"):
        with pytest.raises(OutputError, match=r"taken.*\(a file has the name of the folder\)"):
            make_folder(folder)
    assert make_folder(tmp_path / "a" / "b").is_dir()


def test_what_cannot_be_read_is_told_with_the_remedy(tmp_path):
    (tmp_path / "file").write_bytes(b"four")
    for path, reason in (
        (tmp_path, "is a folder"),
        (tmp_path / "none", "does not exist"),
        (tmp_path / "file", "is larger than 3 bytes"),
    ):
        with pytest.raises(FileFormatError, match=f"{path}' {reason}.*; use another"):
            read_whole(path, limit=3, remedy="use another")


@pytest.mark.skipif(not os.path.exists("/proc/self/stat"), reason="needs files of unknown size")
def test_a_file_that_does_not_say_its_size_is_refused():
    with pytest.raises(FileFormatError, match="has more bytes than its size states; use another"):
        read_whole("/proc/self/stat", limit=10_000, remedy="use another")


def test_a_name_that_no_file_can_have_is_told():
    with pytest.raises(FileFormatError, match=r"cannot be read \(File name too long\); use"):
        read_whole("a" * 5000, limit=10, remedy="use another")


def test_reading_takes_the_memory_of_the_file(tmp_path):
    """However large the limit is."""
    (tmp_path / "file").write_bytes(bytes(1000))
    tracemalloc.start()
    read_whole(tmp_path / "file", limit=10**9, remedy="")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1_000_000


FILES = {"a.txt": b"one", "b.txt": b""}


def test_a_folder_has_all_of_its_files(tmp_path):
    write_folder(tmp_path / "new", FILES)
    assert {file.name: file.read_bytes() for file in (tmp_path / "new").iterdir()} == FILES
    assert [file.name for file in tmp_path.iterdir()] == ["new"]


@pytest.mark.parametrize("call", ["fsync", "mkdir", "rename"])
def test_a_folder_that_cannot_be_completed_leaves_nothing(tmp_path, monkeypatch, call):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, call, full)
    with pytest.raises(OutputError, match=r"new' cannot be written \(No space.*; use a path"):
        write_folder(tmp_path / "new", FILES)
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_process_left_is_no_obstacle(tmp_path):
    part = tmp_path / f".new.{os.getpid()}.part"
    part.mkdir()
    (part / "a.txt").write_bytes(b"half")
    write_folder(tmp_path / "new", FILES)
    assert {file.name: file.read_bytes() for file in (tmp_path / "new").iterdir()} == FILES


def test_two_writers_of_a_file_do_not_mix(tmp_path):
    """The one that ends last stays, whole; nothing of either is left."""
    file = tmp_path / "file"
    with writing_whole(file) as first, writing_whole(file) as second:
        first.write(b"first")
        second.write(b"second and longer")
    assert file.read_bytes() == b"first"
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_an_error_of_what_is_written_stays_what_it_is(tmp_path):
    with pytest.raises(ValueError, match=r"^no number$"), writing_whole(tmp_path / "file"):
        raise ValueError("no number")
    with pytest.raises(OutputError, match="No space"), writing_whole(tmp_path / "file"):
        raise OSError(28, "No space left on device")
    assert not list(tmp_path.iterdir())


def test_the_name_of_a_new_file_is_written_to_the_disk_too(tmp_path, monkeypatch):
    kept, fsync = [], os.fsync

    def noted(handle):
        kept.append(os.path.basename(os.readlink(f"/proc/self/fd/{handle}")))
        fsync(handle)

    monkeypatch.setattr(os, "fsync", noted)
    write_whole(tmp_path / "file", b"content")
    assert kept[1:] == [tmp_path.name]


@pytest.mark.parametrize("kind", ["folder", "file", "link to nothing"])
def test_what_has_the_name_of_a_new_folder_stays(tmp_path, kind):
    place = tmp_path / "taken"
    if kind == "folder":
        place.mkdir()
    elif kind == "file":
        place.write_bytes(b"kept")
    else:
        place.symlink_to(tmp_path / "nowhere")
    before = place.lstat()
    with pytest.raises(OutputError, match=r"taken' exists already.* the name of a new folder"):
        write_folder(place, FILES)
    assert place.lstat().st_ino == before.st_ino
    assert [file.name for file in tmp_path.iterdir()] == ["taken"]


@pytest.mark.parametrize("place", ["no/folder", "file/folder", "a\0b"])
def test_a_folder_in_no_folder(tmp_path, place):
    (tmp_path / "file").write_bytes(b"kept")
    with pytest.raises(OutputError, match=r"use a path in an existing, writable folder"):
        write_folder(tmp_path / place, FILES)
    assert [file.name for file in tmp_path.iterdir()] == ["file"]


def test_a_file_is_written_bit_by_bit_or_stays_as_it_was(tmp_path):
    file = tmp_path / "file"
    with writing_whole(file) as stream:
        for part in (b"one", b"two"):
            stream.write(part)
            assert not file.exists()
    assert file.read_bytes() == b"onetwo"
    with contextlib.suppress(ZeroDivisionError), writing_whole(file) as stream:
        stream.write(b"half")
        stream.write(b"%d" % (1 // 0))
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert file.read_bytes() == b"onetwo"
    with (
        pytest.raises(OutputError, match=r"none.* cannot be"),
        writing_whole(file / "none"),
    ):
        pass


# ---- locks ---------------------------------------------------------------------------------------


def test_a_second_one_is_refused_with_the_name_of_the_first(tmp_path):
    file = tmp_path / "lock"
    first = Lock(file)
    with pytest.raises(OutputError, match=f"process {os.getpid()} on .* writing to this folder"):
        Lock(file)
    with pytest.raises(StoreError, match="writing to this study"):
        Lock(file, on="this study", error=StoreError)
    first.release()
    Lock(file).release()


def test_a_killed_one_leaves_nothing_behind(tmp_path):
    file = tmp_path / "lock"
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(file)], stdout=subprocess.PIPE, text=True
    )
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    with pytest.raises(OutputError, match=str(holder.pid)):
        Lock(file)
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    holder.stdout.close()
    Lock(file).release()


def test_a_file_that_is_removed_meanwhile_is_made_again(tmp_path, monkeypatch):
    """Else two would hold a lock, each on a file of its own."""
    fcntl = pytest.importorskip("fcntl")  # Windows removes no file that is open
    file, flock, removed = tmp_path / "lock", fcntl.flock, []

    def removing(handle, how):
        if not removed:
            removed.append(file.unlink())
        flock(handle, how)

    monkeypatch.setattr(fcntl, "flock", removing)
    first = Lock(file)
    assert file.exists()
    with pytest.raises(OutputError):
        Lock(file)
    first.release()


def test_write_folder_replace_swaps_the_whole_folder(tmp_path):
    place = tmp_path / "place"
    place.mkdir()
    (place / "old.txt").write_bytes(b"old")
    write_folder(place, FILES, replace=True)
    assert {file.name for file in place.iterdir()} == set(FILES)
    assert [*tmp_path.iterdir()] == [place]


def test_write_folder_replace_keeps_the_old_folder_if_the_new_one_fails(tmp_path, monkeypatch):
    place = tmp_path / "place"
    write_folder(place, {"old.txt": b"old"})
    rename = Path.rename

    def failing(self, target):
        if (self / "new.txt").exists():
            raise OSError("no space")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", failing)
    with pytest.raises(OutputError, match="cannot be written"):
        write_folder(place, {"new.txt": b"new"}, replace=True)
    assert [file.name for file in place.iterdir()] == ["old.txt"]
    assert [*tmp_path.iterdir()] == [place]


def test_write_folder_replace_refuses_a_file(tmp_path):
    (tmp_path / "file").write_bytes(b"kept")
    with pytest.raises(OutputError, match="exists already"):
        write_folder(tmp_path / "file", FILES, replace=True)
    assert (tmp_path / "file").read_bytes() == b"kept"
