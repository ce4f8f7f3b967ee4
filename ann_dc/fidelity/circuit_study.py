"""Study of one circuit: prediction, simulation, cost and error budget.

The nominal circuit is emulated and solved once for the error budget and the noise, and a circuit
with resistors of a series or drawn errors once more.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ann_dc.analysis.spectra import DENSE_LIMIT
from ann_dc.backends.settling import settles
from ann_dc.backends.spice.backend import SpiceBackend, ngspice_of, read_run
from ann_dc.backends.spice.circuit_run import KNEE, CircuitRun
from ann_dc.backends.spice.netlist.deck import Deck
from ann_dc.backends.spice.ngspice.raw import Raw
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.evaluation.rules import NEAR
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.error_budget import Item, budget, sensitivity, shares_by_kind
from ann_dc.fidelity.loop_gains import LoopGain, loop_gains, why_no_loops
from ann_dc.fidelity.noise_run import control_noise, noisy
from ann_dc.fidelity.prediction import Prediction, Unpredicted, prediction_of
from ann_dc.fidelity.waveform_prediction import WaveformPrediction, predicted_waveforms
from ann_dc.fidelity.wire_requirements import PreconditionerDemand, preconditioner_demand
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.cost import Cost, cost_of
from ann_dc.hardware.circuit.deviations import Deviations, combined, draw, rounded_to_series
from ann_dc.hardware.circuit.loads import load_power
from ann_dc.hardware.parts.datasheet import Kind
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.technologies import OtaC
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.progress import Progress, silent
from ann_dc.summaries import summarised
from ann_dc.validation import checked

ANALYSES = {
    "items": "error budget (--error-budget)",
    "samples": "drawn circuits (--samples)",
    "loops": "loop gains (--loops)",
}
"""Analyses of a settled point by the argument of `study_circuit` that requests them."""


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
    """Predict the control error of every drawn circuit.

    The error of the settled controls is relative to the largest control. The equilibrium of each
    emulation is found by Newton's method, and its eigenvalues are checked: 0.1 s per circuit of the
    paper's car.

    Parameters
    ----------
    circuit : Circuit
        Circuit with nominal components.
    level : Level
        Level whose tolerances are drawn.
    probe : Trajectory
        Run of the ideal network by which the circuit was scaled.
    seeds : sequence of int
        Seed of each circuit.
    base : mapping of parameter name to (N,) array, optional
        Common deviations of all circuits, for instance by a resistor series. Default: none.

    Returns
    -------
    (seeds,) array
        Errors; nan if a circuit has no equilibrium near the ideal one, or oscillates there.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity import predicted_errors
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> level = ann_dc.levels.macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> errors = predicted_errors(circuit, level, probe, seeds=range(3))
    >>> (0.001 < errors).all() and (errors < 0.1).all()  # with resistors of 1 %
    np.True_
    """
    nominal = CircuitInstance(circuit=circuit, level=level, probe=probe, deviations=base or {})
    drawn = instances(nominal, seeds, progress=progress)
    return np.array([settled_error(instance) for instance in drawn])


def undrawn(backend: SpiceBackend, circuit: Circuit, probe: Trajectory) -> CircuitInstance:
    """Return the circuit before drawing, with resistors and capacitors of the series."""
    off = rounded_to_series(circuit, backend.series)
    return CircuitInstance(circuit=circuit, level=backend.level, probe=probe, deviations=off)


def instances(
    nominal: CircuitInstance, seeds: Sequence[int], *, progress: Progress = silent
) -> Iterator[CircuitInstance]:
    """Yield circuits drawn from the tolerances of a level, one per seed.

    Their common deviations are those of ``nominal``.
    """
    known, sizes = nominal.circuit.parameters, nominal.level.tolerances
    for row, seed in enumerate(seeds):
        progress(f"circuit {row + 1} of {len(seeds)}")
        off = combined(known, nominal.deviations, draw(known, sizes, seed))
        yield replace(nominal, deviations=off)


def settled_error(instance: CircuitInstance) -> float:
    """Return the error of the settled controls relative to the largest; nan if unsettled."""
    try:
        stable = instance.modes.abscissa < 0
    except NetworkError:
        return float("nan")
    return instance.control_error if stable else float("nan")


def sample_decks(
    circuit: Circuit,
    level: Level,
    probe: Trajectory,
    seeds: Sequence[int],
    *,
    base: Deviations | None = None,
) -> list[Deck]:
    """Return one netlist per seed, as drawn by `predicted_errors`.

    Netlists differ only in parameter values.
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
    """Measure the control error of every drawn circuit in ngspice.

    The error of the settled controls is relative to the largest control; nan if a run failed or did
    not settle. Circuits run in parallel. The arguments are those of `predicted_errors`, and equal
    seeds draw equal errors in both functions. The default simulator has the time limit of the
    level. Raises `NgspiceMissing` if ngspice is not found.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity import measured_errors, predicted_errors
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> level, seeds = ann_dc.levels.macro(), range(20)
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> measured = measured_errors(circuit, level, probe, seeds)  # doctest: +SKIP
    >>> measured / predicted_errors(circuit, level, probe, seeds)  # doctest: +SKIP
    """
    backend = SpiceBackend(level=level, simulator=simulator)
    runs = measured_runs(backend, circuit, probe, sample_decks(circuit, level, probe, seeds))
    return np.array([np.nan if run is None or run.unsettled else run.control_error for run in runs])


