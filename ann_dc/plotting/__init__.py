"""Figures of solutions, designs, Pareto fronts and circuits.

Four figures show a solution: trajectory, controls, settling and spectrum. One shows the diagnosis
of a design, one a design over an operating range, and one a front. Two show circuits: voltages, and
the level comparison.

Every function returns a separate `matplotlib.figure.Figure`, without pyplot or global state, so no
figure needs closing. Runs that did not settle are drawn as far as they are finite.
"""

from ann_dc.plotting.circuit import circuit
from ann_dc.plotting.controls import controls
from ann_dc.plotting.diagnosis import diagnosis
from ann_dc.plotting.family import family, front
from ann_dc.plotting.level_comparison import ladder
from ann_dc.plotting.saving import save, save_all
from ann_dc.plotting.settling import settling
from ann_dc.plotting.spectrum import spectrum
from ann_dc.plotting.style import (
    BLUE,
    FASTEST,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    UNSCALED,
    VERMILION,
    caption,
    headline,
    new_figure,
    quiet,
    time_label,
    title,
    with_unit,
)
from ann_dc.plotting.trajectory import trajectory

__all__ = [
    "BLUE",
    "FASTEST",
    "GREEN",
    "GREY",
    "INK",
    "ORANGE",
    "PURPLE",
    "SKY",
    "UNSCALED",
    "VERMILION",
    "caption",
    "circuit",
    "controls",
    "diagnosis",
    "family",
    "front",
    "headline",
    "ladder",
    "new_figure",
    "quiet",
    "save",
    "save_all",
    "settling",
    "spectrum",
    "time_label",
    "title",
    "trajectory",
    "with_unit",
]
