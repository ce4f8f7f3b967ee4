"""``ann-dc circuit``: the network as a circuit, predicted, simulated by ngspice, and priced."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ann_dc.cli.files import make_room, write_json
from ann_dc.cli.ladder import climb
from ann_dc.cli.levels import LADDER, level_of, series_of
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
from ann_dc.cli.terminal import console, list_files, progress_line, table
from ann_dc.errors import ProblemError
from ann_dc.whole_files import write_whole

if TYPE_CHECKING:
    from ann_dc.backends.run import Trajectory
    from ann_dc.backends.spice.backend import CircuitRun, SpiceBackend
    from ann_dc.backends.spice.prediction import Prediction
    from ann_dc.certificate import Certificate
    from ann_dc.network.budget import Item
    from ann_dc.network.components import Components
    from ann_dc.network.e_series import Series
    from ann_dc.network.network import Network
    from ann_dc.problem.declaration import OptimalControlProblem

NEAR = 1e-2
"""Error of the controls, over the largest one, up to which a circuit has found the optimum."""


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
        float,
        typer.Option(
            metavar="K", help="How much faster than the network's fastest mode the op amps are."
        ),
    ] = 10.0,
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
            help="Take resistors from exact, E24, E96, E24-pairs or E96-pairs (two in series).",
        ),
    ] = "exact",
    coordinators: Annotated[
        bool,
        typer.Option(
            help="Wire coarse coordinators: faster at long horizons, for twice the op amps and a "
            "larger --margin (30)."
        ),
    ] = False,
    budget: Annotated[
        int,
        typer.Option(metavar="COUNT", min=0, help="List the parts whose errors cost most."),
    ] = 0,
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
        if level.lower() == LADDER:
            _refuse_with_ladder({"--deck": deck, "--bill": bill, "--a0": a0, "--gbw": gbw})
            with arithmetic_of(declared):
                network = _designed(declared, coordinators, progress)
                report, written = climb(
                    declared, network, margin, seed, slow, figure, json_file, progress
                )
            code = 0
        else:
            chosen = level_of(level, a0, gbw)
            snapping = series_of(resistors)
            with arithmetic_of(declared):
                network = _designed(declared, coordinators, progress)
                models = chosen(network)
                if full_scale is not None:
                    models = replace(models, full_scale=full_scale)
                from ann_dc.backends.spice.backend import SpiceBackend

                backend = SpiceBackend(level=models, margin=margin, seed=seed, progress=progress)
                built = _built(declared, network, backend, snapping, budget)
            report, code = built.rows(), 0 if built.near else 1
            written = _write(built, deck, bill, figure, json_file)
    shown = console(quiet=quiet)
    for part in report if isinstance(report, list) else [report]:
        shown.print(part)
    list_files(written, quiet=quiet)
    raise typer.Exit(code)


def _refuse_with_ladder(given: dict[str, object]) -> None:
    for option, value in given.items():
        if value is not None:
            raise ProblemError(f"{option}: belongs to one level; leave it out with --level ladder")


def _designed(
    problem: OptimalControlProblem, coordinators: bool, progress: Callable[[str], None]
) -> Network:
    from ann_dc.backends.spice.process import find_ngspice
    from ann_dc.network.design import design
    from ann_dc.network.gains import WITHOUT_COORDINATORS
    from ann_dc.network.synthesis import synthesize

    find_ngspice()  # before the design: what is missing is told at once
    recipe = None if coordinators else WITHOUT_COORDINATORS
    designed = design(synthesize(problem), recipe=recipe, progress=progress)
    if not designed.settled:
        raise ProblemError(
            f"{problem.name}: the design did not settle in {designed.first.steps} steps, so there "
            "is nothing to build; check that the target is within reach"
        )
    return designed.network


@dataclass(frozen=True, kw_only=True, eq=False)
class _Built:
    """A circuit that was simulated, and all that is told of it."""

    problem: OptimalControlProblem
    backend: SpiceBackend
    made: Components
    run: CircuitRun
    proof: Certificate
    prediction: Prediction | None
    series: Series
    snapping: float
    noise: float
    items: tuple[Item, ...]

    @property
    def near(self) -> bool:
        """Whether the circuit settled near the optimum."""
        return self.run.settled() and self.run.control_error < NEAR

    def rows(self) -> list:
        """What is printed."""
        run, scaling, level = self.run, self.run.scaling, self.backend.level
        parts = ", ".join(f"{count} {name}" for name, count in run.deck.parts.items())
        rows = {
            "problem": self.problem,
            "level": level.name + self._hardware(),
            "parts": parts + self._power(),
            "scaling": f"{scaling.full_scale:g} V full scale, {run.deck.timing.unit:.3g} s a unit "
            f"of network time; tightest node {scaling.tightest} at "
            f"{scaling.used(scaling.tightest):.0%}",
            "settled": verdict_text(
                run.settled(),
                f"controls within 0.1 % after {run.settling_time() * 1e6:.4g} us"
                if run.settled()
                else "the controls still move at the end of the run",
            ),
            "error of controls": f"{run.control_error:.2e} of the largest one, against the ODE",
            "trajectory": f"normalised mean square error {run.mean_square_error:.1e}, against "
            "the ODE",
            "predicted": self._predicted(),
            "objective": f"{self.proof.objective:.8g}, KKT residual {self.proof.kkt_residual:.1e}",
            "overload": "; ".join(map(str, run.overloads[:3])) or "none",
        }
        if self.noise == self.noise:
            rows["noise"] = f"{self.noise:.1e} of the largest control rms, of resistors at 300 K"
        if self.series.mantissas:
            rows["resistors"] = (
                f"{self.series.name}: off by up to {self.snapping:.2%}, the same in every cell"
            )
        return [named_rows(rows), *([_budget_table(self.items)] if self.items else [])]

    def _hardware(self) -> str:
        values = self.backend.level.parameters
        told = ", ".join(f"{name} {value:g}" for name, value in sorted(values.items()))
        seeded = "" if self.backend.seed is None else f"; parts drawn with seed {self.backend.seed}"
        return (f" ({told})" if told else "") + seeded

    def _power(self) -> str:
        from ann_dc.backends.spice.parts import cost

        run = self.run
        found = cost(run.deck.parts, self.backend.level.hardware, run.settling_time())
        if not found.power > 0:
            return ""
        return f"; {found.power:.3g} W, {found.energy * 1e6:.3g} uJ a solve"

    def _predicted(self) -> str:
        told = self.prediction
        if told is None:
            return "nothing: this level has no emulation"
        return (
            f"error {told.control_error:.2e}, within 0.1 % after "
            f"{told.settling_time * 1e6:.4g} us, slowest pole {told.spectrum.abscissa:+.3g} per "
            "unit of network time"
        )

    def as_dict(self) -> dict:
        """For the JSON file."""
        run, level = self.run, self.backend.level
        return {
            "problem": self.problem.name,
            "level": level.name,
            "parameters": level.parameters,
            "seed": self.backend.seed,
            "resistors": self.series.name,
            "parts": run.deck.parts,
            "full_scale": run.scaling.full_scale,
            "seconds_per_unit": run.deck.timing.unit,
            "settled": run.settled(),
            "settling_time": run.settling_time(),
            "control_error": run.control_error,
            "mean_square_error": run.mean_square_error,
            "predicted": None
            if self.prediction is None
            else {
                "control_error": self.prediction.control_error,
                "settling_time": self.prediction.settling_time,
            },
            "objective": self.proof.objective,
            "kkt_residual": self.proof.kkt_residual,
            "noise": self.noise,
            "overloads": [str(overload) for overload in run.overloads],
            "budget": [
                {
                    "parameter": item.parameter.name,
                    "told": item.parameter.told,
                    "size": item.size,
                    "unit": item.parameter.kind.unit,
                    "error": item.error,
                    "share_of_variance": item.share,
                }
                for item in self.items
            ],
        }


def _built(
    problem: OptimalControlProblem,
    network: Network,
    backend: SpiceBackend,
    series: Series,
    count: int,
) -> _Built:
    from ann_dc.backends.spice.backend import simulate
    from ann_dc.backends.spice.prediction import is_emulated, predict
    from ann_dc.network.e_series import snapped
    from ann_dc.solution import certificate_of

    made, probe = backend.prepare(network)
    items = _items(backend, made, probe)[:count] if count else ()
    off = snapped(made, series)
    deviations = {**backend.deviations(made)}
    for name, values in off.items():
        deviations[name] = (1 + values) * (1 + deviations.get(name, 0.0)) - 1
    run = simulate(backend, made, probe, deviations)
    prediction, noise = None, float("nan")
    if is_emulated(made, backend.level):
        backend.tell("prediction")
        prediction = predict(made, backend.level, probe, deviations)
        noise = _noise(backend, made, probe)
    return _Built(
        problem=problem,
        backend=backend,
        made=made,
        run=run,
        proof=certificate_of(problem, network, run.trajectory.final),
        prediction=prediction,
        series=series,
        snapping=max((float(abs(v).max()) for v in off.values()), default=0.0),
        noise=noise,
        items=items,
    )


def _at_rest(backend: SpiceBackend, made: Components, probe: Trajectory):
    """The emulation of the circuit as it should be, and where it settles."""
    from ann_dc.network.emulation import emulated_state
    from ann_dc.network.sensitivity import equilibrium

    emulation = backend.level.emulate(made, {})
    return emulation, equilibrium(emulation.network, emulated_state(emulation, probe.final))


def _items(backend: SpiceBackend, made: Components, probe: Trajectory) -> tuple[Item, ...]:
    from ann_dc.network.budget import TYPICAL, budget, sensitivity
    from ann_dc.network.hardware import Spread

    spread = backend.level.hardware.spread
    found = sensitivity(*_at_rest(backend, made, probe))
    return budget(found, TYPICAL if spread == Spread() else spread)


def _noise(backend: SpiceBackend, made: Components, probe: Trajectory) -> float:
    """Rms of the worst control over the largest one; nan where it is not known."""
    from ann_dc.backends.noisy import settled_noise
    from ann_dc.network.noise import Noise

    if made.schematic.differential:
        return float("nan")
    emulation, x = _at_rest(backend, made, probe)
    network = emulation.network
    controls = network.of_population("u")
    rms = network.user_units(settled_noise(emulation, x, Noise(step=1.0)))[controls]
    return float(abs(rms).max() / abs(network.user_units(x)[controls]).max())


def _budget_table(items: tuple[Item, ...]):
    shown = table("part", "what", "assumed", "error of controls", "share", dense=True)
    shown.title = "what costs most (standard deviations, each part in all cells)"
    for item in items:
        size = f"{item.size * 1e3:g} mV" if item.parameter.kind.unit == "V" else f"{item.size:.2%}"
        shown.add_row(
            item.parameter.name,
            item.parameter.told,
            size,
            f"{item.error:.2e}",
            f"{item.share:.1%}",
        )
    return shown


def _write(
    built: _Built,
    deck: Path | None,
    bill: Path | None,
    figure: Path | None,
    json_file: Path | None,
) -> list[Path]:
    written = []
    if deck is not None:
        write_whole(deck, built.run.deck.text.encode("utf-8"))
        written.append(deck)
    if bill is not None:
        from ann_dc.backends.spice.bill import bill_of

        write_whole(bill, bill_of(built.made, built.series).encode("utf-8"))
        written.append(bill)
    if figure is not None:
        from ann_dc import plotting

        written.append(plotting.save(plotting.circuit(built.run, built.problem.name), figure))
    if json_file is not None:
        write_json(json_file, built.as_dict())
        written.append(json_file)
    return written
