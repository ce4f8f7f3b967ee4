"""Combined report of several analyses of one circuit: tables, verdict and JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from rich.table import Table

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.report.json_file import write_json


class Answer(Protocol):
    """Result of one analysis of a circuit."""

    @property
    def good(self) -> bool:
        """True if the circuit meets the requirement."""
        ...

    def tables(self) -> list[Table]:
        """Return the tables to print."""
        ...

    def as_dict(self) -> dict:
        """Return the content of the JSON file."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardReport:
    """Results of all requested analyses of one circuit.

    Attributes
    ----------
    problem : str
        Name of the problem that the circuit solves.
    backend : SpiceBackend
        Backend that defines the parts.
    answers : sequence of Answer
        Results of the analyses.
    """

    problem: str
    backend: SpiceBackend
    answers: Sequence[Answer]

    @property
    def good(self) -> bool:
        """True if every result is good."""
        return all(answer.good for answer in self.answers)

    def tables(self) -> list[Table]:
        """Return the tables to print."""
        return [shown for answer in self.answers for shown in answer.tables()]

    def as_dict(self) -> dict:
        """Return the content of the JSON file."""
        backend = self.backend
        found = {
            "problem": self.problem,
            "level": backend.level.name,
            "seed": backend.seed,
            "resistors": backend.series.name,
        }
        for answer in self.answers:
            found |= answer.as_dict()
        return found

    def write(self, *, json_file: Path | None = None) -> list[Path]:
        """Write the JSON file and return its path in a list.

        Raises `OutputError` if the file cannot be written.
        """
        if json_file is None:
            return []
        write_json(json_file, self.as_dict())
        return [json_file]
