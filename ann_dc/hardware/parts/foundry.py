"""Model level of a foundry: devices of an open process with the foundry's models."""

from __future__ import annotations

from ann_dc.hardware.parts.datasheet import Datasheet, Kind, Tolerances
from ann_dc.hardware.parts.generator_curves import Polynomial
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.parasitics import MultiplierLaw
from ann_dc.validation import checked

TRANSLINEAR = MultiplierLaw(
    gain=(7920e-6, -5154e-6, 194e-6),
    gain_y=(0.0, -3759e-6, 1894e-6),
    bend_x=(-467e-6, -997e-6, 1149e-6),
    bend_y=(-686e-6, -1185e-6, 711e-6),
    follow=(-385e-6, -14e-6, -317e-6),
    offset=(742e-6, -2e-6, -735e-6),
    tilt_x=-837e-6,
    tilt_y=-284e-6,
    bow=(10e-6, 0.0, 0.0),
    input_current=1.28e-6,
    output_resistance=31.6,
    least_gain=1.0,
)
"""Law of the multiplier of ``circuits/models/sky130``.

It was fitted to sweeps at full scales of 0.5 to 1.2 V, inputs within 1 V, and 1 + ge of 0.1 to 2.
Currents and resistance are those at 1 V. Four effects limit the accuracy. The emitter resistance of
1.1 kohm is valid at 1 V, and tails shunt the resistors of y if these are large. Early voltages tilt
the gain, and the op amp has a noise gain of 8 or more.
"""

SKY130 = Level(
    name="sky130",
    models="sky130",
    datasheet=Datasheet(
        a0=42.4e3,
        gbw=29e6,
        slew=23e6,
        output_swing=2.4,
        stage_resistance=98e3,
        systematic_offset=32e-6,
        multiplier_output_swing=2.4,
        multiplier_bandwidth=10.4e6,
        multiplier_law=TRANSLINEAR,
        amplifier_power=1.24e-3,
        multiplier_power=2.3e-3,
        tolerances=Tolerances(
            resistor=2.5e-3, capacitor=1.3e-3, offset=2.4e-3, gain=15e-3, product_offset=15e-3
        ),
    ),
    functions=Polynomial(),
    smallest_resistor=100e3,
    smallest_capacitor=0.5e-12,
)
"""Level of op amps, multipliers and reset switches in 5 V devices of SkyWater's 130 nm process.

The figures are those of ``circuits/models/sky130``, typical corner, 27 C. The value
``stage_resistance`` follows from the op-amp gain into 45 kohm. The slew rate applies to 100 kohm.
The multiplier bandwidth is the frequency at which its phase is -45 degrees. The power is that of
one op amp and of one multiplier at +-2.5 V. Spreads follow the PDK's mismatch, for resistors of 100
kohm and 2 um width and capacitors of 1 pF.
"""


@checked
def passive(tolerances: Tolerances) -> Tolerances:
    """Return the tolerances of resistors and capacitors only.

    They are drawn in addition to the errors of transistors, which the device models contain.
    """
    return tolerances.without((Kind.OFFSET, Kind.GAIN, Kind.PRODUCT_OFFSET))
