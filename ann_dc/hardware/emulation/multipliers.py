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
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from ann_dc.hardware.circuit.circuit import Quantity
from ann_dc.hardware.circuit.scaling import built_range, slopes_of
from ann_dc.hardware.emulation.assembly import (
    Coupling,
    Piece,
    State,
    Weight,
    clipped,
    couplings,
    weighted_sum,
)
from ann_dc.hardware.emulation.built_circuit import BuiltCircuit
from ann_dc.hardware.emulation.nodes import Origin
from ann_dc.hardware.parts.generator_curves import (
    CENTRE,
    INPUT,
    LOAD,
    OUTPUT,
    Cascade,
    FittedPolynomial,
    FittedQuotient,
    Step,
    cascade_of,
)
from ann_dc.hardware.parts.parasitics import PRODUCT, MultiplierLaw
from ann_dc.hardware.schematic.elements import Generator, Multiplier
from ann_dc.network.cell import ONE, Function, Limiter, Product, Sum

FAST = 10.0
"""Ratio of a pole to the op-amp bandwidth above which the pole is omitted."""


@dataclass(frozen=True)
class _Factor:
    """Factor of a multiplier: a pair of inputs, driven by a node.

    ``share`` is the difference of the two inputs relative to full scale, and ``volts`` their sum,
    each per unit of the node. ``centre`` is the sum at zero of the node.
    """

    node: str
    share: float
    volts: float
    centre: float = 0.0


def multiplier(built: BuiltCircuit, part: Multiplier) -> Iterator[Piece]:
    """Yield the product of two factors, each with an offset."""
    sign_of, scaling, sheet = built.schematic.sign, built.scaling, built.datasheet
    swapped = sign_of(part.a) * sign_of(part.b) * sign_of(part.name) < 0
    factors = []
    for factor, offset, sign in (
        (part.a, Quantity.OFFSET_X, -1.0 if swapped else 1.0),
        (part.b, Quantity.OFFSET_Y, 1.0),
    ):
        node, unit = f"{offset.letters}.{part.name}", scaling.unit[factor]
        volt = sign_of(factor) * unit / scaling.full_scale
        yield from weighted_sum(node, {factor: 1.0})
        yield built.bias(node, sign * volt, part.name, offset)
        share = sign * sign_of(factor) / unit
        factors.append(_Factor(node=node, share=share, volts=1 / volt))
    x, y = factors
    law, bent = sheet.multiplier_law.at(scaling.full_scale), x
    if sheet.parasitics.multiplier_nonlinearity:
        bent = replace(x, node=f"bent.{part.name}")
        yield from _bent(built, part, x.node)
    product, pieces = _product(part.name, bent, y, scaling.full_scale, law)
    yield from pieces
    target, per_unit, pieces = _output(built, part.name, sheet.multiplier_bandwidth)
    yield from pieces
    share, sag = built.outputs.passed(part.name)
    yield _gained(built, part.name, product, target, (share, per_unit))
    volt = built.circuit.value_of(part.name)
    yield built.bias(target, volt * per_unit, part.name, Quantity.OFFSET_Z, law.offset[0] + sag)
    through = sheet.parasitics.multiplier_feedthrough * per_unit
    if through:
        out = through * scaling.unit[part.name] * sign_of(part.name)
        yield from couplings(target, {x.node: out * x.share, y.node: out * y.share})


def _bent(built: BuiltCircuit, part: Multiplier, x: str) -> Iterator[Piece]:
    """Yield the bent first input x (1 + d (4 x^2 - 3)) of a multiplier."""
    d, unit = built.datasheet.parasitics.multiplier_nonlinearity, built.scaling.unit[part.a]
    square, cube, bent = (f"{word}.{part.name}" for word in ("square", "cube", "bent"))
    yield Product(name=square, a=x, b=x)
    yield Product(name=cube, a=square, b=x)
    yield from weighted_sum(bent, {x: 1 - 3 * d, cube: 4 * d / unit**2})


