"""Figures of a circuit run from reset, and of a comparison of all model levels."""

from __future__ import annotations

from textwrap import fill
from typing import Annotated

import numpy as np
from matplotlib.figure import Figure

from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.backends.trajectory import Trajectory
from ann_dc.fidelity.level_comparison import Group, Measured
from ann_dc.hardware.schematic.elements import PICell
from ann_dc.plotting import style
from ann_dc.plotting.style import BLUE, GREEN, GREY, INK, PURPLE, SKY, VERMILION
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.validation import NotEmpty, checked

COLOURS = {"q": BLUE, "u": VERMILION, "mu": PURPLE, "t": SKY, "beta": GREEN}

SHORTEST = 0.01
"""Smallest drawn duration relative to the run; a circuit that starts in equilibrium settles at
once.
"""

LOWEST = 1e-10
"""Lower limit of drawn errors."""


@checked
def circuit(run: CircuitRun, problem: OptimalControlProblem) -> Figure:
    """Plot the voltages of all neurons, and the distance of the controls to their end."""
    run = run.timed
    figure = style.new_figure(7.6, 5.6)
    volts, error = figure.subplots(2, 1, sharex=True)
    seconds, settled = run.trajectory.time * run.deck.timing.unit * 1e6, run.settling_time() * 1e6
    shown = max(2 * settled, SHORTEST * seconds[-1]) if np.isfinite(settled) else np.inf
    end = min(shown, float(seconds[-1]))
    _voltages(volts, run, seconds)
    controls, probe = run.trajectory.control_values, run.probe
    distance = np.abs(controls - controls[-1]).max(axis=1) / run.trajectory.control_size
    error.semilogy(
        seconds[:-1], np.maximum(distance, LOWEST)[:-1], color=VERMILION, label="to its final value"
    )
    wanted = np.abs(controls - probe.control_values[-1]).max(axis=1) / probe.control_size
    error.semilogy(seconds, np.maximum(wanted, LOWEST), color=INK, lw=1, label="to the optimum")
    error.axhline(1e-3, color=GREY, lw=1, ls=":")
    error.set(xlabel="time (µs)", ylabel="distance of the controls\n" + _share(probe))
    lowest = min(line.get_ydata()[line.get_xdata() <= end].min() for line in error.lines[:2])
    error.set_ylim(bottom=lowest / 3)
    for axes in (volts, error):
        axes.set_xlim(0, end)
        if np.isfinite(settled):
            axes.axvline(settled, color=INK, lw=1, ls="--", label="within 0.1 %")
        style.quiet(axes)
        style.legend_beside(axes)
    outcome = f"within 0.1 % after {settled:.3g} µs" if np.isfinite(settled) else "not settled"
    found = f"{outcome}, error of controls {run.control_error:.1e}"
    style.headline(figure, f"{style.caption(problem)}, as a circuit\n{found}")
    return figure


def _share(probe: Trajectory) -> str:
    """Return the size of the controls as a wrapped label."""
    return fill(f"(relative to {probe.size_in_words})", 36)


def _voltages(axes, run: CircuitRun, seconds: np.ndarray) -> None:
    network, scaling = run.trajectory.network, run.scaling
    values = network.unpack(run.trajectory.states)
    parts = run.circuit.schematic.parts
    dual = {part.dual: part.name for part in parts if isinstance(part, PICell)}
    labelled: set[str] = set()
    for neuron, row in network.neuron_index.items():
        population = network.neuron(neuron).population
        unit = scaling.unit.get(dual.get(neuron, neuron))
        if unit is None:
            continue
        live = network.live[row]
        lines = axes.plot(
            seconds,
            values[:, row, live] * (scaling.full_scale / unit),
            color=COLOURS.get(population, GREY),
            lw=0.7,
        )
        if population not in labelled and lines:
            lines[0].set_label(population)
            labelled.add(population)
    for rail in (-1, 1):
        axes.axhline(rail * scaling.full_scale, color=GREY, lw=1, ls=":")
    axes.set(ylabel="voltage (V)")


@checked
def comparison(
    done: Annotated[list[Measured], NotEmpty()], problem: OptimalControlProblem
) -> Figure:
    """Plot the predicted and measured error and settling time of every model level.

    Measurements are made with ngspice.
    """
    figure = style.new_figure(9.0, 1.2 + 0.26 * len(done))
    error, settling = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    rows = np.arange(len(done))[::-1]
    built = np.array([m.run is not None for m in done])
    columns = (
        (error, [m.error for m in done], [m.predicted_error for m in done]),
        (settling, [1e6 * m.settling for m in done], [1e6 * m.predicted_settling for m in done]),
    )
    for axes, measured, predicted in columns:
        measured = np.maximum(measured, LOWEST)
        axes.plot(predicted, rows, "o", mfc="none", mec=INK, ms=9, label="predicted by emulation")
        axes.plot(measured[built], rows[built], "o", color=BLUE, ms=5, label="ngspice")
        axes.plot(measured[~built], rows[~built], "D", color=GREY, ms=4, label="digital")
        axes.set_xscale("log")
        style.quiet(axes)
    error.set_xlabel("control error (relative to the largest control)")
    settling.set_xlabel("settling time to 0.1 %, or solution time (µs)")
    for row, m in zip(rows, done):
        if m.why and m.run is None:
            error.annotate(
                m.why[:60], (0.01, row), xycoords=("axes fraction", "data"), va="center",
                fontsize=7, color=VERMILION,
            )  # fmt: skip
    error.set_yticks(
        rows, [("  " if m.group is Group.ALONE else "") + m.name for m in done], fontsize=8
    )
    settling.tick_params(labelleft=False)
    handles, labels = error.get_legend_handles_labels()
    figure.legend(handles, labels, frameon=False, fontsize=8, loc="outside lower center", ncols=3)
    style.headline(figure, f"{style.caption(problem)}, model levels")
    return figure
