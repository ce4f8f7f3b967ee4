"""Markdown of the project: glossary, tables of keys, line lengths, headings and word rates."""

import importlib
import re
from collections import Counter
from pathlib import Path

import pytest
import typer
import yaml
from code_blocks import ROOT
from test_docstrings import WORDS

import ann_dc
from ann_dc.cli.commands.app import app
from ann_dc.navigation import scenario
from ann_dc.study.study_file import PLAIN

GUIDE = ROOT / "demos" / "guide"
ROW = re.compile(r"^\| (.+) \|$", re.MULTILINE)
RULE = re.compile(r"\|(:?-+:?\|)+")
FENCE = re.compile(r"^```.*?^```$", re.DOTALL | re.MULTILINE)
PAGES = [
    *(ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")),
    *(ROOT / name for name in ("circuits/README.md", "ann_dc/README.md", "tests/bench/README.md")),
    *sorted((ROOT / "demos").rglob("*.md")),
]
WITHOUT_TERMS = {"index", "glossary", "examples"}
TERMS = [p for p in (ROOT / "README.md", *GUIDE.glob("*.md")) if p.stem not in WITHOUT_TERMS]
"""Pages that use terms of the glossary."""
LONGEST = 120
"""Letters of a line outside tables and code."""
GENERATED = re.compile(r"Measured \d{4}-")
"""Beginning of the line that a bench writes on one line."""
pages = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))


def prose_of(page: Path) -> str:
    """Return a page without its code blocks, with the same line numbers."""
    return FENCE.sub(lambda match: "\n" * match[0].count("\n"), page.read_text("utf-8"))


def long_lines(text: str) -> list[str]:
    """Return lines of prose that are too long."""
    lines = [line for line in text.splitlines() if len(line) > LONGEST]
    return [line for line in lines if not (line.startswith("|") or GENERATED.match(line))]


def heads_of(text: str) -> list[tuple[str, str]]:
    """Return the first two lines of every table."""
    return re.findall(r"^(?<!\|\n)(\|.*)\n(.*)$", text, re.MULTILINE)


def rates_of(text: str) -> dict[str, float]:
    """Return the occurrences per 10,000 words of every word whose rate is limited."""
    count = len(text.split())
    return {
        word: 1e4 * len(re.findall(rf"\b(?:{pattern})\b", text, re.IGNORECASE)) / count
        for word, (pattern, _) in WORDS.items()
    }


def too_frequent(text: str) -> dict[str, float]:
    """Return the words of a text whose rate exceeds its limit."""
    return {word: rate for word, rate in rates_of(text).items() if rate > WORDS[word][1]}


@pages
def test_lines_of_prose_fit_a_screen(page):
    assert long_lines(prose_of(page)) == []


@pages
def test_headings_are_no_questions(page):
    lines = prose_of(page).splitlines()
    assert [line for line in lines if line.startswith("#") and "?" in line] == []


@pages
def test_tables_have_a_head_and_a_rule(page):
    assert [head for head, rule in heads_of(prose_of(page)) if not RULE.fullmatch(rule)] == []


def test_word_rates_of_all_pages_are_those_of_technical_english():
    text = "\n".join(map(prose_of, PAGES))
    places = Counter(
        f"{word}: {page.relative_to(ROOT)}"
        for page in PAGES
        for word in too_frequent(text)
        for _ in re.findall(rf"\b(?:{WORDS[word][0]})\b", prose_of(page), re.IGNORECASE)
    )
    assert places == {}


def test_the_checks_of_prose_find_faults():
    assert heads_of("| a |\n| b |\n| c |\n\n| d |\n|---|\n| e |") == [
        ("| a |", "| b |"),
        ("| d |", "|---|"),
    ]
    assert long_lines("| " + "x" * 130 + " |\n" + "y" * 121) == ["y" * 121]
    assert too_frequent("Tell what it says beside that.").keys() == {
        "what",
        "say",
        "tell",
        "beside",
    }


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


@pytest.mark.parametrize("page", TERMS, ids=lambda page: page.stem)
def test_introduction_links_the_glossary(page):
    introduction = re.split(r"^(?:## |\|)", page.read_text("utf-8"), flags=re.MULTILINE)[0]
    assert re.search(r"\]\((?:demos/guide/)?glossary\.md\)", introduction)


def keys_of(rows: list[list[str]]) -> set[str]:
    return {key.strip("[]") for row in rows for key in re.findall(r"`([^`]+)`", row[0])}


def test_keys_of_study_files_are_those_of_the_reader():
    rows = rows_of(GUIDE / "file_formats.md", "Study")
    assert keys_of(rows) == {*PLAIN, "subject", "vary", "fixed", "sampling"}


def test_keys_of_scenario_files_are_those_of_the_reader():
    rows = rows_of(GUIDE / "file_formats.md", "Scenario")
    assert keys_of(rows) == {*scenario.REQUIRED, *scenario.OPTIONAL}


def test_citation_has_the_keys_of_its_format():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert citation["cff-version"] == "1.2.0"
    assert {"message", "title", "authors"} <= citation.keys()
    assert str(citation["version"]) == ann_dc.__version__
    (paper,) = citation["references"]
    assert {"type", "title", "authors"} <= paper.keys()
    assert paper["title"] in " ".join((ROOT / "README.md").read_text("utf-8").split())
