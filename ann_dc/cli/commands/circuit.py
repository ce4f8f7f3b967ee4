"""``ann-dc circuit``: circuit of a network with prediction, ngspice run and costs."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path

from ann_dc.cli.arguments.options import (
    FiguresOption,
    JsonOption,
    QuietOption,
    TrajectoryOption,
    completing,
    option,
    timed,
)
from ann_dc.cli.arguments.problem import ProblemOptions, arithmetic_of
from ann_dc.cli.arguments.saved_network import (
    NetworkOptions,
    check_duration,
    is_network,
    unchanged_network,
)
from ann_dc.cli.arguments.words import (
    LevelOptions,
    MarginOption,
    PreconditionerOption,
    level_of,
    preconditioner_of,
    series_of,
    series_words,
)
from ann_dc.cli.commands.questions import SAMPLES, TRIMMED, BoardOptions, PlaceOptions
from ann_dc.cli.terminal import finish, notes, progress_line
from ann_dc.errors import ProblemError
from ann_dc.progress import Progress
from ann_dc.report.json_file import make_room


@dataclass(frozen=True, kw_only=True)
class BuildOptions:
    """Options of the circuit construction from the parts of a level."""

    bandwidth_margin: MarginOption = None
    full_scale: float | None = option(
        "Voltage of the largest value (V).",
        metavar="V",
        show_default="value of the level; at most 1 if controls have bounds",
    )
    seed: int | None = option(
        "Draw offsets, tolerances and gain errors of the parts with this seed.", min=0
    )
    series: str = option(
        "E series of the resistors: E12, E24, E96, E24-pairs or E96-pairs (two in series); "
        "capacitors are of E24, with E12 of E12.",
        default="exact",
        metavar="SERIES",
        autocompletion=completing(series_words),
    )
    preconditioner: PreconditionerOption = None


@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """Requested analyses of the circuit."""

    error_budget: int = option(
        "List the COUNT parts with the largest effect on the control error.",
        default=0,
        metavar="COUNT",
        min=0,
    )
    samples: int | None = option(
        "Predict the control errors of COUNT circuits drawn from the tolerances of the parts.",
        metavar="COUNT",
        min=1,
        show_default=f"none; with --yield {SAMPLES}, with --trim {TRIMMED}",
    )
    loops: int = option(
        "List the COUNT op amps with the smallest phase margins.", default=0, metavar="COUNT", min=0
    )
    simulated: bool = option(
        "Simulate in ngspice; predictions, netlist and bill of materials need no simulation.",
        "--simulate/--no-simulate",
        default=True,
    )


@dataclass(frozen=True, kw_only=True)
class CircuitFiles:
    """Output files."""

    deck: Path | None = option("Write the netlist.", "--deck", metavar="FILE")
    bom: Path | None = option(
        "Write all components by cell (CSV); for orders: export --to pack, bill.csv.",
        "--bom",
        metavar="FILE",
    )
    figures: FiguresOption = None
    trajectory: TrajectoryOption = None
    json_file: JsonOption = None

    def given(self) -> dict[str, Path]:
        """Return the requested files."""
        return {name: file for name, file in asdict(self).items() if file is not None}

    def make_room(self, simulated: bool) -> None:
        """Check before a long run that all requested files can be written.

        Raises `ProblemError` if a file requires a simulation and none is requested.
        """
        if not simulated and (self.figures is not None or self.trajectory is not None):
            option = "--trajectory" if self.figures is None else "--figures"
            raise ProblemError(f"{option}: needs the simulation; omit --no-simulate")
        make_room(
            self.json_file,
            self.deck,
            self.bom,
            figures=self.figures,
            trajectory=self.trajectory,
        )


@timed
def circuit(
    *,
    problem: ProblemOptions,
    level: LevelOptions,
    build: BuildOptions,
    study: StudyOptions,
    place: PlaceOptions,
    board: BoardOptions,
    files: CircuitFiles,
    given: NetworkOptions,
    quiet: QuietOption = False,
) -> None:
    """Build a network as a circuit, predict, simulate and compare with the optimum.

    The network is designed, scaled to volts and seconds by a run of its ODE,
    and given resistors and capacitors. Eigenvalues of the pole model
    determine stability. Then ngspice simulates the circuit from reset until
    it settles. The error budget lists the parts that dominate the error.

    PROBLEM may also be a network in a file, designed or wired by hand
    (.npz, .safetensors, an export to weights, or a saved solution). Its
    circuit is compared with its ODE and its emulation. A network that does
    not settle, or whose inputs change over time, needs a --duration.

    Usage examples:

      ann-dc circuit car
      ann-dc circuit car --level opa192_ad734 --seed 1 --error-budget 10
      ann-dc circuit car --series E96-pairs --bom out/car.csv --deck out/car.cir
      ann-dc circuit car --no-simulate --samples 100
      ann-dc circuit car --no-simulate --loops 5
      ann-dc circuit car --preconditioner cyclic-reduction --no-simulate
      ann-dc circuit unicycle --level transistor --figures out
      ann-dc circuit car --level opa192_ad734 --temperature 85 --supply 0.9
      ann-dc circuit car --level transistor --corners --process tt,ss
      ann-dc circuit car --yield "error<2%" --samples 200 --simulate-samples 3
      ann-dc circuit car --yield "error<5%" --series E96-pairs
      ann-dc circuit car --level opa192_ad734 --trim "error<1%"
      ann-dc circuit car --dac 12 --adc 12 --series E96-pairs --seed 1
      ann-dc circuit network.npz --input load=0.3 --level opa192_ad734
      ann-dc circuit oscillator.npz --duration 30 --figures out

    With --corners, --yield, --trim, --dac or --adc the output is a table per
    analysis instead of one circuit, and --json is the only file.

    Exit code 0: the circuit settled near the optimum (within 1 % of the
    largest control, from its scale's offset), is predicted to, or nothing is
    known; or the duration was completed. Conditions for exit code 0 of the tables:

      --corners     every corner is near the optimum, tolerances aside
      --yield       a drawn circuit meets the specification
      --trim        the trims are sufficient
      --dac, --adc  converters leave it near the optimum for the worst inputs

    Exit code 1: otherwise. Exit code 2: bad input, an unstable circuit,
    ngspice not found, or unwritable output.

    Comparison of all levels: ann-dc levels.
    """
    with notes(quiet), progress_line(quiet) as progress:
        files.make_room(study.simulated)
        board.check(_of_one_circuit(build, study, files, board, given), level.level)
        stands = (PlaceOptions() if board.corners else place).single()
        chosen, series = level_of(level, netlist=board.written), series_of(build.series)
        simulated = study.simulated and not board.asked
        if is_network(problem.problem):
            declared, network = None, _saved(problem, build, given)
        else:
            declared, network = _designed(problem, build, given, simulated, progress)
        subject = {"network": network.title} if declared is None else {"problem": declared.name}

        from ann_dc.cli.arguments.building import circuit_backend
        from ann_dc.fidelity.circuit_study import study_circuit
        from ann_dc.hardware.circuit.bill import check_level
        from ann_dc.report.circuit import CircuitReport
        from ann_dc.solution.solution import units_of

        with arithmetic_of(*subject.values()):
            models = chosen(network).at(stands)
            if files.bom is not None:
                check_level(models)
            if build.full_scale is not None:
                models = replace(models, full_scale=build.full_scale)
            backend = circuit_backend(
                network,
                models,
                duration=given.duration,
                bandwidth_margin=build.bandwidth_margin,
                seed=build.seed,
                series=series,
                progress=progress,
            )
            if board.asked:
                report = board.report(subject, network, backend, place, study.samples)
            else:
                found = study_circuit(
                    network,
                    backend,
                    items=study.error_budget,
                    samples=study.samples or 0,
                    loops=study.loops,
                    simulated=simulated,
                    units={} if declared is None else units_of(declared, network),
                )
                report = CircuitReport(problem=declared, backend=backend, found=found)
        tables, written = report.tables(), report.write(**files.given())
    finish(tables, written, quiet=quiet, code=0 if report.good else 1)


def _saved(problem: ProblemOptions, build: BuildOptions, given: NetworkOptions):
    """Return the network of a file, with its inputs."""
    check_duration(given.duration)
    return given.applied_to(unchanged_network(problem, build.preconditioner))


def _designed(
    problem: ProblemOptions,
    build: BuildOptions,
    given: NetworkOptions,
    simulated: bool,
    progress: Progress,
):
    """Return a problem and its designed network.

    Raises `ProblemError` for options of a network in a file.
    """
    named = {"--duration": given.duration, "--input": given.inputs}
    for name, value in named.items():
        if value is not None:
            raise ProblemError(
                f"{name}: belongs to a network in a file; omit it, or save the network (ann-dc "
                f"solve {problem.problem} --save DIR): ann-dc circuit DIR {name} ..."
            )
    declared, kind = problem.declared(), preconditioner_of(build.preconditioner)

    from ann_dc.cli.arguments.building import network_to_build

    with arithmetic_of(declared.name):
        return declared, network_to_build(declared, kind, simulated=simulated, progress=progress)


def _of_one_circuit(
    build: BuildOptions,
    study: StudyOptions,
    files: CircuitFiles,
    board: BoardOptions,
    given: NetworkOptions,
) -> dict:
    """Return the options that apply to the construction of one circuit only."""
    rest = {name: file for name, file in files.given().items() if name != "json_file"}
    return {
        "error-budget": study.error_budget,
        "samples": 0 if board.draws else study.samples,
        "loops": study.loops,
        "seed": build.seed is not None and not board.takes_seed,
        "no-simulate": not study.simulated,
        "duration": given.duration,
        **rest,
    }
