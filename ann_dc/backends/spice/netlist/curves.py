r"""Fitted function generator as one subcircuit of cells of ``circuits/``.

.. math:: v_{out} = (1 + ge)\, f(u) / s_y + oy, \qquad u = s_x v_x ,

without a behavioural source in place of the function. A polynomial is a cascade of multipliers
(`ann_dc.hardware.parts.generator_curves`). A quotient is an op amp with a multiplier in its
feedback: with V the amplitude of the input, it computes

.. math:: |v_x| v_y / V = \pm\frac{1}{|s_x s_y| V}, \qquad v_y = \frac{1}{s_x s_y v_x} .

A chain of chords is one precision rectifier per breakpoint, and an amplifier that sums them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts.generator_curves import (
    LOAD,
    OUTPUT,
    Breakpoints,
    Curve,
    FittedChords,
    FittedPolynomial,
    FittedQuotient,
    Polynomial,
    Step,
    cascade_of,
)
from ann_dc.hardware.schematic.elements import Generator
from ann_dc.hardware.schematic.schematic import Schematic

LEAD = 50e-15
"""Capacitance in farads across a divider's op amp, for the pole of its inputs."""

INSIDE = {
    "mul4q": (1, 0, 0),
    "opamp": (0, 1, 0),
    "breakpoint": (0, 1, 2),
    "inv": (0, 1, 2),
    "sum": (0, 1, 1),
}
"""Multipliers, op amps and resistors in a cell."""

CURVE_CELLS = {Polynomial: (), Breakpoints: ("breakpoint", "inv", "sum")}
"""Files of ``circuits/cells`` required by the generators of a recipe."""


