"""Level comparison: one problem at every model level, predicted and measured.

The levels are the ideal circuit, single non-idealities, part sets and silicon. Every level has two
figures: the error of its settled controls against the optimum, relative to the largest control, and
the settling time to 0.1 %. Digital methods are listed for comparison: the ODE and the recurrent
layer first, solvers on this CPU last.
"""

from __future__ import annotations

import enum
import time as clock
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.spectra import stability_limit
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.settling import control_settling
from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.backends.trajectory import Trajectory, control_values
from ann_dc.errors import NetworkError, SpiceError
from ann_dc.evaluation.rules import size_of
from ann_dc.fidelity.fitting import fitting_intervals
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.cost import Cost, cost_of
from ann_dc.hardware.circuit.deviations import Deviations
from ann_dc.hardware.circuit.loads import load_power
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.datasheet import Datasheet, Tolerances
from ann_dc.hardware.parts.e_series import E96, EXACT, Series
from ann_dc.hardware.parts.levels import (
    BEHAVIOURAL,
    TRANSISTOR,
    Level,
    macro,
    ota_c,
    switched_capacitor,
)
from ann_dc.hardware.schematic.buildable import clamped_full_scale
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.optimality.reference_solvers import SolverTiming
from ann_dc.progress import Progress, silent
from ann_dc.validation import checked

SLOWEST = 0.3
"""Step of the switched-capacitor level relative to the stability limit at the settled point."""


class Group(enum.Enum):
    """Group of a level in the comparison."""

    DIGITAL = "computed digitally"
    LEVEL = "model level"
    ALONE = "one non-ideality"


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedLevel:
    """Level of the comparison, with its part errors.

    Attributes
    ----------
    seed : int or None
        Seed of the errors of single parts, drawn from the tolerances of the level.
    series : Series
        Series of the resistors.
    slow : bool
        True if ngspice needs a minute or more.
    """

    name: str
    level: Level
    group: Group = Group.LEVEL
    seed: int | None = None
    series: Series = EXACT
    slow: bool = False


@checked
def compared_levels(
    network: Network, probe: Trajectory, *, base: str = "opa192_ad734", seed: int = 1
) -> tuple[ComparedLevel, ...]:
    """Return the levels: ideal, single non-idealities, part sets and silicon.

    `network` and `probe`, its run in continuous time, give the step of switched capacitors. `base`
    names the part set whose non-idealities are listed separately. `seed` draws the errors of single
    parts. Raises `UnknownNameError` if the part set is unknown.
    """
    step = SLOWEST * stability_limit(probe.network, probe.final)
    boards = {name: clamped_full_scale(network, presets.get(name)) for name in presets.names()}
    return (
        ComparedLevel(name="behavioural", level=BEHAVIOURAL),
        ComparedLevel(name="OTA-C, tanh 30 x full scale", level=ota_c()),
        ComparedLevel(name="macro, A0 = 1e6", level=macro()),
        ComparedLevel(name="macro, fully differential", level=macro(differential=True)),
        *_alone(clamped_full_scale(network, presets.get(base)), seed),
        *(ComparedLevel(name=name, level=level, seed=seed) for name, level in boards.items()),
        ComparedLevel(
            name="switched-capacitor, A0 = 1e6",
            level=switched_capacitor(a0=1e6, step=step),
            slow=True,
        ),
        ComparedLevel(name="transistor", level=TRANSISTOR),
    )


MULTIPLIERS = ("multiplier_bandwidth", "function_bandwidth")
"""Figures of the datasheet that limit multipliers."""


