"""What the README and the pages of the demos show exists and runs."""

import os
import re
import shlex
import shutil
from importlib.metadata import entry_points
from pathlib import Path

import pytest
import typer.main
from bench.record import QUOTATION, quoting
from code_blocks import blocks_of, run_page

from ann_dc.cli.commands.app import app

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
BENCH = ROOT / "tests" / "bench" / "README.md"
PAGES = [README, ROOT / "demos" / "README.md", *sorted((ROOT / "demos" / "guide").glob("*.md"))]
LINK = re.compile(r"\]\(([^)#:]+)\)")
INLINE = re.compile(r"`(ann-dc [^`]+)`")


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def commands() -> list[list[str]]:
    """Every command line that is shown, in words."""
    shown = [
        line.removeprefix("$ ")
        for page in PAGES
        for block in blocks_of(page)
        if block.language == "console"
        for line in block.text.splitlines()
        if line.startswith("$ ")
    ]
    inline = [line for page in PAGES for line in INLINE.findall(text_of(page))]
    return [shlex.split(line, comments=True) for line in (*shown, *inline)]


def targets() -> set[str]:
    """What `make` knows."""
    return set(re.findall(r"^(\w+):", text_of(ROOT / "Makefile"), re.MULTILINE))


@pytest.mark.skipif(
    shutil.which("ngspice") is None and "CI" not in os.environ, reason="ngspice is not installed"
)
def test_the_python_of_the_readme_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = run_page(README, languages=("python",))
    assert names["solution"].certified
    assert names["run"].control_error < 1e-2
    assert (tmp_path / "network.npz").exists()


@pytest.mark.parametrize("words", commands(), ids=" ".join)
def test_every_command_exists(words):
    if words[0] == "make":
        assert words[1] in targets()
        return
    if words[0] == "dask":
        assert words[1] in {entry.name for entry in entry_points(group="dask_cli")}
        return
    program, command, *arguments = words
    assert program == "ann-dc"
    known = typer.main.get_command(app).commands
    assert command in known
    if arguments:  # a wrong option or number is an error
        code = 0
        try:
            known[command].make_context(command, arguments)
        except typer.Exit as end:  # an option that prints a table and ends
            code = end.exit_code
        assert code == 0


def test_targets_of_make_that_are_named_exist():
    for page in PAGES:
        assert set(re.findall(r"`make (\w+)", text_of(page))) <= targets(), page


@pytest.mark.parametrize("page", [*PAGES, BENCH], ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    for link in LINK.findall(text_of(page)):
        assert (page.parent / link).exists(), link


def test_the_readme_is_read_to_the_end():
    assert len(text_of(README).splitlines()) <= 130


def test_quoted_figures_are_rows_of_the_benches():
    page = text_of(README)
    assert len(QUOTATION.findall(page)) >= 6
    assert quoting(page, text_of(BENCH)) == page


def test_every_demo_and_every_picture_is_in_the_gallery():
    gallery = text_of(ROOT / "demos" / "README.md")
    for demo in (ROOT / "demos").glob("[0-9]*.py"):
        assert f"](./{demo.name})" in gallery
    for picture in (ROOT / "demos" / "pictures").glob("*.png"):
        assert f"](pictures/{picture.name})" in gallery
        assert picture.stat().st_size < 150_000
