"""Answers to several questions about one circuit: their tables, one verdict, one JSON file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from rich.table import Table

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.report.json_file import write_json


class Answer(Protocol):
    """What a question about a circuit brings."""

    @property
    def good(self) -> bool:
        """Whether the circuit does what was asked for."""
        ...

    def tables(self) -> list[Table]:
        """What is printed."""
        ...

    def as_dict(self) -> dict:
        """For the JSON file."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardReport:
    """All that was asked of one circuit.

    Attributes
    ----------
    problem : str
        What the circuit solves.
    backend : SpiceBackend
        Says what it is built of.
    answers : sequence of Answer
    """

    problem: str
    backend: SpiceBackend
    answers: Sequence[Answer]

    @property
    def good(self) -> bool:
        """Whether every answer is."""
        return all(answer.good for answer in self.answers)

    def tables(self) -> list[Table]:
        """What is printed."""
        return [shown for answer in self.answers for shown in answer.tables()]

    def as_dict(self) -> dict:
        """For the JSON file."""
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
        """Write the JSON file, and say so.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        if json_file is None:
            return []
        write_json(json_file, self.as_dict())
        return [json_file]
