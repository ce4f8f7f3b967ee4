"""Runner of ngspice with one process per run: a deck returns voltages or an error.

A process cannot affect the next run, can be killed, and does not depend on the version. A run is
judged only by its exit code and its raw file, which must exist and be complete, finite and long
enough. The output of ngspice changes from version to version; its end is shown to the user
unchanged.
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
from ann_dc.errors import OutputError, SpiceError, SpiceInputError, such_as
from ann_dc.progress import Progress, silent
from ann_dc.resources import cores
from ann_dc.timing import phase
from ann_dc.validation import checked

FILE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+-]{0,99}")
NO_FILES: Mapping[str, str] = MappingProxyType({})

AHEAD = 8
"""Number of decks by which a worker may be ahead of a slow one."""

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
    def run(
        self, deck: str, *, end_time: float | None = None, files: Mapping[str, str] = NO_FILES
    ) -> Raw:
        """Run a deck of one analysis.

        The deck is the complete netlist; its first line is the title. The transient must reach
        ``end_time`` in seconds, if given. ``files`` maps the names of included files to their text.
        Raises `NgspiceMissing` if ngspice is not found, and a subclass of `SpiceError` if the run
        fails or takes too long. Raises `OutputError` if the deck cannot be written or the disk is
        full.
        """
        return _only(self.plots(deck, end_time=end_time, files=files))

    def plots(
        self, deck: str, *, end_time: float | None = None, files: Mapping[str, str] = NO_FILES
    ) -> list[Raw]:
        """Run a deck of several analyses and return one `Raw` for each.

        ``.noise`` counts as two analyses. Everything else is as for `run`.
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
        """Run decks in parallel and return their results in the order of the decks.

        A failing deck gives its error without affecting the others. ``end_time`` and ``files`` are
        those of `run` for all decks. Raises `NgspiceMissing` if ngspice is not found.
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
        """Yield the results of `run_many` one by one, for more decks than fit into memory.

        Results are in the order of the decks. Nothing starts before the first result is requested,
        decks are consumed on demand, and running processes are terminated when the iterator is
        closed. Raises `SpiceInputError` if ``decks`` is a single text, and `NgspiceMissing` if
        ngspice is not found.
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
    """Return names and bytes of the files of a run, all inside its folder."""
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
    """Yield a pool of threads that wait for processes, and release all on any error."""
    pool = ThreadPoolExecutor(workers, thread_name_prefix="ngspice")
    try:
        yield pool
    finally:
        processes.end()
        pool.shutdown(cancel_futures=True)


def _in_order(futures: Iterable[Future[Result]], ahead: int) -> Iterator[Result]:
    """Yield results in the order of their futures, with a limited number ahead."""
    waiting: deque[Future[Result]] = deque()
    for future in futures:
        waiting.append(future)
        if len(waiting) > ahead:
            yield waiting.popleft().result()
    while waiting:
        yield waiting.popleft().result()
