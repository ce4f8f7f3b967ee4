"""The command line: `ann-dc solve`, `show`, `plants`, `paper`.

Words that a user types become objects in one place (`named`, `_problem` and the tables around
them); from there on a command is a few calls of the library and one table. What goes wrong is
caught in one place too (`_Commands`), and told in a sentence.

Exit codes: 0 settled and certified (or shown), 1 ran but did not settle or is not certified,
2 bad input or unwritable output, 130 interrupted.

The library is imported inside the commands, so that ``ann-dc --help`` answers at once.
"""

from __future__ import annotations

import contextlib
import difflib
import inspect
import io
import json
import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text
from typer.core import TyperGroup

from ann_dc.errors import AnnDcError, OutputError, ProblemError, UnknownNameError

if TYPE_CHECKING:
    from ann_dc.backends.ode import OdeBackend
    from ann_dc.decomposition.form import Form
    from ann_dc.network.cell import Block
    from ann_dc.network.network import Network
    from ann_dc.problem.declaration import OptimalControlProblem
    from ann_dc.problem.start import Start
    from ann_dc.solution import Solution

    Plant = Callable[..., OptimalControlProblem]

CERTIFIED = 1e-8
"""Relative KKT residual below which a settled point counts as certified."""

Thing = TypeVar("Thing")


# ---- the application ---------------------------------------------------------------------------


class _Commands(TyperGroup):
    """The one place where an error becomes a sentence and an exit code."""

    def invoke(self, ctx):
        try:
            return super().invoke(ctx)
        except BrokenPipeError:  # `ann-dc show car | head`: typer ends quietly
            raise
        except KeyboardInterrupt:
            raise typer.Exit(130) from None
        except (AnnDcError, OSError) as error:
            message = Text.assemble(("error: ", "bold red"), _sentence(error))
            _console(stderr=True).print(message, soft_wrap=True)
            raise typer.Exit(2) from None


