"""Boards of every part set on ten plants, and on four with bounds.

Each is made as `ann-dc circuit` makes it. What the emulation calls stable has to settle in ngspice,
with its error and its settling time within `CLOSE`; what does not work has to be refused before it
runs, with what would. The largest control of a regulator rests `BELOW` its bound. Then `DRAWN`
boards of each preset, whose parts are off by their tolerances: all of them emulated; the best, the
middle one and the worst in ngspice, too. An hour in all.
"""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
import sympy as sp
from bench.figure import Figure, show
from by_hand import BY_HAND, wired_by_hand
from constrained import CONSTRAINED, cart, two_tanks
from wired import neighbour_wired

from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.backends.spice.circuit_run import CircuitRun, refined
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.errors import NetworkError
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.circuit_study import instances, settled_error
from ann_dc.fidelity.prediction import Prediction, predict
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.parts import presets
from ann_dc.hardware.schematic.buildable import clamped_full_scale
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.solver import solve, synthesize

PLANTS = {
    "double_integrator": 5,
    "lq_stable": 6,
    "pendulum": 8,
    "unicycle": 6,
    "van_der_pol": 8,
    "cstr": 6,
    "car": 9,
}
"""Horizons; those of plants by hand are their own."""

BOUNDED = {
    "dint_u": (CONSTRAINED["dint_u"].build, PreconditionerKind.MULTILEVEL),
    "car_steer": (CONSTRAINED["car_steer"].build, PreconditionerKind.DIAGONAL),
    "two_tanks": (two_tanks, PreconditionerKind.MULTILEVEL),
    "cart": (cart, PreconditionerKind.DIAGONAL),
}
"""Plants whose controls have bounds, which clamps keep, and a preconditioner with which they
settle.
"""

REGULATOR = "regulator"
ALL = (*PLANTS, *BY_HAND, *BOUNDED, REGULATOR)

BELOW = (5e-4, 1e-3, 1e-2, 5e-2)
"""Shares of its bound by which a control rests below it."""

DRAWN_PLANTS = ("double_integrator", "pendulum", "car", "two_tanks")
DRAWN = 50
SPOTS = 3

CLOSE = 0.05
"""By how much error and settling time in ngspice may be off what is predicted."""

BAND = 1e-3
"""Of the controls, within which they count as settled."""

PATIENCE = 600.0


def network_of(plant: str) -> Network:
    """With time constants alone, but for some that have bounds."""
    if plant in BOUNDED:
        build, kind = BOUNDED[plant]
        return design(synthesize(build()), preconditioner=(kind,)).network
    return wired_by_hand(plant) if plant in BY_HAND else neighbour_wired(plant, PLANTS[plant])


def regulator(bound: float | None = None) -> OptimalControlProblem:
    """A position and a speed to rest in four steps; the second control is the largest one."""
    x, v, a = sp.symbols("x v a")
    return OptimalControlProblem(
        states=(x, v), controls=(a,), map=(x + v + a / 2, v + a), horizon=4, q_0=(5, -2), q_d=None,
        cost=x**2 / 2 + v**2 / 2 + a**2 / 20, terminal_cost=x**2 / 2 + v**2 / 2,
        bounds={} if bound is None else {a: (-bound, bound)},
    )  # fmt: skip


def below(share: float) -> Network:
    """Return the regulator's network with a bound of which the largest control misses a share."""
    free = solve(regulator())
    largest = np.abs(free.populations["u"]).max() / (1 - share)
    return design(
        synthesize(regulator(largest)), preconditioner=(PreconditionerKind.DIAGONAL,)
    ).network


def board_of(preset: str, network: Network) -> SpiceBackend:
    """What makes a network of a preset's parts, and has the time that runs take."""
    level = clamped_full_scale(network, presets.get(preset))
    return SpiceBackend(level=level, simulator=Ngspice(timeout=PATIENCE))


def compared(backend: SpiceBackend, instance: CircuitInstance) -> tuple[Prediction, CircuitRun]:
    """What a circuit is said to do, and what it does, with steps as fine as settling asks for."""
    circuit, probe, off = instance.circuit, instance.probe, instance.deviations
    said = predict(circuit, backend.level, probe, off)
    run = simulate(backend, circuit, probe, off)
    return said, refined(run, backend.simulator, backend.level.datasheet)


