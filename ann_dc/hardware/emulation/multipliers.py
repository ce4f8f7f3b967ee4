r"""Multipliers and function generators as products and functions with errors.

A multiplier is (1 + ge) X y + oz + f (x + y) with x = a + ox, y = b + oy. A function generator is
(1 + ge) g(x) + oy. Both have a pole and limits. The first input of a multiplier is bent by an odd
cubic that deviates by at most a fraction d of full scale within full scale,

.. math:: X = x + d\, T_3(x) = x \left(1 + d\, (4 x^2 - 3)\right) ,

all in units of full scale. T_3 is Chebyshev's polynomial: it reaches 1 at both ends and once on
either side of zero, so no straight line is closer to X than x. The feedthrough f is the
contribution of either input to the output. The capacitance of the inputs is omitted. Behind the
output resistance of an op amp it is a pole of the op amp's loop, and 20 pF behind 100 ohm changes
settling by 0.1 %.

A `MultiplierLaw` describes the errors of transistors. A function generator that is a cascade of
multipliers is emulated as these multipliers, each with that law, behind one pole. The input current
of the next multiplier flows through their output resistance. In a divider an op amp drives m = u y
to its required value. This value is K + 3 (o - y / A0) / 2 behind the resistors at its input. With
m given by the law and its load,

.. math:: y = \frac{1}{u} \left(2 - \frac{m(u, 1/u)}{K}
    + \frac{3}{2 K} \left(o - \frac{y}{A_0}\right)\right)

to first order.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, replace

from ann_dc.hardware.circuit.circuit import Quantity
from ann_dc.hardware.circuit.generators import built_range, slopes_of
from ann_dc.hardware.emulation.assembly import Assembly
from ann_dc.hardware.emulation.nodes import Origin
from ann_dc.hardware.parts.generator_cascade import CENTRE, INPUT, OUTPUT, Cascade, Step, cascade_of
from ann_dc.hardware.parts.generator_curves import LOAD, Curves, FittedPolynomial, FittedQuotient
from ann_dc.hardware.parts.parasitics import PRODUCT, MultiplierLaw
from ann_dc.hardware.schematic.elements import Generator, Multiplier
from ann_dc.network.cell import ONE, Limiter

FAST = 10.0
"""Ratio of a pole to the op-amp bandwidth above which the pole is omitted."""


@dataclass(frozen=True)
class _Factor:
    """Factor of a multiplier: a pair of inputs.

    Attributes
    ----------
    node : str
        Node of the assembly.
    share : float
        Difference of the two inputs relative to full scale, per unit of the node.
    volts : float
        Sum of the two inputs in volts per unit of the node.
    centre : float
        Sum of the two inputs at zero of the node.
    """

    node: str
    share: float
    volts: float
    centre: float = 0.0


def add_multiplier(assembly: Assembly, part: Multiplier) -> None:
    """Add the product of two factors, each with an offset, to an assembly."""
    sign_of, scaling = assembly.schematic.sign, assembly.scaling
    swapped = sign_of(part.a) * sign_of(part.b) * sign_of(part.name) < 0
    factors = []
    for factor, offset, sign in (
        (part.a, Quantity.OFFSET_X, -1.0 if swapped else 1.0),
        (part.b, Quantity.OFFSET_Y, 1.0),
    ):
        node, unit = f"{offset.letters}.{part.name}", scaling.unit[factor]
        assembly.sum(node)
        assembly.connect(factor, node, 1.0)
        volt = sign_of(factor) * unit / scaling.full_scale
        assembly.bias(node, sign * volt, part.name, offset)
        share = sign * sign_of(factor) / unit
        factors.append(_Factor(node=node, share=share, volts=1 / volt))
    x, y = factors
    datasheet = assembly.datasheet
    law = datasheet.multiplier_law.at(scaling.full_scale)
    product = _product(assembly, part.name, _bent(assembly, part, x), y, scaling.full_scale, law)
    target, per_unit = _output(
        assembly,
        part.name,
        product,
        Quantity.OFFSET_Z,
        datasheet.multiplier_bandwidth,
        law.offset[0],
    )
    through = datasheet.parasitics.multiplier_feedthrough * per_unit
    if through:
        out = scaling.unit[part.name] * sign_of(part.name)
        assembly.connect(x.node, target, through * out * x.share)
        assembly.connect(y.node, target, through * out * y.share)


def _product(
    assembly: Assembly,
    name: str,
    x: _Factor,
    y: _Factor,
    volts: float,
    law: MultiplierLaw,
    z: float = 0.0,
) -> str:
    """Return the node of a law's product of two factors plus z; ``volts``: full scale."""
    product, slope, lawful = (f"{word}.{name}" for word in ("product", "slope", "lawful"))
    assembly.product(product, x.node, y.node)
    if law == PRODUCT:
        return product
    centred = 1 + law.gain[0] + law.gain_y[0] + law.gain_o[0] + 2 * law.bow[0] * z
    centred += law.tilt_x * x.centre + law.tilt_y * y.centre
    weights = defaultdict(float, {ONE: centred, product: law.bow[0] * volts * x.share * y.share})
    for factor, bend, tilt in ((x, law.bend_x[0], law.tilt_x), (y, law.bend_y[0], law.tilt_y)):
        square = f"square.{factor.node}.{name}"
        if square not in weights:
            assembly.product(square, factor.node, factor.node)
        weights[square] += bend * factor.share**2
        weights[factor.node] += tilt * factor.volts
    assembly.sum(slope)
    for source, weight in weights.items():
        assembly.connect(source, slope, weight)
    assembly.product(lawful, product, slope)
    return lawful


