"""One writer at a time."""

import os
import signal
import subprocess
import sys

import pytest

from ann_dc.errors import OutputError, StoreError
from ann_dc.file_locks import Lock

HOLD = "import sys, time; from pathlib import Path; from ann_dc.file_locks import Lock; " \
       "lock = Lock(Path(sys.argv[1])); print('held', flush=True); time.sleep(60)"  # fmt: skip


def test_a_second_one_is_refused_with_the_name_of_the_first(tmp_path):
    file = tmp_path / "lock"
    first = Lock(file)
    with pytest.raises(OutputError, match=f"process {os.getpid()} on .* at work on this folder"):
        Lock(file)
    with pytest.raises(StoreError, match="at work on this study"):
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
