"""How ngspice is to run a circuit: its options, its steps, its patience.

A level says what is built; how that is simulated follows from its technology, and is no part of it.
"""

from __future__ import annotations

from dataclasses import dataclass

from ann_dc.errors import require_positive
from ann_dc.hardware.parts.technologies import Technology

ACCURATE = "method=trap reltol=1e-4 abstol=1e-12 vntol=1e-7 pivrel=1e-9"
"""Options of a run that proves stability: a damped method would hide ringing."""


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """How ngspice runs a circuit.

    Attributes
    ----------
    options : str
        Of its ``.options`` card.
    points : int
        Steps that a continuous run takes at least: its duration over the largest step.
    patience : float
        Seconds that a run may take.

    Raises
    ------
    NetworkError
        If a number is not positive.
    """

    options: str = ACCURATE
    points: int = 300
    patience: float = 120.0

    def __post_init__(self) -> None:
        require_positive(points=self.points, patience=self.patience)


CONTINUOUS = Simulation()
"""Of circuits in continuous time."""

CLOCKED = Simulation(
    options="method=gear reltol=1e-3 abstol=1e-12 vntol=1e-7",
    patience=1800.0,
)
"""Of circuits with a clock, whose steps its edges set."""


def simulation_for(built: Technology) -> Simulation:
    """What a technology is simulated with unless something else is asked for."""
    return CLOCKED if built.clocked else CONTINUOUS
