"""Figure of every neuron over time, for a network of any kind in the ODE or as a circuit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

from ann_dc.backends.curves import Curves
from ann_dc.backends.run import Run
from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.network.network import Network
from ann_dc.plotting import style
from ann_dc.plotting.style import BLUE, GREEN, INK, ORANGE, PURPLE, SKY, VERMILION
from ann_dc.validation import checked

COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY)
PANELS = 6
"""Largest number of panels."""
LABELLED = len(COLOURS)
"""Largest number of curves in a panel with a label each."""


@checked
def neurons(run: Run | CircuitRun, words: str = "") -> Figure:
    """Plot every neuron of a run in the user's units, one panel per neuron of the cell.

    The horizontal axis is network time, or seconds for a circuit, whose figure also shows the run
    of the ideal network (dashed). A cell of more than `PANELS` neurons has one panel per
    population, or one panel. ``words`` are added to the title.

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> figure = neurons(ann_dc.OdeBackend(duration=20.0).run(network))
    >>> figure.axes[-1].get_xlabel()
    'network time (unit time constants)'
    """
    curves, ideal = run.trajectory.sampled().curves, None
    if isinstance(run, CircuitRun):
        unit, ideal = run.deck.timing.unit, run.probe.sampled().curves
        curves, ideal = run.curves, replace(ideal, time=unit * ideal.time)
    panels = _panels(run.trajectory.network, curves)
    figure = style.new_figure(7.6, 1.4 + max(1.3 * len(panels), 2.6))
    rows = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (name, group) in zip(rows, panels.items()):
        _draw(axes, curves, group)
        if ideal is not None:
            _draw_ideal(axes, ideal, group)
        axes.set_ylabel(name)
        style.quiet(axes)
        if len(axes.get_legend_handles_labels()[0]) > 1:
            style.legend_beside(axes)
    rows[-1].set(xlim=(0, curves.time[-1]), xlabel=style.UNSCALED)
    if ideal is not None:
        rows[-1].xaxis.set_major_formatter(EngFormatter(unit="s"))
        rows[-1].set_xlabel("time after the release of the reset")
    title = run.trajectory.network.title
    style.headline(figure, f"{title}\n{words}" if words else title)
    return figure


def _panels(network: Network, curves: Curves) -> dict[str, list[str]]:
    """Return the neurons of every panel by its label: one neuron, a population, or all."""
    names = [name for name, live in curves.live.items() if live.any()]
    if len(names) <= PANELS:
        return {style.with_unit(name, curves.units.get(name, "")): [name] for name in names}
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(network.neuron(name).population, []).append(name)
    return groups if len(groups) <= PANELS else {"neurons": names}


def _draw_ideal(axes: Axes, ideal: Curves, group: list[str]) -> None:
    """Draw the neurons of a panel in the run of the ideal network, over a circuit's."""
    for name in group:
        values = style.drawable(ideal.neurons[name][:, ideal.live[name]])
        lines = axes.plot(ideal.time, values, color=INK, lw=0.8, ls=(0, (4, 4)))
        lines[0].set_label("ODE" if name == group[0] else "_nolegend_")


def _draw(axes: Axes, curves: Curves, group: list[str]) -> None:
    """Draw the neurons of a panel, with a label each if there are few curves."""
    drawn = [(name, int(k)) for name in group for k in np.flatnonzero(curves.live[name])]
    for count, (name, stage) in enumerate(drawn):
        line = axes.plot(
            curves.time,
            style.drawable(curves.neurons[name][:, stage]),
            color=COLOURS[count % len(COLOURS)],
            lw=1.4 if len(drawn) <= LABELLED else 0.8,
        )[0]
        if len(drawn) <= LABELLED:
            line.set_label(f"{name}[{stage}]")
