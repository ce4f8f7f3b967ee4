"""What every command that computes can be told about its output: --json and --quiet."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

JsonOption = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="Write the result as JSON.")
]
CurvesOption = Annotated[
    Path | None,
    typer.Option("--curves", metavar="FILE", help="Write every neuron over time, as .csv or .npz."),
]
FigureOption = Annotated[
    Path | None, typer.Option("--figure", metavar="FILE", help="Write a picture (PNG).")
]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
