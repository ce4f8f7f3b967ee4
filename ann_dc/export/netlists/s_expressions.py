"""S-expressions as written by KiCad: nested lists of words and quoted texts."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TypeAlias

from ann_dc.errors import FileFormatError

Tree: TypeAlias = "str | list[Tree]"

TOKEN = re.compile(r'\s*(?:([()])|"((?:[^"\\]|\\.)*)"|([^\s()"]+))')
DEEPEST = 50


def written(tree: Tree, depth: int = 0) -> str:
    r"""Format a tree as text: lists of words on one line, lists of lists on several.

    The first item of a list is a word and the following items are quoted. The indentation is
    ``depth`` levels.

    Examples
    --------
    >>> written(["comp", ["ref", "R1"], ["value", '1 "k"']])
    '(comp (ref "R1") (value "1 \\"k\\""))'
    """
    if isinstance(tree, str):
        return '"' + tree.replace("\\", "\\\\").replace('"', '\\"') + '"'
    inner = [written(each, depth + 1) for each in tree[1:]]
    line = " ".join([f"({tree[0]}", *inner]) + ")"
    if len(line) <= 90 and "\n" not in line:
        return line
    indent = "\n" + "  " * (depth + 1)
    beside = all(isinstance(each, str) for each in tree[1])  # as KiCad has it: its name or number
    return f"({tree[0]}{' ' if beside else indent}" + indent.join(inner) + ")"


def read(text: str) -> Tree:
    """Parse a text as a tree.

    Raises `FileFormatError` if the text is not one complete list with a depth of at most `DEEPEST`.

    Examples
    --------
    >>> read('(net (code "1") (name GND))')
    ['net', ['code', '1'], ['name', 'GND']]
    """
    open_lists: list[list[Tree]] = [[]]
    for bracket, word in _tokens(text):
        if bracket == "(":
            open_lists.append([])
        elif bracket == ")":
            done = open_lists.pop()
            if not open_lists:
                raise FileFormatError("s-expression: a list is closed that was not opened")
            open_lists[-1].append(done)
        else:
            open_lists[-1].append(word)
        if len(open_lists) > DEEPEST:
            raise FileFormatError(f"s-expression: lists lie more than {DEEPEST} deep")
    if len(open_lists) != 1 or len(open_lists[0]) != 1 or isinstance(open_lists[0][0], str):
        raise FileFormatError("s-expression: expected one list, whole; the file is cut off")
    return open_lists[0][0]


def _tokens(text: str) -> Iterator[tuple[str, str]]:
    place, end = 0, len(text.rstrip())
    while place < end:
        found = TOKEN.match(text, place)
        if found is None:
            raise FileFormatError(f"s-expression: {text[place : place + 40]!r} is no word")
        place = found.end()
        quoted = found[2]
        if quoted is not None:
            yield "", re.sub(r"\\(.)", r"\1", quoted)
        else:
            yield found[1] or "", found[3] or ""


def entries(tree: Tree, name: str) -> list[list[Tree]]:
    """Return the lists within a list that begin with a given word."""
    inner = tree if isinstance(tree, list) else []
    return [each for each in inner if isinstance(each, list) and each[:1] == [name]]


def entry(tree: Tree, name: str) -> str:
    """Return the text after a word in the single list that begins with the word.

    Raises `FileFormatError` if there is not exactly one such list, or it has no text.
    """
    found = entries(tree, name)
    if len(found) != 1 or len(found[0]) != 2 or not isinstance(found[0][1], str):
        raise FileFormatError(f"s-expression: expected one ({name} ...) in {str(tree)[:60]!r}")
    return found[0][1]
