"""All there is to know of one circuit: predicted, simulated, priced, and what its errors cost.

The circuit as it should be is emulated and solved once; budget and noise read that. With resistors
of a series, or errors drawn by a seed, the circuit that is built is another one, and is emulated
once, too. One deck is written, and it is the one that ngspice runs.

Many circuits of the same parts, each with errors of its own: predicted, and in ngspice.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.analysis.spectra import DENSE_LIMIT
from ann_dc.backends.spice.backend import SpiceBackend, ngspice_of
from ann_dc.backends.spice.circuit_run import KNEE, CircuitRun
from ann_dc.backends.spice.netlist.deck import Deck
from ann_dc.backends.spice.ngspice.raw import Raw
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.backends.spice.refinement import read_timed
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.evaluation.rules import NEAR
from ann_dc.fidelity.circuit_instance import Specimen
from ann_dc.fidelity.error_budget import Item, budget, sensitivity
from ann_dc.fidelity.loop_gains import LoopGain, loop_gains, why_no_loops
from ann_dc.fidelity.noise_run import control_noise, noisy
from ann_dc.fidelity.prediction import Prediction, Unpredicted, prediction_of
from ann_dc.fidelity.wire_requirements import MetricDemand, metric_demand
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.cost import Cost, cost_of
from ann_dc.hardware.circuit.deviations import Deviations, combined, draw, snapped
from ann_dc.hardware.circuit.loads import load_power
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.technologies import OtaC
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Kind
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


@dataclass(frozen=True, kw_only=True, eq=False)
class CircuitStudy:
    """A circuit, and what was found out about it.

    Attributes
    ----------
    circuit : Circuit
        With nominal components.
    deck : Deck
        Its netlist, with the deviations of its parts.
    run : CircuitRun or None
        In ngspice, if it was simulated.
    cost : Cost
        Parts, watts and joules a solve.
    prediction : Prediction or None
        By the circuit's emulation.
    unpredicted : Unpredicted or None
        Why there is no prediction, where there is none.
    snapping : mapping of str to float
        Largest share by which the series of the backend made a "resistor" and a "capacitor" wrong.
    louder : bool
        Whether a larger full scale stays within what the parts can do.
    noise : float
        Rms of the worst control from resistors, and from parts whose noise is known, over
        their size (`size_of`), at the level's temperature; nan where it is not known.
    size : str
        Size to which errors and noise of the controls are related, in words.
    items : tuple of Item
        The error budget, worst first; empty where it was not asked for.
    samples : (S,) array
        Predicted error of the controls of circuits drawn from the level's tolerances.
    demand : MetricDemand or None
        What the metric demands of its wires, where it has any.
    undemanded : str
        Why that is not known, where the metric has wires and it is not.
    loops : tuple of LoopGain
        Of the op amps with the smallest phase margins; empty where they were not asked for.
    unlooped : str
        Why there are none, where they were asked for and take too long.
    """

    circuit: Circuit
    deck: Deck
    run: CircuitRun | None
    cost: Cost
    prediction: Prediction | None
    unpredicted: Unpredicted | None
    snapping: Mapping[str, float]
    louder: bool
    noise: float
    size: str
    items: tuple[Item, ...]
    samples: np.ndarray
    demand: MetricDemand | None = None
    undemanded: str = ""
    loops: tuple[LoopGain, ...] = ()
    unlooped: str = ""

    @property
    def near(self) -> bool:
        """Whether the circuit settled near the optimum, or is predicted to, noise told: `NEAR`."""
        return not self.unknown and not self.shortcoming

    @property
    def unknown(self) -> bool:
        """Whether it was neither simulated nor predicted."""
        return self.run is None and self.prediction is None

    @property
    def shortcoming(self) -> str:
        """What keeps the circuit from the optimum, in a clause; empty where nothing does."""
        found, verb = self.prediction, "is predicted to be"
        if self.run is not None:
            if self.run.unsettled:
                return self.run.unsettled
            error, verb = self.run.control_error, "is"
        elif found is None:
            return ""  # unknown
        elif not found.stable:
            return "its settled point is predicted to repel"
        elif found.astray:
            return f"nothing says that it gets there: {found.astray}"
        else:
            error = found.control_error
        return self._excess(error, verb)

    def _excess(self, error: float, verb: str) -> str:
        """That an error of the controls, or noise beside it, is too large, and what helps."""
        if noisy(error, self.noise) < NEAR:
            return ""
        louder = "a larger full scale, " if self.louder else ""
        if error < NEAR:
            return (
                f"noise of {self.noise:.1%} rms of {self.size} is on its controls, beside "
                f"an error of {error:.2g}; together above {NEAR:.0%}: take smaller resistors, "
                f"{louder}or the mean of many readings"
            )
        means = f"take better parts, {louder}or a slower network"
        if (off := self.snapping.get("resistor", 0.0)) > NEAR / 10:
            means = f"its resistors are off by up to {off:.1%}: take pairs, or exact ones"
        far = f"{error:.1%} of {self.size}, above {NEAR:.0%}"
        return f"the error of its controls {verb} {far}: {means}"


@checked
def study_circuit(
    network: Network,
    backend: SpiceBackend,
    *,
    items: int = 0,
    samples: int = 0,
    loops: int = 0,
    simulated: bool = True,
    units: Mapping[str, str] | None = None,
) -> CircuitStudy:
    """Build a circuit, predict it and simulate it.

    Parameters
    ----------
    network : Network
        What is built; it has to settle.
    backend : SpiceBackend
        Level, seed, margin and resistors of the circuit.
    items : int
        Lines of the error budget.
    samples : int
        Circuits to draw, with seeds 0, 1, ...
    loops : int
        Op amps whose loop gain is told, those with the smallest phase margins.
    simulated : bool
        False leaves ngspice out: netlist, bill and prediction need none.
    units : mapping of str to str, optional
        Units of measure by the neuron's name, for texts.

    Returns
    -------
    CircuitStudy

    Raises
    ------
    NetworkError
        If the network does not settle, the circuit is unstable, or a budget, samples or loops
        are wanted of a level that has no emulation.
    NgspiceMissing, SpiceError
        If ngspice is not there, or fails.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity import study_circuit
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, kinds=[ann_dc.Kind.TIME_CONSTANTS]).network
    >>> ideal = study_circuit(network, ann_dc.SpiceBackend(), simulated=False)
    >>> ideal.cost.parts
    {'op amps': 57, 'resistors': 146, 'capacitors': 39}
    >>> print(ideal.unpredicted)
    behavioural circuits are not emulated
    >>> board = ann_dc.SpiceBackend(level=ann_dc.presets.get("opa192_ad734"), seed=1)
    >>> study = study_circuit(network, board, items=3)  # doctest: +SKIP
    >>> study.near, study.run.control_error / study.prediction.control_error  # doctest: +SKIP
    """
    circuit, probe = backend.prepare(network)
    level, off = backend.level, snapped(circuit, backend.series)
    nominal = Specimen(circuit=circuit, level=level, probe=probe)
    deviations = backend.deviations(circuit)
    built = replace(nominal, deviations=deviations) if deviations else nominal
    op_amps = level.emulated and not isinstance(level.technology, OtaC)
    unlooped = why_no_loops(built.emulation) if loops and op_amps else ""
    margins = _loops(backend, built)[:loops] if loops and not unlooped else ()
    worst = _budget(backend, nominal)[:items] if items else ()
    drawn = np.zeros(0)
    if samples:
        seeds = range(samples)
        drawn = predicted_errors(circuit, level, probe, seeds, base=off, progress=backend.progress)
    backend.progress("prediction")
    found = prediction_of(built)
    backend.progress("noise of resistors")
    quiet = not isinstance(found, Unpredicted) and found.stable
    noise = control_noise(nominal) if quiet else float("nan")
    deck = backend.deck(circuit, probe, deviations)
    run = _run(backend, built, deck) if simulated else None
    prediction, unpredicted = (None, found) if isinstance(found, Unpredicted) else (found, None)
    backend.progress("demand of the metric")
    demand, undemanded = _demand(circuit.schematic.network, probe.final)
    return CircuitStudy(
        circuit=circuit,
        deck=deck,
        run=run,
        cost=cost_of(
            deck.parts,
            level.datasheet,
            _settling_time(run, prediction),
            load_power(circuit, level, probe.final),
        ),
        prediction=prediction,
        unpredicted=unpredicted,
        snapping=_snapping(circuit, off),
        louder=level.full_scale < KNEE * level.limit / 1.2,
        noise=noise,
        size=probe.measured_in(units or {}).size_in_words,
        items=worst,
        samples=drawn,
        demand=demand,
        undemanded=undemanded,
        loops=margins,
        unlooped=unlooped,
    )


def _snapping(circuit: Circuit, off: Deviations) -> dict[str, float]:
    """Largest share by which parts of each kind are off."""
    found = {}
    for parameter in circuit.parameters:
        if parameter.name in off:
            share = float(np.abs(off[parameter.name]).max())
            kind = parameter.kind.value
            found[kind] = max(share, found.get(kind, 0.0))
    return found


def _demand(network: Network, x: np.ndarray) -> tuple[MetricDemand | None, str]:
    """What the metric demands of its wires; or why that is not known."""
    if network.metric.kind is Kind.TIME_CONSTANTS:
        return None, ""
    if network.size > DENSE_LIMIT:
        return None, f"with {network.size} neurons, above {DENSE_LIMIT}, all modes take too long"
    try:
        return metric_demand(network, x), ""
    except NetworkError as error:
        return None, str(error)


def _run(backend: SpiceBackend, built: Specimen, deck: Deck) -> CircuitRun:
    if backend.require_stable and built.level.emulated:
        backend.check_stable(built.emulation, built.probe)
    run = backend.measure(built.circuit, deck, built.probe)
    backend.progress("ngspice, finer steps up to where it settles")
    return run.timed


def _loops(backend: SpiceBackend, built: Specimen) -> tuple[LoopGain, ...]:
    backend.progress("loop gains")
    return loop_gains(built.emulation, built.level, built.settled)


def _budget(backend: SpiceBackend, nominal: Specimen) -> tuple[Item, ...]:
    backend.progress("error budget")
    return budget(sensitivity(nominal.emulation, nominal.settled), nominal.level.tolerances)


def _settling_time(run: CircuitRun | None, prediction: Prediction | None) -> float:
    """Seconds a solve: measured, or else predicted."""
    if run is not None:
        return run.settling_time()
    return prediction.settling_time if prediction is not None else float("nan")