app = typer.Typer(
    cls=_Commands,
    help="Optimal control on an analog neural network: declare a problem, let the network settle, "
    "get a certified optimum.",
    epilog="Start with:  ann-dc plants,  ann-dc solve car,  ann-dc show car",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main() -> None:
    """Entry point of ``ann-dc`` and of ``python -m ann_dc``."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a letter that cannot be shown becomes `?`
            stream.reconfigure(errors="replace")
    app(prog_name="ann-dc")


def _show_version(wanted: bool) -> None:
    if wanted:
        from ann_dc import __version__

        typer.echo(f"ann-dc {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    pass


def _sentence(error: Exception) -> str:
    if isinstance(error, OSError) and not isinstance(error, AnnDcError) and error.strerror:
        return f"{error.filename or 'output'}: {error.strerror}; choose another place"
    return " ".join(str(error).split())


# ---- options that commands share ---------------------------------------------------------------

ProblemArgument = Annotated[
    str,
    typer.Argument(metavar="PROBLEM", help="Name of a plant (see: ann-dc plants) or a .toml file."),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Change a parameter of the plant: a number, or numbers with commas (D=0.5, "
        "q_d=5,5,0,free). In a .toml problem: q_0, q_d, horizon, dt. Repeatable.",
    ),
]
HorizonOption = Annotated[
    int | None, typer.Option("--horizon", "-N", help="Number of stages N, each of dt seconds.")
]
StartStateOption = Annotated[
    str | None,
    typer.Option("--q-0", metavar="NUMBERS", help="State at the start, one number a component."),
]
TargetOption = Annotated[
    str | None,
    typer.Option(
        "--q-d", metavar="NUMBERS", help="State at the end; 'free' leaves a component open."
    ),
]
FormOption = Annotated[
    str,
    typer.Option(
        metavar="FORM",
        help="Equations: corrected, printed (as in the paper), or one slip of it, S1 to S16.",
    ),
]


# ---- words become objects ----------------------------------------------------------------------


def named(option: str, word: str, table: Mapping[str, Thing]) -> Thing:
    """Look up what a word stands for, in upper or lower case.

    >>> named("--colour", "RED", {"red": 1})
    1

    Raises
    ------
    UnknownNameError
        With the words that exist.
    """
    for name, thing in table.items():
        if name.lower() == word.lower():
            return thing
    raise UnknownNameError.of(option, word, table)


def _form(word: str) -> Form:
    from ann_dc.decomposition.form import CORRECTED, PRINTED, SWITCHES

    return named("--form", word, {"corrected": CORRECTED, "printed": PRINTED, **SWITCHES})


def _start(word: str, seed: int, problem: OptimalControlProblem) -> Start:
    from ann_dc.problem.start import line_start, random_start, zero_start

    kinds: dict[str, Callable[[OptimalControlProblem], Start]] = {
        "line": line_start,
        "zero": zero_start,
        "random": partial(random_start, rng=seed),
    }
    return named("--start", word, kinds)(problem)


def _backend(word: str, **settings: Any) -> OdeBackend:
    from ann_dc.backends.ode import METHODS, OdeBackend

    backend = named("--backend", word, {"ode": OdeBackend})
    method = named("--method", settings.pop("method"), METHODS)
    if not 0 < settings["limit"] < math.inf:
        raise ProblemError(f"--limit: expected a positive number, got {settings['limit']!r}")
    return backend(method=method, **settings)


def _problem(
    word: str, given: Sequence[str], horizon: int | None, q_0: str | None, q_d: str | None
) -> OptimalControlProblem:
    """The problem that PROBLEM, --set, --horizon, --q-0 and --q-d describe."""
    from ann_dc.problem import plants

    short = {"N": horizon, "q_0": q_0, "q_d": q_d}
    settings = _settings([*given, *(f"{n}={v}" for n, v in short.items() if v is not None)])
    is_file = word.lower().endswith(".toml") or os.sep in word or Path(word).is_file()
    if is_file and word not in plants.names():
        return _from_file(word, settings)
    return _declared(_plant(word), settings)


def _plant(word: str) -> Plant:
    """The plant of this name, or an error with the names nearest to it."""
    from ann_dc.problem import plants

    if word in plants.names():
        return plants.get(word)
    near = difflib.get_close_matches(word.lower(), plants.names(), n=2, cutoff=0.5)
    hint = f"; did you mean {' or '.join(near)}?" if near else "."
    raise UnknownNameError(
        f"there is no plant {word!r}{hint} The plants are {', '.join(plants.names())}. "
        "A problem of your own goes into a .toml file"
    )


def _declared(plant: Plant, settings: Mapping[str, str]) -> OptimalControlProblem:
    """A plant's problem with some of its parameters changed."""
    defaults = _defaults(plant)
    values = {}
    for name, text in settings.items():
        if name not in defaults:
            raise UnknownNameError.of(f"--set: parameter of {plant.__name__}", name, defaults)
        values[name] = _value(name, text, defaults[name])
    try:
        return plant(**values)
    except (ArithmeticError, TypeError, ValueError) as error:  # a wheel base of 0, a seed of -1
        given = ", ".join(f"{name}={text}" for name, text in settings.items())
        raise ProblemError(f"{plant.__name__} with {given}: {error}") from error


def _from_file(path: str, settings: Mapping[str, str]) -> OptimalControlProblem:
    from ann_dc.problem.files import load_problem

    problem = load_problem(path)
    like = {"N": problem.horizon, "q_0": problem.q_0, "q_d": problem.q_d, "dt": problem.dt}
    values = {}
    for name, text in settings.items():
        if name not in like:
            known = ["q_0", "q_d", "horizon", "dt"]
            raise UnknownNameError(
                f"--set: {name!r} cannot be set from here for a file; choose one of: "
                f"{', '.join(known)}, or edit {path}"
            )
        values[name] = _value(name, text, like[name])
    if "N" in values:
        problem = problem.with_horizon(values.pop("N"))
    return replace(problem, **values)


def _defaults(plant: Plant) -> dict[str, Any]:
    return {p.name: p.default for p in inspect.signature(plant).parameters.values()}


def _settings(given: Iterable[str]) -> dict[str, str]:
    """``["D=0.5", "horizon=18"]`` as a table; horizon is another word for N."""
    settings: dict[str, str] = {}
    for item in given:
        name, equals, text = (part.strip() for part in item.partition("="))
        if not (name and equals and text):
            raise ProblemError(
                f"--set: expected NAME=VALUE, for instance D=0.5 or q_d=5,5,0,free, got {item!r}"
            )
        name = "N" if name == "horizon" else name
        if name in settings:
            raise ProblemError(f"{name}: given twice ({settings[name]} and {text}); give it once")
        settings[name] = text
    return settings


def _value(name: str, text: str, like: Any) -> Any:
    """A parameter's value from its text, of the same kind as its default; nothing is evaluated."""
    if isinstance(like, (tuple, list)) or like is None:
        if name == "q_d" and text.lower() == "free":
            return None
        words = [word.strip() for word in text.strip("()[]").split(",")]
        is_free = lambda word: name == "q_d" and word.lower() == "free"  # noqa: E731
        values = tuple(None if is_free(word) else _number(name, word) for word in words)
        if like is not None and len(values) != len(like):
            raise ProblemError(
                f"{name}: expected {len(like)} numbers separated by commas, got {text!r}"
            )
        return values
    if not isinstance(like, int):
        return _number(name, text)
    if not re.fullmatch(r"[+-]?\d{1,18}", text):
        raise ProblemError(f"{name}: expected a whole number, got {text!r}")
    return int(text)


def _number(name: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        allowed = "a finite number, or free" if name == "q_d" else "a finite number"
        raise ProblemError(f"{name}: expected {allowed}, got {text!r}; decimals take a point")
    return number


# ---- solve -------------------------------------------------------------------------------------


@app.command()
def solve(
    problem: ProblemArgument,
    settings: SetOption = None,
    horizon: HorizonOption = None,
    q_0: StartStateOption = None,
    q_d: TargetOption = None,
    backend: Annotated[str, typer.Option(metavar="BACKEND", help="How it runs: ode.")] = "ode",
    method: Annotated[
        str,
        typer.Option(
            metavar="METHOD", help="Integrator: RK23, RK45, DOP853, Radau, BDF, LSODA (SciPy)."
        ),
    ] = "RK45",
    form: FormOption = "corrected",
    start: Annotated[
        str,
        typer.Option(
            metavar="START", help="Initial neurons: line (from q_0 to q_d), zero, random."
        ),
    ] = "line",
    seed: Annotated[int, typer.Option(min=0, help="Seed of --start random.")] = 0,
    refine: Annotated[
        bool, typer.Option("--refine", help="Search for faster gains: seconds more.")
    ] = False,
    verify: Annotated[
        bool, typer.Option(help="Run twice, the second time at 100 times tighter tolerances.")
    ] = True,
    limit: Annotated[
        float, typer.Option(help="Longest run, in fastest time constants of the network.")
    ] = 20_000.0,
    plot: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the figures into this folder.")
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write the result as JSON.")
    ] = None,
    save: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the frozen network (.npz).")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")] = False,
) -> None:
    """Let the network solve a problem, and check that its answer is an optimum.

    Settling is told in units of network time and in fastest time constants
    of the network: multiply the latter by the time constant of your hardware.
    dt is in seconds; states and controls are in the problem's own units.

    Examples:

      ann-dc solve car --set D=0.5 --json out/car.json
      ann-dc solve unicycle -N 30 --q-d 2,1,free --plot out
      ann-dc solve demos/pendulum.toml --method LSODA

    Exit code: 0 settled and certified, 1 not settled or not certified,
    2 bad input or unwritable output, 130 interrupted.
    """
    with _progress(quiet) as progress:
        declared = _problem(problem, settings or (), horizon, q_0, q_d)
        for file in (json_file, save):
            _make_room(file)
        if plot is not None:
            _make_folder(plot)
        solution = _solved(
            declared,
            form=_form(form),
            start=_start(start, seed, declared),
            refine=refine,
            backend=_backend(backend, method=method, limit=limit, verify=verify, progress=progress),
            progress=progress,
        )
        report = None if quiet else _report(solution)
        written = _write(solution, plot, json_file, save, progress)
    if report is not None:
        _console().print(report)
        _list_files(written)
    raise typer.Exit(0 if is_certified(solution) else 1)