def _alone(level: Level, seed: int) -> Iterator[ComparedLevel]:
    """Yield a level for every non-ideality alone, with all else ideal."""
    datasheet, tolerances = level.datasheet, level.tolerances
    figures: dict[str, tuple[str, ...]] = {
        f"gain {datasheet.a0:.0e}": ("a0",),
        f"slew {datasheet.slew * 1e-6:.0f} V/us": ("slew",),
        f"rails {datasheet.output_swing:g} V": ("output_swing",),
        f"multipliers of {datasheet.multiplier_bandwidth * 1e-6:.0f} MHz": MULTIPLIERS,
    }
    errors = {
        f"op-amp offsets {tolerances.offset * 1e6:.0f} uV": "offset",
        f"resistors {tolerances.resistor:.1%}": "resistor",
        f"multiplier gains {tolerances.gain:.1%}": "gain",
        f"multiplier offsets {tolerances.product_offset * 1e3:g} mV": "product_offset",
    }
    plain = Datasheet(a0=1e8, gbw=datasheet.gbw, tolerances=Tolerances())
    alone = ComparedLevel(
        name="E96 resistors only",
        group=Group.ALONE,
        level=replace(level, name="macro", datasheet=plain),
    )
    for name, fields in figures.items():
        parts = replace(plain, **{field: getattr(datasheet, field) for field in fields})
        yield replace(alone, name=f"{name} only", level=replace(alone.level, datasheet=parts))
    for name, field in errors.items():
        parts = replace(plain, tolerances=Tolerances(**{field: getattr(tolerances, field)}))
        lone = replace(alone.level, datasheet=parts)
        yield replace(alone, name=f"{name} only", level=lone, seed=seed)
    yield replace(alone, series=E96)


NAN = float("nan")


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """Measured and predicted result of one level; nan for a missing figure.

    Attributes
    ----------
    level, circuit, run : Level, Circuit, CircuitRun or None
        Level, built circuit and completed run in ngspice; None if nothing is built.
    error, predicted_error : float
        Error of the settled controls, relative to the largest control.
    settling, predicted_settling : float
        Settling time to 0.1 %, in seconds.
    wall : float
        Wall-clock time of ngspice in seconds, including its process.
    why : str
        Reason of a failure.
    """

    name: str
    group: Group
    level: Level | None = None
    error: float = NAN
    settling: float = NAN
    predicted_error: float = NAN
    predicted_settling: float = NAN
    wall: float = NAN
    run: CircuitRun | None = None
    circuit: Circuit | None = None
    why: str = ""

    @property
    def power(self) -> float:
        """Power in watts; nan if nothing was simulated or the datasheet has no power."""
        return NAN if self._cost is None else self._cost.power

    @property
    def energy(self) -> float:
        """Energy per solve, in joules."""
        return NAN if self._cost is None else self._cost.energy

    @property
    def _cost(self) -> Cost | None:
        if self.run is None or self.level is None or self.circuit is None:
            return None
        loads = load_power(self.circuit, self.level, self.run.trajectory.final)
        return cost_of(self.run.deck.parts, self.level.datasheet, self.settling, loads)


@checked
def quick(compared: ComparedLevel) -> bool:
    """Return True if ngspice needs only seconds.

    Switched capacitors of a car take minutes.

    Examples
    --------
    >>> from ann_dc.fidelity import quick
    >>> from ann_dc.hardware.parts import switched_capacitor
    >>> quick(ComparedLevel(name="sc", level=switched_capacitor(step=0.1), slow=True))
    False
    """
    return not compared.slow


@checked
def compare_levels(
    network: Network,
    comparison: LevelComparison | None = None,
    *,
    seed: int = 1,
    wanted: Callable[[ComparedLevel], bool] = quick,
    timings: Iterable[SolverTiming] = (),
) -> Iterator[Measured]:
    """Yield the level comparison: digital methods, circuits, solvers on this CPU.

    A failed level gives its reason, and the comparison continues. Raises `NetworkError` if the
    network does not settle, and `NgspiceMissing` if ngspice is not found for the first circuit.

    Parameters
    ----------
    network : Network
        Network of one problem, which must settle.
    ladder : Ladder, optional
        Settings of the circuit runs. Default: `LevelComparison` with its defaults.
    seed : int
        Seed of the errors of single parts. Default 1.
    wanted : callable
        Selects the circuits to build from those of `compared_levels`. Default: `quick`.
    timings : iterable of SolverTiming
        Solvers to list for comparison; see `ann_dc.optimality.time_solvers`. Default: none.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity import compare_levels
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> first = next(compare_levels(network))
    >>> first.name, first.group.value, first.error < 1e-6
    ('ODE', 'computed digitally', True)
    >>> for measured in compare_levels(network):  # doctest: +SKIP
    ...     print(measured.name, measured.error, measured.settling)
    """
    comparison = comparison or LevelComparison()
    first, probe = _ode_level(network)
    yield first
    comparison.progress("recurrent layer")
    yield _recurrent_level(network, probe)
    yield from comparison.run(network, filter(wanted, compared_levels(network, probe, seed=seed)))
    for timing in timings:
        name = f"{timing.name} on this CPU"
        yield Measured(name=name, group=Group.DIGITAL, settling=timing.seconds)


