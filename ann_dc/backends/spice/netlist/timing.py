"""Timing and simulation settings of a run: reset, end, options, time limit.

A level defines the circuit. The simulation settings follow from the level but are not part of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.backends.spice.netlist.cell_text import number
from ann_dc.backends.spice.pdk.files import PACKAGE
from ann_dc.errors import require_positive, such_as
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.technologies import SwitchedCapacitors, Technology
from ann_dc.network.waveforms import Waveform
from ann_dc.validation import checked

ACCURATE = "method=trap reltol=1e-4 abstol=1e-12 vntol=1e-7 pivrel=1e-9"
"""Options of a run that proves stability; a damped method would hide ringing."""


@checked
@such_as("ann_dc.backends.spice.netlist.Simulation()")
@dataclass(frozen=True, kw_only=True)
class Simulation:
    """Settings for running a circuit in ngspice.

    Attributes
    ----------
    options : str
        Text of the ``.options`` card.
    points : int
        Smallest number of steps of a continuous run: its duration over the largest step.
    patience : float
        Time limit of a run in seconds.

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
"""Settings for circuits in continuous time."""

CLOCKED = Simulation(
    options="method=gear reltol=1e-3 abstol=1e-12 vntol=1e-7",
    patience=1800.0,
)
"""Settings for circuits with a clock, whose edges determine the steps."""


FOUNDRY = Simulation(patience=3600.0)
"""Settings for circuits of a foundry's transistors, which take minutes instead of the second that
op-amp macro models take.
"""


def simulation_for(level: Level) -> Simulation:
    """Return the default simulation settings for the circuits of a level."""
    if level.technology.clocked:
        return CLOCKED
    return FOUNDRY if level.models == PACKAGE else CONTINUOUS


RELEASE = 1e-3
"""Network time at which the reset switches open."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Timing:
    """Reset until ``release``, run until ``end`` with the largest ``step``, in seconds.

    ``unit`` is the seconds per unit of network time. ``samples`` (T,) are the seconds at which a
    clocked circuit is read, once per period; None reads every time step.
    """

    release: float
    end: float
    step: float
    unit: float
    samples: np.ndarray | None = None


def reset_card(release: float) -> str:
    """Return the source of the reset signal: 5 V closed, 0 V open.

    The switches open at half of 5 V, at ``release`` in seconds.
    """
    return f"V_rst rst 0 PWL(0 5 {number(0.9 * release)} 5 {number(1.1 * release)} 0)"


JUMP = 1e-4
"""Duration of a jump of an input, relative to the shortest time between two samples."""


def pwl_card(node: str, waveform: Waveform, volts: np.ndarray, timing: Timing) -> str:
    """Return the source of an input over time, whose samples are ``volts`` (K,).

    Network time zero is the opening of the reset switches. A sample that is held until the next one
    jumps within `JUMP` of the shortest interval.
    """
    times = waveform.times
    if waveform.hold == "previous" and len(times) > 1:
        late = times[1:] + JUMP * np.diff(times).min()
        order = np.argsort(np.concatenate([times, late]), kind="stable")
        before = np.concatenate([volts[:1], volts[:-1]])
        times = np.concatenate([times, late])[order]
        volts = np.concatenate([before, volts[1:]])[order]
    first = np.interp(0.0, times, volts)
    later = times > 0
    seconds = timing.release + timing.unit * times[later]
    pairs = [f"0 {number(first)}", f"{number(timing.release)} {number(first)}"]
    pairs += [f"{number(s)} {number(v)}" for s, v in zip(seconds, volts[later])]
    lines = [" ".join(pairs[k : k + PAIRS]) for k in range(0, len(pairs), PAIRS)]
    return f"V_{node} {node} 0 PWL(" + "\n+ ".join(lines) + ")"


PAIRS = 4
"""Number of samples on a line of a source."""


def timing_of(built: Technology, time_scale: float, duration: float, points: int) -> Timing:
    """Return the timing of a run of ``duration`` network time.

    A continuous circuit is reset for a thousandth of a unit of network time. In a clocked circuit
    the reset opens in the first sampling phase, and the state is read at the end of each period.
    ``time_scale`` gives seconds per unit of network time; a clocked circuit derives it from clock
    and step.
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
    """Return reset switches that open at ``timing.release``, and the clock, if any."""
    reset = reset_card(timing.release)
    if not isinstance(built, SwitchedCapacitors):
        return [reset]
    period = 1 / built.clock
    times = f"t={number(period)} gap={number(0.04 * period)} tr={number(0.01 * period)}"
    return [f"X_clock p1 p2 clk2 {times}", reset]