def _solved(problem: OptimalControlProblem, **settings: Any) -> Solution:
    """`ann_dc.solve`, with numbers that overflow told as what they are: bad input."""
    import numpy as np

    from ann_dc.solver import solve as solve_problem

    try:
        with np.errstate(all="ignore"):  # the outcome tells, not a warning on the way
            return solve_problem(problem, **settings)
    except AnnDcError:
        raise
    except (ArithmeticError, MemoryError, ValueError) as error:
        raise ProblemError(
            f"{problem.name}: the arithmetic failed ({error}); choose units in which states and "
            "controls are near 1, or a shorter horizon"
        ) from error


def is_certified(solution: Solution) -> bool:
    """Whether a run settled to a strict local minimum with a residual below `CERTIFIED`."""
    proof = solution.certificate
    return solution.status.settled and proof.second_order and proof.kkt_residual < CERTIFIED


def _write(solution, plot, json_file, save, progress) -> list[Path]:
    written: list[Path] = []
    if plot is not None:
        from ann_dc import plotting

        progress("drawing")
        written += plotting.save_all(solution, plot)
    if json_file is not None:
        write_json(json_file, _result(solution))
        written.append(json_file)
    if save is not None:
        from ann_dc.network.files import save as save_network

        save_network(solution.network, save)
        written.append(save)
    return written


