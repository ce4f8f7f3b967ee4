"""All there is to know of one circuit: predicted, simulated, priced, and what its errors cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.backends.spice.backend import LONGER, SpiceBackend, simulate
from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.backends.spice.netlist.deck import Deck, deck_of
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.fidelity.error_budget import Item, budget, sensitivity
from ann_dc.fidelity.monte_carlo import predicted_errors
from ann_dc.fidelity.noise_run import settled_noise
from ann_dc.fidelity.prediction import Prediction, predict
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.cost import Cost, cost
from ann_dc.hardware.circuit.deviations import combined, snapped
from ann_dc.hardware.emulation.emulation import Emulation, emulate, emulated_state
from ann_dc.hardware.emulation.noise import Noise
from ann_dc.hardware.parts.e_series import EXACT, Series
from ann_dc.network.network import Network

ROOM = Noise(step=1.0)
"""Thermal noise of resistors at 300 K; no samples are drawn, so the step does not matter."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CircuitStudy:
    """A circuit, and what was found out about it.

    Attributes
    ----------
    circuit : Circuit
    deck : Deck
        Its netlist.
    run : CircuitRun or None
        In ngspice, if it was simulated.
    cost : Cost
    prediction : Prediction or None
    unpredicted : str
        Why there is no prediction, where there is none.
    series : Series
        What resistors were taken from.
    snapping : float
        Largest share by which that made a resistor wrong.
    noise : float
        Rms of the worst control from resistors at 300 K, over the largest control; nan where it is
        not known.
    items : tuple of Item
        The error budget, worst first; empty where it was not asked for.
    samples : (S,) array
        Predicted error of the controls of circuits drawn from the level's spread.
    """

    circuit: Circuit
    deck: Deck
    run: CircuitRun | None
    cost: Cost
    prediction: Prediction | None
    unpredicted: str
    series: Series
    snapping: float
    noise: float
    items: tuple[Item, ...]
    samples: np.ndarray


def study_circuit(
    network: Network,
    backend: SpiceBackend,
    *,
    series: Series = EXACT,
    items: int = 0,
    samples: int = 0,
    simulated: bool = True,
) -> CircuitStudy:
    """Build a circuit, predict it and simulate it.

    Parameters
    ----------
    network : Network
    backend : SpiceBackend
    series : Series
        What resistors are taken from; the seed's errors come on top.
    items : int
        Lines of the error budget.
    samples : int
        Circuits to draw, with seeds 0, 1, ...
    simulated : bool
        False leaves ngspice out: netlist, bill and prediction need none.

    Raises
    ------
    NetworkError
        If the network does not settle, the circuit is unstable, or a budget or samples are wanted
        of a level that has no emulation.
    NgspiceMissing, SpiceError
        If ngspice is not there, or fails.
    """
    circuit, probe = backend.prepare(network)
    level, off = backend.level, snapped(circuit, series)
    found = _items(backend, circuit, probe)[:items] if items else ()
    drawn = np.zeros(0)
    if samples:
        seeds = range(samples)
        drawn = predicted_errors(circuit, level, probe, seeds, base=off, progress=backend.progress)
    errors = backend.deviations(circuit)
    deviations = combined(circuit.parameters, off, errors) if off or errors else {}
    prediction, noise, why = None, float("nan"), ""
    backend.tell("prediction")
    try:
        prediction = predict(circuit, level, probe, deviations)
        noise = _noise(backend, circuit, probe)
    except NetworkError as error:
        why = str(error).removeprefix("prediction: ")
    duration = LONGER * float(probe.time[-1])
    written = deck_of(circuit, level, duration=duration, deviations=deviations)
    run = simulate(backend, circuit, probe, deviations) if simulated else None
    settling = prediction.settling_time if prediction else float("nan")
    return CircuitStudy(
        circuit=circuit,
        deck=written,
        run=run,
        cost=cost(written.parts, level.datasheet, run.settling_time() if run else settling),
        prediction=prediction,
        unpredicted=why,
        series=series,
        snapping=max((float(np.abs(v).max()) for v in off.values()), default=0.0),
        noise=noise,
        items=found,
        samples=drawn,
    )


def _at_rest(
    backend: SpiceBackend, circuit: Circuit, probe: Trajectory
) -> tuple[Emulation, np.ndarray]:
    """The emulation of the circuit as it should be, and where it settles."""
    emulation = emulate(circuit, backend.level, {})
    return emulation, equilibrium(emulation.network, emulated_state(emulation, probe.final))


def _items(backend: SpiceBackend, circuit: Circuit, probe: Trajectory) -> tuple[Item, ...]:
    return budget(sensitivity(*_at_rest(backend, circuit, probe)), backend.level.tolerances)


def _noise(backend: SpiceBackend, circuit: Circuit, probe: Trajectory) -> float:
    emulation, x = _at_rest(backend, circuit, probe)
    network = emulation.network
    if circuit.schematic.differential or network.size > LARGEST:
        return float("nan")
    rms = emulation.controls(network.user_units(settled_noise(emulation, x, ROOM)))
    return float(np.abs(rms).max() / np.abs(emulation.controls(network.user_units(x))).max())


LARGEST = 1000
"""Neurons of an emulation whose noise is computed unasked: the time grows with their cube."""
