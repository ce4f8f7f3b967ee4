"""Runner of ngspice with one process per run: a deck returns voltages or an error.

A process cannot affect the next run, can be killed, and does not depend on the version. A run is
judged only by its exit code and its raw file, which must exist and be complete, finite and long
enough. The end of the output of ngspice, which changes between versions, is shown to the user.
"""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ann_dc.backends.spice.ngspice.folder import DECK, RAW, run_folder, writing
from ann_dc.backends.spice.ngspice.process import Processes, find_ngspice
from ann_dc.backends.spice.ngspice.raw import MAX_BYTES, REMEDY, Raw, read_raw
from ann_dc.errors import (
    EndedEarlyError,
    FileFormatError,
    NotFiniteError,
    OutputError,
    RawFileError,
    SpiceCrashError,
    SpiceError,
    SpiceInputError,
    SpiceTimeoutError,
    such_as,
)
from ann_dc.files import read_whole
from ann_dc.progress import Progress, silent
from ann_dc.resources import cores
from ann_dc.timing import phase
from ann_dc.validation import checked

END_SHARE = 1e-6
"""Fraction of its end time by which a transient may miss it."""

UNSTABLE = (
    "often the circuit is unstable, or a step became too small: check the eigenvalues first, "
    "and keep voltages near 1 V and times below 1 ms"
)


Result = Raw | SpiceError | OutputError
"""Result of one deck of many."""


@checked
@such_as("ann_dc.backends.spice.ngspice.Ngspice()")
@dataclass(frozen=True, kw_only=True, eq=False)
class Ngspice:
    r"""Runner of decks, each in a separate process and folder.

    Attributes
    ----------
    timeout : float
        Time limit of a run in seconds.
    keep : Path or None
        Folder for decks and logs of failed runs; None for the folder of temporary files. Files of
        successful runs are removed.
    progress : Progress
        Receiver of a line after every deck of many (``3 of 20 decks``).
    workers : int or None
        Number of simultaneous processes; None for one per processor.

    Raises
    ------
    SpiceInputError
        If ``timeout`` or ``workers`` is not positive.

    Examples
    --------
    >>> deck = "divider\nV1 in 0 1\nR1 in x 1k\nR2 x 0 1k\n.op\n.end\n"
    >>> Ngspice().run(deck)["x"]  # doctest: +SKIP
    array([0.5])
    """

    timeout: float = 120.0
    keep: Path | None = None
    progress: Progress = silent
    workers: int | None = None

    def __post_init__(self) -> None:
        if not self.timeout > 0.0:
            raise SpiceInputError(f"timeout: expected seconds above 0, got {self.timeout!r}")
        if self.workers is not None and self.workers < 1:
            raise SpiceInputError(f"workers: expected 1 or more processes, got {self.workers!r}")

    @checked
    @phase("ngspice")
    def run(self, deck: str, *, end_time: float | None = None) -> Raw:
        """Run a deck of one analysis.

        The deck is the complete netlist; its first line is the title. The transient must reach
        ``end_time`` in seconds, if given. Raises `NgspiceMissing` if ngspice is not found, and a
        subclass of `SpiceError` if the run fails or takes too long. Raises `OutputError` if the
        deck cannot be written or the disk is full.
        """
        return _only(self.plots(deck, end_time=end_time))

    def plots(self, deck: str, *, end_time: float | None = None) -> list[Raw]:
        """Run a deck of several analyses and return one `Raw` for each.

        ``.noise`` counts as two analyses.
        """
        with Processes(find_ngspice()) as processes:
            return self._plots(processes, deck, end_time)

    @phase("ngspice")
    def run_many(self, decks: Iterable[str], *, end_time: float | None = None) -> list[Result]:
        """Run decks in parallel and return their results in the order of the decks.

        A failing deck gives its error without affecting the others. Raises `NgspiceMissing` if
        ngspice is not found, and `SpiceInputError` if ``decks`` is a single text.
        """
        if isinstance(decks, str):
            raise SpiceInputError(
                "decks: expected several netlists, got one text; call `run` for one netlist"
            )
        texts, results = [*decks], []
        with Processes(find_ngspice()) as processes, self._pool(processes) as pool:
            for result in pool.map(lambda deck: self._result(processes, deck, end_time), texts):
                results.append(result)
                self.progress(f"{len(results)} of {len(texts)} decks")
        return results

    @contextlib.contextmanager
    def _pool(self, processes: Processes) -> Iterator[ThreadPoolExecutor]:
        """Yield a pool of threads that wait for processes, and release all on any error."""
        pool = ThreadPoolExecutor(self.workers or cores(), thread_name_prefix="ngspice")
        try:
            yield pool
        finally:
            processes.end()
            pool.shutdown(cancel_futures=True)

    def _result(self, processes: Processes, deck: str, end_time: float | None) -> Result:
        try:
            return _only(self._plots(processes, deck, end_time))
        except (SpiceError, OutputError) as error:
            return error

    def _plots(self, processes: Processes, deck: str, end_time: float | None) -> list[Raw]:
        try:
            content = deck.encode()
        except UnicodeEncodeError as error:
            raise SpiceInputError(f"the netlist is not text: {error}") from error
        with run_folder(self.keep) as folder:
            with writing(folder):
                (folder / DECK).write_bytes(content)
            plots = _checked_outcome(folder, processes.run(folder, self.timeout), self.timeout)
            _check_end(plots, end_time)
            _check_finite(plots)
        return plots