def _result(solution: Solution) -> dict:
    return {**solution.as_dict(), "certified": is_certified(solution)}


def _report(solution: Solution) -> Table:
    proof = solution.certificate
    table = Table(show_header=False)
    table.add_column(no_wrap=True, style="bold")
    table.add_column(overflow="fold")
    good = is_certified(solution)
    rows = {
        "problem": solution.problem,
        "equations": solution.equations.form,
        "status": solution.status,
        "certified": Text(
            f"{'yes' if good else 'no'}: {_verdict(solution)}", "green" if good else "red"
        ),
        "objective": f"{solution.objective:.10g}",
        "KKT residual": f"{proof.kkt_residual:.1e} (constraints {proof.constraint_residual:.1e}, "
        f"stationarity {proof.stationarity_residual:.1e})",
        "second order": f"reduced Hessian {_curvature(solution)}",
        "roll-out error": f"{solution.rollout_error:.1e}, from where the controls alone arrive "
        "to q_d",
        **_times(solution),
        **_gains(solution),
    }
    for name, value in rows.items():
        table.add_row(name, value if isinstance(value, Text) else str(value))
    return table


def _verdict(solution: Solution) -> str:
    if is_certified(solution):
        return "strict local minimum"
    if not solution.status.settled:
        return "the network did not settle"
    if not solution.certificate.second_order:
        return f"the reduced Hessian is {_curvature(solution)}"
    return f"the KKT residual is not below {CERTIFIED:g}"


def _curvature(solution: Solution) -> str:
    if math.isnan(solution.certificate.curvature):
        return "not checked"
    return ("" if solution.certificate.second_order else "NOT ") + "positive definite"


def _times(solution: Solution) -> dict[str, str]:
    units = "{:.4g} units of network time = {:.4g} fastest time constants".format
    times, design = {}, solution.design
    if solution.status.settled:
        constants = solution.settling_in_fastest_time_constants
        times["settling time"] = units(solution.settling_time, constants)
        times["verified"] = solution.run.verified
    if design is not None and design.settled:
        predicted = design.predicted_settling()
        times["predicted"] = units(predicted, predicted * design.spectrum.radius)
    return times


def _gains(solution: Solution) -> dict[str, str]:
    design, coordinators = solution.design, solution.network.coordinators
    if design is None:
        return {}
    index = design.network.neuron_index
    rho = _span([design.gains.rho[index[dual.neuron]] for dual in design.network.cell.duals])
    origin = (
        f"positive curvature needs {design.rho_star:.3g}"
        if design.settled
        else "designed where a first run stopped without settling"
    )
    return {
        "rho": f"{rho} ({origin})",
        "coordinators": "none" if coordinators is None else f"{coordinators.size()} coarse neurons",
    }


# ---- show --------------------------------------------------------------------------------------


