"""Figures of the documents at an earlier revision that occur nowhere in the present ones.

``python tests/facts.py REVISION`` prints document, line and text of each. A figure is a number with
an exponent, or one of two or more significant digits with a unit. Numbers are compared by value.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
DOCUMENT = re.compile(
    r"(README|CHANGELOG|CONTRIBUTING)\.md|circuits/README\.md|demos/.*\.md|tests/bench/README\.md"
)
MODULE = re.compile(r"(ann_dc|demos)/.*\.py")
UNIT = (
    r"%|percent\b|[umn]?s\b|[um]?[VAWJ]\b|mm2\b|[kM]?ohm\b|[kMG]?Hz\b|[pnu]F\b|[kMG]B\b|dB\b|C\b|rad\b"
    r"|(?:tau_min|taus|fastest|bits|steps|iterations|times|networks|op amps|starts|periods)\b"
)
NUMBER = re.compile(r"(?<![\w.])(\d+(?:\.\d+)?)(e[-+]?\d+)?")
FIGURE = re.compile(rf"{NUMBER.pattern}(?:[ -]?(?:{UNIT}))?(?![\w])")


def figures_of(text: str) -> Iterator[tuple[float, str]]:
    """Yield (value, text) of the figures of a line."""
    for match in FIGURE.finditer(text):
        digits, exponent = match[1].replace(".", "").lstrip("0"), match[2]
        has_unit = len(match[0]) > len(match[1])
        if exponent or (has_unit and len(digits) >= 2):
            yield float(match[1] + (exponent or "")), match[0]


def values_of(text: str) -> set[float]:
    """Return all numbers of a text, with or without a unit."""
    return {float(match[0]) for match in NUMBER.finditer(text)}


def documentation_of(name: str, text: str) -> str:
    """Return a document, or the docstrings of a module."""
    if not name.endswith(".py"):
        return text
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    nodes = [node for node in ast.walk(ast.parse(text)) if isinstance(node, kinds)]
    return "\n".join(filter(None, map(ast.get_docstring, nodes)))


def lost(old: Iterable[tuple[str, str]], present: str) -> Iterator[tuple[str, str, str]]:
    """Yield (document, figure, line) of the figures of old documents that are not present."""
    known = values_of(present)
    for name, text in old:
        for line in text.splitlines():
            for value, figure in figures_of(line):
                if value not in known:
                    known.add(value)  # reported once
                    yield name, figure, line.strip()


def _git(*words: str) -> str:
    return subprocess.run(
        ["git", *words], capture_output=True, text=True, cwd=ROOT, check=True
    ).stdout


def main(revision: str) -> None:
    """Print the lost figures of a revision."""

    def is_read(name: str) -> bool:
        return bool(DOCUMENT.fullmatch(name) or MODULE.fullmatch(name))

    names = filter(is_read, _git("ls-tree", "-r", "--name-only", revision).splitlines())
    old = ((name, documentation_of(name, _git("show", f"{revision}:{name}"))) for name in names)
    now = [name for name in _git("ls-files").splitlines() if is_read(name)]
    present = [documentation_of(name, (ROOT / name).read_text("utf-8")) for name in now]
    for name, figure, line in lost(old, "\n".join(present)):
        print(f"{name}: {figure}: {line[:300]}")


if __name__ == "__main__":
    main(sys.argv[1])