def agree(said: Prediction, run: CircuitRun) -> bool:
    """Whether a circuit settles as it was said to."""
    error, late = differences(said, run)
    return run.settled() and abs(error) < CLOSE and abs(late) < CLOSE


def differences(said: Prediction, run: CircuitRun) -> tuple[float, float]:
    """By what share the error and the settling time of a run are larger than predicted.

    A control that lingers at the edge of its band has no settling time to compare: one between
    those of bands `CLOSE` narrower and wider is right. Where none is predicted, the second is nan,
    and close to nothing.
    """
    wide, narrow = (run.settling_time(share * BAND) for share in (1 + CLOSE, 1 - CLOSE))
    fitting = float(np.clip(said.settling_time, wide, narrow))
    return run.control_error / said.control_error - 1, fitting / said.settling_time - 1


def names_a_cure(refusal: str) -> bool:
    """Whether a refusal says what would make it work."""
    return any(cure in refusal for cure in ("use ", "raise ", "give it ", "design "))


def made(plant: str, preset: str, network: Network) -> Figure:
    """One board, with the parts of its drawings."""
    name = f"{plant}, {preset}"
    backend = board_of(preset, network)
    try:
        circuit, probe = backend.prepare(network)
        instance = CircuitInstance(circuit=circuit, level=backend.level, probe=probe)
        said, run = compared(backend, instance)
    except NetworkError as refusal:
        text = str(refusal)
        return Figure(name=name, value="refused", remark=text, good=names_a_cure(text))
    smallest = min(float(np.nanmin(ohms)) for ohms in circuit.resistors.values())
    return Figure(
        name=name,
        value=f"{1e6 * run.settling_time():.4g} us" if run.settled() else "does not settle",
        remark=f"predicted {said.unknown or f'{1e6 * said.settling_time:.4g} us'}; "
        f"error {run.control_error:.2e}, predicted {said.control_error:.2e}; "
        f"R from {smallest:.2g} ohm, C from {1e12 * circuit.ranges[1][0]:.2g} pF, "
        f"margin {circuit.scaling.bandwidth_margin:.3g}",
        good=agree(said, run),
    )


def drawn(plant: str, preset: str, count: int = DRAWN) -> Figure:
    """Boards whose parts are off."""
    network = network_of(plant)
    backend = board_of(preset, network)
    circuit, probe = backend.prepare(network)
    nominal = CircuitInstance(circuit=circuit, level=backend.level, probe=probe)
    known = list(instances(nominal, range(count)))
    errors = np.array([settled_error(instance) for instance in known])
    settling = int(np.isfinite(errors).sum())
    spots = [compared(backend, known[seed]) for seed in spread(errors)]
    off = np.abs([differences(said, run) for said, run in spots if run.settled()])
    worst = off.max(axis=0) if len(off) else np.full(2, np.nan)
    return Figure(
        name=f"{plant}, {preset}, {count} drawn",
        value=f"{settling} settle",
        remark=f"error {np.nanmin(errors):.2e} to {np.nanmax(errors):.2e}; {len(off)} of "
        f"{len(spots)} settle in ngspice, errors within {worst[0]:.1%}, settling {worst[1]:.1%}",
        good=settling == count and all(agree(said, run) for said, run in spots),
    )


def spread(errors: np.ndarray) -> Sequence[int]:
    """Circuits that settle: the best, the middle one and the worst."""
    ranked = np.argsort(errors)[: int(np.isfinite(errors).sum())]  # nan is sorted to the end
    places = np.linspace(0, len(ranked) - 1, min(SPOTS, len(ranked))).round().astype(int)
    return [int(ranked[place]) for place in places]


def figures(names: Sequence[str] = ALL) -> Iterator[Figure]:
    """Figures of plants, and of controls `BELOW` their bounds if the regulator is named."""
    for plant, preset in itertools.product(ALL, presets.names()):
        if plant in names and plant != REGULATOR:
            yield made(plant, preset, network_of(plant))
    for share, preset in itertools.product(BELOW if REGULATOR in names else (), presets.names()):
        yield made(f"control {share:.2%} below its bound", preset, below(share))
    for plant, preset in itertools.product(DRAWN_PLANTS, presets.names()):
        if plant in names:
            yield drawn(plant, preset)


if __name__ == "__main__":
    raise SystemExit(show(figures()))