@app.command()
def show(
    problem: ProblemArgument,
    equations: Annotated[
        bool, typer.Option("--equations", help="The equations (11)-(15) of a stage.")
    ] = False,
    cell: Annotated[
        bool, typer.Option("--cell", help="The cell: neurons, blocks and connections.")
    ] = False,
    counts: Annotated[
        bool, typer.Option("--counts", help="How many parts the network has.")
    ] = False,
    latex: Annotated[bool, typer.Option("--latex", help="The equations as LaTeX.")] = False,
    form: FormOption = "corrected",
    settings: SetOption = None,
    horizon: HorizonOption = None,
    q_0: StartStateOption = None,
    q_d: TargetOption = None,
) -> None:
    """Show what is wired for a problem: equations, cell, counts.

    Without options: the equations as text, and the counts. Time constants
    tau and weights are in network units, before gains are designed.

    Examples:

      ann-dc show car
      ann-dc show car --cell
      ann-dc show demos/pendulum.toml --latex > equations.tex
    """
    console = _console()
    with _progress() as progress:
        from ann_dc.decomposition.display import as_latex, as_text
        from ann_dc.decomposition.equations import decompose
        from ann_dc.network.synthesis import synthesize

        stage = decompose(_problem(problem, settings or (), horizon, q_0, q_d), _form(form))
        chosen = equations or cell or counts or latex
        parts: list[Any] = []
        if equations or latex or not chosen:
            progress("writing the equations")
            parts.append(as_latex(stage) if latex else as_text(stage))
        if cell or counts or not chosen:
            progress("wiring the network")
            network = synthesize(stage)
            parts += _cell_listing(network) if cell else []
            parts += [str(network)] if counts or not chosen else []
    for number, part in enumerate(parts):
        if number:
            console.print()
        console.print(part, soft_wrap=isinstance(part, str))


def _cell_listing(network: Network) -> list[Any]:
    """Neurons, blocks and ends of a cell, each with what it reads."""
    cell = network.cell
    arriving: dict[str, list[str]] = {}
    for wire in cell.connections:
        where = f"@{wire.template.name.lower()}" if wire.template else ""
        arriving.setdefault(wire.target, []).append(f"{_span(wire.weight)} {wire.source}{where}")
    neurons = _table("neuron", "role", "tau dx/ds = sum of")
    for neuron in cell.neurons:
        reads = ", ".join(arriving.get(neuron.name, ["-"]))
        neurons.add_row(neuron.name, neuron.role.value, reads)
    blocks = _table("block", "kind", "computes")
    for block in cell.blocks:
        blocks.add_row(block.name, type(block).__name__.lower(), _computes(block, arriving))
    ends = [f"{p.neuron} of cell {p.stage} is the input {p.input}" for p in network.pins]
    ends += [f"{a.neuron} of cell {a.stage} is left out" for a in network.absent]
    inputs = ", ".join(cell.inputs)
    head = f"{network.title}: {network.stages} cells, all wired like this one"
    return [head, neurons, blocks, "\n".join([f"inputs: {inputs}", "ends:", *ends])]


def _computes(block: Block, arriving: Mapping[str, list[str]]) -> str:
    from ann_dc.network.cell import Function, Product

    if isinstance(block, Product):
        return f"{block.a} times {block.b}"
    if isinstance(block, Function):
        return f"{block.function} of {block.x}"
    return ", ".join(arriving.get(block.name, ["-"]))


def _span(values: Any) -> str:
    """One number, or the range of those that differ from row to row or stage to stage."""
    each = [float(value) for value in values] if hasattr(values, "__len__") else [float(values)]
    low, high = f"{min(each):.4g}", f"{max(each):.4g}"
    return low if low == high else f"({low} .. {high})"


# ---- plants ------------------------------------------------------------------------------------

_COMMON = {
    "dt": "Sampling interval in seconds.",
    "N": "Horizon: the number of stages.",
    "q_0": "State at the start, one number a component.",
    "q_d": "State at the end; 'free' leaves a component open.",
}


@app.command()
def plants(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="A plant, to see its parameters.")
    ] = None,
) -> None:
    """List the plants that come with the package, or the parameters of one.

    Every plant is a problem that 'ann-dc solve' takes by name, and --set
    changes its parameters. dt is in seconds; other units stand with them.

    Examples:

      ann-dc plants
      ann-dc plants car
    """
    with _progress():
        from ann_dc.problem import plants as known

        if name is None:
            shown: list[Any] = [_plant_table([known.get(plant) for plant in known.names()])]
        else:
            shown = _plant_page(_plant(name))
    for part in shown:
        _console().print(part)


