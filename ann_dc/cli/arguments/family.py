"""Operating range of inputs as options: ``--over q_d.x=3:7``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

OverOption = Annotated[
    list[str] | None,
    typer.Option(
        "--over",
        metavar="INPUT=LOW:HIGH",
        help="Design one network for a range of an input: q_d.x=3:7, q_0.phi=-0.5:0.5, or an input "
        "that the problem declares. Repeatable.",
    ),
]


@dataclass(frozen=True, kw_only=True)
class FamilyOptions:
    """Options that describe an operating range."""

    over: OverOption = None
    held_out: Annotated[
        int, typer.Option("--held-out", min=1, help="With --over: inputs of the validation.")
    ] = 1000
