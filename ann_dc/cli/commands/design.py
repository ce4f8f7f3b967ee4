"""``ann-dc design``: gains of a network, compared candidates and diagnosis.

Operating range of inputs as options: ``--over q_d.x=3:7``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import typer

from ann_dc.cli.arguments.backends import StartOptions, start_of
from ann_dc.cli.arguments.options import QuietOption, option, timed
from ann_dc.cli.arguments.problem import ProblemOptions, arithmetic_of
from ann_dc.cli.arguments.words import KindsOption, kinds_of
from ann_dc.cli.terminal import console, list_files, progress_line
from ann_dc.errors import DesignError
from ann_dc.files import make_folder
from ann_dc.network.inputs import ranges_of
from ann_dc.network.preconditioners.base import ALL_KINDS
from ann_dc.timing import phase


@dataclass(frozen=True, kw_only=True)
class FamilyOptions:
    """Options that describe an operating range."""

    over: list[str] | None = option(
        "Design one network for a range of an input: q_d.x=3:7, q_0.phi=-0.5:0.5, or an input "
        "that the problem declares. Repeatable.",
        "--over",
        metavar="INPUT=LOW:HIGH",
    )
    held_out: int = option(
        "With --over: inputs of the validation.", "--held-out", default=1000, min=1
    )


@timed
def design(
    *,
    problem: ProblemOptions,
    start: StartOptions,
    preconditioner: KindsOption = None,
    family: FamilyOptions,
    refine: bool = option("Search for faster gains: seconds more.", "--refine", default=False),
    why: bool = option("Why it is as slow as it is, and what would help.", "--why", default=False),
    out: Path | None = option(
        "Write design.json, network.npz and a picture (--why, --over) into this folder.",
        metavar="DIR",
    ),
    quiet: QuietOption = False,
) -> None:
    """Choose the gains of a problem's network, without running it to the end.

    The design minimises the stiffness ratio, the ratio of the fastest to the
    slowest rate at the equilibrium. Settling to 1e-6 takes 14 times as many
    fastest time constants. The lower limit of the ratio is 2. --why reports
    the slow modes, the weakly reachable constraints (by how much a multiplier
    responds to a perturbation beyond its penalty), and remedies. Numbers are
    in network units.

    --over designs one network for ranges of inputs. Gain candidates come from
    equilibria of a sample, are screened on an increasing number of inputs,
    and are validated on held-out inputs, each with a certificate. Failing
    inputs are listed with the reason.

    Usage examples:

      ann-dc design car
      ann-dc design car --over q_d.x=3:7 --over q_d.y=3:7 --out out/cars
      ann-dc design pendulum --why --out out/pendulum
      ann-dc design two_link_arm --kinds multilevel --refine --why

    Exit code: 0 the gain-scheduled run settled, so the gains belong to the
    solution (with --over: 99 % of the held-out inputs are certified), 1 the
    run did not settle, 2 bad input or unwritable output.
    """
    if family.over:
        _design_family(
            problem, start, preconditioner, family, out=out, quiet=quiet, other=refine or why
        )
    with progress_line(quiet) as progress:
        declared = problem.declared()
        if out is not None:
            make_folder(out)
        neurons, allowed = start_of(start), kinds_of(preconditioner, ALL_KINDS)

        with phase("imports"):
            from ann_dc import diagnosis, solver
            from ann_dc.analysis.objectives import SETTLING_TIME
            from ann_dc.report.design import candidate_table, write_design

        with arithmetic_of(declared.name):
            network = solver.synthesize(declared, initial_guess=neurons(declared))
            designed = solver.design(
                network,
                preconditioner=allowed,
                refine=SETTLING_TIME if refine else None,
                progress=progress,
            )
            progress("looking for the slowest modes")
            found = diagnosis.diagnose(designed) if why and designed.settled else None
        written = [] if out is None else write_design(declared, designed, found, out, progress)
    shown = console(quiet=quiet)
    shown.print(str(designed), soft_wrap=True)
    shown.print()
    shown.print(candidate_table(designed))
    if found is not None:
        shown.print(f"\n{found}", soft_wrap=True)
    elif why:
        shown.print("\nnothing to analyse: the first run did not settle, so no optimum is known")
    list_files(written, quiet=quiet)
    raise typer.Exit(0 if designed.settled else 1)


ENOUGH = 0.99
"""Fraction of certified held-out inputs required of a design over a range."""


def _design_family(
    problem: ProblemOptions,
    start: StartOptions,
    kinds: str | None,
    family: FamilyOptions,
    *,
    out: Path | None,
    quiet: bool,
    other: bool,
) -> None:
    """Design one network over an operating range (``--over``) and end the command."""
    with progress_line(quiet) as progress:
        if other or start != StartOptions(seed=start.seed):
            raise DesignError(
                "--over: goes with neither --refine nor --why nor a start; every input starts on "
                "its own straight line"
            )
        declared, over = problem.declared(), ranges_of(family.over or [], "--over")
        if out is not None:
            make_folder(out)

        from ann_dc.families.family_design import design_family
        from ann_dc.report.design import write_family

        with arithmetic_of(declared.name):
            designed = design_family(
                declared,
                over,
                preconditioner=kinds_of(kinds, ALL_KINDS),
                held_out=family.held_out,
                seed=start.seed,
                progress=progress,
            )
        written = [] if out is None else write_family(designed, out, progress)
    console(quiet=quiet).print(str(designed), soft_wrap=True)
    list_files(written, quiet=quiet)
    raise typer.Exit(0 if designed.validation.share >= ENOUGH else 1)