def _plant_table(known: Iterable[Plant]) -> Table:
    table = _table("plant", "states", "controls", "N", "dt", "what it is", dense=True)
    table.columns[0].no_wrap = True
    table.columns[1].min_width = table.columns[2].min_width = 13
    for plant in known:
        problem = plant()
        states, controls = (
            ", ".join(map(str, group)) for group in (problem.states, problem.controls)
        )
        row = (plant.__name__, states, controls, str(problem.horizon), f"{problem.dt:g}")
        table.add_row(*row, _summary(plant))
    return table


def _plant_page(plant: Plant) -> list[Any]:
    meanings = _documented(plant) | _COMMON
    table = _table("parameter", "default", "meaning")
    for parameter, default in _defaults(plant).items():
        table.add_row(parameter, _as_typed(default), meanings.get(parameter, ""))
    name, value = next(iter(_defaults(plant).items()))
    example = f"ann-dc solve {plant.__name__} --set {name}={_as_typed(value)}"
    return [_summary(plant), str(plant()), table, f"change one with --set: {example}"]


def _summary(plant: Plant) -> str:
    """The first sentence of a plant's docstring, without its mark-up."""
    paragraph = " ".join((inspect.getdoc(plant) or "").split("\n\n")[0].split())
    plain = re.sub(r",? ?:math:`[^`]*`|``", "", paragraph)
    return re.split(r"(?<=\.)\s", plain)[0]


def _documented(plant: Plant) -> dict[str, str]:
    """The numpydoc section Parameters as a table."""
    _, _, section = (inspect.getdoc(plant) or "").partition("Parameters\n----------\n")
    meanings: dict[str, str] = {}
    names: list[str] = []
    for line in section.split("\n\n")[0].splitlines():
        if not line.startswith(" "):
            names = [n.strip() for n in line.partition(" :")[0].split(",")]
            continue
        for name in names:
            text = f"{meanings.get(name, '')} {line.strip()}"
            meanings[name] = text.replace("``", "").strip()
    return meanings


def _as_typed(value: Any) -> str:
    """A value as --set takes it."""
    if isinstance(value, (tuple, list)):
        return ",".join(map(_as_typed, value))
    return "free" if value is None else f"{value:.6g}"


# ---- paper -------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class _PaperRun:
    """One row of the paper's table: a solution, or the reason why there is none."""

    label: str
    solution: Solution | None
    refusal: str = ""


@app.command()
def paper(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for results and figures.")] = (
        Path("out")
    ),
) -> None:
    """Solve the paper's car example, and show what its printed equations do.

    Four runs: the corrected network with wheel base D = 1 m and D = 0.5 m,
    the equations exactly as printed, and the corrected equations on the plain
    network (rho = 0, unit time constants). Times as in 'ann-dc solve'.
    Writes result.json and the figures of the two corrected runs.

    Example:

      ann-dc paper --out out

    Exit code: 0 if both corrected runs settle and are certified, 1 if not, 2 bad input.
    """
    result = out / "result.json"
    _make_folder(out)
    _make_room(result)
    with _progress() as progress:
        from ann_dc import plotting

        runs = list(_paper_runs(progress))
        corrected = [run.solution for run in runs[:2] if run.solution is not None]
        table = _paper_table(runs)
        written = []
        for solution, folder in zip(corrected, ("car_D1", "car_D0.5")):
            progress(f"drawing {folder}")
            written += plotting.save_all(solution, _make_folder(out / folder))
        write_json(result, {run.label: _paper_result(run) for run in runs})
    _console().print(table)
    _list_files([*written, result])
    raise typer.Exit(0 if len(corrected) == 2 and all(map(is_certified, corrected)) else 1)


def _paper_runs(progress: Callable[[str], None]) -> Iterator[_PaperRun]:
    from ann_dc.decomposition.equations import decompose
    from ann_dc.decomposition.form import PRINTED
    from ann_dc.network.design import hand_gains
    from ann_dc.network.synthesis import synthesize
    from ann_dc.problem.plants import car

    plain = hand_gains(synthesize(decompose(car())))
    kinds: dict[str, Callable[..., Solution]] = {
        "corrected D=1": partial(_solved, car()),
        "corrected D=0.5": partial(_solved, car(D=0.5)),
        "printed D=1": partial(_solved, car(), form=PRINTED),
        "plain D=1": partial(_solved, car(), gains=plain),
    }
    for label, run in kinds.items():
        try:
            solution = run(progress=lambda line, label=label: progress(f"{label}: {line}"))
        except AnnDcError as error:  # a form that no network of this kind can wire
            yield _PaperRun(label=label, solution=None, refusal=str(error))
        else:
            yield _PaperRun(label=label, solution=solution)


