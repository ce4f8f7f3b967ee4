"""Run of a circuit: node voltages converted to neuron states in network units.

The value of a neuron q, u or t is that of its node, x = p (S / V) v, where p is the polarity. S / V
is in units per volt. The node of a PI dual carries the multiplier m = mu + rho c, so mu is m minus
rho c, with c from the other nodes. The node of a diode neuron that is off leaks towards the zero at
its output. Voltages beyond the capability of a part are recorded as overloads.

A run spends most of its steps after settling. The settling time comes from a second run that ends
there, with a largest step a fourth as long and an eighth of the truncation error. The change of the
settling time is its error estimate.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from ann_dc.backends.curves import Curves, Tabulated
from ann_dc.backends.settling import control_settling, settles
from ann_dc.backends.spice.netlist.deck import Deck
from ann_dc.backends.spice.ngspice.raw import Raw
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.backends.trajectory import Trajectory, control_error
from ann_dc.errors import NetworkError, SpiceError, such_as
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.evaluation.drive import Drive, values_over_time
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.rules import RESTING
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.scaling import Scaling
from ann_dc.hardware.parts.datasheet import Datasheet
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.elements import Generator, Multiplier, PICell
from ann_dc.network.network import Network
from ann_dc.summaries import summarised
from ann_dc.validation import checked

OVERLOAD = 0.95
"""Fraction of full scale above which a node without rails counts as overloaded."""

KNEE = 0.9
"""Fraction of its rails above which a part clips."""

OFF = 1e-4
"""Fraction of full scale below which the output of a diode neuron counts as zero."""

Voltages: TypeAlias = dict[tuple[str, int], np.ndarray]
"""Voltages (T,) in volts by node name and stage."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Overload:
    """Node that exceeded the capability of its part.

    It reached ``volts`` at ``time`` seconds after the reset switches opened. If the part has no
    rails to clip at, the permitted ``limit`` is a fraction of full scale.
    """

    node: str
    stage: int
    time: float
    volts: float
    limit: float
    clips: bool = True

    def __str__(self) -> str:
        when = f"{self.volts:.4g} V at {self.time:.3g} s"
        reached = f"{self.node} of cell {self.stage} reached {when}"
        if self.clips:
            return f"{reached}, beyond its limit of {self.limit:.4g} V"
        return f"{reached}, above {self.limit:.4g} V; the model does not clip"


