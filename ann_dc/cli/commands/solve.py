"""``ann-dc solve``: solution of a problem by a settled and certified network."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ann_dc.cli.arguments.backends import (
    BACKENDS,
    FormOption,
    RunOptions,
    StartOptions,
    backend_of,
    form_of,
    needing_torch,
    objective_of,
    start_of,
)
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
from ann_dc.cli.arguments.saved_network import NETWORKS
from ann_dc.cli.arguments.words import (
    PreconditionersOption,
    TableOption,
    kinds_of,
    named,
    stages_of,
)
from ann_dc.cli.terminal import finish, notes, progress_line
from ann_dc.errors import OutputError, ProblemError, require_positive
from ann_dc.files import make_folder
from ann_dc.progress import Deadline, Progress, Stopped
from ann_dc.report.json_file import STDOUT, make_room, write_json
from ann_dc.timing import phase


@dataclass(frozen=True, kw_only=True)
class SolutionFiles:
    """Output files."""

    figures: FiguresOption = None
    json_file: JsonOption = None
    trajectory: TrajectoryOption = None
    weights: Path | None = option(
        "Write the network with its gains (.npz, .safetensors).", metavar="FILE"
    )
    save: Path | None = option("Write the complete solution into a new folder.", metavar="DIR")
    overwrite: bool = option(
        "Replace the saved solution in the folder of --save.", "--overwrite", default=False
    )

    def make_room(self) -> None:
        """Check before a long run that all requested files can be written.

        Raises `OutputError` otherwise.
        """
        if self.weights is not None and self.weights.suffix not in NETWORKS:
            raise OutputError(
                f"--weights: expected a name that ends in {' or '.join(NETWORKS)}, got "
                f"{str(self.weights)!r}"
            )
        make_room(self.json_file, self.weights, figures=self.figures, trajectory=self.trajectory)
        if self.save is None:
            return
        if self.save == STDOUT or self.save.suffix in NETWORKS:
            raise OutputError(
                f"--save: expected a folder, got {str(self.save)!r}; write a weight file with "
                "--weights"
            )
        from ann_dc.solution.saved_result import check_result_folder

        make_folder(self.save.parent)
        check_result_folder(self.save, overwrite=self.overwrite)


@timed
def solve(
    *,
    problem: ProblemOptions,
    backend: str = option(
        "Backend: ode (continuous time) or recurrent (discrete time).",
        default="ode",
        metavar="BACKEND",
        autocompletion=completing(lambda: BACKENDS),
    ),
    form: FormOption = "corrected",
    initial_guess: StartOptions,
    preconditioner: PreconditionersOption = None,
    refine: bool = option(
        "Search for faster gains or fewer steps (20 s).", "--refine", default=False
    ),
    time_limit: float | None = option(
        "Wall-clock limit (s); on expiry or Ctrl-C the current state is reported.",
        metavar="SECONDS",
    ),
    files: SolutionFiles,
    table: TableOption = "short",
    quiet: QuietOption = False,
    run: RunOptions,
) -> None:
    """Solve a problem with the network and certify that the result is an optimum.

    Settling times are in tau_min, the fastest time constant of the network.
    Values are in the units of the problem, which the table lists.

    Usage examples:

      ann-dc solve car --set D=0.5 --json out/car.json
      ann-dc solve unicycle -N 30 --q-d 2,1,free --figures out
      ann-dc solve car --trajectory out/car.csv --save out/car
      ann-dc solve car --backend recurrent --accelerate
      ann-dc solve pendulum --preconditioner multilevel,diagonal
      ann-dc solve unicycle_soft_obstacle --starts 64

    Exit code: 0 settled and certified, 1 not settled or not certified,
    2 bad input or unwritable output, 130 interrupted.
    """
    with notes(quiet), progress_line(quiet) as line, _deadline(line, time_limit) as progress:
        declared, rows = problem.declared(), stages_of(table)
        files.make_room()
        if initial_guess.starts is not None:
            _refuse(initial_guess, backend=backend, form=form, refine=refine, time_limit=time_limit)
            backend, run = "recurrent", _for_many(run)
        with phase("imports"):
            chosen = backend_of(backend, run, progress=progress)
        equations, neurons = form_of(form), start_of(initial_guess)

        with phase("imports"):
            from ann_dc import solver
            from ann_dc.report.solution import Stages, solution_report

        found = None
        with arithmetic_of(declared.name), needing_torch(f"--backend {backend}"):
            if initial_guess.starts is not None:
                many = initial_guess.starts, initial_guess.seed
                found = _from_many(declared, *many, preconditioner, chosen, progress)
                solution = found.solution()
            else:
                kinds = kinds_of(preconditioner, chosen.kinds)
                options = {"initial_guess": neurons(declared), "preconditioner": kinds}
                aim = objective_of(backend, run)
                gains = _refined(declared, equations, options, aim, progress) if refine else None
                settings = {"form": equations, "gains": gains, "backend": chosen}
                solution = solver.solve(declared, **settings, **options, progress=progress)
        shown = solution_report(solution, chosen, Stages(rows))
        written = _write(solution, found, files, progress)
    code = 0 if solution.status.settled and solution.certified else 1
    shown_first = [] if found is None else [str(found)]
    finish([*shown_first, shown], written, quiet=quiet, code=130 if progress.interrupted else code)


def _deadline(progress: Progress, seconds: float | None) -> Deadline:
    """Return the deadline of --time-limit, or one without a limit."""
    if seconds is not None:
        require_positive(ProblemError, **{"--time-limit": seconds})
    return Deadline(progress, float("inf") if seconds is None else seconds)


def _refined(declared, form, options: Mapping[str, Any], objective, progress: Progress):
    """Return a `Design` with refined gains, for the corrected equations of the form."""
    from ann_dc import solver
    from ann_dc.decomposition.equations import decompose

    network = solver.synthesize(
        decompose(declared, form.designable), initial_guess=options["initial_guess"]
    )
    kinds = options["preconditioner"]
    return solver.design(network, preconditioner=kinds, refine=objective, progress=progress)


def _refuse(
    start: StartOptions, *, backend: str, form: str, refine: bool, time_limit: float | None
) -> None:
    """Raise `ProblemError` for options that have no effect with --starts."""
    given = {
        "--initial-guess": start.initial_guess != "line",
        "--form": form != "corrected",
        "--refine": refine,
        "--time-limit": time_limit is not None,
    }
    for name, is_given in given.items():
        if is_given:
            raise ProblemError(f"--starts: cannot be combined with {name}; omit one of them")
    named("--backend", backend, {name: name for name in BACKENDS})


def _for_many(run: RunOptions) -> RunOptions:
    """Return the run options with the defaults of `multistart`."""
    from ann_dc.families.seeded_starts import LONGEST

    steps = LONGEST if run.max_steps is None else run.max_steps
    return replace(run, order=run.order or "two-phase", max_steps=steps)


def _from_many(declared, starts: int, seed: int, kinds: str | None, chosen, progress: Progress):
    """Return the optima that --starts finds, as a `Multistart`."""
    from ann_dc.families.many_starts import multistart

    try:
        return multistart(
            declared,
            starts,
            seed=seed,
            preconditioner=None if kinds is None else kinds_of(kinds, chosen.kinds),
            backend=chosen,
            progress=progress,
        )
    except Stopped as end:  # there is nothing to show yet
        raise KeyboardInterrupt from end


def _write(solution, found, files: SolutionFiles, progress: Progress) -> list[Path]:
    """Write the requested files; with --starts the JSON file contains every optimum."""
    from ann_dc.report.solution import write_solution

    single = files.json_file if found is None else None
    written = write_solution(
        solution,
        figures=files.figures,
        json_file=single,
        trajectory=files.trajectory,
        weights=files.weights,
        folder=files.save,
        overwrite=files.overwrite,
        progress=progress,
    )
    if found is not None and files.json_file is not None:
        write_json(files.json_file, {**solution.as_dict(), "multistart": found.as_dict()})
        written.append(files.json_file)
    return written
