"""Parts made of transistors of a generic process, with hand-written models.

The figures were measured with the testbenches of ``circuits/testbenches``, each part alone.
"""

from __future__ import annotations

import math
from dataclasses import replace

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts.datasheet import TYPICAL, Datasheet
from ann_dc.hardware.parts.parasitics import MultiplierLaw, Parasitics

GILBERT = MultiplierLaw(
    gain=(-1746e-6, 1671e-6, 896e-6),
    gain_o=(0.0, -38e-6, -26e-6),
    bend_x=(50e-6, -381e-6, 5e-6),
    bend_y=(1e-6, -381e-6, -2e-6),
    follow=(-73e-6, 0.0, -30e-6),
    tilt_x=-139e-6,
    tilt_y=-18e-6,
    bow=(-63e-6, -2e-6, 15e-6),
    offset=(-7e-6, 0.0, -4e-6),
    input_current=0.64e-6,
    output_resistance=4.2,
)
"""Law of the multiplier of ``circuits/models/transistor``.

It was fitted to sweeps at full scales of 0.4 to 1.6 V. The emitter resistance of 26 mV / 200 uA
causes a curvature proportional to 1 / V, and Early voltages make the gain depend on the common
mode. The summing stage is an op amp of finite gain: V / 68 kohm for half of the product costs 56
kohm / 22.2e3 times that current, 37 uV at full scale, for any V_o.
"""

MATCHING = 10e-3
"""A_VT: threshold mismatch in volts between two gates of 1 um^2 [1]_, of either kind."""

PAIR, MIRROR = 34.0, 15.0
"""Gate areas of ``opamp`` in um^2 for ``area`` 1."""

LARGEST_AREA = 64.0
"""Largest area, which leaves the op amps a phase margin above 55 degrees (smallest mirrors: 82)."""

ADDED = 1 + 34 / 51
"""Noise gain of a multiplier's op amp, which refers its offset to the output."""


def offset_of(area: float) -> float:
    r"""Return the standard deviation of the op amps' input offset in volts [1]_.

    .. math:: \sigma = A_{VT} \sqrt{\frac{1}{(WL)_{pair}}
              + \left(\frac{g_{mirror}}{g_{pair}}\right)^2 \frac{1}{(WL)_{mirror}}}

    The ``area`` of the gates is relative to that of the smallest gates.

    References
    ----------
    .. [1] M. J. M. Pelgrom, A. C. J. Duinmaijer, A. P. G. Welbers, Matching properties of MOS
       transistors, IEEE Journal of Solid-State Circuits 24, 1989, 1433-1439.

    Examples
    --------
    >>> f"{offset_of(1.0):.2g}", f"{offset_of(36.0):.2g}"
    ('0.0033', '0.00055')
    """
    ratio = math.sqrt(110e-6 * MIRROR / (40e-6 * PAIR))  # of transconductances, at equal currents
    return MATCHING * math.sqrt((1 / PAIR + ratio**2 / MIRROR) / area)


def transistor_sheet(area: float) -> Datasheet:
    """Return the datasheet of op amps and multipliers with enlarged matched gates.

    The ``area`` is relative to the smallest gates, from 1 to `LARGEST_AREA`; other values raise
    `NetworkError`. The length of the gates grows with their width, so currents and
    transconductances do not change. Gate capacitances grow with the area, overlap capacitances with
    its square root. They load the virtual grounds (``opamp_transistor_input.cir``), the mirrors,
    which form a second pole, and the op amps of multipliers, which become slower by the same factor
    (``mul4q_transistor_area.cir``). Offsets are those of the gates. The offset of a multiplier is
    that of its op amp. It is also used at the inputs of the multiplier, because mismatch data of
    the bipolar transistors and resistors there are not available.
    """
    if not 1.0 <= area <= LARGEST_AREA:
        raise NetworkError(f"area: expected 1 to {LARGEST_AREA:g} times the smallest, got {area!r}")
    root, offset = math.sqrt(area), offset_of(area)
    slower = 1 + 0.34 * (root - 1) + 0.0635 * (area - 1)
    return Datasheet(
        a0=22.2e3,
        gbw=26.6e6,
        slew=25e6,
        output_swing=2.4,
        stage_resistance=56e3,
        systematic_offset=-2.7e-6,
        multiplier_output_swing=2.4,
        multiplier_bandwidth=24e6 / slower,
        function_bandwidth=8e6 / slower,
        multiplier_law=GILBERT,
        amplifier_power=1.3e-3,
        multiplier_power=11.4e-3,
        tolerances=replace(TYPICAL, offset=offset, product_offset=ADDED * offset),
        parasitics=Parasitics(
            input_capacitance=40.6e-15 * area + 14.4e-15 * root, second_pole=1.4e9 / area
        ),
    )
