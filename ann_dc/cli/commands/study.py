"""``ann-dc study``: run or continuation of a study file, or repetition of a case.

``ann-dc report``: result of a study as one HTML page.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ann_dc.cli.arguments.options import QuietOption, argument, option, timed, unfolded
from ann_dc.cli.terminal import finish, notes, progress_line
from ann_dc.errors import StudyError
from ann_dc.progress import Progress
from ann_dc.report.json_file import make_room

FINISHED, SOME_FAILED, INTERRUPTED = 0, 1, 130
"""Exit codes."""


@dataclass(frozen=True, kw_only=True)
class Running:
    """Options of execution and storage."""

    out: Path | None = option(
        "Where rows are kept as they finish. A study there goes on.", metavar="DIR"
    )
    workers: int | None = option(
        "Processes; 0 for none but this.", min=0, show_default="one a core"
    )
    scheduler: str | None = option(
        "A Dask scheduler whose workers do it instead.", metavar="ADDRESS"
    )
    retry: bool = option("Do points that failed again.", "--retry", default=False)


@dataclass(frozen=True, kw_only=True)
class Exports:
    """Export files of the table."""

    csv: Path | None = option("Write the table as CSV.", "--csv", metavar="FILE")
    parquet: Path | None = option("Write the table as Parquet.", "--parquet", metavar="FILE")

    def check(self, *, is_whole: bool) -> None:
        """Check before the run that a whole study is run if a table is requested.

        Raises `StudyError` otherwise.
        """
        if not is_whole and (self.csv or self.parquet):
            raise StudyError(
                "--csv, --parquet: write a whole study; leave out --point and --settings"
            )

    def write(self, folder: Path) -> list[Path]:
        """Write the requested files from the store in a folder, and return their paths."""
        from ann_dc.study.store import Store

        with Store.open(folder) as store:
            if self.csv is not None:
                store.to_csv(self.csv)
            if self.parquet is not None:
                store.to_parquet(self.parquet)
        return [file for file in (self.csv, self.parquet) if file is not None]


@unfolded
def study(
    *,
    source: str = argument(
        "A study file (.toml); or, with --point, the folder of a study; or, with "
        "--settings, a plant or a problem file.",
        metavar="STUDY",
    ),
    running: Running,
    point: int | None = option("Do one point, and print its row.", min=0, metavar="NUMBER"),
    settings: bool = option(
        "List what can be varied, and what is measured.", "--settings", default=False
    ),
    exports: Exports,
    quiet: QuietOption = False,
) -> None:
    """Vary the settings of a study file, measure every case and store the records.

    Records are stored in DIR as they finish. Ctrl-C, a crash or a power cut
    lose none of them: the same command continues the study. Failed cases have
    records with the reason; --retry repeats them.

    On a cluster, start a scheduler and workers, then pass the address:

      dask scheduler                       prints tcp://HOST:8786
      dask worker tcp://HOST:8786 --nworkers 8 --nthreads 1

    Usage examples:

      ann-dc study demos/yield.toml --out out/yield --workers 2
      ann-dc report out/yield
      ann-dc study out/yield --point 17
      ann-dc study car --settings

    Exit code: 0 every case has a result, 1 some have none, 2 bad input,
    130 interrupted.
    """
    exports.check(is_whole=not settings and point is None)
    written, code = [], FINISHED
    with notes(quiet), progress_line(quiet) as progress:
        if settings:
            shown = _settable(source)
        elif point is not None:
            shown = _one(source, point)
        else:
            shown, written, code = _run(source, running, exports, progress)
    finish(shown, written, quiet=quiet, code=code)


def _run(
    source: str, running: Running, exports: Exports, progress: Progress
) -> tuple[list[Any], list[Path], int]:
    """Return the summary of the study, the files written, and the exit code.

    Raises `StudyError` if no folder is given, or the file does not contain a study.
    """
    if running.out is None:
        raise StudyError("--out: is missing; name the folder where rows are to be kept")
    progress("study")
    from ann_dc.report.study_summary import summary
    from ann_dc.study.study_file import load_study

    declared = load_study(source)
    with _executor(running.scheduler) as executor:
        table = declared.run(
            running.out,
            workers=running.workers,
            executor=executor,
            retry=running.retry,
            progress=progress,
        )
    shown = [*summary(declared, table), f"a page of it: ann-dc report {running.out}"]
    if table.stopped:
        shown.append(f"{table.stopped}; the same command goes on from here")
        return shown, [], INTERRUPTED
    return shown, exports.write(running.out), FINISHED if table.is_complete else SOME_FAILED


def _settable(source: str) -> list[Any]:
    """Return tables of the available settings and metrics."""
    from ann_dc.cli.arguments.problem import problem_of
    from ann_dc.problem import plants
    from ann_dc.report.study_summary import settings_table
    from ann_dc.study.metrics import METRICS
    from ann_dc.study.settings import subject_of

    subject = source if source in plants.names() else problem_of(source, (), None, None, None)
    return settings_table(subject_of(subject), METRICS)


def _one(source: str, point: int) -> list[Any]:
    """Return the record of one case of a study file, or of the study in a folder."""
    from ann_dc.report.tables import named_rows
    from ann_dc.study.store import Store
    from ann_dc.study.study_file import load_study, study_from

    if Path(source).is_dir():
        with Store.open(source) as store:
            declared = study_from(store.identity)
    else:
        declared = load_study(source)
    return [named_rows(declared.row(point))]


@contextmanager
def _executor(scheduler: str | None) -> Iterator[Any]:
    """Yield the executor of a Dask cluster; None for processes of this machine.

    Raises `StudyError` if Dask is not installed or the scheduler does not respond.
    """
    if scheduler is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise StudyError(
            "--scheduler: needs Dask, which is not installed: pip install 'ann-dc[cluster]'"
        ) from error
    try:
        client = Client(scheduler, timeout="10s")
    except (OSError, ValueError) as error:
        raise StudyError(f"--scheduler: no scheduler answers at {scheduler}: {error}") from error
    with client, client.get_executor() as executor:
        yield executor


NAME = "report.html"
"""Default file name in the folder of the study, without --out."""


@timed
def report(
    *,
    folder: Path = argument("Folder of a study: what ann-dc study --out made.", metavar="DIR"),
    out: Path | None = option(f"The page; {NAME} in DIR without it.", "--out", metavar="FILE"),
    quiet: QuietOption = False,
) -> None:
    """Write the result of a study as one HTML page to read, search and print.

    The page is self-contained and needs no network connection. It shows the
    declaration of the study, outcomes with causes, the yield against the
    specification with its interval, and exponents. Interactive figures
    support hovering and zooming. The slowest and worst cases are listed with
    the command that repeats each. A table of all records can be sorted by a
    click and filtered by text and numbers. For a running study the page shows
    the records so far. If the study keeps curves, the residuals over time are
    also written beside the page, as PDF and SVG.

    Usage examples:

      ann-dc report out/study
      ann-dc report out/study --out study.html

    Exit code: 0 written, 2 study not found, a missing package, or unwritable
    output, 130 interrupted.
    """
    with progress_line(quiet) as progress:
        from ann_dc.report.study_page import write_residuals, write_study_page
        from ann_dc.study.store import Store

        file = out or folder / NAME
        with Store.open(folder) as store:
            make_room(file)
            write_study_page(store, file, progress=progress)
            figures = write_residuals(store, file)
            count = len(store)
    finish([f"{count:,} points"], [file, *figures], quiet=quiet)
