"""Output options of every command: --json, --figure, --quiet and --timing.

--timing prints the time per phase on stderr when the command ends.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from ann_dc.cli.terminal import console
from ann_dc.timing import Seconds, Stopwatch

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
TimingOption = Annotated[
    bool,
    typer.Option(
        "--timing",
        help="Tell on stderr where the time went; what is compiled counts where it is first used.",
    ),
]


def timed(command: Callable[..., None]) -> Callable[..., None]:
    """Add the option --timing to a command with keyword parameters.

    The decorator must be below `unfolded`.
    """

    @functools.wraps(command)
    def with_timing(*, timing: bool = False, **given: Any) -> None:
        if not timing:
            return command(**given)
        watch = Stopwatch()
        watch.phases["start"] = Seconds.since_start()
        try:
            with watch:
                command(**given)
        finally:
            console(stderr=True).print(str(watch))

    whole = inspect.signature(command)
    option = inspect.Parameter(
        "timing", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=TimingOption
    )
    with_timing.__signature__ = whole.replace(  # type: ignore[attr-defined]
        parameters=[*whole.parameters.values(), option]
    )
    with_timing.__annotations__ = {**command.__annotations__, "timing": TimingOption}
    return with_timing
