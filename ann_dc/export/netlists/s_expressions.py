"""S-expressions, as KiCad writes them: nested lists of words and of texts in quotes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TypeAlias

from ann_dc.errors import FileFormatError

Tree: TypeAlias = "str | list[Tree]"

TOKEN = re.compile(r'\s*(?:([()])|"((?:[^"\\]|\\.)*)"|([^\s()"]+))')
DEEPEST = 50


def written(tree: Tree, depth: int = 0) -> str:
    """A tree as text: lists of words on one line, lists of lists over several.

    Parameters
    ----------
    tree : str or list
        The first of a list is a word, what follows is quoted.
    depth : int
        How far it is indented.

    Returns
    -------
    str

    Examples
    --------
    >>> written(["comp", ["ref", "R1"], ["value", '1 "k"']])
    '(comp (ref "R1") (value "1 \\\\"k\\\\""))'
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
    """The tree that a text is.

    Parameters
    ----------
    text : str

    Returns
    -------
    list

    Raises
    ------
    FileFormatError
        If it is not one list, whole and no deeper than `DEEPEST`.

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
    """The lists within a list that begin with a word.

    Parameters
    ----------
    tree : str or list
    name : str
    """
    inner = tree if isinstance(tree, list) else []
    return [each for each in inner if isinstance(each, list) and each[:1] == [name]]


def entry(tree: Tree, name: str) -> str:
    """The text that follows a word, in the one list within a list that begins with it.

    Parameters
    ----------
    tree : str or list
    name : str

    Raises
    ------
    FileFormatError
        If there is none, more than one, or no text in it.
    """
    found = entries(tree, name)
    if len(found) != 1 or len(found[0]) != 2 or not isinstance(found[0][1], str):
        raise FileFormatError(f"s-expression: expected one ({name} ...) in {str(tree)[:60]!r}")
    return found[0][1]
