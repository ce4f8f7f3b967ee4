"""Corner analysis of a circuit over temperature, supplies and process corners.

Boards of discrete parts are emulated. Their output swing follows the supplies, their bias currents
grow with temperature, and errors of single parts grow with the distance from room temperature.
Transistor levels are simulated in ngspice, with one netlist per corner.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.circuit_run import CircuitRun, check_full_scale
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.circuit_study import NEAR, measured_runs, undrawn
from ann_dc.fidelity.error_budget import Sensitivity, sensitivity, total_error
from ann_dc.fidelity.noise_run import control_noise, noisy
from ann_dc.fidelity.prediction import Prediction, Reason, Unpredicted, prediction_of
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.parts.conditions import CORNERS, NOMINAL, ROOM, Conditions
from ann_dc.validation import checked

TEMPERATURES = (-40.0, ROOM, 125.0)
"""Temperatures in degrees Celsius: the limits of the industrial range and room temperature."""

SUPPLIES = (0.9, 1.0, 1.1)
"""Supply voltages relative to their nominal values."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Corner:
    """Result of a circuit at one combination of temperature, supplies and process.

    Attributes
    ----------
    control_error : float
        Error of the settled controls against the ideal network, relative to the largest control;
        nan if the circuit does not settle.
    settling_time : float
        Time in seconds until every control stays within 0.1 %; nan if unknown.
    clipped : bool
        True if a part saturates: at the settled point of an emulation, at any time of an ngspice
        run. Also true if full scale is so close to the output swing that no circuit is designed.
    spread, noise : float
        Standard deviation of the worst control due to the tolerances of the level at this corner,
        and its rms noise, relative to the largest control; nan if unknown.
    remark : str
        Remark on a corner without figures; otherwise empty.
    """

    conditions: Conditions
    control_error: float = math.nan
    settling_time: float = math.nan
    stable: bool = False
    clipped: bool = False
    spread: float = math.nan
    noise: float = math.nan
    remark: str = ""

    @property
    def within_tolerance(self) -> bool:
        """True if the circuit settles near the optimum (noise included), unsaturated."""
        settles = self.stable and not self.clipped
        return settles and noisy(self.control_error, self.noise) < NEAR


@checked
def corners(
    backend: SpiceBackend,
    circuit: Circuit,
    probe: Trajectory,
    *,
    temperatures: Sequence[float] = TEMPERATURES,
    supplies: Sequence[float] = SUPPLIES,
    processes: Sequence[str] | None = None,
) -> list[Corner]:
    """Evaluate a circuit at every temperature, supply and process corner.

    Return the corners ordered by process, then temperature, then supply. Raises `NetworkError` if a
    temperature or a supply is out of range or a process corner is unknown, and `NgspiceMissing` if
    ngspice is needed but not found.

    Parameters
    ----------
    backend : SpiceBackend
        The seed draws errors of single parts of its resistor series, identical at all corners.
        Transistor levels and levels without an emulation run in ngspice.
    circuit, probe : Circuit, Trajectory
        Circuit from `SpiceBackend.prepare`, designed for room temperature, with its probe.
    temperatures : sequence of float
        Temperatures in degrees Celsius.
    supplies : sequence of float
        Supply voltages relative to the nominal ones.
    processes : sequence of str, optional
        Process corners. Default: all `CORNERS` for transistors, the typical corner for other parts.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity.boards import corners
    >>> from ann_dc.hardware.parts import Tolerances
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> parts = Tolerances(resistor=1e-3, resistor_drift=1e-5)
    >>> backend = ann_dc.SpiceBackend(level=ann_dc.levels.macro(tolerances=parts))
    >>> found = corners(backend, *backend.prepare(network), temperatures=[127.0, 27.0])
    >>> len(found), all(corner.within_tolerance for corner in found)
    (6, True)
    >>> round((found[0].spread / found[-1].spread) ** 2, 6)  # 0.1 % of tolerance and as much drift
    2.0
    """
    level = backend.level
    if processes is None:
        processes = CORNERS if level.transistors else (NOMINAL.process,)
    places = [
        Conditions(temperature=float(celsius), supply=float(supply), process=process)
        for process in processes
        for celsius in temperatures
        for supply in supplies
    ]
    there = [replace(backend, level=level.at(place)) for place in places]
    if level.transistors or not level.emulated:
        return _measured(backend, circuit, probe, there)
    return _emulated(circuit, probe, there)


