"""The rung of a foundry's transistors: devices of an open process, from its own models."""

from __future__ import annotations

from ann_dc.hardware.parts.curves import Polynomial
from ann_dc.hardware.parts.datasheet import Datasheet
from ann_dc.hardware.parts.levels import Level

SKY130 = Level(
    name="sky130",
    models="sky130",
    datasheet=Datasheet(
        a0=8.7e3,
        gbw=24e6,
        slew=25e6,
        rails=2.4,
        multiplier_rails=2.4,
        multiplier_bandwidth=8e6,
        amplifier_power=1.25e-3,
        multiplier_power=7.2e-3,
    ),
    functions=Polynomial(),
    smallest_resistor=100e3,
)
"""Op amps, multipliers and reset switches of 5 V devices of SkyWater's 130 nm process."""
