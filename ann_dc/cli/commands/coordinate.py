"""``ann-dc coordinate``: the paper's two-level algorithm, stages below and a coordinator above."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from ann_dc.cli.arguments.backends import lower_of, needing_torch
from ann_dc.cli.arguments.lookup import named
from ann_dc.cli.arguments.problem import (
    HorizonOption,
    ProblemArgument,
    SetOption,
    StartStateOption,
    TargetOption,
    arithmetic_of,
    problem_of,
)
from ann_dc.cli.terminal import console, list_files, progress_line
from ann_dc.errors import ProblemError
from ann_dc.report.json_file import make_room, write_json

if TYPE_CHECKING:
    import numpy as np

    from ann_dc.gain_design.procedure import Design
    from ann_dc.network.network import Network
    from ann_dc.problem.declaration import OptimalControlProblem
    from ann_dc.two_level.coordination import Coordination, Undesigned
    from ann_dc.two_level.lower_level import LowerLevel
    from ann_dc.two_level.upper_gains import UpperGains
    from ann_dc.two_level.upper_level import UpperLevel

CONFIRM = 0.005
"""The run goes on to this share of --tolerance, as other backends do (`Settling.confirm`)."""
SMALLEST_TOLERANCE = 1e-8
"""A share of less is lost in rounding."""
POLISHING = 3
"""Newton iterations from the designed point, which is good to 1e-8: Theta can tell more."""


class Coordinator(NamedTuple):
    """What a coordinator is called, and how it is made at a solution."""

    name: str
    make: Callable[[Network, np.ndarray], tuple[UpperLevel, UpperGains | None]]


def coordinate(
    problem: ProblemArgument,
    settings: SetOption = None,
    horizon: HorizonOption = None,
    q_0: StartStateOption = None,
    q_d: TargetOption = None,
    coordinator: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Upper level: gradient (17), newton (a banded linear system each iteration), "
            "oracle (33: needs the solution, for studies).",
        ),
    ] = "gradient",
    lower: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Lower level: closed (stage equations solved by Newton steps), iterated (16).",
            show_default="closed; newton: linearised stages",
        ),
    ] = None,
    limit: Annotated[int, typer.Option(min=1, help="Most outer iterations.")] = 2000,
    tolerance: Annotated[
        float,
        typer.Option(
            help="Outer iterations are counted until the relative KKT residual stays below this; "
            "the run goes on to 0.005 of it, so that its end can be certified."
        ),
    ] = 1e-6,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write the result as JSON.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")] = False,
) -> None:
    """Run the paper's two-level algorithm: stages solve, a coordinator moves t and beta.

    A network is designed for the corrected equations (with q_0 as a neuron),
    Theorem IV.2 is checked at its solution, and the iteration runs from the
    usual start: in every outer iteration the stages settle with t and beta
    held, then the coordinator moves them. lambda_t and lambda_beta of the
    gradient coordinator are the best at the solution, in network units;
    'predicted' is what their spectral radius lets expect. Theta is half the
    squared distance of t and beta from the solution, in network units.

    Examples:

      ann-dc coordinate car
      ann-dc coordinate car --coordinator newton
      ann-dc coordinate double_integrator -N 5 --lower iterated

    Exit code: 0 settled and certified, 1 not settled or not certified,
    2 bad input or unwritable output, 130 interrupted.
    """
    with progress_line(quiet) as progress:
        declared = problem_of(problem, settings or (), horizon, q_0, q_d)
        if not SMALLEST_TOLERANCE <= tolerance < 1:
            raise ProblemError(
                f"--tolerance: expected a number below 1, at least {SMALLEST_TOLERANCE:g}, got "
                f"{tolerance!r}"
            )
        make_room(json_file)
        with needing_torch("coordinate"):
            chosen = named("--coordinator", coordinator, _coordinators())
            level = lower_of(lower, CONFIRM * tolerance)
        with arithmetic_of(declared):
            outcome = _outcome(declared, chosen, level, limit, tolerance, progress)
        if json_file is not None:
            write_json(json_file, outcome.as_dict())
    console(quiet=quiet).print(outcome.shown())
    list_files([] if json_file is None else [json_file], quiet=quiet)
    raise typer.Exit(0 if outcome.certified else 1)


def _coordinators() -> dict[str, Coordinator]:
    from ann_dc.two_level.upper_gains import UpperMap
    from ann_dc.two_level.upper_level import Gradient, NewtonCoordinator, Oracle

    def gradient(network: Network, settled: np.ndarray) -> tuple[UpperLevel, UpperGains]:
        gains = UpperMap(network=network, settled=settled).best()
        return Gradient(lambda_t=gains.lambda_t, lambda_beta=gains.lambda_beta), gains

    known = (
        Coordinator("gradient", gradient),
        Coordinator("newton", lambda *_: (NewtonCoordinator(), None)),
        Coordinator("oracle", lambda _, settled: (Oracle(settled=settled), None)),
    )
    return {coordinator.name: coordinator for coordinator in known}


def _outcome(
    problem: OptimalControlProblem,
    chosen: Coordinator,
    lower: LowerLevel | None,
    limit: int,
    tolerance: float,
    progress: Callable[[str], None],
) -> Coordination | Undesigned:
    from ann_dc.solution import certificate_of
    from ann_dc.two_level.coordination import Coordination, Undesigned
    from ann_dc.two_level.layer import TwoLevelLayer
    from ann_dc.two_level.theorem import theorem_IV_2

    designed = _designed(problem, progress)
    if not designed.settled:
        return Undesigned(problem=problem, steps=designed.first.steps)
    network, settled = designed.network, _polished(designed)
    progress("choosing lambda_t and lambda_beta")
    upper, gains = chosen.make(network, settled)
    layer = TwoLevelLayer(network, upper=upper, lower=lower)
    run = layer.run(settled=settled, tolerance=CONFIRM * tolerance, limit=limit, progress=progress)
    return Coordination(
        problem=problem,
        coordinator=chosen.name,
        lower=type(layer.lower).__name__.lower(),
        hypothesis=theorem_IV_2(network, settled),
        gains=gains,
        run=run,
        tolerance=tolerance,
        certificate=certificate_of(problem, network, run.states[0]),
        values=_values(problem, network, run.states[0]),
    )


def _designed(problem: OptimalControlProblem, progress: Callable[[str], None]) -> Design:
    """A network whose stages can be solved by themselves: q_0 is a neuron (closing B)."""
    from ann_dc.decomposition.equations import decompose
    from ann_dc.decomposition.form import Form
    from ann_dc.gain_design.procedure import design
    from ann_dc.synthesis.synthesis import synthesize

    equations = decompose(problem, Form(start_is_neuron=True))
    return design(synthesize(equations), progress=progress)


def _polished(designed: Design) -> np.ndarray:
    """The solution, as exactly as the arithmetic has it."""
    from ann_dc.two_level.layer import TwoLevelLayer
    from ann_dc.two_level.upper_level import NewtonCoordinator

    layer = TwoLevelLayer(designed.network, upper=NewtonCoordinator())
    run = layer.run(designed.state, tolerance=0.0, limit=POLISHING)
    better = run.residuals[-1, 0] < run.residuals[0, 0]
    return run.states[0] if better else designed.state


def _values(problem: OptimalControlProblem, network: Network, x: np.ndarray) -> dict[str, Any]:
    """States over N + 1 stages and controls over N, by name."""
    import numpy as np

    from ann_dc.solution import neuron_values

    values = neuron_values(network, x)
    q = np.vstack([values["q"], values["t"][-1:]])
    columns = [*zip(problem.states, q.T), *zip(problem.controls, values["u"].T)]
    return {str(symbol): column.tolist() for symbol, column in columns}
