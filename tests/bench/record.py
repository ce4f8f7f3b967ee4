"""Run benches and write what they measured into README.md here. ``make bench``.

Every bench runs in a process of its own and renews its own section, with date, commit and the kind
of machine; the other sections keep what they say. ``make bench BENCHES="kernel circuits"`` runs
two, and ``BENCHES=preset_circuits:cart,car`` renews the rows of two names in the section of one.
The project's README quotes some rows; they are renewed with their sections.
"""

from __future__ import annotations

import argparse
import datetime
import importlib
import multiprocessing
import os
import platform
import re
import subprocess
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from bench.figure import Figure

README = Path(__file__).with_name("README.md")
FRONT = Path(__file__).parents[2] / "README.md"
"""Page that quotes rows."""
WRITTEN = "tests/bench/README.md", "README.md"
"""Files that recording itself changes."""
BENCHES = (
    "kernel",
    "preconditioners",
    "settled_run",
    "settling_with_horizon",
    "suite",
    "constrained",
    "search",
    "navigation",
    "gains",
    "basin",
    "recurrent_steps",
    "batch",
    "batch_memory",
    "many_starts",
    "units",
    "families",
    "studies",
    "circuits",
    "preset_circuits",
    "preconditioner_circuits",
    "coordinator_circuits",
    "transistor_circuits",
    "silicon_circuits",
    "store",
    "exports",
    "integers",
)


def figures_of(name: str, rows: str = "") -> tuple[str, list[Figure], float]:
    """(Title, its figures, seconds) of a bench, or of some of its names, run in this process."""
    bench = importlib.import_module(f"bench.{name}")
    began = time.perf_counter()
    figures = []
    for figure in bench.figures(rows.split(",")) if rows else bench.figures():
        print(figure, flush=True)
        figures.append(figure)
    title = bench.__doc__.partition("\n")[0].rstrip(".")
    return title, figures, time.perf_counter() - began


def machine() -> str:
    """Its kind: nothing that tells which one it is."""
    cores = len(os.sched_getaffinity(0))
    version = platform.python_version()
    return f"{cores} cores ({platform.machine()}, {platform.system()}), Python {version}"


def commit() -> str:
    """Return the commit that is measured; a note where files differ from it."""

    def git(*words: str) -> str:
        done = subprocess.run(["git", *words], capture_output=True, text=True, cwd=FRONT.parent)
        return done.stdout.rstrip() if done.returncode == 0 else ""

    changed = {line[3:] for line in git("status", "--porcelain", "-uno").splitlines()}
    name = git("rev-parse", "--short=7", "HEAD") or "an unpacked copy"
    return f"{name} with changes" if changed - set(WRITTEN) else name


HEAD = "| quantity | value | condition |\n|---|---|---|"
"""Head of every table."""


def section(title: str, figures: Sequence[Figure], when: str) -> str:
    """Heading, when and where, and the table."""
    return "\n\n".join([f"### {title}", when, "\n".join([HEAD, *map(row, figures)])])


def measured(asked: str, when: str) -> str:
    """Return the line of a section: date, commit, machine, seconds and command.

    >>> measured("kernel", "2026-11-27 at 12ab on x, in 3 s")
    'Measured 2026-11-27 at 12ab on x, in 3 s: `make bench BENCHES=kernel`.'
    """
    return f"Measured {when}: `make bench BENCHES={asked}`."


def collapsed(lines: str) -> str:
    """Return the line of a section, and of partial renewals the last one only.

    >>> collapsed("Measured a. Renewed cart: b. Renewed cart, car: c.")
    'Measured a. Renewed cart, car: c.'
    """
    whole, *partial = re.split(r" (?=Renewed )", lines)
    return " ".join([whole, *partial[-1:]])


def row(figure: Figure) -> str:
    """Return the line of a table that shows a figure."""
    missed = "" if figure.good else " (misses its limit)"
    return f"| {figure.name} | {figure.value} | {figure.remark}{missed} |"


