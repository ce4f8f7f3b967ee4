"""Operating conditions of a circuit: --temperature, --supply, --process.

With --corners each option takes several values.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from ann_dc.cli.arguments.numbers import number_of
from ann_dc.errors import ProblemError

PANEL = "Boards and chips"


@dataclass(frozen=True, kw_only=True)
class PlaceOptions:
    """Temperature, supplies and process; comma-separated values with --corners."""

    temperature: Annotated[
        str | None,
        typer.Option(
            metavar="C",
            help="Degrees Celsius of the circuit, -55 to 150; with --corners several: -40,27,125.",
            show_default="27",
            rich_help_panel=PANEL,
        ),
    ] = None
    supply: Annotated[
        str | None,
        typer.Option(
            metavar="SHARE",
            help="Supplies over their nominal values, 0.5 to 1.5; rails follow them. With "
            "--corners several: 0.9,1,1.1.",
            show_default="1",
            rich_help_panel=PANEL,
        ),
    ] = None
    process: Annotated[
        str | None,
        typer.Option(
            metavar="CORNER",
            help="Of transistors, n- and p-channel devices typical, slow or fast: tt, ss, ff, sf, "
            "fs. With --corners several.",
            show_default="tt",
            rich_help_panel=PANEL,
        ),
    ] = None

    def several(self) -> dict[str, list]:
        """Return all given values by parameter name of `corners`.

        Raises ProblemError if a temperature or a supply is not a number.
        """
        return {name: values for name, (_, values) in self._given().items()}

    def nominal(self):
        """Return the nominal `Conditions` for the design of a circuit with corners."""
        from ann_dc.hardware.parts.conditions import NOMINAL

        return NOMINAL

    def single(self):
        """Return the `Conditions` of a single operating point.

        Raises `ProblemError` if several values are given, which require --corners. Raises
        NetworkError if a value is out of range or not a corner.
        """
        from ann_dc.hardware.parts.conditions import Conditions

        found = {}
        for option, values in self._given().values():
            if len(values) != 1:
                raise ProblemError(f"--{option}: a circuit stands at one place; say --corners too")
            found[option] = values[0]
        return Conditions(**found)

    def _given(self) -> dict[str, tuple[str, list]]:
        """Return options and values by parameter name of `corners`."""
        given = {}
        for plural, option, text in (
            ("temperatures", "temperature", self.temperature),
            ("supplies", "supply", self.supply),
        ):
            if text is not None:
                words = text.split(",")
                given[plural] = option, [number_of(f"--{option}", word.strip()) for word in words]
        if self.process is not None:
            words = [word.strip().lower() for word in self.process.split(",")]
            given["processes"] = "process", words
        return given
