"""``ann-dc circuit``: the network as a circuit, simulated by ngspice beside the ODE."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ann_dc.cli.files import make_room, write_json
from ann_dc.cli.problem import (
    HorizonOption,
    ProblemArgument,
    SetOption,
    StartStateOption,
    TargetOption,
    arithmetic_of,
    problem_of,
)
from ann_dc.cli.report import named_rows, verdict_text
from ann_dc.cli.terminal import console, list_files, progress_line
from ann_dc.cli.words import named
from ann_dc.errors import ProblemError
from ann_dc.whole_files import write_whole

if TYPE_CHECKING:
    from ann_dc.backends.spice.backend import CircuitRun
    from ann_dc.backends.spice.levels import Level
    from ann_dc.certificate import Certificate
    from ann_dc.network.components import Components
    from ann_dc.problem.declaration import OptimalControlProblem

SETTLED = 1e-3
"""Share of the largest control within which a circuit counts as settled."""


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
            help="Models: behavioural (ideal parts) or macro (op amps with finite gain, bandwidth, "
            "slew and rails).",
        ),
    ] = "macro",
    a0: Annotated[float, typer.Option("--a0", help="Open-loop gain of the op amps.")] = 1e6,
    gbw: Annotated[
        float, typer.Option(metavar="HZ", help="Gain-bandwidth product of the op amps.")
    ] = 10e6,
    margin: Annotated[
        float,
        typer.Option(
            metavar="K", help="How much faster than the network's fastest mode the op amps are."
        ),
    ] = 10.0,
    full_scale: Annotated[
        float, typer.Option(metavar="V", help="Voltage that stands for the largest value.")
    ] = 1.0,
    coordinators: Annotated[
        bool,
        typer.Option(
            help="Wire coarse coordinators: faster at long horizons, for twice the op amps and a "
            "larger --margin (30)."
        ),
    ] = False,
    deck: Annotated[
        Path | None, typer.Option("--deck", metavar="FILE", help="Write the netlist.")
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write the result as JSON.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")] = False,
) -> None:
    """Build the network as a circuit, simulate it, and compare it with the optimum.

    The network is designed, scaled to volts and seconds by a run of its
    ODE, given resistors and capacitors, and simulated by ngspice from
    reset to rest. One op amp is a neuron, a PI dual or an inverter.

    Examples:

      ann-dc circuit car
      ann-dc circuit car --a0 1e4 --deck out/car.cir
      ann-dc circuit unicycle --level behavioural

    Exit code: 0 the circuit settled near the optimum (1 % of the largest
    control), 1 it did not, 2 bad input, no ngspice, or unwritable output.
    """
    with progress_line(quiet) as progress:
        declared = problem_of(problem, settings or (), horizon, q_0, q_d)
        for file in (deck, json_file):
            make_room(file)
        models = _level(level, a0, gbw)
        with arithmetic_of(declared):
            made, run, proof = _built(declared, models, margin, full_scale, coordinators, progress)
        written = []
        if deck is not None:
            write_whole(deck, run.deck.text.encode("utf-8"))
            written.append(deck)
        if json_file is not None:
            write_json(json_file, _as_dict(declared, models, made, run, proof))
            written.append(json_file)
    console(quiet=quiet).print(named_rows(_rows(declared, models, made, run, proof)))
    list_files(written, quiet=quiet)
    raise typer.Exit(0 if _near(run) else 1)


def _level(word: str, a0: float, gbw: float) -> Level:
    from ann_dc.backends.spice.levels import BEHAVIOURAL, macro

    made = {"behavioural": lambda: BEHAVIOURAL, "macro": lambda: macro(a0=a0, gbw=gbw)}
    return named("--level", word, made)()


def _built(declared, models, margin, full_scale, coordinators, progress):
    from ann_dc.backends.spice.backend import SpiceBackend, simulate
    from ann_dc.backends.spice.process import find_ngspice
    from ann_dc.network.design import design
    from ann_dc.network.gains import WITHOUT_COORDINATORS
    from ann_dc.network.synthesis import synthesize
    from ann_dc.solution import certificate_of

    find_ngspice()  # before the design: what is missing is told at once
    recipe = None if coordinators else WITHOUT_COORDINATORS
    designed = design(synthesize(declared), recipe=recipe, progress=progress)
    if not designed.settled:
        raise ProblemError(
            f"{declared.name}: the design did not settle in {designed.first.steps} steps, so there "
            "is nothing to build; check that the target is within reach"
        )
    backend = SpiceBackend(level=models, margin=margin, full_scale=full_scale, progress=progress)
    made, probe = backend.prepare(designed.network)
    run = simulate(backend, made, probe)
    return made, run, certificate_of(declared, designed.network, run.trajectory.final)


def _near(run: CircuitRun) -> bool:
    return run.settled(SETTLED) and run.control_error < 1e-2


def _rows(
    problem: OptimalControlProblem,
    level: Level,
    made: Components,
    run: CircuitRun,
    proof: Certificate,
) -> dict[str, object]:
    parts = made.parts
    scaling = run.scaling
    values = ", ".join(f"{name} {value:g}" for name, value in sorted(level.parameters.items()))
    settled = run.settled(SETTLED)
    return {
        "problem": problem,
        "level": level.name + (f" ({values})" if values else ""),
        "parts": ", ".join(f"{count} {name}" for name, count in parts.items()),
        "scaling": f"{scaling.full_scale:g} V full scale, {scaling.time:.3g} s a unit of network "
        f"time; tightest node {scaling.tightest} at {scaling.used(scaling.tightest):.0%}",
        "settled": verdict_text(
            settled,
            f"controls within {SETTLED:g} after {run.settling_time(SETTLED) * 1e6:.4g} us"
            if settled
            else "the controls still move at the end of the run",
        ),
        "error of controls": f"{run.control_error:.2e} of the largest one, against the ODE",
        "trajectory": f"normalised mean square error {run.mean_square_error:.1e}, against the ODE",
        "objective": f"{proof.objective:.8g}, KKT residual {proof.kkt_residual:.1e}",
        "overload": "; ".join(map(str, run.overloads[:3])) or "none",
    }


def _as_dict(problem, level, made: Components, run: CircuitRun, proof: Certificate) -> dict:
    return {
        "problem": problem.name,
        "level": level.name,
        "parameters": dict(level.parameters),
        "parts": made.parts,
        "full_scale": run.scaling.full_scale,
        "seconds_per_unit": run.scaling.time,
        "settled": run.settled(SETTLED),
        "settling_time": run.settling_time(SETTLED),
        "control_error": run.control_error,
        "mean_square_error": run.mean_square_error,
        "objective": proof.objective,
        "kkt_residual": proof.kkt_residual,
        "overloads": [str(overload) for overload in run.overloads],
    }
