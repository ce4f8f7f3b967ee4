"""``ann-dc study``: a study from a file, run, gone on with, or repeated point by point."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from ann_dc.cli.arguments.output import QuietOption
from ann_dc.cli.terminal import console, list_files, notes, progress_line
from ann_dc.errors import StudyError

FINISHED = 0
SOME_FAILED = 1
INTERRUPTED = 130


def study(
    source: Annotated[
        str,
        typer.Argument(
            metavar="STUDY",
            help="A study file (.toml); or, with --point, the folder of a study; or, with "
            "--settings, a plant or a problem file.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Where rows are kept as they finish. A study there goes on."
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=0, help="Processes; 0 for none but this.", show_default="one a core"),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="A Dask scheduler whose workers do it instead."),
    ] = None,
    retry: Annotated[bool, typer.Option("--retry", help="Do points that failed again.")] = False,
    point: Annotated[
        int | None, typer.Option(min=0, metavar="NUMBER", help="Do one point, and print its row.")
    ] = None,
    settings: Annotated[
        bool, typer.Option("--settings", help="List what can be varied, and what is measured.")
    ] = False,
    csv: Annotated[
        Path | None, typer.Option("--csv", metavar="FILE", help="Write the table as CSV.")
    ] = None,
    parquet: Annotated[
        Path | None, typer.Option("--parquet", metavar="FILE", help="Write the table as Parquet.")
    ] = None,
    quiet: QuietOption = False,
) -> None:
    """Vary what a file says, measure every point, and keep the rows.

    Rows reach DIR as they finish. Ctrl-C, a crash or a power cut lose none of
    them: the same command goes on where it was. Points that fail are rows that
    say why; --retry does them again.

    On a cluster, start a scheduler and workers, then give the address:

      dask scheduler                       prints tcp://HOST:8786
      dask worker tcp://HOST:8786 --nworkers 8 --nthreads 1

    Examples:

      ann-dc study demos/yield.toml --out out/yield --workers 2
      ann-dc report out/yield
      ann-dc study out/yield --point 17
      ann-dc study car --settings

    Exit code: 0 every point has a result, 1 some have none, 2 bad input,
    130 interrupted.
    """
    with notes(quiet), progress_line(quiet) as progress:
        if settings:
            shown = _settable(source)
            written: list[Path] = []
            code = FINISHED
        elif point is not None:
            shown, written, code = _one(source, point), [], FINISHED
        else:
            if out is None:
                raise StudyError("--out: is missing; name the folder where rows are to be kept")
            progress("study")
            from ann_dc.report.findings.summary import summary
            from ann_dc.study.study_file import load_study

            declared = load_study(source)
            with _executor(scheduler) as executor:
                table = declared.run(
                    out, workers=workers, executor=executor, retry=retry, progress=progress
                )
            shown, written = summary(declared, table), _export(out, csv, parquet)
            code = FINISHED if table.is_complete else SOME_FAILED
            if table.stopped:
                shown.append(f"{table.stopped}; the same command goes on from here")
                code = INTERRUPTED
    for part in shown:
        console(quiet=quiet).print(part)
    list_files(written, quiet=quiet)
    if out is not None and point is None and not settings:
        console(quiet=quiet).print(f"a page of it: ann-dc report {out}", soft_wrap=True)
    raise typer.Exit(code)


def _settable(source: str) -> list[Any]:
    """Tables of what can be varied and measured."""
    from ann_dc.cli.arguments.problem import problem_of
    from ann_dc.problem import plants
    from ann_dc.report.findings.summary import settings_table
    from ann_dc.study.measuring.metrics import METRICS
    from ann_dc.study.varying.subject import subject_of

    subject = source if source in plants.names() else problem_of(source, (), None, None, None)
    return settings_table(subject_of(subject), METRICS)


def _one(source: str, point: int) -> list[Any]:
    """The row of one point of a study file, or of a folder's study."""
    from ann_dc.report.tables import named_rows
    from ann_dc.study.keeping.store import Store
    from ann_dc.study.study_file import load_study, study_from

    if Path(source).is_dir():
        with Store.open(source) as store:
            declared = study_from(store.identity)
    else:
        declared = load_study(source)
    return [named_rows(declared.row(point))]


@contextmanager
def _executor(scheduler: str | None) -> Iterator[Any]:
    """That of a Dask cluster; None for processes of this machine."""
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


def _export(folder: Path, csv: Path | None, parquet: Path | None) -> list[Path]:
    from ann_dc.study.keeping.store import Store

    with Store.open(folder) as store:
        if csv is not None:
            store.to_csv(csv)
        if parquet is not None:
            store.to_parquet(parquet)
    return [file for file in (csv, parquet) if file is not None]
