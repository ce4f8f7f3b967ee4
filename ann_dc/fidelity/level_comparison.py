"""The ladder report: one problem at every level of fidelity, prediction beside measurement.

Every rung is told by two figures: the error of its settled controls against the optimum, over the
largest control, and the time to settle within 0.1 %. Rungs with one defect alone say which of them
costs what; presets have all of them at once. What is computed digitally stands
beside them: the ODE and the recurrent layer first, solvers on this CPU last.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.settling import control_settling
from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.backends.trajectory import Trajectory, control_values
from ann_dc.errors import NetworkError, SpiceError
from ann_dc.evaluation.rules import size_of
from ann_dc.fidelity.fitting import fitting_intervals
from ann_dc.fidelity.model_level import Group, Rung, rungs
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.cost import Cost, cost_of
from ann_dc.hardware.circuit.deviations import Deviations
from ann_dc.hardware.circuit.loads import load_power
from ann_dc.hardware.parts.levels import Level, macro
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Kind
from ann_dc.optimality.reference_solvers import SolverTiming
from ann_dc.progress import Progress, silent
from ann_dc.validation.checked import checked

NAN = float("nan")


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """What a rung did, and what the emulator had predicted; nan where there is no figure.

    Attributes
    ----------
    name : str
        Of the rung.
    group : Group
        What it is one of.
    level : Level or None
        None where nothing is built.
    error, predicted_error : float
        Of the settled controls, over the largest one.
    settling, predicted_settling : float
        Seconds to 0.1 %.
    wall : float
        Seconds that ngspice took, with its process.
    run : CircuitRun or None
        In ngspice, where it came to an end.
    circuit : Circuit or None
        What was built.
    why : str
        What went wrong, where something did.
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
        """Watts; nan where nothing was simulated, or the level's parts do not say."""
        return NAN if self._cost is None else self._cost.power

    @property
    def energy(self) -> float:
        """Joules a solve."""
        return NAN if self._cost is None else self._cost.energy

    @property
    def _cost(self) -> Cost | None:
        if self.run is None or self.level is None or self.circuit is None:
            return None
        loads = load_power(self.circuit, self.level, self.run.trajectory.final)
        return cost_of(self.run.deck.parts, self.level.datasheet, self.settling, loads)


@checked
def quick(rung: Rung) -> bool:
    """Whether ngspice needs seconds only; the switched capacitors of a car take minutes.

    Examples
    --------
    >>> from ann_dc.fidelity import Rung, quick
    >>> from ann_dc.hardware.parts import switched_capacitor
    >>> quick(Rung(name="switched capacitors", level=switched_capacitor(step=0.1), slow=True))
    False
    """
    return not rung.slow


@checked
def climb(
    network: Network,
    ladder: Ladder | None = None,
    *,
    seed: int = 1,
    wanted: Callable[[Rung], bool] = quick,
    timings: Iterable[SolverTiming] = (),
) -> Iterator[Measured]:
    """The whole report, rung by rung: what is computed digitally, circuits, solvers on this CPU.

    Parameters
    ----------
    network : Network
        One problem's; it has to settle.
    ladder : Ladder, optional
        Runs the circuits.
    seed : int
        Of the errors of single parts.
    wanted : callable
        Which circuits to build, of those that `rungs` lists.
    timings : iterable of SolverTiming
        Of solvers beside it; see `ann_dc.optimality.time_solvers`.

    Yields
    ------
    Measured
        A rung that fails says why, and the others go on.

    Raises
    ------
    NetworkError
        If the network does not settle.
    NgspiceMissing
        If there is no ngspice to run the first circuit with.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity import climb
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, kinds=[ann_dc.Kind.TIME_CONSTANTS]).network
    >>> first = next(climb(network))
    >>> first.name, first.group.value, first.error < 1e-6
    ('ODE', 'computed digitally', True)
    >>> for measured in climb(network):  # doctest: +SKIP
    ...     print(measured.name, measured.error, measured.settling)
    """
    ladder = ladder or Ladder()
    first, probe = ode_rung(network)
    yield first
    ladder.progress("recurrent layer")
    yield recurrent_rung(network, probe)
    yield from ladder.run(network, filter(wanted, rungs(network, probe, seed=seed)))
    yield from map(_cpu_rung, timings)


