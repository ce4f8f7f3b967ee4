"""Structure check of exported LaTeX files: head, braces, and permitted commands."""

from __future__ import annotations

import re

from ann_dc.errors import FileFormatError
from ann_dc.export.drawings.latex_document import PREAMBLE
from ann_dc.export.drawings.latex_symbols import FUNCTIONS, GREEK

COMMANDS = (
    "begin end section hline endhead qquad frac sqrt mathrm sum max infty dots cdot backslash "
    "wedge sim"
)
WORDS = {*COMMANDS.split(), *GREEK, *(word.removeprefix("\\") for word in FUNCTIONS.values())}
"""Permitted commands after the head; any other command makes a file invalid."""
ENVIRONMENT = re.compile(r"\{(document|align\*|longtable)\}")
HEAD = re.compile(rf"(?:%[^\n]*\n)*{re.escape(PREAMBLE)}\n")
"""Required head: hashes, class and packages."""
HIDDEN = re.compile(r"\^\^|[^\n -~]")
"""Characters that TeX may read as other characters, and invisible characters."""
TOKEN = re.compile(r"\\([A-Za-z]+|.|\Z)|%[^\n]*|[{}$]", re.DOTALL)


def check_structure(name: str, text: str) -> None:
    """Check the head, commands, environments, braces and dollar signs of a file.

    Raises `FileFormatError` that describes the first violation.
    """
    open_ones: list[str] = []
    for token in TOKEN.finditer(text, _behind_head(name, text)):
        word, sign = token[1], token[0]
        if word in ("begin", "end"):
            _match(name, open_ones, word == "begin", _environment(name, text, token.end()))
        elif word and word.isalpha() and word not in WORDS:
            raise FileFormatError(f"{name}: the command \\{word:.40} is none of ours")
        elif sign in "{}":
            _match(name, open_ones, sign == "{", "brace")
        elif sign == "$":
            _match(name, open_ones, open_ones[-1:] != ["$"], "$")
    if open_ones:
        raise FileFormatError(f"{name}: {open_ones[-1]} is not closed")


def _behind_head(name: str, text: str) -> int:
    """Return the position at which the document begins."""
    head, hidden = HEAD.match(text), HIDDEN.search(text)
    if head is None:
        raise FileFormatError(f"{name}: does not begin with the class and the packages of ours")
    if hidden:
        raise FileFormatError(f"{name}: {hidden[0]!r} hides a letter; none of ours has it")
    return head.end()


def _environment(name: str, text: str, place: int) -> str:
    found = ENVIRONMENT.match(text, place)
    if found is None:
        raise FileFormatError(f"{name}: {text[place : place + 20]!r} is no environment of ours")
    return found[1]


def _match(name: str, open_ones: list[str], opens: bool, kind: str) -> None:
    if opens:
        open_ones.append(kind)
    elif not open_ones or open_ones.pop() != kind:
        raise FileFormatError(f"{name}: {kind} is closed where it is not open")