def patched(text: str, name: str, figures: Sequence[Figure], when: str) -> str:
    """Return the text with those rows of a section replaced that have the names of the figures.

    >>> old = Figure(name="car", value="1 s"), Figure(name="cart", value="2 s")
    >>> text = renewed("", "kernel", section("Kernel", old, "Measured today."))
    >>> text = patched(text, "kernel", [Figure(name="cart", value="3 s")], "Renewed cart: later.")
    >>> [line for line in text.splitlines() if "car" in line]
    ['Measured today. Renewed cart: later.', '| car | 1 s |  |', '| cart | 3 s |  |']
    """
    head, before, table = content_of(text, name).split("\n\n")
    lines = [*table.splitlines(), *map(row, figures)]
    table = "\n".join({line.split(" | ")[0]: line for line in lines}.values())
    return renewed(text, name, "\n\n".join([head, collapsed(f"{before} {when}"), table]))


def content_of(text: str, name: str) -> str:
    """Return the section of a bench, without its marks."""
    return text.partition(f"<!-- {name} -->\n")[2].partition(f"\n<!-- end of {name} -->")[0]


QUOTATION = re.compile(
    r"^\| (?P<what>.+?) \| .* \| \[(?P<bench>\w+)\]\((?P<page>\S+)\).* \|$", re.M
)
"""Row of a table that quotes a bench: its name, figure, remark, and the bench with its page."""
MEASURED = re.compile(r"^Measured (?P<date>\S+) at (?P<commit>.+?) on ", re.M)


def quoting(page: str, text: str) -> str:
    """Return a page with the rows that it quotes as the sections of ``text`` have them.

    >>> row = Figure(name="car", value="1 s", remark="IPOPT 2 s")
    >>> bench = renewed("", "kernel", section("Kernel", [row], "Measured 2026-11-27 at 12ab on x."))
    >>> print(quoting("| car | 3 s | - | [kernel](bench.md) |", bench))
    | car | 1 s | IPOPT 2 s | [kernel](bench.md), 2026-11-27, 12ab |
    """

    def renew(match: re.Match[str]) -> str:
        content = content_of(text, match["bench"])
        rows = [line for line in content.splitlines() if line.startswith(f"| {match['what']} | ")]
        measured = MEASURED.search(content)
        if len(rows) != 1 or measured is None:
            raise LookupError(f"bench {match['bench']} has no row of the name {match['what']!r}")
        link = f"[{match['bench']}]({match['page']})"
        return f"{rows[0]} {link}, {measured['date']}, {measured['commit']} |"

    return QUOTATION.sub(renew, page)


def renewed(text: str, name: str, content: str) -> str:
    """The text with the section of a bench replaced, or put behind the others.

    >>> print(renewed("log", "kernel", "two"))
    log
    <BLANKLINE>
    <!-- kernel -->
    two
    <!-- end of kernel -->
    <BLANKLINE>
    >>> renewed(renewed("log", "kernel", "1"), "kernel", "2") == renewed("log", "kernel", "2")
    True
    """
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    if begin not in text:
        text = f"{text.rstrip()}\n\n{begin}\n{end}\n"
    before, _, rest = text.partition(begin)
    return f"{before}{begin}\n{content}\n{end}{rest.partition(end)[2]}"


def main() -> int:
    """Run, print and write; exit code 1 if a figure misses its bar."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("benches", nargs="*", help=f"all by default: {', '.join(BENCHES)}")
    names = parser.parse_args().benches
    if unknown := {name.partition(":")[0] for name in names} - set(BENCHES):
        parser.error(f"{', '.join(unknown)}: no such bench; there are: {', '.join(BENCHES)}")
    good = True
    for asked in names or BENCHES:
        print(f"--- {asked}", flush=True)
        name, _, rows = asked.partition(":")
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            title, figures, seconds = pool.submit(figures_of, name, rows).result()
        when = f"{datetime.date.today()} at {commit()} on {machine()}, in {seconds:.0f} s"
        text = README.read_text(encoding="utf-8")
        if rows:
            text = patched(text, name, figures, f"Renewed {rows.replace(',', ', ')}: {when}.")
        else:
            text = renewed(text, name, section(title, figures, measured(name, when)))
        README.write_text(text, encoding="utf-8")
        FRONT.write_text(quoting(FRONT.read_text(encoding="utf-8"), text), encoding="utf-8")
        good &= all(figure.good for figure in figures)
    return int(not good)


if __name__ == "__main__":
    raise SystemExit(main())
