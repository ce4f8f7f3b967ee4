"""Names of an export's files, the list of their hashes, and what a README states."""

import pytest

from ann_dc.errors import FileFormatError
from ann_dc.export.catalogue import FORMATS
from ann_dc.export.reference.contents import README, SUMS, check_contents, stated, with_sums

FILES = {"a.csv": b"1", "library/b.lib": b"2"}
EXPECTED = f"c.zip | a.csv library/* {SUMS}"


def test_what_is_listed_passes_with_a_readme_or_without():
    check_contents(with_sums(FILES), EXPECTED)
    check_contents(with_sums({**FILES, README: b"# a"}), EXPECTED)
    check_contents({"c.zip": b""}, EXPECTED)


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({}, "missing"),
        (FILES, "SHA256SUMS: missing"),
        (with_sums({"a.csv": b"1"}), r"library/\*: missing"),
        (with_sums({**FILES, "evil.exe": b""}), "evil.exe: expected only a.csv, library"),
        ({**with_sums(FILES), "a.csv": b"3"}, "a.csv: differs from its hash in SHA256SUMS"),
        ({**with_sums(FILES), "library/c.lib": b""}, "SHA256SUMS: does not list library/c.lib"),
        (with_sums(FILES) | {SUMS: b"\xff"}, "SHA256SUMS: not UTF-8"),
        ({"c.zip": b"", "a.csv": b""}, "a.csv: expected only c.zip|missing"),
    ],
)
def test_what_is_missing_changed_or_foreign_is_told(files, said):
    with pytest.raises(FileFormatError, match=said):
        check_contents(files, EXPECTED)


def test_statements_are_printable_paragraphs_of_the_readme():
    readme = "# t\n\nNo part to buy for: x (1).\n\nA circuit.\n\nA circuit \x1b[2J.\n\nWARNING: y."
    assert stated({README: readme.encode()}) == "No part to buy for: x (1). WARNING: y. Not run."


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_needs_its_files(name):
    with pytest.raises(FileFormatError, match="missing"):
        FORMATS[name].check({})
