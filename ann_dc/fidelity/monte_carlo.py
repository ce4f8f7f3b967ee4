"""Many circuits of the same parts, each with errors of its own: predicted, and in ngspice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ann_dc.backends.spice.backend import SpiceBackend, ngspice_of
from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.backends.spice.netlist.deck import Deck
from ann_dc.backends.spice.ngspice.raw import Raw
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.backends.spice.refinement import read_timed
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.fidelity.circuit_instance import Specimen
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.deviations import Deviations, combined, draw, snapped
from ann_dc.hardware.parts.levels import Level
from ann_dc.progress import Progress, silent
from ann_dc.validation.checked import checked


@checked
def predicted_errors(
    circuit: Circuit,
    level: Level,
    probe: Trajectory,
    seeds: Sequence[int],
    *,
    base: Deviations | None = None,
    progress: Progress = silent,
) -> np.ndarray:
    """Error of the settled controls of every circuit, over the largest control.

    The equilibrium of each emulation, by Newton's method, and its eigenvalues: 0.1 s a circuit of
    the paper's car. nan where a circuit has no equilibrium near the ideal one, or oscillates there.

    Parameters
    ----------
    circuit : Circuit
    level : Level
        Its tolerances say how far parts are off.
    probe : Trajectory
        The ideal network's run that the circuit was scaled by.
    seeds : sequence of int
        One a circuit.
    base : mapping of parameter name to (N,) array, optional
        What all circuits have in common, for instance parts of a series.
    progress : Progress
        Told one line a circuit.

    Returns
    -------
    (seeds,) array

    Raises
    ------
    NetworkError
        If the circuit has no emulation.

    Examples
    --------
    >>> from ann_dc.fidelity import predicted_errors
    >>> import ann_dc
    >>> from ann_dc.hardware.parts import macro
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, kinds=[ann_dc.Kind.TIME_CONSTANTS]).network
    >>> level = macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> errors = predicted_errors(circuit, level, probe, seeds=range(3))
    >>> (0.001 < errors).all() and (errors < 0.1).all()  # with resistors of 1 %
    np.True_
    """
    nominal = Specimen(circuit=circuit, level=level, probe=probe, deviations=base or {})
    drawn = specimens(nominal, seeds, progress=progress)
    return np.array([settled_error(specimen) for specimen in drawn])


def undrawn(backend: SpiceBackend, circuit: Circuit, probe: Trajectory) -> Specimen:
    """What all circuits of a backend have in common: resistors and capacitors of its series.

    Parameters
    ----------
    backend : SpiceBackend
    circuit : Circuit
    probe : Trajectory
        The ideal network's run that the circuit was scaled by.
    """
    off = snapped(circuit, backend.series)
    return Specimen(circuit=circuit, level=backend.level, probe=probe, deviations=off)


def specimens(
    nominal: Specimen, seeds: Sequence[int], *, progress: Progress = silent
) -> Iterator[Specimen]:
    """Circuits drawn from the tolerances of a level, one a seed.

    Parameters
    ----------
    nominal : Specimen
        Circuit, level and probe of all of them, and what they have in common that is off.
    seeds, progress
        As `predicted_errors` takes them.

    Yields
    ------
    Specimen
    """
    known, sizes = nominal.circuit.parameters, nominal.level.tolerances
    for row, seed in enumerate(seeds):
        progress(f"circuit {row + 1} of {len(seeds)}")
        off = combined(known, nominal.deviations, draw(known, sizes, seed))
        yield replace(nominal, deviations=off)


def settled_error(specimen: Specimen) -> float:
    """Error of the settled controls, over the largest one; nan where the circuit does not settle.

    Parameters
    ----------
    specimen : Specimen
    """
    try:
        stable = specimen.modes.abscissa < 0
    except NetworkError:
        return float("nan")
    return specimen.control_error if stable else float("nan")


@checked
def sample_decks(
    circuit: Circuit,
    level: Level,
    probe: Trajectory,
    seeds: Sequence[int],
    *,
    base: Deviations | None = None,
) -> list[Deck]:
    """A netlist a seed, which differ in the values of their parameters only.

    Parameters
    ----------
    circuit, level, probe, seeds, base
        As `predicted_errors` takes them.

    Returns
    -------
    list of Deck

    Examples
    --------
    >>> from ann_dc.fidelity import sample_decks
    >>> import ann_dc
    >>> from ann_dc.hardware.parts import macro
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, kinds=[ann_dc.Kind.TIME_CONSTANTS]).network
    >>> level = macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> first, second = sample_decks(circuit, level, probe, seeds=(1, 2))
    >>> first.parts == second.parts, first.text == second.text
    (True, False)
    """
    backend, known = SpiceBackend(level=level), circuit.parameters
    drawn = (combined(known, base or {}, draw(known, level.tolerances, seed)) for seed in seeds)
    return [backend.deck(circuit, probe, off) for off in drawn]


@checked
def measured_errors(
    circuit: Circuit,
    level: Level,
    probe: Trajectory,
    seeds: Sequence[int],
    simulator: Ngspice | None = None,
) -> np.ndarray:
    """Error of the settled controls of every circuit in ngspice, over the largest control.

    Side by side; nan where one failed or did not settle.

    Parameters
    ----------
    circuit, level, probe, seeds
        As `predicted_errors` takes them; the same seeds draw the same errors there and here.
    simulator : Ngspice, optional
        One with the level's patience where none is given.

    Returns
    -------
    (seeds,) array

    Raises
    ------
    NgspiceMissing
        If there is no ngspice.

    Examples
    --------
    >>> from ann_dc.fidelity import measured_errors, predicted_errors
    >>> import ann_dc
    >>> from ann_dc.hardware.parts import macro
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, kinds=[ann_dc.Kind.TIME_CONSTANTS]).network
    >>> level = macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> seeds = range(20)
    >>> measured = measured_errors(circuit, level, probe, seeds)  # doctest: +SKIP
    >>> measured / predicted_errors(circuit, level, probe, seeds)  # doctest: +SKIP
    """
    backend = SpiceBackend(level=level, simulator=simulator)
    runs = measured_runs(backend, circuit, probe, sample_decks(circuit, level, probe, seeds))
    return np.array([np.nan if run is None or run.unsettled else run.control_error for run in runs])


def measured_runs(
    backend: SpiceBackend, circuit: Circuit, probe: Trajectory, decks: Sequence[Deck]
) -> list[CircuitRun | None]:
    """Runs of several netlists of a circuit in ngspice, side by side; None where one failed.

    Parameters
    ----------
    backend : SpiceBackend
        Its level's rails tell overloads.
    circuit : Circuit
    probe : Trajectory
        What they are compared with.
    decks : sequence of Deck
        All as long as the first one.

    Raises
    ------
    NgspiceMissing
        If there is no ngspice.
    """
    end = decks[0].end if decks else None
    simulator, datasheet = ngspice_of(backend), backend.level.datasheet
    results = simulator.run_many([deck.text for deck in decks], end_time=end)
    return [
        read_timed((circuit, deck, raw, probe), simulator, datasheet)
        if isinstance(raw, Raw)
        else None
        for deck, raw in zip(decks, results)
    ]