@such_as("ann_dc.SpiceBackend().run(network)")
@summarised(
    lambda self: {
        "circuit": self.circuit.schematic.network.title,
        "control error relative to the ODE": f"{self.control_error:.2e}",
        "overloads": len(self.overloads),
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class CircuitRun(Tabulated):
    """Run of a circuit.

    Attributes
    ----------
    trajectory : Trajectory
        States in network units over network time, from the opening of the reset switches.
    deck : Deck
        Simulated netlist.
    overloads : tuple of Overload
        Nodes above `KNEE` of their rails, or above `OVERLOAD` of full scale if parts have no rails,
        worst first. A clipped circuit can settle to a wrong point without further signs.
    probe : Trajectory
        ODE run of the same network.
    circuit : Circuit
        Circuit of the netlist.
    tightest : Overload or None
        Node that came closest to full scale, overloaded or not.
    settling_error : float
        Change of the settling time by finer steps, in seconds; nan for a run without finer steps.
    finer : function of the run, optional
        Function that returns the run with finer steps for `timed`; without it `timed` is the run
        itself.

    Examples
    --------
    >>> import ann_dc
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> run = ann_dc.SpiceBackend().run(network)  # doctest: +SKIP
    >>> run.settled(), run.control_error < 1e-3, run.overloads  # doctest: +SKIP
    (True, True, ())
    """

    trajectory: Trajectory
    deck: Deck
    overloads: tuple[Overload, ...]
    probe: Trajectory
    circuit: Circuit
    settling_error: float = float("nan")
    tightest: Overload | None = None
    finer: Callable[[CircuitRun], CircuitRun] | None = None

    def __str__(self) -> str:
        overloads = f"overload: {'; '.join(map(str, self.overloads[:3])) or 'none'}"
        if not settles(self.probe):
            seconds = 1e6 * float(self.trajectory.time[-1]) * self.deck.timing.unit
            off = math.sqrt(self.mean_square_error)
            return f"ran for {seconds:.4g} us, rms error {off:.2e} against the ODE; {overloads}"
        known = vars(self).get("timed", self)  # text does not start ngspice
        time = 1e6 * control_settling(known.trajectory, 1e-3) * self.deck.timing.unit
        about = "" if known.finer is None else " by coarse steps"
        when = f"controls within 0.1 % after {time:.4g} us{about}"
        return (
            f"{self.unsettled or when}, {self.control_error:.2e} of {self.probe.size_in_words} "
            f"against the ODE; {overloads}"
        )

    @property
    def scaling(self) -> Scaling:
        """Volts and seconds of the circuit."""
        return self.circuit.scaling

    @property
    def fullest(self) -> str:
        """Name of the tightest node and its fraction of full scale; empty if unknown."""
        top = self.tightest
        return f"{top.node} at {top.volts / self.scaling.full_scale:.0%}" if top else ""

    @cached_property
    def timed(self) -> CircuitRun:
        """Run with steps fine enough for its settling time.

        ngspice runs once or twice more at the first access. Errors do not need these runs.
        """
        return self if self.finer is None else self.finer(self)

    @property
    def curves(self) -> Curves:
        """Values of every neuron in the user's units, over seconds since the release."""
        found, unit = self.trajectory.curves, self.deck.timing.unit
        return replace(
            found, time=unit * found.time, time_unit="s", residual_time=unit * found.residual_time
        )

    @property
    def control_error(self) -> float:
        """Largest final control error relative to the size (`size_of`) of the probe's controls."""
        return control_error(self.trajectory.control_values[-1], self.probe)

    @property
    def mean_square_error(self) -> float:
        """Mean square error of the trajectory relative to the mean square of the ODE's.

        The reference is at least that of one state at `RESTING` of its scale.
        """
        at = self.trajectory.time
        wanted = states_of(self.probe, at)
        weight = np.gradient(at)[:, None]  # over time, however unevenly the circuit was sampled
        error = ((self.trajectory.states - wanted) ** 2 * weight).sum()
        return float(error / max((wanted**2 * weight).sum(), RESTING**2 * weight.sum()))

    @property
    def unsettled(self) -> str:
        """Clause on why the run does not show the settled state; empty if it does."""
        if not self.settled():
            why = f": {self.deck.cut}" if self.deck.cut else ""
            return f"the controls still change at the end of the run{why}"
        return f"the run is too short to decide: {self.deck.cut}" if self.deck.cut else ""

    def settled(self, share: float = 1e-3) -> bool:
        """Return True if the controls stayed settled for the last third of the run.

        The allowed deviation is the fraction ``share`` of their size. The controls can still move
        later if the run was cut short; `unsettled` reports this case.
        """
        return control_settling(self.trajectory, share) < 2 / 3 * float(self.trajectory.time[-1])

    def settling_time(self, share: float = 1e-3) -> float:
        """Return the seconds after which every control stays within ``share`` of its size.

        The run is repeated with finer steps (`timed`) if its steps are too long for the result.
        """
        return control_settling(self.timed.trajectory, share) * self.deck.timing.unit


def states_of(probe: Trajectory, times: np.ndarray) -> np.ndarray:
    """Return the states (T, n) of an ideal run at times (T,), with its ends before and after."""
    if probe.is_dense:
        return probe.at(np.clip(times, probe.time[0], probe.time[-1]))
    return np.array([np.interp(times, probe.time, x) for x in probe.states.T]).T


def read_back(
    circuit: Circuit, deck: Deck, raw: Raw, probe: Trajectory, datasheet: Datasheet | None = None
) -> CircuitRun:
    """Return the circuit run with neuron states from the voltages of ngspice.

    Rails of the datasheet define an overload; without a datasheet, parts are ideal. Raises
    `UnknownNameError` if the answer lacks a node of the deck.
    """
    network = circuit.schematic.network
    time, volts = _voltages(circuit, deck, raw)
    states = _states(circuit, volts, time)
    residuals = _residuals(network, time, states)
    nodes = _reached(circuit, volts, time * deck.timing.unit, datasheet or Datasheet())
    return CircuitRun(
        trajectory=Trajectory(
            network=network, time=time, states=states, residual_time=time, residuals=residuals
        ),
        deck=deck,
        overloads=tuple(node for node in nodes if node.volts > node.limit),
        tightest=max(nodes, key=lambda node: node.volts, default=None),
        probe=probe,
        circuit=circuit,
    )


def _voltages(circuit: Circuit, deck: Deck, raw: Raw) -> tuple[np.ndarray, Voltages]:
    """Return network times of the samples and signed voltages of every node."""
    polarity, timing = circuit.schematic.polarity, deck.timing
    columns = {
        (name, stage): polarity[name] * np.real(raw[node])
        for (name, stage), node in deck.signals.items()
    }
    if timing.samples is None:
        after = raw.time >= timing.release
        time = (raw.time[after] - timing.release) / timing.unit
        return time, {place: volts[after] for place, volts in columns.items()}
    time = np.concatenate([[0.0], timing.samples[1:] / timing.unit])
    sampled = {p: np.interp(timing.samples, raw.time, volts) for p, volts in columns.items()}
    return time, sampled


def _residuals(network: Network, time: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Return both residuals (T, 2) at states (T, n), with the inputs of their times."""
    if not network.waveforms:
        kernel = fast_evaluator(network)
        return np.array([kernel.residuals(x) for x in states])
    drive, found = Drive(InterpretedEvaluator(network)), []
    for now, x in zip(time, states):
        drive(float(now))
        found.append(drive.evaluator.residuals(np.ascontiguousarray(x)))
    return np.array(found)


def _states(circuit: Circuit, volts: Voltages, time: np.ndarray) -> np.ndarray:
    """Return states (T, n): q, u, t from their nodes; mu = m - rho c from all nodes."""
    network, scaling, count = circuit.schematic.network, circuit.scaling, len(time)
    values = np.repeat(network.unpack(np.zeros(network.size))[None], count, axis=0)
    for (name, stage), across in volts.items():
        if name in network.neuron_index:
            values[:, network.neuron_index[name], stage] = scaling.value(name, across)
    known = values_over_time(network, time, network.pack(values))
    rectified = (*network.cell.inequality_duals, *network.cell.objectives)
    before = {dual.multiplier: dual.sum for dual in rectified}
    for part in circuit.schematic.parts:
        if not isinstance(part, PICell):
            continue
        with_mu_at_zero = before.get(part.name, part.name)
        proportional = known[:, network.node_index[with_mu_at_zero]]  # rho c
        leaking = 1.0 + part.rho * part.compliance  # of a compliant row, g reads its own m
        for stage in range(network.stages):
            if (part.name, stage) in volts:
                m = scaling.value(part.name, volts[part.name, stage])
                mu = (m - proportional[:, stage]) * leaking[stage]
                if part.rectified:
                    mu = np.where(volts[part.name, stage] > OFF * scaling.full_scale, mu, m)
                values[:, network.neuron_index[part.dual], stage] = mu
    return network.pack(values)


def _reached(
    circuit: Circuit, volts: Voltages, seconds: np.ndarray, datasheet: Datasheet
) -> list[Overload]:
    """Return every node's largest magnitude relative to its limit, in falling order."""
    found = []
    for (name, stage), across in volts.items():
        swing = _swing(circuit, name, datasheet)
        clips = bool(np.isfinite(swing))
        limit = KNEE * swing if clips else OVERLOAD * circuit.scaling.full_scale
        sample = int(np.abs(across).argmax())
        place = {"node": name, "stage": stage, "time": float(seconds[sample])}
        reached = float(np.abs(across[sample]))
        found.append(Overload(**place, volts=reached, limit=limit, clips=clips))
    return sorted(found, key=lambda node: -node.volts / node.limit)


def _swing(circuit: Circuit, name: str, datasheet: Datasheet) -> float:
    """Return the volts at which the part of a node saturates."""
    part = circuit.schematic.by_name.get(name)
    computed = isinstance(part, (Multiplier, Generator))
    return datasheet.multiplier_output_swing if computed else datasheet.output_swing


def check_full_scale(level: Level) -> None:
    """Raise `NetworkError` if parts of a level clip at its full scale."""
    if level.full_scale > KNEE * level.limit:
        share = level.conditions.supply
        supplied = f" with supplies of {share:g} times the nominal voltage" if share != 1 else ""
        raise NetworkError(
            f"full_scale: parts of level {level.name} clip at {level.limit:.4g} V{supplied}, "
            f"got {level.full_scale:g} V; use at most {KNEE * level.limit:.3g} V"
        )


FINER = 4
"""Ratio of the largest steps of a run and the next one."""

TRUNCATION = 7.0
"""Factor of tolerated truncation errors in ngspice, ``trtol``."""

RUNS = 2
"""Largest number of finer runs."""

ENOUGH = 0.01
"""Relative change of the settling time below which no further run is made."""

BEYOND = 1.1
"""End of a finer run relative to the settling time."""


@checked
def refined(
    run: CircuitRun, simulator: Ngspice, datasheet: Datasheet, *, finer: int = FINER
) -> CircuitRun:
    """Return a settled run with finer steps and an error of its settling time.

    A run that did not settle is returned unchanged; a clocked run is accurate to a period. The
    largest steps shrink by ``finer`` from run to run, and truncation errors by twice as much.
    ``settling_error`` is the change by the last of the finer runs. If ngspice fails in a run, the
    settling time is that of the run before, with a warning and a ``settling_error`` of nan.
    """
    samples = run.deck.timing.samples
    if samples is not None:
        return replace(run, settling_error=float(samples[-1] - samples[-2]), finer=None)
    if not run.settled():
        return run
    run = replace(run, finer=None)
    for count in range(1, RUNS + 1):
        before = run.settling_time()
        deck = _finer(run.deck, before, finer**count)
        try:
            raw = simulator.run(deck.text, end_time=deck.end)
        except SpiceError as error:
            warnings.warn(
                f"ngspice failed with steps refined by {finer**count}: {error}; the settling "
                "time is that of coarser steps and may be inaccurate by some percent; raise "
                "the timeout of ngspice",
                stacklevel=2,
            )
            return replace(run, settling_error=float("nan"))
        fine = read_back(run.circuit, deck, raw, run.probe, datasheet).trajectory
        run = replace(run, trajectory=_joined(fine, run.trajectory))
        change = abs(run.settling_time() - before)
        run = replace(run, settling_error=change)
        if change < ENOUGH * before:
            break
    return run


def _finer(deck: Deck, settling: float, factor: int) -> Deck:
    """Return the netlist up to the settling time, with steps finer by a factor."""
    timing = deck.timing
    end = min(timing.release + BEYOND * settling, timing.end)
    finer = replace(timing, end=end, step=timing.step / factor)
    options = f"{deck.options} trtol={TRUNCATION / (2 * factor):.3g}"
    return replace(deck, timing=finer, options=options)


def _joined(fine: Trajectory, coarse: Trajectory) -> Trajectory:
    """Return a trajectory followed, after its end, by another one."""
    later = coarse.time > fine.time[-1]
    time = np.concatenate([fine.time, coarse.time[later]])
    residuals = np.concatenate([fine.residuals, coarse.residuals[later]])
    states = np.concatenate([fine.states, coarse.states[later]])
    return replace(coarse, time=time, states=states, residual_time=time, residuals=residuals)
