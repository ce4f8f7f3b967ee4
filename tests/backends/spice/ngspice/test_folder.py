"""Folders of runs: removed, kept as evidence, and never in the way of what lies there."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from ngspice_runs import DIVIDER, ENDLESS, on_linux
from raw_files import ramp

from ann_dc.backends.spice.ngspice import runner
from ann_dc.backends.spice.ngspice.raw import Raw
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.errors import (
    OutputError,
    RawFileError,
    SpiceCrashError,
    SpiceError,
)


def test_nothing_is_left_of_a_run(ngspice, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    ngspice.run(DIVIDER.format(1.0))
    assert not [*tmp_path.iterdir()]


def test_a_syntax_error(ngspice, tmp_path):
    deck = "wrong\nX1 a b nosuch\n.op\n.end\n"
    with pytest.raises(SpiceCrashError, match="exit code 1; its last output") as caught:
        runner.Ngspice(keep=tmp_path / "made" / "kept").run(deck)
    message = str(caught.value)
    assert re.search(r"\n  \| .*unknown subckt: x1 a b nosuch", message)
    kept = Path(re.search(r"stored as '(.*)'; ngspice printed last:\n", message)[1])
    assert kept.read_text() == deck
    assert kept.is_relative_to(tmp_path / "made" / "kept")
    assert {file.name for file in kept.parent.iterdir()} == {"deck.cir", "ngspice.log"}


def test_a_failed_run_is_kept_among_temporary_files(ngspice, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(RawFileError, match=r"no raw file; check that the netlist has an analysis"):
        ngspice.run("no analysis\nR1 a 0 1\nV1 a 0 1\n.end\n")
    assert [file.name for file in tmp_path.glob("*/*.cir")] == ["deck.cir"]


def test_a_run_that_removes_its_folder(stand_in):
    with pytest.raises(RawFileError, match="no raw file"):
        stand_in('rm -r "$PWD"').run("")


def test_a_long_log_is_told_by_its_end(stand_in):
    ngspice = stand_in("yes 'a long line' | head -c 3000000; seq 40; echo; exit 1")
    with pytest.raises(SpiceCrashError) as caught:
        ngspice.run("")
    assert str(caught.value).split("last:\n")[1].split() == [
        word for i in range(26, 41) for word in ("|", str(i))
    ]


def test_what_is_no_text_is_shown_nevertheless(stand_in):
    ngspice = stand_in(r"printf 'caf\351 1%%\r caf\351 2%%\n'; exit 1")
    with pytest.raises(SpiceCrashError, match=r"last:\n  \|  caf\ufffd 2%$"):
        ngspice.run("")


def test_a_folder_that_cannot_be_written_to(stand_in, tmp_path, monkeypatch):
    stand_in("cp $here/raw.raw out.raw", raw=ramp())
    taken = tmp_path / "taken"
    taken.write_text("")
    with pytest.raises(OutputError, match=r"taken'.*a file has the name of the folder"):
        Ngspice(keep=taken).run("")
    monkeypatch.setattr("tempfile.tempdir", str(taken))
    with pytest.raises(OutputError, match=r"'the folder of temporary files' \(Not a dir.*TMPDIR"):
        Ngspice().run("")


def test_a_disk_that_fills_up_costs_no_earlier_result(stand_in, monkeypatch):
    write = Path.write_bytes

    def full(path, content):
        if content == b"late":
            raise OSError(28, "No space left on device")
        return write(path, content)

    ngspice = stand_in("cp $here/raw.raw out.raw", raw=ramp())
    monkeypatch.setattr(Path, "write_bytes", full)
    first, second, third, last = ngspice.run_many(["a", "b", "late", "c"])
    assert {type(result) for result in (first, second, last)} == {Raw}
    assert isinstance(third, OutputError)
    assert re.search(
        r"the netlist cannot be written .*\(No space left on device\); free", str(third)
    )
    assert not [*ngspice.keep.iterdir()]


@on_linux
def test_folders_that_nobody_can_write_to(stand_in):
    """Not even root, whom permissions do not stop."""
    ngspice = stand_in("cp $here/raw.raw out.raw", raw=ramp())
    for folder in ("/proc/here", "/dev/null", "/dev/null/below", "a\0b"):
        with pytest.raises(OutputError, match=r"cannot be written.*; (use|free)"):
            Ngspice(keep=Path(folder), timeout=20.0).run("")
    assert ngspice.run("").time[-1] == 1.0


def test_a_disk_without_room_is_told_from_a_bad_answer(stand_in, monkeypatch):
    """Where nothing may be mounted: ngspice wrote half a file, and there is no room for more."""
    ngspice = stand_in("cp $here/cut.raw out.raw", cut=ramp()[:-1])
    usage = shutil.disk_usage(ngspice.keep.parent)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=4096))
    with pytest.raises(OutputError, match=r"\(the disk is full\); free space"):
        ngspice.run("")
    assert not [*ngspice.keep.iterdir()]
    monkeypatch.undo()


@on_linux
def test_what_is_kept_of_earlier_runs_stays(stand_in, tmp_path):
    """Whatever goes wrong next: evidence of other failures, and the user's own files."""
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "notes.txt").write_text("mine")
    scripts = ["exit 1", "kill -9 $$", ": > out.raw", "cp $here/cut.raw out.raw", 'rm -r "$PWD"']
    for count, script in enumerate(scripts):
        ngspice = stand_in(script, cut=ramp()[:-1])
        before = {file: file.read_bytes() for file in kept.rglob("*") if file.is_file()}
        with pytest.raises(SpiceError):
            ngspice.run(f"deck {count}")
        assert all(file.read_bytes() == content for file, content in before.items())
    decks = [file.read_text() for file in kept.rglob("deck.cir")]
    assert sorted(decks) == [f"deck {i}" for i in range(4)]  # the last one removed its own
    assert (kept / "notes.txt").read_text() == "mine"


@pytest.fixture
def small_disk(tmp_path):
    folder = tmp_path / "small"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "none", str(folder)]
    if not shutil.which("mount") or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("file systems may not be mounted here")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_ngspice_on_a_full_disk(ngspice, small_disk):
    """ngspice itself ends with exit code 0 then."""
    small = Ngspice(keep=small_disk, timeout=20.0)
    ends, fills = small.run_many([DIVIDER.format(1.0), ENDLESS])
    np.testing.assert_allclose(ends["x"], 0.5)
    assert isinstance(fills, OutputError)
    assert re.search(r"could not write .*\(the disk is full\); free space", str(fills))
    assert not [*small_disk.iterdir()]
