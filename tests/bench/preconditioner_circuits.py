"""Circuits by preconditioner: settling, parts and error, in ngspice and emulated.

Op amps of 10 MHz, gain 1e6, no errors of single parts; each circuit as `ann-dc circuit`
would build it. What a preconditioner demands of its wires stands beside it: the largest lag of its
nodes, in the network's fastest time constants, and the largest rms error of its weights, each of
which doubles the time of the slowest mode. The pendulum and the arm have shorter horizons than in
the suite, for ngspice takes minutes where op amps have to be a hundred times as fast as the network
(half an hour in all); after `PATIENCE` seconds it is stopped.
"""

from collections.abc import Iterator

import numpy as np
from bench.figure import Figure, show
from preconditioner_networks import with_preconditioner

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.netlist.timing import Simulation
from ann_dc.errors import SpiceTimeoutError
from ann_dc.fidelity.fitting import fitted
from ann_dc.fidelity.prediction import predict
from ann_dc.fidelity.wire_requirements import PreconditionerDemand, preconditioner_demand
from ann_dc.hardware.circuit.cost import CAPACITOR, NEGATIVE, OP_AMP, RESISTOR
from ann_dc.hardware.parts.levels import macro
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind

PLANTS = {"car": None, "pendulum": 12, "two_link_arm": 8}
"""Horizons that are shorter than the suite's, where ngspice would take too long."""

KINDS = (
    PreconditionerKind.DIAGONAL,
    PreconditionerKind.MULTILEVEL,
    PreconditionerKind.COUPLED_MULTILEVEL,
    PreconditionerKind.CYCLIC_REDUCTION,
    PreconditionerKind.RESISTIVE_GRID,
)
PATIENCE = 240.0


def prepared(network: Network):
    """The backend with the margin and the intervals that suit the preconditioner, and what it
    builds.
    """
    backend = SpiceBackend(level=macro(), simulation=Simulation(points=1000, patience=PATIENCE))
    if network.preconditioner.kind is not PreconditionerKind.DIAGONAL:
        backend = fitted(backend, network)
    return backend, *backend.prepare(network)


def demanded(found: PreconditionerDemand | None) -> str:
    """In few words."""
    if found is None:
        return ""
    return f"; requires a lag below {found.lag:.1e} and weights within {found.error:.2g}"


def measured(
    name: str, kind: PreconditionerKind, horizon: int | None
) -> tuple[Figure, tuple[float, float]]:
    """One circuit, and by what parts of ngspice's the emulated settling time and error differ."""
    network = with_preconditioner(name, kind, horizon)
    backend, circuit, probe = prepared(network)
    reported = predict(circuit, backend.level, probe)
    deck = backend.deck(circuit, probe, {})
    parts = [(OP_AMP, "op amps"), (RESISTOR, "R"), (NEGATIVE, "negative R"), (CAPACITOR, "C")]
    count = ", ".join(f"{deck.parts[part]} {word}" for part, word in parts if part in deck.parts)
    apart = (np.nan, np.nan)
    try:
        run = backend.measure(circuit, deck, probe)
        settling = f"{1e6 * run.settling_time():.1f} us" if run.settled() else "does not settle"
        error = f"{run.control_error:.1e}"
        apart = (
            abs(reported.settling_time / run.settling_time() - 1),
            abs(reported.control_error / run.control_error - 1),
        )
    except SpiceTimeoutError:
        settling = error = f"not done in {PATIENCE:.0f} s"
    soon = np.isfinite(reported.settling_time)
    when = f"{1e6 * reported.settling_time:.1f} us" if soon else "not in 30000 steps"
    figure = Figure(
        name=f"{name}, {kind.value}, N = {network.stages}",
        value=settling,
        remark=f"emulated {when}; error {error}, emulated {reported.control_error:.1e}; {count}; "
        f"margin {circuit.scaling.bandwidth_margin:.0f}"
        + demanded(preconditioner_demand(network, probe.final)),
    )
    return figure, apart


def figures() -> Iterator[Figure]:
    """One a circuit; the last compares emulation and ngspice over all of them."""
    differences = []
    for name, horizon in PLANTS.items():
        for kind in KINDS:
            figure, apart = measured(name, kind, horizon)
            differences.append(apart)
            yield figure
    settling, error = 100 * np.array(differences).T
    yield Figure(
        name=f"emulated settling time against ngspice, {len(differences)} circuits of op amps",
        value=f"within {np.nanmax(settling):.2g} %, median {np.nanmedian(settling):.2g} %",
        remark=f"error of the controls: within {np.nanmax(error):.2g} %, "
        f"median {np.nanmedian(error):.2g} %; {np.isfinite(settling).sum()} simulated",
    )


if __name__ == "__main__":
    raise SystemExit(show(figures()))
