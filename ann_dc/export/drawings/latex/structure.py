"""Whether a LaTeX file is one of ours: its braces match, and it has no command but ours."""

from __future__ import annotations

import re

from ann_dc.errors import FileFormatError
from ann_dc.export.drawings.latex.symbols import FUNCTIONS, GREEK

COMMANDS = (
    "documentclass usepackage allowdisplaybreaks begin end section hline endhead qquad frac sqrt "
    "mathrm sum max infty dots cdot backslash wedge sim"
)
WORDS = {*COMMANDS.split(), *GREEK, *(word.removeprefix("\\") for word in FUNCTIONS.values())}
"""Every command that such a file uses; a file with another one is none of ours."""
TOKEN = re.compile(r"\\([A-Za-z]+|.|\Z)|%[^\n]*|[{}$]", re.DOTALL)


def check_structure(name: str, text: str) -> None:
    """Refuse what does not match: braces, dollars, environments, and unknown commands.

    Parameters
    ----------
    name : str
        Of the file.
    text : str
        What is in it.

    Raises
    ------
    FileFormatError
        With what is wrong.
    """
    open_ones: list[str] = []
    for token in TOKEN.finditer(text):
        word, sign = token[1], token[0]
        if word in ("begin", "end"):
            kind = re.compile(r"\{([a-z*]+)\}").match(text, token.end())
            _match(name, open_ones, word == "begin", kind[1] if kind else "?")
        elif word and word.isalpha() and word not in WORDS:
            raise FileFormatError(f"{name}: the command \\{word:.40} is none of ours")
        elif sign in "{}":
            _match(name, open_ones, sign == "{", "brace")
        elif sign == "$":
            _match(name, open_ones, open_ones[-1:] != ["$"], "$")
    if open_ones:
        raise FileFormatError(f"{name}: {open_ones[-1]} is not closed")


def _match(name: str, open_ones: list[str], opens: bool, kind: str) -> None:
    if opens:
        open_ones.append(kind)
    elif not open_ones or open_ones.pop() != kind:
        raise FileFormatError(f"{name}: {kind} is closed where it is not open")
