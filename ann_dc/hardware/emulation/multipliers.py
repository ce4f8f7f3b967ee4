"""Multipliers and function generators as products and functions, with what spoils them.

A multiplier is (1 + ge) (a + ox) (b + oy) + oz, a function generator (1 + ge) g(x) + oy, behind a
pole and between rails.
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
    assembly.product(product, *factors)
    bandwidth = assembly.datasheet.multiplier_bandwidth
    _output(assembly, part.name, product, Quantity.OFFSET_Z, bandwidth)


def add_generator(assembly: Assembly, part: Generator) -> None:
    """Add a function of a node to an assembly."""
    curve = f"curve.{part.name}"
    assembly.function(curve, part.function, part.x)
    bandwidth = assembly.datasheet.function_bandwidth
    _output(assembly, part.name, curve, Quantity.OFFSET_Y, bandwidth)


def _output(assembly: Assembly, name: str, ideal: str, offset: Quantity, bandwidth: float) -> None:
    """Gain error, output offset, rails and pole."""
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