def _ode_level(network: Network) -> tuple[Measured, Trajectory]:
    """Return the result of the ODE in the time scale of 10 MHz op amps, and its run."""
    circuit, probe = SpiceBackend(level=macro()).prepare(network)
    first = Measured(
        name="ODE",
        group=Group.DIGITAL,
        error=_distance(probe.network, probe, probe.final),
        settling=control_settling(probe) * circuit.scaling.time,
    )
    return first, probe


def _recurrent_level(network: Network, probe: Trajectory) -> Measured:
    """Return the result of the recurrent layer with adaptive steps.

    The layer has steps instead of seconds. The error is measured near the end of `probe`, the run
    in continuous time.
    """
    try:
        run = RecurrentBackend().run(network)
    except ImportError as error:  # a wiring without code of its own, and no torch
        return Measured(name="recurrent layer", group=Group.DIGITAL, why=str(error))
    name = f"recurrent layer, {run.settling_steps} steps"
    error = _distance(network, probe, run.trajectory.final)
    return Measured(name=name, group=Group.DIGITAL, error=error)


def _distance(network: Network, probe: Trajectory, x: np.ndarray) -> float:
    """Return the control error at a state, relative to the size at the equilibrium."""
    wanted = control_values(probe.network, equilibrium(probe.network, probe.final))
    off = np.abs(control_values(network, x) - wanted).max()
    return float(off / size_of(wanted, probe.control_reach))


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class LevelComparison:
    """Settings for running the circuits of a level comparison.

    By default each level has a simulator with its time limit and its fitted bandwidth margin k:
    op-amp bandwidth relative to the fastest network mode.
    """

    simulator: Ngspice | None = None
    bandwidth_margin: float | None = None
    progress: Progress = silent

    def run(self, network: Network, steps: Iterable[ComparedLevel]) -> Iterator[Measured]:
        """Predict and measure the given levels in order, when their results are requested.

        A failed level gives its reason. Raises `NgspiceMissing` if ngspice is not found for the
        first circuit.
        """
        for compared in steps:
            self.progress(compared.name)
            yield self._measured(network, compared)

    def _measured(self, network: Network, compared: ComparedLevel) -> Measured:
        backend = SpiceBackend(
            level=compared.level,
            simulator=self.simulator,
            bandwidth_margin=self.bandwidth_margin,
            seed=compared.seed,
            series=compared.series,
            require_stable=False,
        )
        done = Measured(name=compared.name, group=compared.group, level=compared.level)
        try:
            if (
                network.preconditioner.kind is not PreconditionerKind.DIAGONAL
                and compared.level.emulated
            ):
                backend = replace(backend, intervals=fitting_intervals(backend, network))
            circuit, probe = backend.prepare(network)
            deviations = backend.deviations(circuit)
        except NetworkError as error:
            return replace(done, why=str(error))
        done = _predicted(replace(done, circuit=circuit), circuit, probe, deviations)
        return _simulated(done, backend, circuit, probe, deviations)


def _predicted(
    done: Measured, circuit: Circuit, probe: Trajectory, deviations: Deviations
) -> Measured:
    level = done.level
    if level is None or not (level.emulated or level.technology.clocked):
        return done
    try:
        found = predict(circuit, level, probe, deviations)
    except NetworkError as error:
        return replace(done, why=str(error))
    if not found.stable:
        return replace(done, why="the pole model predicts oscillation")
    return replace(
        done, predicted_error=found.control_error, predicted_settling=found.settling_time
    )


def _simulated(
    done: Measured,
    backend: SpiceBackend,
    circuit: Circuit,
    probe: Trajectory,
    deviations: Deviations,
) -> Measured:
    began = clock.monotonic()
    try:
        run = simulate(backend, circuit, probe, deviations).timed
    except (SpiceError, NetworkError) as error:
        return replace(done, why=str(error).splitlines()[0])
    return replace(
        done,
        error=run.control_error,
        settling=NAN if run.unsettled else run.settling_time(),
        wall=clock.monotonic() - began,
        run=run,
        why=done.why or run.unsettled,
    )