@checked
def ode_rung(network: Network) -> tuple[Measured, Trajectory]:
    """The ladder's foot: the ODE in the time scale of 10 MHz op amps.

    Returns
    -------
    measured : Measured
    probe : Trajectory
        Its run.

    Raises
    ------
    NetworkError
        If the network does not settle.
    """
    circuit, probe = SpiceBackend(level=macro()).prepare(network)
    first = Measured(
        name="ODE",
        group=Group.DIGITAL,
        error=_distance(probe.network, probe, probe.final),
        settling=control_settling(probe) * circuit.scaling.time,
    )
    return first, probe


@checked
def recurrent_rung(network: Network, probe: Trajectory) -> Measured:
    """The recurrent layer with adaptive steps; it has steps, and no seconds.

    Parameters
    ----------
    network : Network
    probe : Trajectory
        Its run in continuous time, near whose end the error is measured.
    """
    try:
        run = RecurrentBackend().run(network)
    except ImportError as error:  # a wiring without code of its own, and no torch
        return Measured(name="recurrent layer", group=Group.DIGITAL, why=str(error))
    name = f"recurrent layer, {run.settling_steps} steps"
    error = _distance(network, probe, run.trajectory.final)
    return Measured(name=name, group=Group.DIGITAL, error=error)


def _cpu_rung(timing: SolverTiming) -> Measured:
    name = f"{timing.name} on this CPU"
    return Measured(name=name, group=Group.DIGITAL, settling=timing.seconds)


def _distance(network: Network, probe: Trajectory, x: np.ndarray) -> float:
    """Return the error of the controls at a state, relative to the equilibrium's."""
    wanted = control_values(probe.network, equilibrium(probe.network, probe.final))
    off = np.abs(control_values(network, x) - wanted).max()
    return float(off / size_of(wanted, probe.control_reach))


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Ladder:
    """Runs rungs.

    Attributes
    ----------
    simulator : Ngspice, optional
        One with the patience of every level where none is given.
    margin : float, optional
        k: op-amp bandwidth over the network's fastest mode; what suits each rung where none is
        given.
    progress : Progress
    """

    simulator: Ngspice | None = None
    margin: float | None = None
    progress: Progress = silent

    @checked
    def run(self, network: Network, steps: Iterable[Rung]) -> Iterator[Measured]:
        """Predict and measure one rung after the other; one that fails says why.

        Parameters
        ----------
        network : Network
        steps : iterable of Rung
            Taken one by one, as their results are asked for.

        Yields
        ------
        Measured

        Raises
        ------
        NgspiceMissing
            If there is no ngspice to run the first circuit with.
        """
        for rung in steps:
            self.progress(rung.name)
            yield self._measured(network, rung)

    def _measured(self, network: Network, rung: Rung) -> Measured:
        backend = SpiceBackend(
            level=rung.level,
            simulator=self.simulator,
            margin=self.margin,
            seed=rung.seed,
            series=rung.series,
            require_stable=False,
        )
        done = Measured(name=rung.name, group=rung.group, level=rung.level)
        try:
            if network.metric.kind is not Kind.TIME_CONSTANTS and rung.level.emulated:
                backend = replace(backend, intervals=fitting_intervals(backend, network))
            circuit, probe = backend.prepare(network)
            deviations = backend.deviations(circuit)
        except NetworkError as error:
            return replace(done, why=str(error))
        done = _predicted(replace(done, circuit=circuit), backend, probe, deviations)
        return _simulated(done, backend, probe, deviations)


def _predicted(
    done: Measured, backend: SpiceBackend, probe: Trajectory, deviations: Deviations
) -> Measured:
    assert done.circuit is not None
    if not (backend.level.emulated or backend.level.technology.clocked):
        return done
    try:
        found = predict(done.circuit, backend.level, probe, deviations)
    except NetworkError as error:
        return replace(done, why=str(error))
    if not found.stable:
        return replace(done, why="the pole model says that it oscillates")
    return replace(
        done, predicted_error=found.control_error, predicted_settling=found.settling_time
    )


def _simulated(
    done: Measured, backend: SpiceBackend, probe: Trajectory, deviations: Deviations
) -> Measured:
    assert done.circuit is not None
    began = clock.monotonic()
    try:
        run = simulate(backend, done.circuit, probe, deviations).timed
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
