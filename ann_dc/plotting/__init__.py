"""Four pictures of a solution: where it goes, what drives it, how it settled, and why so fast.

One of a design: why it is slow; one of a design for a family of inputs, and one of a front. And two
of circuits: the voltages of one, and the ladder of all levels.

Every function returns a `matplotlib.figure.Figure` of its own: no pyplot, no global state, nothing
to close. Runs that did not settle are drawn as far as they are finite.
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
