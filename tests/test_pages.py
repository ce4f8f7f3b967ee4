"""Markdown of the project: glossary, tables of keys, line lengths, headings and word rates."""

import importlib
import re
from pathlib import Path

import pytest
import typer
from code_blocks import ROOT

from ann_dc.cli.commands.app import app
from ann_dc.navigation import scenario
from ann_dc.study.study_file import PLAIN

GUIDE = ROOT / "demos" / "guide"
ROW = re.compile(r"^\| (.+) \|$", re.MULTILINE)


def rows_of(page: Path, heading: str) -> list[list[str]]:
    """Return the cells of all tables below a heading, without their head."""
    text = page.read_text("utf-8").partition(f"# {heading}\n")[2]
    text = re.split(r"^#+ ", text, maxsplit=1, flags=re.MULTILINE)[0]
    found = [re.split(r"\s*\|\s*", row) for row in ROW.findall(text)]
    return [row for row in found[1:] if not row[0].startswith("---")]


def exists(name: str) -> bool:
    """Return True if a dotted name, a command or an option exists."""
    if name.startswith("ann-dc "):
        _, command, *words = name.split()
        options = {word for word in words if word.startswith("--")}
        found = typer.main.get_group(app).commands.get(command)
        known = [] if found is None else [word for one in found.params for word in one.opts]
        return found is not None and options <= {*known}
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            if not hasattr(found, part):
                return part in getattr(found, "__dataclass_fields__", ())
            found = getattr(found, part)
        return True
    return False


def test_every_code_name_of_the_glossary_exists():
    rows = rows_of(GUIDE / "glossary.md", "Glossary")
    assert len(rows) > 50
    missing = [row for row in rows if not exists(row[3].strip("`"))]
    assert missing == []


@pytest.mark.parametrize(
    "name",
    [
        "ann_dc.nothing",
        "ann_dc.Soft.nothing",
        "nothing.at_all",
        "ann-dc nothing",
        "ann-dc solve --no",
    ],
)
def test_other_names_do_not_exist(name):
    assert not exists(name)


def test_terms_of_the_glossary_are_sorted_and_occur_once():
    terms = [row[0].lower() for row in rows_of(GUIDE / "glossary.md", "Glossary")]
    assert terms == sorted(set(terms))


def keys_of(rows: list[list[str]]) -> set[str]:
    return {key.strip("[]") for row in rows for key in re.findall(r"`([^`]+)`", row[0])}


def test_keys_of_study_files_are_those_of_the_reader():
    rows = rows_of(GUIDE / "file_formats.md", "Study")
    assert keys_of(rows) == {*PLAIN, "subject", "vary", "fixed", "sampling"}


def test_keys_of_scenario_files_are_those_of_the_reader():
    rows = rows_of(GUIDE / "file_formats.md", "Scenario")
    assert keys_of(rows) == {*scenario.REQUIRED, *scenario.OPTIONAL}
