"""What is asked of a circuit away from the bench: --corners, --yield."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import typer

from ann_dc.cli.commands.boards.places import PANEL, PlaceOptions
from ann_dc.errors import ProblemError

SAMPLES = 100
"""Circuits that are drawn where nothing else is said."""


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

    spec: Annotated[
        str | None,
        typer.Option(
            "--yield",
            metavar="SPEC",
            help="What share of circuits, drawn from the tolerances of the level's parts, keeps a "
            "spec: error<1% (of the controls), settle<50us, stable, or several with commas. By "
            "emulation; --samples says how many are drawn.",
            rich_help_panel=PANEL,
        ),
    ] = None
    spot: Annotated[
        int,
        typer.Option(
            metavar="COUNT",
            min=0,
            help="With --yield: so many of the drawn circuits, best to worst, run in ngspice too.",
            rich_help_panel=PANEL,
        ),
    ] = 0

    @property
    def asked(self) -> bool:
        """Whether anything is asked."""
        return self.corners or self.spec is not None

    @property
    def draws(self) -> bool:
        """Whether circuits are drawn, so that --samples counts them."""
        return self.spec is not None

    def check(self, given: Mapping[str, Any]) -> None:
        """Refuse options of one circuit, where something else is asked for.

        Raises
        ------
        ProblemError
            Naming the first of ``given``, by option, that is given.
        NetworkError
            If a spec cannot be read.
        """
        if self.spot and self.spec is None:
            raise ProblemError("--spot: is about drawn circuits; say --yield SPEC too")
        if self.spec is not None:
            self._spec()
        for option, value in given.items():
            if self.asked and value:
                raise ProblemError(
                    f"--{option}: belongs to one circuit that is built and simulated; leave it out "
                    "here"
                )

    def report(self, problem, network, backend, place: PlaceOptions, samples: int):
        """The answers, a `BoardReport`."""
        from ann_dc.report.boards.board_report import BoardReport

        circuit, probe = backend.prepare(network)
        answers: list[Any] = []
        if self.corners:
            answers.append(self._corners(backend, circuit, probe, place))
        if self.spec is not None:
            answers.append(self._yield(backend, circuit, probe, samples))
        return BoardReport(problem=problem.name, level=backend.level.name, answers=answers)

    def _corners(self, backend, circuit, probe, place: PlaceOptions):
        from ann_dc.fidelity.boards.corners import corners
        from ann_dc.report.boards.corner_table import CornerTable

        found = corners(backend, circuit, probe, **place.several())
        return CornerTable(corners=found, level=backend.level.name)

    def _yield(self, backend, circuit, probe, samples: int):
        from ann_dc.fidelity.boards.yields import yield_of
        from ann_dc.report.boards.yield_table import YieldTable

        drawn = samples or SAMPLES
        found = yield_of(backend, circuit, probe, self._spec(), samples=drawn, spots=self.spot)
        return YieldTable(yielded=found)

    def _spec(self):
        from ann_dc.fidelity.boards.spec import spec_of

        return spec_of(self.spec or "")