def _product(
    name: str, x: _Factor, y: _Factor, volts: float, law: MultiplierLaw, z: float = 0.0
) -> tuple[str, list[Piece]]:
    """Return the node of a law's product of two factors plus z; ``volts``: full scale."""
    product, slope, lawful = (f"{word}.{name}" for word in ("product", "slope", "lawful"))
    pieces: list[Piece] = [Product(name=product, a=x.node, b=y.node)]
    if law == PRODUCT:
        return product, pieces
    centred = 1 + law.gain[0] + law.gain_y[0] + law.gain_o[0] + 2 * law.bow[0] * z
    centred += law.tilt_x * x.centre + law.tilt_y * y.centre
    weights = defaultdict(float, {ONE: centred, product: law.bow[0] * volts * x.share * y.share})
    for factor, bend, tilt in ((x, law.bend_x[0], law.tilt_x), (y, law.bend_y[0], law.tilt_y)):
        square = f"square.{factor.node}.{name}"
        if square not in weights:
            pieces.append(Product(name=square, a=factor.node, b=factor.node))
        weights[square] += bend * factor.share**2
        weights[factor.node] += tilt * factor.volts
    pieces += weighted_sum(slope, weights)
    return lawful, [*pieces, Product(name=lawful, a=product, b=slope)]


def generator(built: BuiltCircuit, part: Generator) -> Iterator[Piece]:
    """Yield a function of a node, made of parts by the level's fitting method if there is one."""
    curve, scaling, gain_rule = f"curve.{part.name}", built.scaling, built.level.functions
    fitted = gain_rule.fit(part.function, *built_range(part, scaling)) if gain_rule else None
    slopes = slopes_of(built.schematic, scaling, part)
    if isinstance(fitted, FittedPolynomial):
        yield from _cascade(built, part, cascade_of(fitted, *slopes), 1 / slopes[0])
    elif isinstance(fitted, FittedQuotient):
        yield from _divider(built, part, fitted, slopes)
    else:
        yield Function(name=curve, function=part.function, x=part.x)
    target, per_unit, pieces = _output(built, part.name, built.datasheet.function_bandwidth)
    yield from pieces
    held = isinstance(fitted, FittedQuotient)  # by the divider's op amp, under any load
    share, sag = (1.0, 0.0) if held else built.outputs.passed(part.name)
    yield _gained(built, part.name, curve, target, (share, per_unit))
    volt = built.circuit.value_of(part.name)
    yield built.bias(target, volt * per_unit, part.name, Quantity.OFFSET_Y, sag)


def _divider(
    built: BuiltCircuit, part: Generator, fitted: FittedQuotient, slopes: tuple[float, float]
) -> Iterator[Piece]:
    """Yield 1/u of an op amp and a multiplier; its input is in units of full scale."""
    name, (sx, sy), value = part.name, slopes, built.circuit.value_of(part.name)
    low, high = fitted.stretch.low, fitted.stretch.high
    V = max(abs(low), abs(high)) / abs(sx)
    K = math.copysign(1 / (abs(sx * sy) * V), low * sy)
    size, ideal, inverse = f"{INPUT}.{name}", f"ideal.{name}", f"inverse.{name}"
    yield from weighted_sum(size, {part.x: 1 / (sx * V)})
    yield Function(name=ideal, function=part.function, x=part.x)
    law = built.datasheet.multiplier_law.at(V)
    x = _Factor(node=size, share=math.copysign(1.0, low * sx), volts=V)
    y = _Factor(node=ideal, share=1 / (value * V), volts=1 / value)
    made, pieces = _product(name, x, y, V, law)
    yield from pieces
    held, gain = built.outputs.offset(name), built.outputs.gain(name)
    left = 1 / (1 + law.output_resistance / (LOAD / 2))
    weights = {
        ONE: 2 - law.offset[0] / K + 1.5 * held / K,
        made: -left * V * x.share * y.share / K,
        ideal: -1.5 / (K * value * gain),
    }
    yield from weighted_sum(inverse, weights)
    yield Product(name=f"curve.{name}", a=ideal, b=inverse)


