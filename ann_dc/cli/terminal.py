"""Terminal output: consoles, progress line, notes and results."""

from __future__ import annotations

import contextlib
import logging
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NoReturn

import typer
from rich.console import Console
from rich.text import Text

from ann_dc.progress import Progress, silent
from ann_dc.report.json_file import STDOUT


def console(*, stderr: bool = False, quiet: bool = False) -> Console:
    """Return a console that prints text literally."""
    return Console(stderr=stderr, quiet=quiet, markup=False, highlight=False, emoji=False)


@contextlib.contextmanager
def progress_line(quiet: bool = False) -> Iterator[Progress]:
    """Show a progress line on stderr if it is an interactive terminal.

    If `quiet`, notices of the library are not printed either.
    """
    shown = console(stderr=True)
    if quiet:
        with _without_notices():
            yield silent
        return
    if not shown.is_terminal:
        yield silent
        return
    with shown.status("starting", spinner="line") as status:
        yield lambda line: status.update(Text(line))


@contextlib.contextmanager
def _without_notices() -> Iterator[None]:
    """Turn off the notices of the library, such as that of a long compilation."""
    logger = logging.getLogger("ann_dc")
    before = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(before)


@contextlib.contextmanager
def notes(quiet: bool = False) -> Iterator[None]:
    """Collect library warnings and print them at the end on stderr, one per line."""
    sentences: dict[str, None] = {}
    otherwise = warnings.showwarning

    def keep(message: Warning | str, category: type[Warning], *where: Any) -> None:
        if issubclass(category, UserWarning):
            sentences[" ".join(str(message).split())] = None
        else:
            otherwise(message, category, *where)

    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = keep
        try:
            yield
        finally:
            for line in sentences:
                note = Text.assemble(("note: ", "bold yellow"), line)
                console(stderr=True, quiet=quiet).print(note, soft_wrap=True)


def finish(
    shown: Iterable[Any], written: Iterable[Path] = (), *, quiet: bool = False, code: int = 0
) -> NoReturn:
    """Print results and the names of written files, and end a command with an exit code.

    Nothing is printed if the JSON data went to the standard output.
    """
    written = [*written]
    quiet = quiet or STDOUT in written
    for part in shown:
        console(quiet=quiet).print(part, soft_wrap=isinstance(part, str))
    for file in written:
        console(quiet=quiet).print(f"wrote {file}", soft_wrap=True)
    raise typer.Exit(code)