def _only(plots: list[Raw]) -> Raw:
    if len(plots) > 1:
        names = ", ".join(raw.plot for raw in plots)
        raise SpiceInputError(
            f"the deck has {len(plots)} analyses ({names}) expected one; keep one, or call `plots`"
        )
    return plots[0]


def _checked_outcome(folder: Path, code: int | None, timeout: float) -> list[Raw]:
    """Return the plots of a run that ended by itself with exit code 0.

    The code is negative for a signal, and None after the time limit of ``timeout`` seconds. Raises
    `SpiceTimeoutError` in the latter case, `SpiceCrashError` for any code but 0, `EndedEarlyError`
    if an analysis was aborted, and `RawFileError` if the answer is missing or not readable.
    """
    if code is None:
        raise SpiceTimeoutError(
            f"ngspice was terminated after {timeout:g} s; {UNSTABLE}; or use a shorter "
            "transient, or a longer `timeout`"
        )
    if code < 0:
        raise SpiceCrashError(_killed(-code))
    try:
        plots = _answer(folder / RAW)
    except EndedEarlyError as error:
        raise EndedEarlyError(f"{error}; {UNSTABLE}") from None
    except RawFileError:
        if code == 0:
            raise
        plots = []
    if code > 0:
        raise SpiceCrashError(
            f"ngspice ended with exit code {code}; its last output often names the faulty line "
            "of the netlist or the analysis"
        )
    return plots


def _answer(file: Path) -> list[Raw]:
    if not file.exists():
        raise RawFileError(
            "ngspice wrote no raw file; check that the netlist has an analysis (.op, .tran)"
        )
    try:
        return read_raw(read_whole(file, MAX_BYTES, REMEDY))
    except FileFormatError as error:
        raise RawFileError(f"the output of ngspice cannot be read: {error}") from None


def _killed(number: int) -> str:
    if number == signal.SIGXFSZ:
        return f"ngspice wrote more than {MAX_BYTES} bytes; {REMEDY}"
    names = {known.value: f" ({known.name})" for known in signal.Signals}
    return (
        f"ngspice was killed by signal {number}{names.get(number, '')}; if memory was "
        "exhausted, use fewer `workers` or save fewer nodes; if it crashed, run the netlist "
        "separately"
    )


def _check_end(plots: list[Raw], end_time: float | None) -> None:
    """Raise `EndedEarlyError` if a transient did not reach its end (s), or is missing."""
    if end_time is None:
        return
    transients = [raw for raw in plots if raw.names[0] == "time"]
    if not transients:
        raise EndedEarlyError(f"expected a transient until {end_time:g} s, got none; add a .tran")
    for raw in transients:
        if not raw.time[-1] >= end_time * (1.0 - END_SHARE):
            raise EndedEarlyError(
                f"the transient ended at {raw.time[-1]:g} s, expected {end_time:g} s; {UNSTABLE}"
            )


def _check_finite(plots: list[Raw]) -> None:
    """Raise `NotFiniteError` if a value is infinite or not a number."""
    for raw in plots:
        wrong = ~np.isfinite(raw.values)
        if wrong.any():
            point, column = (int(i) for i in np.argwhere(wrong)[0])
            raise NotFiniteError(
                f"{raw.names[column]} is {raw.values[point, column]} at point {point} of "
                f"{raw.plot!r} ({raw.names[0]} {raw.values[point, 0]:g}); keep divisors and the "
                "arguments of functions inside their domains"
            )