def check_functions(schematic: Schematic, library: Iterable[str]) -> None:
    """Raise `NetworkError` if the library lacks a function generator's subcircuit."""
    built = {name for text in library for name in re.findall(r"(?m)^\.subckt func_(\w+)", text)}
    for part in schematic.parts:
        if isinstance(part, Generator) and part.function not in built:
            raise NetworkError(
                f"{part.name}: function block {part.function!r} has no subcircuit "
                f"func_{part.function} in the SPICE library; it has {', '.join(sorted(built))}"
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class Subcircuit:
    """Function generator: text from ``.subckt`` to ``.ends``, and its numbers of parts."""

    text: str
    multipliers: int
    op_amps: int
    resistors: int


def subcircuit_of(name: str, curve: Curve, sx: float, sy: float) -> Subcircuit:
    """Write a generator, v(out) = (1 + ge) f(u) / sy + oy with u = sx v(x).

    The subcircuit is ``.subckt <name> x out params: ge=0 oy=0`` of the fitted function f. The
    scales ``sx`` and ``sy`` are units of u per volt of the input and units of f(u) per volt of the
    output, of any sign. Raises `NetworkError` if a scale is zero or not finite.
    """
    if not (0 < abs(sx) < math.inf and 0 < abs(sy) < math.inf):
        raise NetworkError(f"{curve.stretch}: sx, sy: expected nonzero units, got {sx}, {sy}")
    if isinstance(curve, FittedPolynomial):
        cards = _cascade(curve, sx, sy)
    elif isinstance(curve, FittedQuotient):
        cards = _divider(curve, sx, sy)
    else:
        cards = _rectifiers(*_in_volts(curve, sx, sy))
    cells = [INSIDE[word] for card in cards for word in card.split() if word in INSIDE]
    multipliers, op_amps, resistors = np.sum(cells, axis=0).tolist()
    head = f"* {name}: {curve.stretch}, error {curve.error:.1e}"
    start = f".subckt {name} x out params: ge=0 oy=0"
    return Subcircuit(
        text="\n".join([head, start, *cards, f".ends {name}"]),
        multipliers=multipliers,
        op_amps=op_amps,
        resistors=resistors + sum(card.startswith("R") for card in cards),
    )


def _cascade(curve: FittedPolynomial, sx: float, sy: float) -> list[str]:
    """Return the cards of a polynomial: its sources and its multipliers."""
    cascade = cascade_of(curve, sx, sy)
    cards = [f"V{node} {node} 0 {volts:.9g}" for node, volts in cascade.sources.items()]
    for step in cascade.steps:
        cards += _product(step, cascade.amplitude)
    return cards


def _product(step: Step, V: float) -> list[str]:
    """Return the cards of a multiplier; the last drives the output, with the errors."""
    out, constant, gain = step.node, f"{step.constant:.9g}", f"{abs(step.gain):.9g}"
    if out == OUTPUT:
        constant, gain = f"{{{constant}*(1+ge)+oy}}", f"(1+ge)*{gain}"
    x = step.x if step.gain > 0 else step.x[::-1]
    pins = " ".join([*x, *step.y, f"z_{out}", out])
    return [f"V{out} z_{out} 0 {constant}", f"X{out} {pins} mul4q vm={V:.9g} ge={{{gain}-1}}"]


def _divider(curve: FittedQuotient, sx: float, sy: float) -> list[str]:
    """Return the cards of an op amp whose output times the input size is constant."""
    low, high = curve.stretch.low, curve.stretch.high
    V = max(abs(low), abs(high)) / abs(sx)
    size = ("x", "0") if low * sx > 0 else ("0", "x")
    constant = math.copysign(2 / (abs(sx * sy) * V), -low * sy)
    return [
        f"Xm {' '.join(size)} y 0 0 m mul4q vm={V:.9g}",
        f"Va a 0 {{{constant:.9g}*(1+ge)}}",
        f"Ra a s {LOAD:g}",
        f"Rm m s {LOAD / 2:g}",
        f"Cs y s {LEAD:g}",
        "Xa 0 s y opamp",
        "Vo out y {oy}",
        f".nodeset v(y)={2 / (sy * (low + high)):.3g}",
    ]


def _in_volts(curve: FittedChords, sx: float, sy: float) -> tuple[np.ndarray, np.ndarray]:
    """Return input voltages of the chord ends, rising, and output voltages there."""
    order = np.argsort(curve.ends / sx)
    return (curve.ends / sx)[order], (curve.values / sy)[order]


def _rectifiers(v: np.ndarray, y: np.ndarray) -> list[str]:
    """Return the cards of a chain of chords, from rising input volts to volts."""
    slopes, V = np.diff(y) / np.diff(v), float(np.abs(v).max())
    bends, places = np.diff(slopes), v[1:-1]
    left = np.minimum(bends, 0.0)  # of those that are active left of their breakpoint
    beta = slopes[0] + left.sum()
    alpha = y[0] - beta * v[0] - left @ (places - v[0])
    rf = LOAD * max(1.0, abs(beta), 2 * np.abs(bends).max(initial=0.0))
    cards = [f"Vplus plus 0 {V:.9g}", f"Vminus minus 0 {-V:.9g}"]
    for j, (bend, place) in enumerate(zip(bends, places)):
        if abs(bend) <= 1e-9 * np.abs(slopes).max():
            continue
        # half of v - place: outputs stay within full scale, op amps a diode drop below the rails
        cards += [f"Rx{j} x s{j} {4 * LOAD:g}", f"X{j} s{j} n{j} p{j} breakpoint rf={2 * LOAD:g}"]
        if abs(place) > 1e-9 * V:
            ohms = 4 * LOAD * V / abs(place)
            cards.append(f"Rb{j} {'minus' if place > 0 else 'plus'} s{j} {ohms:.9g}")
        cards.append(f"Ro{j} {'n' if bend > 0 else 'p'}{j} s {0.5 * rf / abs(bend):.9g}")
    if beta > 0:
        cards.append(f"Xi x i inv r={LOAD:g}")
    if beta != 0:
        cards.append(f"Rl {'i' if beta > 0 else 'x'} s {rf / abs(beta):.9g}")
    cards += [f"Va a 0 {{{-alpha:.9g}-oy/(1+ge)}}", f"Ra a s {rf:.9g}"]
    return [*cards, f"Xs s out sum rf={{{rf:.9g}*(1+ge)}}"]