def _cascade(
    built: BuiltCircuit, part: Generator, cascade: Cascade, volts: float
) -> Iterator[Piece]:
    """Yield multipliers in series; inner nodes are in units of their full scale."""
    V, name = cascade.amplitude, part.name
    centre = cascade.sources.get(CENTRE, 0.0)
    centred = {ONE: -centre / V} if centre else {}
    yield from weighted_sum(f"{INPUT}.{name}", {part.x: volts / V, **centred})
    for node, constant in cascade.sources.items():
        if node != CENTRE:
            yield from weighted_sum(f"{node}.{name}", {ONE: constant / V})
    for step in cascade.steps:
        yield from _step(built, part, cascade, step)


def _step(built: BuiltCircuit, part: Generator, cascade: Cascade, step: Step) -> Iterator[Piece]:
    V, gain = cascade.amplitude, abs(step.gain)
    law = built.datasheet.multiplier_law.at(V, gain)
    x, y = (_pair(part.name, cascade, pins) for pins in (step.x, step.y))
    x = replace(x, share=math.copysign(1.0, step.gain) * x.share)
    product, pieces = _product(f"{step.node}.{part.name}", x, y, V, law, step.constant)
    yield from pieces
    is_last = step.node == OUTPUT
    node = f"curve.{part.name}" if is_last else f"{step.node}.{part.name}"
    unit = V * built.circuit.value_of(part.name) if is_last else 1.0
    constant = (1 + law.follow[0]) * step.constant + law.offset[0]
    readers = sum(step.node in (*other.x, *other.y) for other in cascade.steps)
    constant -= readers * law.output_resistance * law.input_current
    weights = {product: gain * x.share * y.share * unit, ONE: constant / V * unit}
    yield from weighted_sum(node, weights)


def _pair(name: str, cascade: Cascade, pins: tuple[str, str]) -> _Factor:
    """Return the voltage between two nodes of a cascade as a factor."""
    V = cascade.amplitude
    if INPUT not in pins:
        return _Factor(node=f"{pins[0]}.{name}", share=1.0, volts=V)
    share = 1.0 if pins[0] == INPUT else -1.0
    centre = 2 * cascade.sources.get(CENTRE, 0.0)
    return _Factor(node=f"{INPUT}.{name}", share=share, volts=V, centre=centre)


def _output(built: BuiltCircuit, name: str, bandwidth: float) -> tuple[str, float, Iterable[Piece]]:
    """Return node and weight of the contributions to an output, and its pole or limits."""
    sheet, swing = built.datasheet, built.datasheet.multiplier_output_swing
    swing *= abs(built.circuit.value_of(name))
    if bandwidth < FAST * sheet.gbw:
        tau = 1 / (2 * math.pi * bandwidth * built.scaling.time)
        pole = State(name, tau, Origin(name), Limiter(low=-swing, high=swing))
        return name, 1.0, (pole, Coupling(name, name, -1.0))
    if math.isinf(swing):
        return name, 1.0, (Sum(name=name),)
    free = f"free.{name}"
    return free, 1 / swing, (Sum(name=free), Sum(name=name), *clipped(free, name, swing))


def _gained(
    built: BuiltCircuit, name: str, ideal: str, target: str, factors: tuple[Weight, float]
) -> Coupling:
    """Return the coupling of an ideal value with its gain error, load factor and unit."""
    share, per_unit = factors
    gain = share * (1 + built.deviation(name, Quantity.GAIN))
    slopes = (built.slope(share * per_unit, name, Quantity.GAIN),)
    return Coupling(ideal, target, gain * per_unit, slopes=slopes)
