"""The ladder report: one problem at every level of fidelity, prediction beside measurement.

Every rung is told by two figures: the error of its settled controls against the optimum, over the
largest control, and the time to settle within 0.1 %. Rungs with one defect alone say which of them
costs what; presets have all of them at once.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.spectra import stability_limit
from ann_dc.backends.settling import control_settling
from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.backends.trajectory import Trajectory, control_error, controls_of
from ann_dc.errors import NetworkError, SpiceError
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.cost import Cost, cost
from ann_dc.hardware.circuit.deviations import Deviations, combined, snapped
from ann_dc.hardware.emulation.emulation import is_emulated
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
from ann_dc.hardware.parts.presets import preset, presets
from ann_dc.network.network import Network

SLOWEST = 0.3
"""Step of the switched-capacitor rung over the stability limit at the settled point."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rung:
    """A level, and what is off in it.

    Attributes
    ----------
    name : str
    level : Level
    seed : int or None
        Draws the errors of single parts from the level's spread.
    series : Series or None
        Resistors are taken from it.
    slow : bool
        Whether ngspice needs a minute or more.
    """

    name: str
    level: Level
    seed: int | None = None
    series: Series | None = None
    slow: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """What a rung did, and what the emulator had predicted; nan where there is no figure.

    Attributes
    ----------
    rung : Rung
    error, predicted_error : float
        Of the settled controls, over the largest one.
    settling, predicted_settling : float
        Seconds to 0.1 %.
    wall : float
        Seconds that ngspice took, with its process.
    run : CircuitRun or None
    circuit : Circuit or None
    why : str
        What went wrong, where something did.
    """

    rung: Rung
    error: float = float("nan")
    settling: float = float("nan")
    predicted_error: float = float("nan")
    predicted_settling: float = float("nan")
    wall: float = float("nan")
    run: CircuitRun | None = None
    circuit: Circuit | None = None
    why: str = ""

    @property
    def power(self) -> float:
        """Watts; nan where the level's parts do not say."""
        return self._cost().power if self.run is not None else float("nan")

    @property
    def energy(self) -> float:
        """Joules a solve."""
        return self._cost().energy if self.run is not None else float("nan")

    def _cost(self) -> Cost:
        assert self.run is not None
        return cost(self.run.deck.parts, self.rung.level.datasheet, self.settling)


def ode_rung(network: Network) -> tuple[Measured, Trajectory]:
    """The ladder's foot, the ODE in the time scale of 10 MHz op amps, and its run."""
    circuit, probe = SpiceBackend().prepare(network)
    return (
        Measured(
            rung=Rung(name="ODE", level=BEHAVIOURAL),
            error=_distance(network, probe, probe.final),
            settling=control_settling(probe) * circuit.scaling.time,
        ),
        probe,
    )


def recurrent_rung(network: Network, probe: Trajectory) -> Measured:
    """The recurrent layer with adaptive steps; it has steps, and no seconds."""
    try:
        from ann_dc.backends.recurrent.backend import RecurrentBackend
    except ImportError:
        why = "torch is not installed (pip install 'ann_dc[torch]')"
        return Measured(rung=Rung(name="recurrent layer", level=BEHAVIOURAL), why=why)
    run = RecurrentBackend().run(network)
    name = f"recurrent layer, {run.settling_steps} steps"
    error = _distance(network, probe, run.trajectory.final)
    return Measured(rung=Rung(name=name, level=BEHAVIOURAL), error=error)


def _distance(network: Network, probe: Trajectory, x: np.ndarray) -> float:
    """Of the controls at a state from the equilibrium's, over the largest one."""
    settled = replace(probe, states=equilibrium(network, probe.final)[None])
    return control_error(controls_of(network, x), settled)


def rungs(network: Network, probe: Trajectory, *, base: str = "opa192_ad734", seed: int = 1):
    """The ladder: ideal levels, each defect of a preset alone, presets with all, silicon.

    Parameters
    ----------
    network : Network
    probe : Trajectory
        Its run in continuous time.
    base : str
        Preset whose defects are shown alone.
    seed : int
        Of the errors of single parts.

    Returns
    -------
    tuple of Rung
    """
    step = SLOWEST * stability_limit(network, probe.final)
    return (
        Rung(name="behavioural", level=BEHAVIOURAL),
        Rung(name="OTA-C, tanh 30 x full scale", level=ota_c()),
        Rung(name="macro, A0 = 1e6", level=macro()),
        Rung(name="macro, fully differential", level=macro(differential=True)),
        *_alone(preset(base), seed),
        *(Rung(name=name, level=level, seed=seed) for name, level in presets().items()),
        Rung(
            name="switched-capacitor, A0 = 1e6",
            level=switched_capacitor(a0=1e6, step=step),
            slow=True,
        ),
        Rung(name="transistor", level=TRANSISTOR),
    )


