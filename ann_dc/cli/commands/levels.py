"""``ann-dc levels``: comparison of all model levels, from the ODE to transistors."""

from __future__ import annotations

from ann_dc.cli.arguments.options import (
    FiguresOption,
    JsonOption,
    QuietOption,
    option,
    timed,
)
from ann_dc.cli.arguments.problem import ProblemOptions, arithmetic_of
from ann_dc.cli.arguments.words import MarginOption, PreconditionerOption, preconditioner_of
from ann_dc.cli.terminal import finish, progress_line
from ann_dc.report.json_file import make_room


@timed
def levels(
    *,
    problem: ProblemOptions,
    bandwidth_margin: MarginOption = None,
    seed: int = option(
        "Seed of the offsets, tolerances and gain errors of the parts.", default=1, min=0
    ),
    preconditioner: PreconditionerOption = None,
    slow: bool = option("Include levels that need minutes in ngspice.", "--slow", default=False),
    figures: FiguresOption = None,
    json_file: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Compare the problem at every model level, with predictions and measurements.

    The levels are the ODE, the recurrent layer, then circuits in ngspice. The
    circuits have ideal parts, every non-ideality of real parts alone, named
    parts with all non-idealities, and transistors. The last rows are solvers
    on this CPU. The error of the settled controls is relative to the largest
    control. The units are us (settling time to 0.1 %), W (power)
    and uJ (energy per solve).

    Usage examples:

      ann-dc levels car
      ann-dc levels car --figures out --json out/levels.json
      ann-dc levels unicycle --seed 3 --slow

    Exit code: 0 the comparison was run (a failed level shows the reason),
    2 bad input, ngspice not found, or unwritable output, 130 interrupted.
    """
    with progress_line(quiet) as progress:
        declared = problem.declared()
        make_room(json_file, figures=figures)
        kind = preconditioner_of(preconditioner)

        from ann_dc.backends.spice.backend import SpiceBackend
        from ann_dc.cli.arguments.building import fitted_to_build, network_to_build
        from ann_dc.fidelity.level_comparison import LevelComparison, compare_levels, quick
        from ann_dc.hardware.parts.levels import macro
        from ann_dc.optimality.reference_solvers import time_solvers
        from ann_dc.report.level_comparison import level_table, write_level_comparison

        with arithmetic_of(declared.name):
            network = network_to_build(declared, kind, progress=progress)
            asked = SpiceBackend(
                level=macro(), bandwidth_margin=bandwidth_margin, progress=progress
            )
            rungs = compare_levels(
                network,
                LevelComparison(
                    bandwidth_margin=fitted_to_build(asked, network).bandwidth_margin,
                    progress=progress,
                ),
                seed=seed,
                wanted=(lambda compared: True) if slow else quick,
                timings=time_solvers(declared),
            )
            done = [*rungs]
        written = write_level_comparison(done, declared, figures=figures, json_file=json_file)
    finish([level_table(done, str(declared))], written, quiet=quiet)
