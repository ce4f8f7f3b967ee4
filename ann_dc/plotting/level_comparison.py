"""Figure of a level comparison: predictions and ngspice measurements by level."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from matplotlib.figure import Figure

from ann_dc.fidelity.level_comparison import Group, Measured
from ann_dc.plotting.circuit import LOWEST
from ann_dc.plotting.style import BLUE, GREY, INK, VERMILION, caption, headline, new_figure, quiet
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.validation import NotEmpty, checked


@checked
def ladder(done: Annotated[list[Measured], NotEmpty()], problem: OptimalControlProblem) -> Figure:
    """Plot the predicted and measured error and settling time of every model level.

    Measurements are made with ngspice.

    Parameters
    ----------
    done : list of Measured
        Results by level; not empty.
    problem : OptimalControlProblem
        Problem solved at every level, for the title.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = new_figure(9.0, 1.2 + 0.26 * len(done))
    error, settling = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    rows = np.arange(len(done))[::-1]
    built = np.array([m.run is not None for m in done])
    columns = (
        (error, [m.error for m in done], [m.predicted_error for m in done]),
        (settling, [1e6 * m.settling for m in done], [1e6 * m.predicted_settling for m in done]),
    )
    for axes, measured, predicted in columns:
        measured = np.maximum(measured, LOWEST)
        axes.plot(
            predicted, rows, "o", mfc="none", mec=INK, ms=9, label="predicted by the emulator"
        )
        axes.plot(measured[built], rows[built], "o", color=BLUE, ms=5, label="ngspice")
        axes.plot(measured[~built], rows[~built], "D", color=GREY, ms=4, label="computed digitally")
        axes.set_xscale("log")
        quiet(axes)
    error.set_xlabel("error of the controls (share of the largest)")
    settling.set_xlabel("time to 0.1 %, or to solve (µs)")
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
    headline(figure, f"{caption(problem)}, from ideal parts to silicon")
    return figure