def _paper_table(runs: Sequence[_PaperRun]) -> Table:
    numbers = (
        "objective", "KKT\nresidual", "roll-out\nerror", "settling\ntime",
        "fastest\ntime\nconstants",
    )  # fmt: skip
    table = _table("run", "outcome", *numbers, "remark", dense=True)
    table.columns[0].max_width, table.columns[1].max_width = 9, 8
    for column in table.columns[2:7]:
        column.no_wrap, column.justify = True, "right"
    for run in runs:
        table.add_row(run.label, *_paper_row(run))
    return table


def _paper_row(run: _PaperRun) -> tuple[str, ...]:
    solution = run.solution
    if solution is None:
        return ("refused", *"-----", run.refusal)
    outcome = solution.status.outcome.name.lower().replace("_", " ")
    residuals = f"{solution.kkt_residual:.1e}", f"{solution.rollout_error:.1e}"
    if not solution.status.settled:
        where = solution.status.neuron or "above tolerance"
        return (outcome, "-", *residuals, "-", "-", f"{where} at {solution.status.time:.3g}")
    constants = solution.settling_in_fastest_time_constants
    times = f"{solution.settling_time:.1f}", f"{constants:.0f}"
    return (outcome, f"{solution.objective:.4f}", *residuals, *times, _verdict(solution))


def _paper_result(run: _PaperRun) -> dict:
    if run.solution is None:
        return {"status": "refused", "message": run.refusal}
    return _result(run.solution)


# ---- the terminal ------------------------------------------------------------------------------


def _console(*, stderr: bool = False) -> Console:
    return Console(stderr=stderr, markup=False, highlight=False, emoji=False)


def _table(*columns: str, dense: bool = False) -> Table:
    """A table; dense ones have many columns and still fit into 80 letters."""
    look = {"box": box.SIMPLE_HEAD, "show_edge": False, "padding": 0} if dense else {}
    table = Table(**look)
    for column in columns:
        table.add_column(column, overflow="fold")
    return table


@contextlib.contextmanager
def _progress(quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """A line on stderr that says what is going on, where someone is there to read it."""
    console = _console(stderr=True)
    if quiet or not console.is_terminal:
        yield lambda line: None
        return
    with console.status("starting", spinner="line") as status:
        yield lambda line: status.update(Text(line))


def _list_files(files: Iterable[Path]) -> None:
    for file in files:
        _console().print(f"wrote {file}", soft_wrap=True)


# ---- files -------------------------------------------------------------------------------------


def write_json(path: Path, content: Any) -> None:
    """Write strict JSON (no NaN, no Infinity), the whole file or nothing.

    Raises
    ------
    OutputError
        If the file cannot be written; what was there before stays.
    """
    text = json.dumps(_strict(content), indent=2, allow_nan=False) + "\n"
    if path.exists() and not path.is_file():  # /dev/stdout
        with _told(path):
            path.write_text(text, encoding="utf-8")
        return
    part = path.with_name(path.name + ".part")
    try:
        with _told(path):
            part.write_text(text, encoding="utf-8")
            part.replace(path.resolve())
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


def _strict(value: Any) -> Any:
    """Plain JSON data: numbers that JSON does not know become null."""
    if isinstance(value, Mapping):
        return {str(key): _strict(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_strict(item) for item in value]
    if hasattr(value, "item"):  # a NumPy scalar
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _make_room(file: Path | None) -> None:
    """Before a long run: the file's folder exists, and the file is no folder."""
    if file is None:
        return
    if file.is_dir():
        raise OutputError(f"{file}: is a folder; give the name of a file")
    _make_folder(file.parent)


def _make_folder(folder: Path) -> Path:
    with _told(folder):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


@contextlib.contextmanager
def _told(path: Path) -> Iterator[None]:
    """An OSError as a sentence about the path that the user gave."""
    try:
        yield
    except OSError as error:
        is_file = isinstance(error, (FileExistsError, NotADirectoryError))
        reason = "a file stands where a folder is needed" if is_file else error.strerror or error
        raise OutputError(f"{path}: cannot be written ({reason}); choose another place") from error
