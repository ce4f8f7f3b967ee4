"""``ann-dc circuit``: the network as a circuit, predicted, simulated by ngspice, and priced."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ann_dc.cli.arguments.levels import LADDER, level_of, series_of
from ann_dc.cli.arguments.problem import (
    HorizonOption,
    ProblemArgument,
    SetOption,
    StartStateOption,
    TargetOption,
    arithmetic_of,
    problem_of,
)
from ann_dc.cli.commands.ladder import ladder_report
from ann_dc.cli.terminal import console, list_files, progress_line
from ann_dc.errors import ProblemError
from ann_dc.report.json_file import make_room

if TYPE_CHECKING:
    from ann_dc.network.network import Network
    from ann_dc.problem.declaration import OptimalControlProblem


def circuit(
    problem: ProblemArgument,
    settings: SetOption = None,
    horizon: HorizonOption = None,
    q_0: StartStateOption = None,
    q_d: TargetOption = None,
    level: Annotated[
        str,
        typer.Option(
            metavar="LEVEL",
            help="behavioural, ota-c, macro, differential, switched-capacitor, transistor; parts "
            "by name (tl072_ad633, opa192_ad734, opa828_ad734, ad8065_ad835, zero_drift_trimmed); "
            "or ladder: a report of them all.",
        ),
    ] = "macro",
    a0: Annotated[
        float | None,
        typer.Option("--a0", help="Open-loop gain of the op amps.", show_default="1e6"),
    ] = None,
    gbw: Annotated[
        float | None,
        typer.Option(
            metavar="HZ", help="Gain-bandwidth product of the op amps.", show_default="10e6"
        ),
    ] = None,
    margin: Annotated[
        float | None,
        typer.Option(
            metavar="K",
            help="How much faster than the network's fastest mode the op amps are.",
            show_default="10, with coordinators 30",
        ),
    ] = None,
    full_scale: Annotated[
        float | None,
        typer.Option(
            metavar="V",
            help="Voltage that stands for the largest value.",
            show_default="the level's",
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="Draw offsets, tolerances and gain errors of the level's parts."),
    ] = None,
    resistors: Annotated[
        str,
        typer.Option(
            metavar="SERIES",
            help="Take resistors from E12, E24, E96, or E24-pairs, E96-pairs (two in series).",
        ),
    ] = "exact",
    coordinators: Annotated[
        bool,
        typer.Option(
            help="Wire coarse coordinators: faster at long horizons, for twice the op amps and a "
            "larger margin."
        ),
    ] = False,
    budget: Annotated[
        int,
        typer.Option(metavar="COUNT", min=0, help="List the parts whose errors cost most."),
    ] = 0,
    samples: Annotated[
        int,
        typer.Option(
            metavar="COUNT",
            min=0,
            help="Draw so many circuits of the level's parts, and predict the error of each.",
        ),
    ] = 0,
    simulated: Annotated[
        bool,
        typer.Option(
            "--simulate/--no-simulate",
            help="Run ngspice; without it netlist, bill, prediction and budget are still there.",
        ),
    ] = True,
    slow: Annotated[
        bool, typer.Option("--slow", help="In a ladder: also what ngspice takes minutes for.")
    ] = False,
    deck: Annotated[
        Path | None, typer.Option("--deck", metavar="FILE", help="Write the netlist.")
    ] = None,
    bill: Annotated[
        Path | None,
        typer.Option("--bill", metavar="FILE", help="Write every component's value (CSV)."),
    ] = None,
    figure: Annotated[
        Path | None, typer.Option("--figure", metavar="FILE", help="Write a picture (PNG).")
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write the result as JSON.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")] = False,
) -> None:
    """Build the network as a circuit, predict and simulate it, and compare with the optimum.

    The network is designed, scaled to volts and seconds by a run of its
    ODE, and given resistors and capacitors. Eigenvalues of the pole model
    tell whether it is stable; then ngspice runs it from reset to rest.
    The error budget tells which parts to pay for.

    Examples:

      ann-dc circuit car
      ann-dc circuit car --level opa192_ad734 --seed 1 --budget 10
      ann-dc circuit car --resistors E96-pairs --bill out/car.csv --deck out/car.cir
      ann-dc circuit car --no-simulate --samples 100
      ann-dc circuit unicycle --level transistor --figure out/unicycle.png
      ann-dc circuit car --level ladder --figure out/ladder.png

    Exit code: 0 the circuit settled near the optimum (1 % of the largest
    control; a ladder: it was climbed), 1 it did not, 2 bad input, an unstable
    circuit, no ngspice, or unwritable output.
    """
    with progress_line(quiet) as progress:
        declared = problem_of(problem, settings or (), horizon, q_0, q_d)
        for file in (deck, bill, figure, json_file):
            make_room(file)
        margin = margin if margin is not None else 30.0 if coordinators else 10.0
        if level.lower() == LADDER:
            _refuse_with_ladder(
                {"--deck": deck, "--bill": bill, "--a0": a0, "--gbw": gbw},
                {"--full-scale": full_scale, "--budget": budget or None},
                {"--samples": samples or None, "--no-simulate": None if simulated else True},
                {"--resistors": None if resistors == "exact" else resistors},
            )
            with arithmetic_of(declared):
                network = _designed(declared, coordinators, progress)
                report, written = ladder_report(
                    declared, network, margin, seed, slow, figure, json_file, progress
                )
            code = 0
        else:
            from ann_dc.backends.spice.backend import SpiceBackend
            from ann_dc.fidelity.circuit_study import study_circuit
            from ann_dc.hardware.circuit.bill import check_level
            from ann_dc.report.circuit import CircuitReport

            if slow:
                raise ProblemError("--slow: belongs to --level ladder")
            if figure is not None and not simulated:
                raise ProblemError("--figure: draws what ngspice did; leave out --no-simulate")
            chosen = level_of(level, a0, gbw)
            snapping = series_of(resistors)
            with arithmetic_of(declared):
                network = _designed(declared, coordinators, progress, simulated)
                models = chosen(network)
                if bill is not None:
                    check_level(models)
                if full_scale is not None:
                    models = replace(models, full_scale=full_scale)
                backend = SpiceBackend(level=models, margin=margin, seed=seed, progress=progress)
                found = study_circuit(
                    network,
                    backend,
                    series=snapping,
                    items=budget,
                    samples=samples,
                    simulated=simulated,
                )
                told = CircuitReport(problem=declared, backend=backend, found=found)
            report, code = told.tables(), 0 if found.near else 1
            written = told.write(deck=deck, bill=bill, figure=figure, json_file=json_file)
    shown = console(quiet=quiet)
    for part in report if isinstance(report, list) else [report]:
        shown.print(part)
    list_files(written, quiet=quiet)
    raise typer.Exit(code)


def _refuse_with_ladder(*given: dict[str, object]) -> None:
    for option, value in {k: v for group in given for k, v in group.items()}.items():
        if value is not None:
            raise ProblemError(f"{option}: belongs to one level; leave it out with --level ladder")


def _designed(
    problem: OptimalControlProblem,
    coordinators: bool,
    progress: Callable[[str], None],
    simulated: bool = True,
) -> Network:
    from ann_dc.backends.spice.ngspice.process import find_ngspice
    from ann_dc.gain_design.procedure import design
    from ann_dc.gain_design.recipe import WITHOUT_COORDINATORS
    from ann_dc.solver import synthesize

    if simulated:
        find_ngspice()  # before the design: what is missing is told at once
    recipe = None if coordinators else WITHOUT_COORDINATORS
    designed = design(synthesize(problem), recipe=recipe, progress=progress)
    if not designed.settled:
        raise ProblemError(
            f"{problem.name}: the design did not settle in {designed.first.steps} steps, so there "
            "is nothing to build; check that the target is within reach"
            + ("" if coordinators else ", or try --coordinators")
        )
    return designed.network
