"""Errors for former names of commands and options, which name the present ones."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ann_dc.errors import UnknownNameError

COMMANDS = {"ladder": "levels"}
"""Present names of renamed commands."""

OPTIONS = {
    "--bill": "--bom",
    "--budget": "--error-budget --settling-budget",
    "--curves": "--trajectory",
    "--figure": "--figures",
    "--film": "--animation",
    "--formats": "--list-formats",
    "--kinds": "--preconditioner",
    "--limit": "--max-settling --max-steps --max-iterations",
    "--margin": "--bandwidth-margin",
    "--metric": "--preconditioner",
    "--out": "--output",
    "--over": "--range",
    "--plot": "--figures",
    "--resistors": "--series",
    "--settings": "--list-settings",
    "--shield": "--safety-filter",
    "--spot": "--simulate-samples",
    "--start": "--initial-guess",
    "--why": "--diagnose",
    "--with": "--option",
}
"""Present names of renamed options; a command has one or some of several."""


def check_command(word: str) -> None:
    """Raise `UnknownNameError` with the present name of a renamed command."""
    if word in COMMANDS:
        raise UnknownNameError(f"{word}: unknown command; use {COMMANDS[word]}")


def check_options(words: Sequence[str], known: Collection[str]) -> None:
    """Raise `UnknownNameError` with the present name if a word is a renamed option.

    `known` contains the options of the command.
    """
    for word in words:
        name = word.partition("=")[0]
        present = [new for new in OPTIONS.get(name, "").split() if new in known]
        if present and name not in known:
            raise UnknownNameError(f"{name}: unknown option; use {' or '.join(present)}")
