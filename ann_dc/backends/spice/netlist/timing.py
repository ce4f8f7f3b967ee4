"""When what happens in a run, and how ngspice is to run it: reset, the end, options, patience.

A level says what is built; how that is simulated follows from it, and is no part of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.backends.spice.netlist.cell_text import number
from ann_dc.backends.spice.pdk.files import PACKAGE
from ann_dc.errors import require_positive
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.technologies import SwitchedCapacitors, Technology
from ann_dc.validation.checked import checked
from ann_dc.validation.values import such_as

ACCURATE = "method=trap reltol=1e-4 abstol=1e-12 vntol=1e-7 pivrel=1e-9"
"""Options of a run that proves stability: a damped method would hide ringing."""


@checked
@such_as("ann_dc.backends.spice.netlist.Simulation()")
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

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.backends.spice.netlist import Simulation
    >>> finer = ann_dc.SpiceBackend(simulation=Simulation(points=3000, patience=600.0))
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


FOUNDRY = Simulation(patience=3600.0)
"""Of circuits of a foundry's transistors: minutes where op amps as macro models take a second."""


def simulation_for(level: Level) -> Simulation:
    """What the circuits of a level are simulated with unless something else is asked for."""
    if level.technology.clocked:
        return CLOCKED
    return FOUNDRY if level.models == PACKAGE else CONTINUOUS


RELEASE = 1e-3
"""Network time at which the reset switches open."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Timing:
    """When reset ends, when the run ends, and where to look.

    Attributes
    ----------
    release, end : float
        In seconds.
    step : float
        Largest step of the simulator in seconds.
    unit : float
        Seconds per unit of network time.
    samples : (T,) array or None
        Seconds at which a clocked circuit is read, once a period; None reads every time step.
    """

    release: float
    end: float
    step: float
    unit: float
    samples: np.ndarray | None = None


def reset_card(release: float) -> str:
    """The source of the reset signal: 5 V closed, 0 V open; switches open at half of it.

    Parameters
    ----------
    release : float
        Seconds at which they open.

    Examples
    --------
    >>> reset_card(1e-9)
    'V_rst rst 0 PWL(0 5 9e-10 5 1.1e-09 0)'
    """
    return f"V_rst rst 0 PWL(0 5 {number(0.9 * release)} 5 {number(1.1 * release)} 0)"


def timing_of(built: Technology, time_scale: float, duration: float, points: int) -> Timing:
    """When what happens, for a run of ``duration`` network time.

    A continuous circuit is reset for a thousandth of a unit of network time. In a clocked one reset
    opens in the first sampling phase, and the state is read at the end of each period.

    Parameters
    ----------
    built : Technology
    time_scale : float
        Seconds per unit of network time; a clocked circuit takes its own from clock and step.
    duration : float
        In units of network time.
    points : int
        Steps that a continuous run takes at least.
    """
    if isinstance(built, SwitchedCapacitors):
        period = 1 / built.clock
        cycles = max(int(np.ceil(duration / built.step - 1e-9)), 1)
        samples = np.concatenate([[0.45 * period], (1 + np.arange(cycles)) * period])
        return Timing(
            release=0.25 * period,
            end=(cycles + 0.01) * period,
            step=period / 10,
            unit=period / built.step,
            samples=samples,
        )
    release = RELEASE * time_scale
    span = duration * time_scale
    return Timing(release=release, end=release + span, step=span / points, unit=time_scale)


def control_cards(built: Technology, timing: Timing) -> list[str]:
    """Reset switches that open at ``timing.release``, and the clock of a clocked circuit."""
    reset = reset_card(timing.release)
    if not isinstance(built, SwitchedCapacitors):
        return [reset]
    period = 1 / built.clock
    times = f"t={number(period)} gap={number(0.04 * period)} tr={number(0.01 * period)}"
    return [f"X_clock p1 p2 clk2 {times}", reset]
