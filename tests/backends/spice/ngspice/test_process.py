"""Processes of ngspice: found, started, and ended with their children, whatever happens."""

import os
import shutil
import signal
import subprocess
import sys
import threading
import time

import pytest
from ngspice_runs import ENDLESS, on_linux, wait_for, working_in

from ann_dc.backends.spice.ngspice import process as processes, runner as verdict
from ann_dc.backends.spice.ngspice.process import find_ngspice
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.errors import (
    NgspiceMissing,
    SpiceCrashError,
    SpiceTimeoutError,
)


def test_no_ngspice(monkeypatch, tmp_path):
    monkeypatch.delenv(processes.VARIABLE, raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    for call in (find_ngspice, lambda: Ngspice().run(""), lambda: Ngspice().run_many([])):
        with pytest.raises(NgspiceMissing, match=r"`apt-get install ngspice`.*`brew install.*page"):
            call()
    (tmp_path / "plain").write_text("")
    for name in ("nowhere", "plain"):
        monkeypatch.setenv(processes.VARIABLE, str(tmp_path / name))
        with pytest.raises(NgspiceMissing, match=rf"ANN_DC_NGSPICE is .*{name}.*or unset it"):
            find_ngspice()
    assert issubclass(NgspiceMissing, RuntimeError)


def test_a_program_that_cannot_be_started(stand_in, tmp_path):
    ngspice = stand_in("")
    (tmp_path / "stand-in/ngspice").write_bytes(b"\x7fELF and then nothing")
    with pytest.raises(SpiceCrashError, match=r"cannot be started \(.+\); set ANN"):
        ngspice.run("")


@on_linux
def test_a_timeout_ends_the_process(ngspice, tmp_path):
    begin = time.monotonic()
    with pytest.raises(
        SpiceTimeoutError, match=r"terminated after 0\.5 s; often.*longer `timeout`"
    ):
        Ngspice(timeout=0.5, keep=tmp_path).run(ENDLESS)
    assert time.monotonic() - begin < 60.0  # it never ends by itself
    assert not working_in(tmp_path)
    assert not [*tmp_path.glob("*/out.raw")]
    assert issubclass(SpiceTimeoutError, TimeoutError)


@on_linux
def test_a_timeout_ends_the_children(stand_in, tmp_path):
    ngspice = stand_in("sleep 600 & sleep 600")
    with pytest.raises(SpiceTimeoutError):
        Ngspice(timeout=0.5, keep=ngspice.keep).run("")
    wait_for(lambda: not working_in(tmp_path))


@on_linux
@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("many", [False, True])
def test_an_interrupt_ends_the_processes(stand_in, tmp_path, many):
    ngspice = stand_in("sleep 600 & sleep 600")

    def interrupt():
        wait_for(lambda: len(working_in(ngspice.keep)) >= (6 if many else 3))
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        ngspice.run_many(["deck"] * 5) if many else ngspice.run("deck")
    thread.join()
    wait_for(lambda: not working_in(tmp_path))
    assert not [*ngspice.keep.iterdir()]


@on_linux
@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_while_a_process_starts_ends_it(stand_in, tmp_path, monkeypatch):
    ngspice = stand_in("sleep 600 & sleep 600")

    class Interrupted(subprocess.Popen):
        def __init__(self, *given, **named):
            super().__init__(*given, **named)
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.01)

    monkeypatch.setattr(subprocess, "Popen", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        ngspice.run("deck")
    wait_for(lambda: not working_in(tmp_path))
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@on_linux
def test_ngspice_killed_in_the_middle_of_a_run(ngspice, tmp_path):
    """By somebody else, say for want of memory, with half of its answer written."""
    answers = lambda: [*tmp_path.glob("*/out.raw")]  # noqa: E731

    def kill():
        wait_for(lambda: working_in(tmp_path) and answers() and answers()[0].stat().st_size > 1e5)
        for process in working_in(tmp_path):
            os.kill(int(process), signal.SIGKILL)

    thread = threading.Thread(target=kill)
    thread.start()
    with pytest.raises(SpiceCrashError, match=r"killed by signal 9 \(SIGKILL\)"):
        Ngspice(keep=tmp_path, timeout=20.0).run(ENDLESS)
    thread.join()
    assert not answers()
    (deck,) = tmp_path.glob("*/deck.cir")
    assert deck.read_text() == ENDLESS


@on_linux
@pytest.mark.skipif(not shutil.which("setpriv"), reason="needs util-linux")
def test_ngspice_ends_with_a_python_that_is_killed(ngspice, tmp_path):
    """A process that gets no chance to clean up: its circuit must not run on for hours."""
    script = (
        "from pathlib import Path; from ann_dc.backends.spice.ngspice.runner import Ngspice; "
        "print(flush=True); "
        f"Ngspice(keep=Path({str(tmp_path)!r}), timeout=60).run({ENDLESS!r})"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE) as python:
        assert python.stdout is not None
        assert python.stdout.readline() == b"\n"  # imported
        wait_for(lambda: [*tmp_path.glob("*/out.raw")])
        assert working_in(tmp_path)
        python.kill()
    wait_for(lambda: not working_in(tmp_path))


@on_linux
def test_a_run_that_fills_the_disk_is_ended(ngspice, tmp_path, monkeypatch):
    for module in (processes, verdict):
        monkeypatch.setattr(module, "MAX_BYTES", 200_000)
    with pytest.raises(SpiceCrashError, match=r"wrote more than 200000 bytes; save fewer nodes"):
        Ngspice(keep=tmp_path, timeout=20.0).run(ENDLESS)
    assert not working_in(tmp_path)
