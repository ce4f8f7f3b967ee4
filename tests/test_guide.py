"""Pages of the user guide: every code block runs and prints what its page shows."""

import os
import re
import shutil
from pathlib import Path

import pytest
from code_blocks import ROOT, blocks_of, difference, run_page
from typer.main import get_command

from ann_dc.backends.status import EXPLANATIONS, Outcome
from ann_dc.cli.commands.app import app
from ann_dc.problem.named_functions import FUNCTIONS

GUIDE = ROOT / "demos" / "guide"
PAGES = sorted(GUIDE.glob("*.md"))
LONGEST = 120
"""Letters of a line outside tables."""

needs_ngspice = pytest.mark.skipif(
    shutil.which("ngspice") is None and "CI" not in os.environ, reason="ngspice is not installed"
)
pages = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder from which the files of the demos have the paths that pages show."""
    (tmp_path / "demos").symlink_to(ROOT / "demos")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@needs_ngspice
@pages
def test_code_blocks_run_and_print_what_the_page_shows(page, folder):
    run_page(page)


@needs_ngspice
@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [p for p in PAGES if any(b.is_slow for b in blocks_of(p))], ids=lambda page: page.stem
)
def test_slow_code_blocks_run_and_print_what_the_page_shows(page, folder):
    run_page(page, slow=True)


@pages
def test_lines_outside_tables_are_short(page):
    lines = page.read_text("utf-8").splitlines()
    long = [line for line in lines if len(line) > LONGEST and not line.startswith("|")]
    assert long == []


@pages
def test_headings_are_not_questions(page):
    text = re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    assert [line for line in text.splitlines() if line.startswith("#") and "?" in line] == []


@pages
def test_page_is_in_the_index(page):
    index = (GUIDE / "index.md").read_text("utf-8").splitlines()
    assert page.stem in ("index", *index)


def test_table_of_outcomes_has_a_row_for_every_outcome():
    page = (GUIDE / "certification.md").read_text("utf-8")
    rows = re.findall(r"^\| `([A-Z_]+)` \| (.+) \| (.+) \|$", page, re.MULTILINE)
    assert [name for name, *_ in rows] == [outcome.name for outcome in Outcome]
    assert {name: tuple(texts) for name, *texts in rows} == {
        outcome.name: tuple(explanation) for outcome, explanation in EXPLANATIONS.items()
    }


def test_page_of_problems_lists_the_functions_of_formulas():
    page = (GUIDE / "problems.md").read_text("utf-8")
    (listed,) = re.findall(r"and the functions\s`([a-z ]+)`", page)
    assert listed.split() == [*FUNCTIONS]


NAMES = re.compile(r"ann-dc [a-z]+(?: --[a-z-]+)?|--[a-z-]+")


def unknown(text: str) -> list[str]:
    """Return the commands and options in a text that the command line does not have."""
    commands = get_command(app).commands
    options = {
        name: {word for option in command.params for word in option.opts}
        for name, command in commands.items()
    }
    missing = []
    for found in NAMES.findall(text):
        _, command, option = f"{found}  ".split(" ")[:3] if " " in found else ("", "", found)
        known = options.get(command, set()) if command else set().union(*options.values())
        if (command and command not in options) or (option and option not in known):
            missing.append(found)
    return missing


@pytest.mark.parametrize("outcome", EXPLANATIONS)
def test_commands_and_options_of_a_next_step_exist(outcome):
    assert unknown(EXPLANATIONS[outcome].next_step) == []


def test_unknown_commands_and_options_are_found():
    text = "raise --limit, or ann-dc designs; ann-dc design --step; ann-dc design --diagnose"
    assert unknown(text) == ["--limit", "ann-dc designs", "ann-dc design --step"]


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        ("settled after 51.2", "settled after 51.5"),
        ("residual 1.2e-09", "residual 3.4e-09"),
        ("error 1.2e-04", "error 1.3e-04"),
        ("a  1.0\nb", "a │ 1.0\n───\nb"),
        ("a\n...\nd", "a\nb\nc\nd"),
        ("a\n...", "a\nb\nc"),
        ("0", "0"),
    ],
)
def test_output_is_equal_but_for_digits_and_layout(shown, printed):
    assert difference(shown, printed) is None


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        ("settled after 51.2", "settled after 53.0"),
        ("settled", "stalled"),
        ("error 1.2e-04", "error 1.2e-05"),
        ("residual 1.2e-09", "residual 1.0e-03"),
        ("9 of 10", "8 of 10"),
        ("a", "a\nb"),
        ("a\nb", "a"),
        ("a\n...\nd", "a\nb"),
        ("a\n...\nd", "a\nd\ne"),
        ("x 1.0", "x -1.0"),
    ],
)
def test_output_with_another_word_or_number_differs(shown, printed):
    assert difference(shown, printed) is not None


def written(folder: Path, text: str) -> Path:
    page = folder / "page.md"
    page.write_text(text, encoding="utf-8")
    return page


def test_wrong_output_of_python_fails(folder):
    page = written(folder, "```python\nprint(1)\n```\n\n```text\n2\n```\n")
    with pytest.raises(AssertionError, match="line 1: expected 2, got 1"):
        run_page(page)


def test_wrong_output_of_a_command_fails(folder):
    page = written(folder, "```console\n$ ann-dc --version\nann-dc 99\n```\n")
    with pytest.raises(AssertionError, match=r"page\.md, line 1"):
        run_page(page)


def test_unexpected_exit_status_fails(folder):
    page = written(folder, "```console\n$ ann-dc solve nothing  # exit status 2\n```\n")
    run_page(page)
    with pytest.raises(AssertionError, match="nothing"):
        run_page(written(folder, "```console\n$ ann-dc solve nothing\n```\n"))


def test_slow_block_is_left_out_unless_slow(folder):
    page = written(folder, "<!-- slow -->\n```python\nx = 1\n```\n\n```python\ny = 2\n```\n")
    assert "x" not in run_page(page)
    assert run_page(page, slow=True)["x"] == 1
    assert run_page(page)["y"] == 2


def test_named_toml_block_is_written(folder):
    run_page(written(folder, "```toml\n# small.toml\nhorizon = 3\n```\n"))
    assert (folder / "small.toml").read_text() == "# small.toml\nhorizon = 3\n"
