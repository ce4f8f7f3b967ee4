"""Many circuits of the same parts, each with errors of its own: predicted, and in ngspice."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.spice.backend import LONGER
from ann_dc.backends.spice.circuit_run import read_back
from ann_dc.backends.spice.netlist.deck import Deck, deck_of
from ann_dc.backends.spice.ngspice.raw import Raw
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.fidelity.prediction import emulated_error
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.deviations import Deviations, combined, draw
from ann_dc.hardware.emulation.emulation import emulate, emulated_state
from ann_dc.hardware.parts.levels import Level


def sample_decks(
    circuit: Circuit, level: Level, probe: Trajectory, seeds: Sequence[int]
) -> list[Deck]:
    """A netlist a seed, which differ in the values of their parameters only."""
    known, duration = circuit.parameters, LONGER * float(probe.time[-1])
    return [
        deck_of(circuit, level, duration=duration, deviations=draw(known, level.tolerances, seed))
        for seed in seeds
    ]


def predicted_errors(
    circuit: Circuit,
    level: Level,
    probe: Trajectory,
    seeds: Sequence[int],
    *,
    base: Deviations | None = None,
    progress: Callable[[str], None] | None = None,
) -> np.ndarray:
    """Error of the settled controls of every circuit, over the largest control.

    The equilibrium of each emulation, by Newton's method, and its eigenvalues: 0.1 s a circuit of
    the paper's car. nan where a circuit has no equilibrium near the ideal one, or oscillates there.

    Parameters
    ----------
    circuit : Circuit
    level : Level
        Its spread says how far parts are off.
    probe : Trajectory
        The ideal network's run.
    seeds : sequence of int
    base : mapping of parameter name to (N,) array, optional
        What all circuits have in common, for instance resistors of a series.
    progress : callable, optional

    Returns
    -------
    (seeds,) array
    """
    known = circuit.parameters
    start = emulated_state(emulate(circuit, level, {}), probe.final)
    errors = np.full(len(seeds), np.nan)
    for row, seed in enumerate(seeds):
        if progress:
            progress(f"circuit {row + 1} of {len(seeds)}")
        off = combined(known, base or {}, draw(known, level.tolerances, seed))
        emulation = emulate(circuit, level, off)
        try:
            settled = equilibrium(emulation.network, start)
        except NetworkError:
            continue
        if spectrum(emulation.network, settled).abscissa < 0:
            errors[row] = emulated_error(emulation, settled, probe)
    return errors


def measured_errors(
    circuit: Circuit,
    level: Level,
    probe: Trajectory,
    seeds: Sequence[int],
    simulator: Ngspice | None = None,
) -> np.ndarray:
    """The same of every circuit in ngspice, side by side; nan where one failed.

    Raises
    ------
    NgspiceMissing
        If there is no ngspice.
    """
    decks = sample_decks(circuit, level, probe, seeds)
    simulator = simulator or Ngspice(timeout=level.patience)
    results = simulator.run_many([d.text for d in decks], end_time=decks[0].end)
    return np.array(
        [
            read_back(circuit, written, raw, probe, level.datasheet).control_error
            if isinstance(raw, Raw)
            else np.nan
            for written, raw in zip(decks, results)
        ]
    )
