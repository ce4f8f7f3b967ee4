r"""Multipliers and function generators as products and functions, with what spoils them.

A multiplier is (1 + ge) X y + oz + f (x + y) with x = a + ox, y = b + oy, a function generator
(1 + ge) g(x) + oy, behind a pole and between rails. The first input of a multiplier is bent: by an
odd cubic that is off by a share d of full scale at most, within full scale,

.. math:: X = x + d\, T_3(x) = x \left(1 + d\, (4 x^2 - 3)\right) ,

all in units of full scale. T_3 is Chebyshev's polynomial: it reaches 1 at both ends and once on
either side of zero, so that no straight line is closer to X than x is. The feedthrough f is what
either input adds to the output.
"""

from __future__ import annotations

import math

from ann_dc.hardware.circuit.parameters import Quantity
from ann_dc.hardware.emulation.assembly import Assembly, Origin
from ann_dc.hardware.schematic.elements import Generator, Multiplier
from ann_dc.network.cell import Limiter

FAST = 10.0
"""A pole that many times faster than the op amps is left out."""


def add_multiplier(assembly: Assembly, part: Multiplier) -> None:
    """Add the product of two factors, each with an offset, to an assembly."""
    sign_of, scaling = assembly.schematic.sign, assembly.scaling
    swapped = sign_of(part.a) * sign_of(part.b) * sign_of(part.name) < 0
    factors = []
    for factor, offset, sign in (
        (part.a, Quantity.OFFSET_X, -1.0 if swapped else 1.0),
        (part.b, Quantity.OFFSET_Y, 1.0),
    ):
        node = f"{offset.letters}.{part.name}"
        assembly.sum(node)
        assembly.connect(factor, node, 1.0)
        volt = scaling.unit[factor] / scaling.full_scale
        assembly.bias(node, sign * sign_of(factor) * volt, part.name, offset)
        factors.append(node)
    product = f"product.{part.name}"
    x, y = factors
    assembly.product(product, _bent(assembly, part, x), y)
    bandwidth = assembly.datasheet.multiplier_bandwidth
    target, per_unit = _output(assembly, part.name, product, Quantity.OFFSET_Z, bandwidth)
    through = assembly.datasheet.parasitics.multiplier_feedthrough * per_unit
    if through:
        out = scaling.unit[part.name] * sign_of(part.name)
        sign = -1.0 if swapped else 1.0
        per_x = out / (scaling.unit[part.a] * sign_of(part.a) * sign)
        assembly.connect(x, target, through * per_x)
        assembly.connect(y, target, through * out / (scaling.unit[part.b] * sign_of(part.b)))


def _bent(assembly: Assembly, part: Multiplier, x: str) -> str:
    """What a multiplier makes of its first input before it multiplies: x (1 + d (4 x^2 - 3))."""
    d = assembly.datasheet.parasitics.multiplier_nonlinearity
    if d == 0:
        return x
    square, cube, bent = (f"{word}.{part.name}" for word in ("square", "cube", "bent"))
    assembly.product(square, x, x)
    assembly.product(cube, square, x)
    assembly.sum(bent)
    assembly.connect(x, bent, 1 - 3 * d)
    assembly.connect(cube, bent, 4 * d / assembly.scaling.unit[part.a] ** 2)
    return bent


def add_generator(assembly: Assembly, part: Generator) -> None:
    """Add a function of a node to an assembly."""
    curve = f"curve.{part.name}"
    assembly.function(curve, part.function, part.x)
    bandwidth = assembly.datasheet.function_bandwidth
    _output(assembly, part.name, curve, Quantity.OFFSET_Y, bandwidth)


def _output(
    assembly: Assembly, name: str, ideal: str, offset: Quantity, bandwidth: float
) -> tuple[str, float]:
    """Gain error, output offset, rails and pole; where a unit of output enters, and its weight."""
    gain = 1 + assembly.deviation(name, Quantity.GAIN)
    volt = assembly.circuit.value_of(name)
    rails = assembly.datasheet.multiplier_rails * abs(volt)
    target, per_unit = name, 1.0
    if bandwidth < FAST * assembly.datasheet.gbw:
        tau = 1 / (2 * math.pi * bandwidth * assembly.scaling.time)
        assembly.neuron(name, tau, Origin(name), limiter=Limiter(low=-rails, high=rails))
        assembly.connect(name, name, -1.0)
    elif math.isinf(rails):
        assembly.sum(name)
    else:
        target, per_unit = f"free.{name}", 1 / rails
        assembly.sum(target)
        assembly.sum(name)
        assembly.clip(target, name, rails)
    connection = assembly.connect(ideal, target, gain * per_unit)
    assembly.slope(connection, per_unit, name, Quantity.GAIN)
    assembly.bias(target, volt * per_unit, name, offset)
    return target, per_unit
