"""ngspice, one process a run: a deck goes in, a table of voltages comes out, or a reason.

A process cannot leak into the next run, can be killed, and stays the same over versions. A run is
judged by its exit code and its raw file only (there, whole, finite, long enough), since what
ngspice prints changes from version to version; the end of that is shown to the user as it is.
"""

from __future__ import annotations

import contextlib
import re
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sized
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from ann_dc.backends.spice.ngspice.folder import DECK, LOG, RAW, run_folder, writing
from ann_dc.backends.spice.ngspice.outcome import check_end, check_finite, checked_outcome
from ann_dc.backends.spice.ngspice.process import Processes, find_ngspice
from ann_dc.backends.spice.ngspice.raw import Raw
from ann_dc.errors import OutputError, SpiceError, SpiceInputError
from ann_dc.progress import Progress, silent
from ann_dc.resources import cores
from ann_dc.timing import phase
from ann_dc.validation.checked import checked
from ann_dc.validation.values import such_as

FILE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+-]{0,99}")
NO_FILES: Mapping[str, str] = MappingProxyType({})

AHEAD = 8
"""Decks a worker may run ahead of one that is slow."""

Result = Raw | SpiceError | OutputError
"""What comes back for one deck of many."""


@checked
@such_as("ann_dc.backends.spice.ngspice.Ngspice()")
@dataclass(frozen=True, kw_only=True, eq=False)
class Ngspice:
    """Runs decks, each in a process and a folder of its own.

    Attributes
    ----------
    timeout : float
        Seconds a run may take.
    keep : Path or None
        Folder in which the decks and logs of failed runs are kept; None for the folder of
        temporary files. What a run that succeeds leaves is removed.
    progress : Progress
        A line after every deck of many (``3 of 20 decks``).
    workers : int or None
        Processes at a time; None for one a processor.

    Raises
    ------
    SpiceInputError
        If ``timeout`` or ``workers`` is not positive.

    Examples
    --------
    >>> deck = "divider\\nV1 in 0 1\\nR1 in x 1k\\nR2 x 0 1k\\n.op\\n.end\\n"
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
    def run(
        self, deck: str, *, end_time: float | None = None, files: Mapping[str, str] = NO_FILES
    ) -> Raw:
        """Run a deck of one analysis.

        Parameters
        ----------
        deck : str
            The whole netlist; its first line is the title.
        end_time : float or None
            Seconds that the transient has to reach.
        files : mapping of str to str
            Text of the files that the deck includes, by their names.

        Returns
        -------
        Raw

        Raises
        ------
        NgspiceMissing
            If there is no ngspice.
        SpiceError
            If the run fails, or takes too long; its kind says how.
        OutputError
            If the deck cannot be written, or the disk is full.
        """
        return _only(self.plots(deck, end_time=end_time, files=files))

    def plots(
        self, deck: str, *, end_time: float | None = None, files: Mapping[str, str] = NO_FILES
    ) -> list[Raw]:
        """Run a deck of several analyses (``.noise`` counts as two); otherwise as `run`.

        Returns
        -------
        list of Raw
            One an analysis.
        """
        with Processes(find_ngspice()) as processes:
            return self._plots(processes, deck, end_time, files)

    @phase("ngspice")
    def run_many(
        self,
        decks: Iterable[str],
        *,
        end_time: float | None = None,
        files: Mapping[str, str] = NO_FILES,
    ) -> list[Result]:
        """Run decks side by side; a deck that fails gives its error, and the others their answer.

        Parameters
        ----------
        decks : iterable of str
        end_time, files
            As for `run`, the same for all.

        Returns
        -------
        list of Raw, SpiceError or OutputError
            In the order of the decks.

        Raises
        ------
        NgspiceMissing
            If there is no ngspice.
        """
        known = decks if isinstance(decks, Sized) else [*decks]
        return [*self.stream(known, end_time=end_time, files=files)]

    def stream(
        self,
        decks: Iterable[str],
        *,
        end_time: float | None = None,
        files: Mapping[str, str] = NO_FILES,
    ) -> Iterator[Result]:
        """As `run_many`, one result after the other, for more than fit into memory.

        Nothing starts before the first result is asked for, decks are taken as they are needed,
        and what runs is ended when the iterator is closed.

        Yields
        ------
        Raw, SpiceError or OutputError
            In the order of the decks.

        Raises
        ------
        SpiceInputError
            If ``decks`` is one text.
        NgspiceMissing
            If there is no ngspice.
        """
        if isinstance(decks, str):
            raise SpiceInputError("decks: expected several, got one text; call `run` for one deck")
        total = f" of {len(decks)}" if isinstance(decks, Sized) else ""
        workers = self.workers or cores()
        with Processes(find_ngspice()) as processes, _pool(workers, processes) as pool:

            def submit(deck: str) -> Future[Result]:
                return pool.submit(self._result, processes, deck, end_time, files)

            results = _in_order(map(submit, decks), ahead=AHEAD * workers)
            for count, result in enumerate(results, start=1):
                self.progress(f"{count}{total} decks")
                yield result

    def _result(self, processes: Processes, deck, end_time, files) -> Result:
        try:
            return _only(self._plots(processes, deck, end_time, files))
        except (SpiceError, OutputError) as error:
            return error

    def _plots(
        self, processes: Processes, deck: str, end_time: float | None, files: Mapping[str, str]
    ) -> list[Raw]:
        contents = _contents(deck, files)
        with run_folder(self.keep) as folder:
            with writing(folder):
                for name, content in contents.items():
                    (folder / name).write_bytes(content)
            plots = checked_outcome(folder, processes.run(folder, self.timeout), self.timeout)
            check_end(plots, end_time)
            check_finite(plots)
        return plots


def _only(plots: list[Raw]) -> Raw:
    if len(plots) > 1:
        names = ", ".join(raw.plot for raw in plots)
        raise SpiceInputError(
            f"the deck has {len(plots)} analyses ({names}) where one is expected; "
            "leave one, or call `plots`"
        )
    return plots[0]


def _contents(deck: str, files: Mapping[str, str]) -> dict[str, bytes]:
    """Names and bytes of the files of a run, none of which can lie elsewhere."""
    for name in files:
        if not FILE_NAME.fullmatch(name) or name.lower() in (DECK, RAW, LOG):
            raise SpiceInputError(
                f"files: {name!r} cannot lie beside a deck; give a plain name of letters, digits, "
                f"'_', '.', '+' and '-' that is not {DECK}, {RAW} or {LOG}"
            )
    try:
        return {name: text.encode() for name, text in {**files, DECK: deck}.items()}
    except UnicodeEncodeError as error:
        raise SpiceInputError(f"the deck or a file beside it is no text: {error}") from error


@contextlib.contextmanager
def _pool(workers: int, processes: Processes) -> Iterator[ThreadPoolExecutor]:
    """Threads that wait for processes; none is left waiting when something else goes wrong."""
    pool = ThreadPoolExecutor(workers, thread_name_prefix="ngspice")
    try:
        yield pool
    finally:
        processes.end()
        pool.shutdown(cancel_futures=True)


def _in_order(futures: Iterable[Future[Result]], ahead: int) -> Iterator[Result]:
    """Results in the order of their futures, of which only so many exist ahead."""
    waiting: deque[Future[Result]] = deque()
    for future in futures:
        waiting.append(future)
        if len(waiting) > ahead:
            yield waiting.popleft().result()
    while waiting:
        yield waiting.popleft().result()