def _emulated(circuit: Circuit, probe: Trajectory, there: Sequence[SpiceBackend]) -> list[Corner]:
    """Return the corners by emulation; equal circuits are emulated only once."""
    slopes = _slopes(circuit, probe, there[0]) if there else None
    known, noises, found = {}, {}, []
    for number, backend in enumerate(there):
        level, seed = backend.level, backend.seed
        backend.progress(f"corner {number + 1} of {len(there)}")
        try:
            check_full_scale(level)
        except NetworkError as error:
            found.append(Corner(conditions=level.conditions, clipped=True, remark=str(error)))
            continue
        emulated = replace(level.datasheet, amplifier_power=0.0, multiplier_power=0.0)
        same = emulated, None if seed is None else level.tolerances
        if same not in known:
            off = backend.deviations(circuit)
            instance = CircuitInstance(circuit=circuit, level=level, probe=probe, deviations=off)
            known[same] = instance, prediction_of(instance)
        instance, predicted = known[same]
        warm = same, level.conditions.kelvin
        if warm not in noises:
            noises[warm] = control_noise(replace(instance, level=level))
        found.append(_reported(backend, predicted, noises[warm], slopes))
    return found


def _slopes(circuit: Circuit, probe: Trajectory, backend: SpiceBackend) -> Sensitivity | None:
    """Return the nominal sensitivities at room temperature; None without a budget."""
    backend.progress("sensitivities")
    there = replace(backend, level=backend.level.at(NOMINAL))
    nominal = undrawn(there, circuit, probe)
    try:
        return sensitivity(nominal.emulation, nominal.settled)
    except NetworkError:
        return None


def _reported(
    backend: SpiceBackend,
    found: Prediction | Unpredicted,
    noise: float,
    slopes: Sensitivity | None,
) -> Corner:
    level = backend.level
    spread = math.nan if slopes is None else total_error(slopes, level.tolerances)
    if isinstance(found, Unpredicted):
        return Corner(
            conditions=level.conditions,
            stable=found.reason is Reason.CLIPPED,
            clipped=found.reason is Reason.CLIPPED,
            spread=spread,
            remark=found.sentence,
        )
    settles = found.stable and not found.other_equilibrium
    return Corner(
        conditions=level.conditions,
        control_error=found.control_error if settles else math.nan,
        settling_time=found.settling_time,
        stable=settles,
        spread=spread,
        noise=noise if settles else math.nan,
        remark=found.other_equilibrium or found.unknown,
    )


def _measured(
    backend: SpiceBackend, circuit: Circuit, probe: Trajectory, there: Sequence[SpiceBackend]
) -> list[Corner]:
    """Return the corners by ngspice; reject a circuit unstable at room temperature."""
    if backend.require_stable and backend.level.emulated:
        off = backend.deviations(circuit)
        backend.check_stable(emulate(circuit, backend.level, off), probe)
    decks = [each.deck(circuit, probe, each.deviations(circuit)) for each in there]
    backend.progress(f"ngspice, {len(decks)} corners")
    runs = measured_runs(backend, circuit, probe, decks)
    return [_read(each.level.conditions, run) for each, run in zip(there, runs)]


def _read(conditions: Conditions, run: CircuitRun | None) -> Corner:
    if run is None:
        return Corner(conditions=conditions, remark="ngspice did not complete the run")
    clipped = bool(run.overloads)
    if why := run.unsettled:
        return Corner(conditions=conditions, clipped=clipped, remark=why)
    return Corner(
        conditions=conditions,
        control_error=run.control_error,
        settling_time=run.settling_time(),
        stable=True,
        clipped=clipped,
    )
