"""TODO: the idea."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.backends.spice.netlist.cell_text import number

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
    """The source of the reset signal: 5 V closed, 0 V open; switches open at half of it."""
    return f"V_rst rst 0 PWL(0 5 {number(0.9 * release)} 5 {number(1.1 * release)} 0)"
