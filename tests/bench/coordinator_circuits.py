"""Circuits with coarse levels: settling, error, parts and power over the number of stages.

Op amps of 10 MHz, gain 1e6, no errors of single parts. Those of time constants have a margin of 10,
those with coordinators the margin and the intervals that `fitted` finds, as `ann-dc circuit` has
them. Power is quiescent, with op amps and multipliers like those of the transistor level. ngspice
takes three minutes for the car's pyramid at N = 18 and twenty at N = 36; what takes it longer is
not simulated.
"""

from collections.abc import Iterator
from dataclasses import replace

from bench.figure import Figure, show

import ann_dc
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.netlist.timing import Simulation
from ann_dc.fidelity.fitting import fitted
from ann_dc.fidelity.prediction import predict
from ann_dc.hardware.circuit.cost import CAPACITOR, MULTIPLIER, OP_AMP, RESISTOR, cost_of
from ann_dc.hardware.parts.levels import TRANSISTOR, macro
from ann_dc.network.preconditioners.base import PreconditionerKind

ROWS = (
    ("double_integrator", 20),
    ("double_integrator", 40),
    ("car", 9),
    ("car", 18),
    ("car", 36),
    ("car", 80),
)
KINDS = (
    PreconditionerKind.DIAGONAL,
    PreconditionerKind.MULTILEVEL,
    PreconditionerKind.COUPLED_MULTILEVEL,
)
PLAIN = 10.0
"""Margin of time constants alone."""

PATIENCE = 3600.0
UNSIMULATED = {("car", 80, kind) for kind in KINDS} | {
    ("car", 36, PreconditionerKind.COUPLED_MULTILEVEL)
}
"""What takes ngspice too long: of the last one it had run a sixth in three quarters of an hour."""


def measured(name: str, stages: int, kind: PreconditionerKind) -> Figure:
    """One circuit."""
    problem = getattr(ann_dc.plants, name)(N=stages)
    network = ann_dc.design(problem, preconditioner=[kind]).network
    backend = SpiceBackend(level=macro(a0=1e6), simulation=Simulation(patience=PATIENCE))
    plain = kind is PreconditionerKind.DIAGONAL
    backend = replace(backend, bandwidth_margin=PLAIN) if plain else fitted(backend, network)
    circuit, probe = backend.prepare(network)
    deck = backend.deck(circuit, probe, {})
    found = predict(circuit, backend.level, probe)
    reported = "not simulated"
    if (name, stages, kind) not in UNSIMULATED:
        run = backend.measure(circuit, deck, probe)
        reported = f"in ngspice {1e6 * run.settling_time():.1f} us, error {run.control_error:.2e}"
    kinds = (OP_AMP, MULTIPLIER, RESISTOR, CAPACITOR)
    count = ", ".join(f"{deck.parts[part]} {part}" for part in kinds if part in deck.parts)
    power = cost_of(deck.parts, TRANSISTOR.datasheet, found.settling_time).power
    return Figure(
        name=f"{name}, {kind.value}, N = {stages}",
        value=f"{1e6 * found.settling_time:.1f} us" if not found.unknown else found.unknown,
        remark=f"emulated, error {found.control_error:.2e}; {reported}; "
        f"margin {circuit.scaling.bandwidth_margin:.0f}; "
        f"{count}; {power:.2g} W",
    )


def figures() -> Iterator[Figure]:
    """Every figure."""
    for name, stages in ROWS:
        for kind in KINDS:
            yield measured(name, stages, kind)


if __name__ == "__main__":
    raise SystemExit(show(figures()))
