"""Files of an export by name: the check that is common to all formats.

Files are compared by their SHA-256, and their names with those that the format writes. Text that
only people or other programs read is not parsed: no file of an export is trusted, and a hash finds
every change that a reader would find.
"""

from __future__ import annotations

import csv
import hashlib
import importlib
import io
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

from ann_dc.errors import ExportPackageMissing, FileFormatError

README = "README.md"
SUMS = "SHA256SUMS"
STATEMENTS = ("No part to buy for: ", "A circuit ", "WARNING: ")
"""First words of the paragraphs of a README on parts and accuracy."""


def check_contents(files: Mapping[str, bytes], expected: str) -> None:
    """Check the names of files, and the list of their hashes if there is one.

    ``expected`` has the names that the format writes, separated by blanks, with patterns of
    `fnmatch`. An alternative set of names follows a separate ``|``. 'README.md' may be present in
    any set. Raises `FileFormatError` if a file is missing, does not belong to the format, or
    differs from its hash.
    """
    patterns = max(
        (names.split() for names in expected.split(" | ")),
        key=lambda names: sum(_is_one_of(file, names) for file in files),
    )
    for pattern in patterns:
        if not any(fnmatchcase(file, pattern) for file in files):
            raise FileFormatError(f"{pattern}: missing; export the network again")
    for file in files:
        if not _is_one_of(file, [*patterns, README]):
            raise FileFormatError(
                f"{file:.80}: expected only {', '.join(patterns)}; remove it or export again"
            )
    if SUMS in files:
        _check_sums(files)


def _is_one_of(file: str, patterns: list[str]) -> bool:
    return any(fnmatchcase(file, pattern) for pattern in patterns)


def file_of(files: Mapping[str, bytes], name: str) -> bytes:
    """Return the content of a file, or raise `FileFormatError`."""
    if name not in files:
        raise FileFormatError(f"{name:.80}: missing; export the network again")
    return files[name]


def text_of(files: Mapping[str, bytes], name: str) -> str:
    """Return the text of a file, or raise `FileFormatError` if it is not UTF-8."""
    try:
        return file_of(files, name).decode("utf-8")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{name:.80}: not UTF-8 text: {error}") from error


def with_sums(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return files with the list of their hashes, in the format of ``sha256sum -c``."""
    sums = "".join(f"{hashlib.sha256(files[n]).hexdigest()}  {n}\n" for n in sorted(files))
    return {**files, SUMS: sums.encode()}


def _check_sums(files: Mapping[str, bytes]) -> None:
    """Compare all files with the list of their hashes."""
    lines = [line.partition("  ") for line in text_of(files, SUMS).splitlines()]
    listed = {name: digest for digest, _, name in lines}
    unlisted = sorted(set(files) - set(listed) - {SUMS})
    if unlisted or len(listed) != len(lines):
        raise FileFormatError(f"{SUMS}: does not list {', '.join(unlisted)[:80] or 'a file once'}")
    for name, digest in listed.items():
        if hashlib.sha256(file_of(files, name)).hexdigest() != digest:
            raise FileFormatError(f"{name:.80}: differs from its hash in {SUMS}; export it again")


def not_run(files: Mapping[str, bytes]) -> str:
    """Return the result for files that cannot be run: pictures and equations."""
    return f"{len(files.keys() - {README})} files; pictures and text are not run"


def stated(files: Mapping[str, bytes]) -> str:
    """Return the statements of a README on parts and accuracy; the circuit is not run."""
    paragraphs = text_of(files, README).split("\n\n")
    said = [part for part in paragraphs if part.startswith(STATEMENTS) and part.isprintable()]
    return " ".join([*said, "Not run."])


def package(name: str, extra: str) -> Any:
    """Load an optional package, or raise `ExportPackageMissing` with the command to install it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ExportPackageMissing(
            f"{error.name or name} is not installed; install it with: pip install 'ann-dc[{extra}]'"
        ) from error


def csv_text(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    r"""Format rows as CSV text."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return stream.getvalue()


def rows_by_connection(
    files: Mapping[str, bytes], table: str, head: Sequence[str]
) -> dict[str, list[list[str]]]:
    """Return the other columns of a table of connections and their stages in turn.

    Raises `FileFormatError` if the table has other columns, or a stage is out of order.
    """
    try:
        rows = list(csv.reader(io.StringIO(text_of(files, table)), strict=True))
    except csv.Error as error:
        raise FileFormatError(f"{table}: no table of text: {error}") from error
    if not rows or rows[0] != [*head] or any(len(row) != len(head) for row in rows):
        raise FileFormatError(f"{table}: expected the columns {', '.join(head)}")
    found: dict[str, list[list[str]]] = {}
    for name, stage, *values in rows[1:]:
        stages = found.setdefault(name, [])
        if stage != str(len(stages)):
            raise FileFormatError(f"{table}: {name}: stage {stage!r:.20} is out of order")
        stages.append(values)
    return found