def _bent(assembly: Assembly, part: Multiplier, x: _Factor) -> _Factor:
    """Return the bent first input of a multiplier: x (1 + d (4 x^2 - 3))."""
    d = assembly.datasheet.parasitics.multiplier_nonlinearity
    if d == 0:
        return x
    square, cube, bent = (f"{word}.{part.name}" for word in ("square", "cube", "bent"))
    assembly.product(square, x.node, x.node)
    assembly.product(cube, square, x.node)
    assembly.sum(bent)
    assembly.connect(x.node, bent, 1 - 3 * d)
    assembly.connect(cube, bent, 4 * d / assembly.scaling.unit[part.a] ** 2)
    return replace(x, node=bent)


def add_generator(assembly: Assembly, part: Generator, gain_rule: Curves | None) -> None:
    """Add a function of a node, made of parts by a fitting method if one exists."""
    curve, scaling = f"curve.{part.name}", assembly.scaling
    fitted = gain_rule.fit(part.function, *built_range(part, scaling)) if gain_rule else None
    slopes, loaded = slopes_of(assembly.schematic, scaling, part), None
    if isinstance(fitted, FittedPolynomial):
        _add_cascade(assembly, part, cascade_of(fitted, *slopes), 1 / slopes[0])
    elif isinstance(fitted, FittedQuotient):
        _add_divider(assembly, part, fitted, slopes)
        loaded = 1.0, 0.0  # its op amp holds the output
    else:
        assembly.function(curve, part.function, part.x)
    bandwidth = assembly.datasheet.function_bandwidth
    _output(assembly, part.name, curve, Quantity.OFFSET_Y, bandwidth, loaded=loaded)


