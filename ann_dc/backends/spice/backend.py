"""A network as a circuit in ngspice: scaled by a probe run, read back by neuron."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.ode import DOP853, OdeBackend
from ann_dc.backends.run import Trajectory, control_error, control_settling
from ann_dc.backends.spice.netlist.deck import Deck, deck
from ann_dc.backends.spice.ngspice.raw import Raw
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.errors import NetworkError
from ann_dc.evaluation.compiled import Kernel
from ann_dc.fidelity.prediction import is_emulated, judge
from ann_dc.hardware.circuit.circuit import Components, components
from ann_dc.hardware.circuit.deviations import Deviations, draw, parameters
from ann_dc.hardware.circuit.scaling import HEADROOM, MARGIN, Scaling, scale
from ann_dc.hardware.circuit.schematic import Generator, Multiplier, schematic
from ann_dc.hardware.parts.datasheet import Hardware
from ann_dc.hardware.parts.levels import BEHAVIOURAL, Level
from ann_dc.network.network import Network

OVERLOAD = 0.95
"""Share of full scale from which on a node counts as overloaded, where there are no rails."""

KNEE = 0.9
"""Share of its rails from which on a part clips."""

LONGER = 1.5
"""Duration of a circuit run over that of the probe run."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Overload:
    """A node that went further than its part can: where, when (s), and to how many volts."""

    node: str
    stage: int
    time: float
    volts: float
    limit: float

    def __str__(self) -> str:
        return (
            f"{self.node} of cell {self.stage} reached {self.volts:.4g} V at {self.time:.3g} s; "
            f"it is good for {self.limit:.4g} V"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class CircuitRun:
    """One run of a circuit.

    Attributes
    ----------
    trajectory : Trajectory
        States in network units over network time, from the opening of the reset switches on.
    deck : Deck
    scaling : Scaling
    overloads : tuple of Overload
        Nodes above `KNEE` of their rails, or above `OVERLOAD` of full scale where parts have none,
        worst first: a clipped circuit can settle quietly to a wrong point.
    probe : Trajectory
        The ODE run of the same network.
    made : Components
    """

    trajectory: Trajectory
    deck: Deck
    scaling: Scaling
    overloads: tuple[Overload, ...]
    probe: Trajectory
    made: Components

    @property
    def control_error(self) -> float:
        """Largest error of a control at the end, over the largest control of the optimum."""
        return control_error(self.trajectory.controls[-1], self.probe)

    @property
    def mean_square_error(self) -> float:
        """Of the whole trajectory against the ODE, normalised by the mean square of the ODE's."""
        at = self.trajectory.time
        wanted = np.array([np.interp(at, self.probe.time, x) for x in self.probe.states.T]).T
        weight = np.gradient(at)[:, None]  # over time, however unevenly the circuit was sampled
        error = ((self.trajectory.states - wanted) ** 2 * weight).sum()
        return float(error / (wanted**2 * weight).sum())

    def settled(self, share: float = 1e-3) -> bool:
        """Whether the controls kept within ``share`` for the last third of the run."""
        end = self.deck.timing.unit * float(self.trajectory.time[-1])
        return self.settling_time(share) < 2 / 3 * end

    def settling_time(self, share: float = 1e-3) -> float:
        """Seconds after which every control stays within ``share`` of the largest final one."""
        return control_settling(self.trajectory, share) * self.deck.timing.unit


@dataclass(frozen=True, kw_only=True, eq=False)
class SpiceBackend:
    """Runs networks as circuits.

    Attributes
    ----------
    level : Level
    simulator : Ngspice, optional
        One with the level's patience where none is given.
    headroom, margin, intervals
        See `scale`.
    seed : int or None
        Draws the errors of single parts from the level's spread; None: every part as it should be.
    require_stable : bool
        Refuse a circuit whose pole model oscillates: ngspice would take for ever to show it. Set
        it to False to watch one ring.
    progress : callable or None
    """

    level: Level = BEHAVIOURAL
    simulator: Ngspice | None = None
    seed: int | None = None
    headroom: float = HEADROOM
    margin: float = MARGIN
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    require_stable: bool = True
    progress: Callable[[str], None] | None = None

    def prepare(self, network: Network) -> tuple[Components, Trajectory]:
        """Probe, scale and choose components.

        Raises
        ------
        NetworkError
            If the network does not settle, so that there is nothing to scale by.
        """
        level = self.level
        if level.full_scale > KNEE * level.limit:
            raise NetworkError(
                f"full_scale: parts of level {level.name} clip at {level.limit:g} V, got "
                f"{level.full_scale:g} V; take at most {KNEE * level.limit:.3g} V"
            )
        self.tell("probe run")
        run = replace(PROBE, progress=self.progress).run(network)
        if not run.status.settled:
            raise NetworkError(f"circuit: the network has to settle to be scaled; {run.status}")
        trajectory = run.trajectory
        if not np.abs(trajectory.controls[-1]).max(initial=0.0) > 1e-12:
            raise NetworkError(
                "circuit: all controls settle at zero, so that no error can be related to them; "
                "give the problem another target"
            )
        scaling = scale(
            network,
            trajectory.states,
            trajectory.time,
            radius=spectrum(network, trajectory.final).radius,
            gbw=self.level.hardware.usable_bandwidth,
            margin=self.margin,
            full_scale=self.level.full_scale,
            headroom=self.headroom,
            intervals=self.intervals,
        )
        made = schematic(network, differential=self.level.technology.differential)
        return components(made, scaling, smallest=self.level.smallest_resistor), trajectory

    def deviations(self, made: Components) -> dict[str, np.ndarray]:
        """Errors of single parts: drawn from the level's spread with the seed, none without."""
        if self.seed is None:
            return {}
        return draw(parameters(made), self.level.spread, self.seed)

    def run(self, network: Network) -> CircuitRun:
        """Compile a network, simulate it, and read it back.

        Raises
        ------
        NetworkError
            If the network does not settle in continuous time.
        NgspiceMissing, SpiceError
            If ngspice is not there, or fails.
        """
        return simulate(self, *self.prepare(network))

    def tell(self, line: str) -> None:
        """One line of progress."""
        if self.progress:
            self.progress(line)


def simulate(
    backend: SpiceBackend,
    made: Components,
    probe: Trajectory,
    deviations: Deviations | None = None,
) -> CircuitRun:
    """Run components on a backend's level, and compare them with their probe run.

    ``deviations`` say which parts are off by how much, instead of the backend's seed.

    Raises
    ------
    NetworkError
        If the pole model oscillates and the backend requires stability.
    SpiceError
        If ngspice fails.
    """
    off = backend.deviations(made) if deviations is None else deviations
    if backend.require_stable and is_emulated(made, backend.level):
        _check_stable(backend, made, probe, off)
    duration = LONGER * float(probe.time[-1])
    written = deck(made, backend.level, duration=duration, deviations=off)
    backend.tell(f"ngspice, {backend.level.name} level")
    simulator = backend.simulator or Ngspice(timeout=backend.level.patience)
    raw = simulator.run(written.text, end_time=written.end)
    return read_back(made, written, raw, probe, backend.level.hardware)


def _check_stable(
    backend: SpiceBackend, made: Components, probe: Trajectory, deviations: Deviations
) -> None:
    backend.tell("eigenvalues of the pole model")
    level = backend.level
    found = judge(level.emulate(made, deviations), probe)
    if found.abscissa < 0:
        return
    ideal = spectrum(made.schematic.network, probe.final).abscissa
    if ideal >= 0:
        why = f"so is the ideal network ({ideal:+.3g}); no hardware cures that"
    else:
        why = (
            f"parts of {level.hardware.usable_bandwidth:.3g} Hz are too slow at margin "
            f"{backend.margin:g}; raise the margin"
        )
    raise NetworkError(
        f"circuit: the pole model is unstable (an eigenvalue of {found.abscissa:+.3g} per unit of "
        f"network time): {why}"
    )


PROBE = OdeBackend(method=DOP853, verify=False)
"""The run that a circuit is scaled by and compared with."""


def read_back(
    made: Components, written: Deck, raw: Raw, probe: Trajectory, hardware: Hardware | None = None
) -> CircuitRun:
    """States of the neurons from the voltages of a run; rails are those of the hardware."""
    network, scaling = made.schematic.network, made.scaling
    time, nodes = _voltages(made, written, raw)
    states = _states(made, nodes, len(time))
    kernel = Kernel(network)
    residuals = np.array([kernel.residuals(x) for x in states])
    seconds = time * written.timing.unit
    return CircuitRun(
        trajectory=Trajectory(
            network=network, time=time, states=states, residual_time=time, residuals=residuals
        ),
        deck=written,
        scaling=scaling,
        overloads=_overloads(made, nodes, seconds, hardware or Hardware()),
        probe=probe,
        made=made,
    )


def _voltages(
    made: Components, written: Deck, raw: Raw
) -> tuple[np.ndarray, dict[tuple[str, int], np.ndarray]]:
    """Network time of the samples, and the voltage of every node with the sign of its value."""
    polarity, timing, samples = made.schematic.polarity, written.timing, written.timing.samples
    if samples is None:
        after = raw.time >= timing.release
        time = (raw.time[after] - timing.release) / timing.unit
        look = lambda volts: volts[after]  # noqa: E731
    else:
        time = np.concatenate([[0.0], samples[1:] / timing.unit])
        look = lambda volts: np.interp(samples, raw.time, volts)  # noqa: E731
    nodes = {
        place: polarity[place[0]] * look(np.real(raw[node]))
        for place, node in written.signals.items()
    }
    return time, nodes


def _states(made: Components, nodes: dict[tuple[str, int], np.ndarray], count: int) -> np.ndarray:
    """(T, n): q, u, t as they are; mu = m - rho c, with c from the others."""
    network, scaling = made.schematic.network, made.scaling
    values = np.repeat(network.unpack(np.zeros(network.size))[None], count, axis=0)
    for (name, stage), volts in nodes.items():
        if name in network.neuron_index:
            values[:, network.neuron_index[name], stage] = scaling.value(name, volts)
    rows, program = network.program.nodes, network.program
    known = program.values(network.pack(values))[..., 1:-1]
    for part in made.schematic.parts:
        dual = getattr(part, "dual", None)
        for stage in range(network.stages):
            if dual is not None and (part.name, stage) in nodes:
                given = scaling.value(part.name, nodes[part.name, stage])
                proportional = known[:, rows[part.name], stage]  # m with mu at zero: rho c
                values[:, network.neuron_index[dual], stage] = given - proportional
    return network.pack(values)


def _overloads(made: Components, nodes, seconds: np.ndarray, hardware: Hardware):
    found = []
    for (name, stage), volts in nodes.items():
        part = made.schematic.by_name.get(name)
        computed = isinstance(part, (Multiplier, Generator))
        rails = hardware.multiplier_rails if computed else hardware.rails
        full_scale = made.scaling.full_scale
        limit = KNEE * rails if np.isfinite(rails) else OVERLOAD * full_scale
        sample = int(np.abs(volts).argmax())
        reached = float(np.abs(volts[sample]))
        if reached > limit:
            found.append(
                Overload(
                    node=name,
                    stage=stage,
                    time=float(seconds[sample]),
                    volts=reached,
                    limit=limit,
                )
            )
    return tuple(sorted(found, key=lambda overload: -overload.volts / overload.limit))
