"""``ann-dc design``: gains of a network, compared candidates and diagnosis.

Operating range of inputs as options: ``--range q_d.x=3:7``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from ann_dc.cli.arguments.backends import StartOptions, start_of
from ann_dc.cli.arguments.options import JsonOption, QuietOption, option, timed
from ann_dc.cli.arguments.problem import ProblemOptions, arithmetic_of
from ann_dc.cli.arguments.words import PreconditionersOption, kinds_of
from ann_dc.cli.terminal import finish, progress_line
from ann_dc.errors import DesignError
from ann_dc.network.inputs import ranges_of
from ann_dc.network.preconditioners.base import ALL_KINDS
from ann_dc.report.json_file import make_room
from ann_dc.timing import phase


@dataclass(frozen=True, kw_only=True)
class FamilyOptions:
    """Options that describe an operating range."""

    ranges: list[str] | None = option(
        "Design one network for a range of an input, for instance q_d.x=3:7. Repeatable.",
        "--range",
        metavar="INPUT=LOW:HIGH",
    )
    held_out: int = option(
        "Number of validation inputs, with --range.", "--held-out", default=1000, min=1
    )


@timed
def design(
    *,
    problem: ProblemOptions,
    initial_guess: StartOptions,
    preconditioner: PreconditionersOption = None,
    family: FamilyOptions,
    refine: bool = option("Search for faster gains (seconds).", "--refine", default=False),
    diagnose: bool = option(
        "Report the slowest modes, their causes, and remedies with their effect.",
        "--diagnose",
        default=False,
    ),
    output: Path | None = option(
        "Folder of design.json, network.npz and the figure of --diagnose or --range.",
        metavar="DIR",
    ),
    json_file: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Choose the gains of a problem's network, without running it to the end.

    The design minimises the stiffness ratio, the ratio of the fastest to the
    slowest rate at the equilibrium. Settling to 1e-6 takes 14 times as many
    fastest time constants. The lower limit of the ratio is 2. --diagnose reports
    the slow modes, the weakly reachable constraints (by how much a multiplier
    responds to a perturbation beyond its penalty), and remedies. Numbers are
    in network units.

    --range designs one network for ranges of inputs. Gain candidates come from
    equilibria of a sample, are screened on an increasing number of inputs,
    and are validated on held-out inputs, each with a certificate. Failing
    inputs are listed with the reason.

    Usage examples:

      ann-dc design car
      ann-dc design car --range q_d.x=3:7 --range q_d.y=3:7 --output out/cars
      ann-dc design pendulum --diagnose --output out/pendulum
      ann-dc design two_link_arm --preconditioner multilevel --refine --diagnose

    Exit code: 0 the gain-scheduled run settled, so the gains belong to the
    solution (with --range: 99 % of the held-out inputs are certified), 1 the
    run did not settle, 2 bad input or unwritable output.
    """
    if family.ranges:
        _design_family(
            problem,
            initial_guess,
            preconditioner,
            family,
            output=output,
            json_file=json_file,
            quiet=quiet,
            other=refine or diagnose,
        )
    with progress_line(quiet) as progress:
        declared = problem.declared()
        make_room(json_file, figures=output)
        neurons, allowed = start_of(initial_guess), kinds_of(preconditioner, ALL_KINDS)

        with phase("imports"):
            from ann_dc import diagnosis, solver
            from ann_dc.analysis.objectives import SETTLING_TIME
            from ann_dc.report.design import design_report, write_design

        with arithmetic_of(declared.name):
            network = solver.synthesize(declared, initial_guess=neurons(declared))
            designed = solver.design(
                network,
                preconditioner=allowed,
                refine=SETTLING_TIME if refine else None,
                progress=progress,
            )
            progress("diagnosis: slowest modes")
            found = diagnosis.diagnose(designed) if diagnose and designed.settled else None
        written = write_design(declared, designed, found, output, json_file, progress)
    shown: list[object] = [design_report(declared, designed, allowed)]
    if found is not None:
        shown.append(f"\n{found}")
    elif diagnose:
        shown.append(
            "\nno diagnosis: the gain-scheduled run did not settle, so no optimum is known"
        )
    finish(shown, written, quiet=quiet, code=0 if designed.settled else 1)


ENOUGH = 0.99
"""Fraction of certified held-out inputs required of a design over a range."""


def _design_family(
    problem: ProblemOptions,
    start: StartOptions,
    kinds: str | None,
    family: FamilyOptions,
    *,
    output: Path | None,
    json_file: Path | None,
    quiet: bool,
    other: bool,
) -> NoReturn:
    """Design one network over an operating range (``--range``) and end the command."""
    with progress_line(quiet) as progress:
        if other or start != StartOptions(seed=start.seed):
            raise DesignError(
                "--range: cannot be combined with --refine, --diagnose, --initial-guess or "
                "--starts; omit them"
            )
        declared, over = problem.declared(), ranges_of(family.ranges or [], "--range")
        make_room(json_file, figures=output)

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
        written = write_family(designed, output, json_file, progress)
    good = designed.validation.share >= ENOUGH
    finish([str(designed)], written, quiet=quiet, code=0 if good else 1)