def measured_runs(
    backend: SpiceBackend, circuit: Circuit, probe: Trajectory, decks: Sequence[Deck]
) -> list[CircuitRun | None]:
    """Run several netlists of a circuit in ngspice in parallel; None for a failed run.

    All runs have the duration of the first netlist.
    """
    end = decks[0].end if decks else None
    results = ngspice_of(backend).run_many([deck.text for deck in decks], end_time=end)
    return [
        read_run(backend, circuit, deck, raw, probe) if isinstance(raw, Raw) else None
        for deck, raw in zip(decks, results)
    ]


@summarised(
    lambda self: {
        "circuit": self.circuit,
        "simulated": self.run is not None,
        "predicted": self.prediction is not None or self.waveforms is not None,
        "within tolerance": self.within_tolerance,
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class CircuitStudy:
    """Circuit with its predicted and simulated results.

    Attributes
    ----------
    circuit, deck : Circuit, Deck
        Circuit with nominal components, and netlist with the deviations of the parts.
    run : CircuitRun or None
        Run in ngspice, if simulated.
    cost : Cost
        Parts, watts, and joules per solve.
    probe : Trajectory
        Run of the ideal network by which the circuit was scaled.
    prediction, waveforms : Prediction or None, WaveformPrediction or None
        Prediction of a circuit that settles, or of one that runs for a given duration.
    unpredicted : Unpredicted or None
        Reason of a missing prediction.
    series_rounding : mapping of str to float
        Largest relative error of a "resistor" and of a "capacitor" by rounding to the series of the
        backend.
    raise_full_scale : bool
        True if a larger full scale stays within the limits of the parts.
    noise : float
        Rms noise of the worst control from resistors and parts with known noise, at the temperature
        of the level. The value is relative to the size of the controls (`size_of`); nan if unknown.
    size : str
        Description of the size to which errors and noise of the controls refer.
    items : tuple of Item
        Error budget, worst first; empty if not requested.
    budget_shares : mapping of Kind to float
        Fraction of the variance by kind of error, of all lines of the budget.
    samples : (S,) array
        Predicted control errors of circuits drawn from the tolerances of the level.
    demand, undemanded : PreconditionerDemand or None, str
        Wire requirements of the preconditioner, None without wires; or the reason if unknown.
    loops, unlooped : tuple of LoopGain, str
        Op amps with the smallest phase margins, if requested; or the reason if they would take too
        long.
    """

    circuit: Circuit
    deck: Deck
    run: CircuitRun | None
    cost: Cost
    probe: Trajectory
    prediction: Prediction | None
    waveforms: WaveformPrediction | None
    unpredicted: Unpredicted | None
    series_rounding: Mapping[str, float]
    raise_full_scale: bool
    noise: float
    size: str
    items: tuple[Item, ...]
    samples: np.ndarray
    demand: PreconditionerDemand | None = None
    undemanded: str = ""
    loops: tuple[LoopGain, ...] = ()
    unlooped: str = ""
    budget_shares: Mapping[Kind, float] = field(default_factory=dict)

    @property
    def within_tolerance(self) -> bool:
        """True if the settled or predicted error, noise included, is below `NEAR`."""
        return not self.unknown and not self.shortcoming

    @property
    def unknown(self) -> bool:
        """True if the circuit was neither simulated nor predicted."""
        return self.run is None and self.prediction is None and self.waveforms is None

    @property
    def moves(self) -> bool:
        """True if the network does not settle, so that the circuit runs for a duration."""
        return not settles(self.probe)

    @property
    def terms(self) -> str:
        """Compared quantities: "controls", or "states" for a network without controls."""
        has_controls = self.probe.network.of_population("u").any()
        return "controls" if has_controls else "states"

    @property
    def final_difference(self) -> float:
        """Largest difference of a final control in ngspice from the predicted one.

        The reference is that of the errors, or the largest control of the ideal run if the network
        does not settle. The result is nan without a simulation or a prediction.
        """
        found = self.prediction or self.waveforms
        if self.run is None or found is None:
            return float("nan")
        size = self.probe.control_reach if self.moves else self.probe.control_size
        return float(np.abs(self.run.trajectory.control_values[-1] - found.final).max() / size)

    @property
    def shortcoming(self) -> str:
        """Deviation from the optimum, as a clause; empty if the circuit settles near it.

        The clause is empty for a circuit of a given duration.
        """
        if self.moves:
            return ""
        found, verb = self.prediction, "is predicted to be"
        if self.run is not None:
            if self.run.unsettled:
                return self.run.unsettled
            error, verb = self.run.control_error, "is"
        elif found is None:
            return ""  # unknown
        elif not found.stable:
            return "the equilibrium is predicted to be unstable"
        elif found.other_equilibrium:
            return f"the optimum is predicted to be missed: {found.other_equilibrium}"
        else:
            error = found.control_error
        return self._excess(error, verb)

    def _excess(self, error: float, verb: str) -> str:
        """Return a message on a control error or noise that is too large, with a remedy."""
        if noisy(error, self.noise) < NEAR:
            return ""
        larger = "a larger full scale, " if self.raise_full_scale else ""
        if error < NEAR:
            return (
                f"rms noise of the {self.terms} {self.noise:.1%} and error {error:.2g}, relative "
                f"to {self.size}, together exceed {NEAR:.0%}; use smaller resistors, "
                f"{larger}or the mean of several readings"
            )
        means = f"use better parts, {larger}or a slower network"
        if (off := self.series_rounding.get("resistor", 0.0)) > NEAR / 10:
            means = f"rounded resistors deviate by up to {off:.1%}; use pairs, or exact values"
        far = f"{error:.1%} relative to {self.size}, which exceeds {NEAR:.0%}"
        return f"the error of the {self.terms} {verb} {far}; {means}"


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
    """Design a circuit, predict its behaviour and simulate it.

    A network that does not settle runs for the duration of the backend. Raises `NetworkError` if
    there is none, if the circuit is unstable, or if a budget, samples or loops are requested for a
    network that does not settle or a level without emulation. Raises `NgspiceMissing` or
    `SpiceError` if ngspice is not found or fails.

    Parameters
    ----------
    backend : SpiceBackend
        Level, seed, bandwidth margin and resistors of the circuit.
    items : int
        Number of lines of the error budget.
    samples : int
        Number of drawn circuits, with seeds 0, 1, ...
    loops : int
        Number of op amps with reported loop gains, smallest phase margin first.
    simulated : bool
        If False, ngspice is not run; netlist, bill of materials and prediction do not need it.
    units : mapping of str to str, optional
        Units by neuron name, for texts.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity import study_circuit
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> ideal = study_circuit(network, ann_dc.SpiceBackend(), simulated=False)
    >>> ideal.cost.parts
    {'op amps': 57, 'resistors': 146, 'capacitors': 39}
    >>> board = ann_dc.SpiceBackend(level=ann_dc.presets.get("opa192_ad734"), seed=1)
    >>> study = study_circuit(network, board, items=3)  # doctest: +SKIP
    >>> study.within_tolerance  # doctest: +SKIP
    >>> study.run.control_error / study.prediction.control_error  # doctest: +SKIP
    """
    circuit, probe = backend.prepare(network)
    _check_settled(probe, items=items, samples=samples, loops=loops)
    level, off = backend.level, rounded_to_series(circuit, backend.series)
    nominal = CircuitInstance(circuit=circuit, level=level, probe=probe)
    deviations = backend.deviations(circuit)
    built = replace(nominal, deviations=deviations) if deviations else nominal
    op_amps = level.emulated and not isinstance(level.technology, OtaC)
    unlooped = why_no_loops(built.emulation) if loops and op_amps else ""
    margins = _loops(backend, built)[:loops] if loops and not unlooped else ()
    worst = _budget(backend, nominal) if items else ()
    drawn = np.zeros(0)
    if samples:
        seeds = range(samples)
        drawn = predicted_errors(circuit, level, probe, seeds, base=off, progress=backend.progress)
    backend.progress("prediction")
    found = prediction_of(built) if settles(probe) else predicted_waveforms(built)
    prediction = found if isinstance(found, Prediction) else None
    backend.progress("noise of resistors")
    quiet = prediction is not None and prediction.stable
    noise = control_noise(nominal) if quiet else float("nan")
    deck = backend.deck(circuit, probe, deviations)
    run = _run(backend, built, deck) if simulated else None
    backend.progress("wire requirements of the preconditioner")
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
        probe=probe,
        prediction=prediction,
        waveforms=found if isinstance(found, WaveformPrediction) else None,
        unpredicted=found if isinstance(found, Unpredicted) else None,
        series_rounding=_series_rounding(circuit, off),
        raise_full_scale=level.full_scale < KNEE * level.limit / 1.2,
        noise=noise,
        size=probe.measured_in(units or {}).size_in_words,
        items=worst[:items],
        budget_shares=shares_by_kind(worst),
        samples=drawn,
        demand=demand,
        undemanded=undemanded,
        loops=margins,
        unlooped=unlooped,
    )


def _check_settled(probe: Trajectory, **requested: int) -> None:
    """Raise `NetworkError` for an analysis of the settled point if the network has none."""
    for name, count in requested.items():
        if count and not settles(probe):
            raise NetworkError(
                f"{name}: expected a network that settles for {ANALYSES[name]}, got one that "
                "does not; omit it"
            )


def _series_rounding(circuit: Circuit, off: Deviations) -> dict[str, float]:
    """Return the largest relative deviation of the parts of each kind."""
    found = {}
    for parameter in circuit.parameters:
        if parameter.name in off:
            share = float(np.abs(off[parameter.name]).max())
            kind = parameter.kind.value
            found[kind] = max(share, found.get(kind, 0.0))
    return found


def _demand(network: Network, x: np.ndarray) -> tuple[PreconditionerDemand | None, str]:
    """Return the wire requirements of the preconditioner, or the reason if unknown."""
    if network.preconditioner.kind is PreconditionerKind.DIAGONAL:
        return None, ""
    if network.size > DENSE_LIMIT:
        return None, (
            f"with {network.size} neurons, above {DENSE_LIMIT}, the computation of all modes "
            "takes too long"
        )
    try:
        return preconditioner_demand(network, x), ""
    except NetworkError as error:
        return None, str(error)


def _run(backend: SpiceBackend, built: CircuitInstance, deck: Deck) -> CircuitRun:
    settling = settles(built.probe)
    if backend.require_stable and built.level.emulated and settling:
        backend.check_stable(built.emulation, built.probe)
    run = backend.measure(built.circuit, deck, built.probe)
    if not settling:
        return run
    backend.progress("ngspice with finer steps until the settling time")
    return run.timed


def _loops(backend: SpiceBackend, built: CircuitInstance) -> tuple[LoopGain, ...]:
    backend.progress("loop gains")
    return loop_gains(built.emulation, built.level, built.settled)


def _budget(backend: SpiceBackend, nominal: CircuitInstance) -> tuple[Item, ...]:
    backend.progress("error budget")
    return budget(sensitivity(nominal.emulation, nominal.settled), nominal.level.tolerances)


def _settling_time(run: CircuitRun | None, prediction: Prediction | None) -> float:
    """Return the seconds per solve: measured if available, else predicted."""
    if run is not None:
        return run.settling_time() if settles(run.probe) else float("nan")
    return prediction.settling_time if prediction is not None else float("nan")
