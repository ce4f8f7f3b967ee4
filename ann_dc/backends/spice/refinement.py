"""Settling time of a circuit from repeated runs with finer steps.

A run that shows the settled state spends most of its steps after settling. A second run ends at the
settling time, with a largest step a fourth as long and an eighth of the truncation error. The
change of the settling time is its error estimate.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import partial

import numpy as np

from ann_dc.backends.spice.circuit_run import CircuitRun, read_back
from ann_dc.backends.spice.netlist.deck import Deck
from ann_dc.backends.spice.ngspice.raw import Raw
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import SpiceError
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.parts.datasheet import Datasheet
from ann_dc.validation import Count, checked

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


def read_timed(
    answer: tuple[Circuit, Deck, Raw, Trajectory], simulator: Ngspice, datasheet: Datasheet
) -> CircuitRun:
    """Read back a run whose settling time comes from finer runs, made on request.

    ``answer`` contains circuit, netlist, answer of ngspice and probe, as for `read_back`.
    """
    finer = partial(refined, simulator=simulator, datasheet=datasheet)
    return replace(read_back(*answer, datasheet), finer=finer)


@checked
def refined(
    run: CircuitRun, simulator: Ngspice, datasheet: Datasheet, *, finer: Count = FINER
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
                f"ngspice failed in steps finer by {finer**count}: {error}; the settling time is "
                "that of coarser steps and may be some percent off; allow ngspice more time",
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
