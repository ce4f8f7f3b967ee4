"""What is asked of a circuit away from the bench: --corners."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import typer

from ann_dc.cli.commands.boards.places import PANEL, PlaceOptions
from ann_dc.errors import ProblemError


@dataclass(frozen=True, kw_only=True)
class BoardOptions:
    """Questions; any of them is answered instead of simulating one circuit."""

    corners: Annotated[
        bool,
        typer.Option(
            "--corners",
            help="A table over temperature, supplies and process instead: by emulation, of "
            "transistors in ngspice.",
            rich_help_panel=PANEL,
        ),
    ] = False

    @property
    def asked(self) -> bool:
        """Whether anything is asked."""
        return self.corners

    def check(self, given: Mapping[str, Any]) -> None:
        """Refuse options of one circuit, where something else is asked for.

        Raises
        ------
        ProblemError
            Naming the first of ``given``, by option, that is given.
        """
        for option, value in given.items():
            if self.asked and value:
                raise ProblemError(
                    f"--{option}: belongs to one circuit that is built and simulated; leave it out "
                    "here"
                )

    def report(self, problem, network, backend, place: PlaceOptions):
        """The answers, a `BoardReport`."""
        from ann_dc.report.boards.board_report import BoardReport

        circuit, probe = backend.prepare(network)
        answers = [self._corners(backend, circuit, probe, place)]
        return BoardReport(problem=problem.name, level=backend.level.name, answers=answers)

    def _corners(self, backend, circuit, probe, place: PlaceOptions):
        from ann_dc.fidelity.boards.corners import corners
        from ann_dc.report.boards.corner_table import CornerTable

        found = corners(backend, circuit, probe, **place.several())
        return CornerTable(corners=found, level=backend.level.name)