def _add_divider(
    assembly: Assembly, part: Generator, fitted: FittedQuotient, slopes: tuple[float, float]
) -> None:
    """Add 1/u by an op amp and a multiplier; its input is in units of full scale."""
    name, (sx, sy), value = part.name, slopes, assembly.circuit.value_of(part.name)
    low, high = fitted.stretch.low, fitted.stretch.high
    V = max(abs(low), abs(high)) / abs(sx)
    K = math.copysign(1 / (abs(sx * sy) * V), low * sy)
    size, ideal, inverse = f"{INPUT}.{name}", f"ideal.{name}", f"inverse.{name}"
    assembly.sum(size)
    assembly.connect(part.x, size, 1 / (sx * V))
    assembly.function(ideal, part.function, part.x)
    law = assembly.datasheet.multiplier_law.at(V)
    x = _Factor(node=size, share=math.copysign(1.0, low * sx), volts=V)
    y = _Factor(node=ideal, share=1 / (value * V), volts=1 / value)
    made = _product(assembly, name, x, y, V, law)
    assembly.sum(inverse)
    held, gain = assembly.outputs.offset(name), assembly.outputs.gain(name)
    assembly.connect(ONE, inverse, 2 - law.offset[0] / K + 1.5 * held / K)
    left = 1 / (1 + law.output_resistance / (LOAD / 2))
    assembly.connect(made, inverse, -left * V * x.share * y.share / K)
    assembly.connect(ideal, inverse, -1.5 / (K * value * gain))
    assembly.product(f"curve.{name}", ideal, inverse)


def _add_cascade(assembly: Assembly, part: Generator, cascade: Cascade, volts: float) -> None:
    """Add multipliers in series; inner nodes are in units of their full scale."""
    V, name = cascade.amplitude, part.name
    assembly.sum(f"{INPUT}.{name}")
    assembly.connect(part.x, f"{INPUT}.{name}", volts / V)
    centre = cascade.sources.get(CENTRE, 0.0)
    if centre:
        assembly.connect(ONE, f"{INPUT}.{name}", -centre / V)
    for node, constant in cascade.sources.items():
        if node != CENTRE:
            assembly.sum(f"{node}.{name}")
            assembly.connect(ONE, f"{node}.{name}", constant / V)
    for step in cascade.steps:
        _add_step(assembly, part, cascade, step)


def _add_step(assembly: Assembly, part: Generator, cascade: Cascade, step: Step) -> None:
    V, gain = cascade.amplitude, abs(step.gain)
    law = assembly.datasheet.multiplier_law.at(V, gain)
    x, y = (_pair(part.name, cascade, pins) for pins in (step.x, step.y))
    x = replace(x, share=math.copysign(1.0, step.gain) * x.share)
    product = _product(assembly, f"{step.node}.{part.name}", x, y, V, law, step.constant)
    is_last = step.node == OUTPUT
    node = f"curve.{part.name}" if is_last else f"{step.node}.{part.name}"
    unit = V * assembly.circuit.value_of(part.name) if is_last else 1.0
    constant = (1 + law.follow[0]) * step.constant + law.offset[0]
    readers = sum(step.node in (*other.x, *other.y) for other in cascade.steps)
    constant -= readers * law.output_resistance * law.input_current
    assembly.sum(node)
    assembly.connect(product, node, gain * x.share * y.share * unit)
    assembly.connect(ONE, node, constant / V * unit)


def _pair(name: str, cascade: Cascade, pins: tuple[str, str]) -> _Factor:
    """Return the voltage between two nodes of a cascade as a factor."""
    V = cascade.amplitude
    if INPUT not in pins:
        return _Factor(node=f"{pins[0]}.{name}", share=1.0, volts=V)
    share = 1.0 if pins[0] == INPUT else -1.0
    centre = 2 * cascade.sources.get(CENTRE, 0.0)
    return _Factor(node=f"{INPUT}.{name}", share=share, volts=V, centre=centre)


def _output(
    assembly: Assembly,
    name: str,
    ideal: str,
    offset: Quantity,
    bandwidth: float,
    known: float = 0.0,
    loaded: tuple[float, float] | None = None,
) -> tuple[str, float]:
    """Add gain error, offset, limits and pole; return the target node and its weight."""
    share, sag = loaded or assembly.outputs.passed(name)
    gain = share * (1 + assembly.deviation(name, Quantity.GAIN))
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
    assembly.slope(connection, share * per_unit, name, Quantity.GAIN)
    assembly.bias(target, volt * per_unit, name, offset, known + sag)
    return target, per_unit
