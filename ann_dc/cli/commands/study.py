"""``ann-dc study``: run or continuation of a study file, or repetition of a case.

``ann-dc report``: result of a study as one HTML page.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ann_dc.cli.arguments.options import (
    JsonOption,
    QuietOption,
    argument,
    option,
    timed,
    unfolded,
)
from ann_dc.cli.terminal import finish, notes, progress_line
from ann_dc.errors import StudyError
from ann_dc.progress import Progress
from ann_dc.report.json_file import make_room, write_results

FINISHED, SOME_FAILED, INTERRUPTED = 0, 1, 130
"""Exit codes."""


@dataclass(frozen=True, kw_only=True)
class Running:
    """Options of execution and storage."""

    output: Path | None = option(
        "Folder of the records; an existing study is continued.", metavar="DIR"
    )
    workers: int | None = option(
        "Number of worker processes; 0 for none.", min=0, show_default="one per core"
    )
    scheduler: str | None = option(
        "Address of a Dask scheduler whose workers run the cases.", metavar="ADDRESS"
    )
    retry: bool = option("Repeat failed cases.", "--retry", default=False)


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
                "--csv, --parquet: apply to a whole study; omit --point and --list-settings"
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
        "Study file (.toml); with --point also the folder of a study; with --list-settings a plant "
        "or problem file.",
        metavar="STUDY",
    ),
    running: Running,
    point: int | None = option("Run one case and print its record.", min=0, metavar="NUMBER"),
    list_settings: bool = option(
        "List the settings that can be varied, and the metrics.", "--list-settings", default=False
    ),
    exports: Exports,
    json_file: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Vary the settings of a study file, measure every case and store the records.

    Records are stored in DIR while the study runs. Cases that differ in numbers
    only run in batches of about 3 s, others one by one; an interruption loses
    the batches that are running. The same command continues the study. Failed
    cases have records with the reason; --retry repeats them.

    On a cluster, start a scheduler and workers, then pass the address:

      dask scheduler                       prints tcp://HOST:8786
      dask worker tcp://HOST:8786 --nworkers 8 --nthreads 1

    Usage examples:

      ann-dc study demos/yield.toml --output out/yield --workers 2
      ann-dc report out/yield
      ann-dc study out/yield --point 17
      ann-dc study car --list-settings

    Exit code: 0 every case has a result, 1 some have none, 2 bad input,
    130 interrupted.
    """
    exports.check(is_whole=not list_settings and point is None)
    make_room(json_file)
    written, code = [], FINISHED
    with notes(quiet), progress_line(quiet) as progress:
        if list_settings:
            shown, content = _settable(source)
        elif point is not None:
            shown, content = _one(source, point)
        else:
            shown, content, written, code = _run(source, running, exports, progress)
        written = [*written, *write_results(content, json_file)]
    finish(shown, written, quiet=quiet, code=code)


def _run(
    source: str, running: Running, exports: Exports, progress: Progress
) -> tuple[list[Any], dict[str, Any], list[Path], int]:
    """Return the summary of the study, its JSON data, the files written, and the exit code.

    Raises `StudyError` if no folder is given, or the file does not contain a study.
    """
    if running.output is None:
        raise StudyError("--output: expected a folder for the records, got none; add --output DIR")
    progress("study")
    from ann_dc.report.study_summary import summary, summary_dict
    from ann_dc.study.study_file import load_study

    declared = load_study(source)
    with _executor(running.scheduler) as executor:
        table = declared.run(
            running.output,
            workers=running.workers,
            executor=executor,
            retry=running.retry,
            progress=progress,
        )
    shown = [*summary(declared, table), f"HTML page: ann-dc report {running.output}"]
    content = summary_dict(declared, table)
    if table.stopped:
        shown.append(f"{table.stopped}; repeat the command to continue")
        return shown, content, [], INTERRUPTED
    return (
        shown,
        content,
        exports.write(running.output),
        FINISHED if table.is_complete else SOME_FAILED,
    )


def _settable(source: str) -> tuple[list[Any], dict[str, Any]]:
    """Return tables of the available settings and metrics, and their JSON data."""
    from ann_dc.cli.arguments.problem import problem_of
    from ann_dc.problem import plants
    from ann_dc.report.study_summary import settings_dict, settings_table
    from ann_dc.study.metrics import METRICS
    from ann_dc.study.settings import subject_of

    subject = source if source in plants.names() else problem_of(source, (), None, None, None)
    described = subject_of(subject)
    return settings_table(described, METRICS), settings_dict(described, METRICS)


def _one(source: str, point: int) -> tuple[list[Any], dict[str, Any]]:
    """Return the record of one case of a study file, or of the study in a folder.

    The record is returned as a table and as JSON data.
    """
    from ann_dc.report.tables import named_rows
    from ann_dc.study.store import Store
    from ann_dc.study.study_file import load_study, study_from

    if Path(source).is_dir():
        with Store.open(source) as store:
            declared = study_from(store.identity)
    else:
        declared = load_study(source)
    record = declared.row(point)
    return [named_rows(record)], dict(record)


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
        raise StudyError(f"--scheduler: no response from {scheduler}: {error}") from error
    with client, client.get_executor() as executor:
        yield executor


NAME = "report.html"
"""Default file name in the folder of the study, without --output."""


@timed
def report(
    *,
    folder: Path = argument("Folder of a study.", metavar="DIR"),
    output: Path | None = option("HTML page.", metavar="FILE", show_default=f"{NAME} in DIR"),
    json_file: JsonOption = None,
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
      ann-dc report out/study --output study.html

    Exit code: 0 written, 2 study not found, a missing package, or unwritable
    output, 130 interrupted.
    """
    with progress_line(quiet) as progress:
        from ann_dc.report.study_page import write_residuals, write_study_page
        from ann_dc.study.store import Store

        file = output or folder / NAME
        with Store.open(folder) as store:
            make_room(json_file, file)
            write_study_page(store, file, progress=progress)
            figures = write_residuals(store, file)
            count = len(store)
        files = [file, *figures]
        written = [*files, *write_results({"cases": count, "files": files}, json_file)]
    finish([f"{count:,} points"], written, quiet=quiet)
