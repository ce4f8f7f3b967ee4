"""Processes of ngspice: search, start in a separate session, and termination."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from ann_dc.backends.spice.ngspice.folder import DECK, LOG, RAW, writing
from ann_dc.backends.spice.ngspice.raw import MAX_BYTES
from ann_dc.errors import NgspiceMissing, SpiceCrashError

VARIABLE = "ANN_DC_NGSPICE"
"""Environment variable with the path of the ngspice executable."""

NOT_STARTED = (126, 127)
"""Exit codes of setpriv if it could not start a program."""


def find_ngspice() -> Path:
    """Return the ngspice executable from ``ANN_DC_NGSPICE``, or from the path.

    Raises `NgspiceMissing` if there is none; the message contains installation instructions.
    """
    named = os.environ.get(VARIABLE)
    found = shutil.which(named or "ngspice")
    if found:
        return Path(found).absolute()
    if named:
        raise NgspiceMissing(
            f"{VARIABLE} is {named!r}, which is not an executable program; set it to ngspice, "
            "or unset it"
        )
    raise NgspiceMissing(
        "ngspice is not installed; `apt-get install ngspice` on Debian and Ubuntu, `brew "
        "install ngspice` on macOS, or the download page of ngspice.sourceforge.io; or set "
        f"{VARIABLE} to its path"
    )


class Processes:
    """Processes of one ngspice executable, terminated together."""

    def __init__(self, program: Path) -> None:
        self._program, self._tied = str(program), _tied_to_us()
        # -n: no user's .spiceinit
        self._command = [*self._tied, self._program, "-n", "-b", "-r", RAW, DECK]
        self._lock = threading.Lock()
        self._live: set[subprocess.Popen[bytes]] = set()
        self._over = False

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def end(self) -> None:
        """Terminate the running processes and start no more."""
        with self._lock:
            self._over = True
            for process in self._live:
                _kill(process)

    def run(self, folder: Path, timeout: float) -> int | None:
        """Run the deck of a folder and return the exit code, negative for a signal.

        Returns None after ``timeout`` seconds. The raw file and the log are written to the folder.
        Raises `CancelledError` if `end` was called before or during the run, `SpiceCrashError` if
        the program cannot be started, and `OutputError` if the log cannot be written.
        """
        process = self._start(folder)
        try:
            code = process.wait(timeout)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            _kill(process)
            with self._lock:
                self._live.discard(process)
        if self._over:
            raise CancelledError
        if code in NOT_STARTED and self._tied:
            raise self._no_start("it is not an executable program on this machine")
        return code

    def _no_start(self, why: object) -> SpiceCrashError:
        return SpiceCrashError(
            f"{self._program!r} cannot be started ({why}); set {VARIABLE} to a working ngspice, "
            "or use fewer `workers`"
        )

    def _start(self, folder: Path) -> subprocess.Popen[bytes]:
        with self._lock, writing(folder), (folder / LOG).open("wb") as log, _interrupts_held():
            if self._over:
                raise CancelledError
            try:
                process = subprocess.Popen(
                    self._command,
                    cwd=folder,
                    env=_environment(),
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    start_new_session=True,  # so that it is killed with its children
                )
            except OSError as error:
                raise self._no_start(error.strerror or error) from error
            self._live.add(process)
        _limit_files(process)
        return process


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Delay an interrupt until a started process is registered and can be terminated."""
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    held: list[tuple[int, FrameType | None]] = []
    signal.signal(signal.SIGINT, lambda number, frame: held.append((number, frame)))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if held:
            before(*held[0])


def _tied_to_us() -> list[str]:
    """Return the command prefix for a process that dies with its parent (util-linux).

    A killed Python cannot terminate its children, and a ringing circuit runs for hours.
    """
    setpriv = shutil.which("setpriv") if sys.platform == "linux" else None
    return [setpriv, "--pdeathsig", "KILL", "--"] if setpriv else []


def _environment() -> dict[str, str]:
    """Return the user's environment without variables that change ngspice's files."""
    changed = ("SPICE_ASCIIRAWFILE", "SPICE_SCRIPTS")
    return {key: value for key, value in os.environ.items() if key not in changed}


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Terminate a running process with its children."""
    if process.poll() is None:
        with contextlib.suppress(ProcessLookupError):
            if hasattr(os, "killpg"):
                os.killpg(process.pid, signal.SIGKILL)
            else:  # Windows has no groups of processes
                process.kill()
        process.wait()


def _limit_files(process: subprocess.Popen[bytes]) -> None:
    """Limit the file size, since a circuit that rings forever must not fill the disk."""
    if sys.platform == "linux":
        import resource

        with contextlib.suppress(OSError):  # it has ended
            resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (MAX_BYTES, MAX_BYTES))
