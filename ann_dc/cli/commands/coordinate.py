"""``ann-dc coordinate``: two-level algorithm of the paper, stages and coordinator."""

from __future__ import annotations

from dataclasses import dataclass

from ann_dc.cli.arguments.backends import lower_of
from ann_dc.cli.arguments.options import JsonOption, QuietOption, completing, option, timed
from ann_dc.cli.arguments.problem import ProblemOptions, arithmetic_of
from ann_dc.cli.arguments.words import named
from ann_dc.cli.terminal import finish, progress_line
from ann_dc.errors import ProblemError
from ann_dc.report.json_file import make_room, write_results

SMALLEST_TOLERANCE = 1e-8
"""Smallest tolerance; smaller fractions are below the rounding error."""


def _coordinators():
    from ann_dc.two_level.coordination import COORDINATORS

    return COORDINATORS


@dataclass(frozen=True, kw_only=True)
class CoordinationOptions:
    """Options of the coordinator and of the stages."""

    coordinator: str = option(
        "Upper level: gradient (17), newton (a banded linear system each iteration) or oracle "
        "(33, needs the solution).",
        default="gradient",
        metavar="NAME",
        autocompletion=completing(_coordinators),
    )
    lower: str | None = option(
        "Lower level: closed (Newton steps of the stage equations) or iterated (16).",
        metavar="NAME",
        autocompletion=completing(lambda: ("closed", "iterated")),
        show_default="closed; newton: linearised stages",
    )


@timed
def coordinate(
    *,
    problem: ProblemOptions,
    levels: CoordinationOptions,
    max_iterations: int = option("Maximum number of outer iterations.", default=2000, min=1),
    tolerance: float = option(
        "Relative KKT residual that ends the count of outer iterations; the run continues to "
        "0.005 of it.",
        default=1e-6,
    ),
    json_file: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Run the two-level algorithm: stages solve, a coordinator updates t and beta.

    A network is designed for the corrected equations (with q_0 as a neuron)
    and Theorem IV.2 is checked at its solution. The iteration starts from the
    default initial guess. In every outer iteration the stages settle with t
    and beta fixed, then the coordinator updates t and beta. lambda_t and
    lambda_beta of the gradient coordinator are the best at the solution, in
    network units. 'predicted' is the number of iterations expected from their
    spectral radius. Theta is half the squared distance of t and beta from the
    solution, in network units.

    Usage examples:

      ann-dc coordinate car
      ann-dc coordinate car --coordinator newton
      ann-dc coordinate double_integrator -N 5 --lower iterated

    Exit code: 0 settled and certified, 1 not settled or not certified,
    2 bad input or unwritable output, 130 interrupted.
    """
    with progress_line(quiet) as progress:
        declared = problem.declared()
        _check_tolerance(tolerance)
        make_room(json_file)

        from ann_dc.backends.settling import Settling
        from ann_dc.report.coordination import as_dict, coordination_report
        from ann_dc.two_level import coordination

        settling = Settling(tolerance=tolerance)
        chosen = named("--coordinator", levels.coordinator, coordination.COORDINATORS)
        level = lower_of(levels.lower, settling.confirm * tolerance)
        with arithmetic_of(declared.name):
            found = coordination.coordinate(
                declared,
                coordinator=chosen,
                lower=level,
                settling=settling,
                limit=max_iterations,
                progress=progress,
            )
        written = write_results(as_dict(found), json_file)
    finish([coordination_report(found)], written, quiet=quiet, code=0 if found.certified else 1)


def _check_tolerance(tolerance: float) -> None:
    if not SMALLEST_TOLERANCE <= tolerance < 1:
        raise ProblemError(
            f"--tolerance: expected a number below 1, at least {SMALLEST_TOLERANCE:g}, got "
            f"{tolerance!r}"
        )