def _alone(level: Level, seed: int) -> Iterator[Rung]:
    """Every defect of a level by itself, all else ideal."""
    datasheet, tolerances = level.datasheet, level.datasheet.tolerances

    def rung(told: str, *, errors: Tolerances | None = None, series=None, **given) -> Rung:
        parts = Datasheet(
            **({"a0": 1e8, "gbw": datasheet.gbw} | given), tolerances=errors or Tolerances()
        )
        return Rung(
            name=f"  {told}",
            level=replace(level, name="macro", datasheet=parts),
            seed=seed if errors else None,
            series=series,
        )

    yield rung(f"gain {datasheet.a0:.0e} alone", a0=datasheet.a0)
    yield rung(f"slew {datasheet.slew * 1e-6:.0f} V/us alone", slew=datasheet.slew)
    yield rung(f"rails {datasheet.rails:g} V alone", rails=datasheet.rails)
    yield rung(
        f"multipliers of {datasheet.multiplier_bandwidth * 1e-6:.0f} MHz alone",
        multiplier_bandwidth=datasheet.multiplier_bandwidth,
        function_bandwidth=datasheet.function_bandwidth,
    )
    yield rung(
        f"op-amp offsets {tolerances.offset * 1e6:.0f} uV alone",
        errors=Tolerances(offset=tolerances.offset),
    )
    yield rung(
        f"resistors {tolerances.resistor:.1%} alone",
        errors=Tolerances(resistor=tolerances.resistor),
    )
    yield rung(
        f"multiplier gains {tolerances.gain:.1%} alone", errors=Tolerances(gain=tolerances.gain)
    )
    yield rung(
        f"multiplier offsets {tolerances.product_offset * 1e3:g} mV alone",
        errors=Tolerances(product_offset=tolerances.product_offset),
    )
    yield rung("E96 resistors alone", series=E96)


@dataclass(frozen=True, kw_only=True, eq=False)
class Ladder:
    """Climbs the rungs.

    Attributes
    ----------
    simulator : Ngspice, optional
        One with the patience of every level where none is given.
    margin : float
        k: op-amp bandwidth over the network's fastest mode.
    progress : callable or None
    """

    simulator: Ngspice | None = None
    margin: float = 10.0
    progress: Callable[[str], None] | None = None

    def climb(self, network: Network, steps: tuple[Rung, ...]) -> Iterator[Measured]:
        """Predict and measure one rung after the other; one that fails says why."""
        for rung in steps:
            backend = SpiceBackend(
                level=rung.level,
                simulator=self.simulator,
                margin=self.margin,
                seed=rung.seed,
                require_stable=False,
            )
            if self.progress:
                self.progress(rung.name.strip())
            try:
                circuit, probe = backend.prepare(network)
                off = snapped(circuit, rung.series or EXACT), backend.deviations(circuit)
                deviations = combined(circuit.parameters, *off)
            except NetworkError as error:
                yield Measured(rung=rung, why=str(error))
                continue
            done = self._predicted(Measured(rung=rung, circuit=circuit), probe, deviations)
            yield self._simulated(done, backend, probe, deviations)

    def _predicted(self, done: Measured, probe: Trajectory, deviations: Deviations) -> Measured:
        level, circuit = done.rung.level, done.circuit
        if circuit is None or not is_emulated(circuit, level):
            return done
        try:
            told = predict(circuit, level, probe, deviations)
        except NetworkError as error:
            return replace(done, why=str(error))
        if not told.stable:
            return replace(done, why="the pole model says that it oscillates")
        return replace(
            done, predicted_error=told.control_error, predicted_settling=told.settling_time
        )

    def _simulated(
        self, done: Measured, backend: SpiceBackend, probe: Trajectory, deviations: Deviations
    ) -> Measured:
        assert done.circuit is not None
        began = clock.monotonic()
        try:
            run = simulate(backend, done.circuit, probe, deviations)
        except (SpiceError, NetworkError) as error:
            return replace(done, why=str(error).splitlines()[0])
        settled = run.settled()
        return replace(
            done,
            error=run.control_error,
            settling=run.settling_time() if settled else float("nan"),
            wall=clock.monotonic() - began,
            run=run,
            why=done.why or ("" if settled else "still moving at the end of the run"),
        )
