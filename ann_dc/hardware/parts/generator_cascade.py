"""Fitted polynomial as a cascade of multipliers, with node voltages in volts.

Every partial sum of Horner's rule is scaled so that its largest value equals the amplitude of the
input. Inner nodes therefore use full scale and do not exceed it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import polynomial

from ann_dc.hardware.parts.generator_curves import FittedPolynomial
from ann_dc.hardware.parts.generator_stretch import GRID

INPUT, CENTRE, GROUND, OUTPUT = "x", "c", "0", "out"
"""Nodes of a cascade: input, centre of the input range, ground and output."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """Multiplier of a cascade: gain x y / V + constant.

    Attributes
    ----------
    x, y : (str, str)
        Pair of nodes of each input; the input is the voltage between them.
    gain : float
        Gain of any sign.
    constant : float
        Added voltage in volts.
    node : str
        Output node; `OUTPUT` for the last multiplier.
    """

    x: tuple[str, str]
    y: tuple[str, str]
    gain: float
    constant: float
    node: str


@dataclass(frozen=True, kw_only=True)
class Cascade:
    """Multipliers of full scale V in series.

    Attributes
    ----------
    amplitude : float
        V in volts.
    sources : dict of node to float
        Voltages of the constant nodes, in volts.
    steps : tuple of Step
        Multipliers, beginning with the highest power.
    """

    amplitude: float
    sources: dict[str, float]
    steps: tuple[Step, ...]


def cascade_of(curve: FittedPolynomial, sx: float, sy: float) -> Cascade:
    """Return the multipliers of a generator, v(out) = f(u) / sy with u = sx v(x).

    The scales ``sx`` (units of u per volt of the input) and ``sy`` (units of f(u) per volt of the
    output) have any sign.

    Examples
    --------
    >>> from ann_dc.hardware.parts.generator_curves import Polynomial
    >>> cascade = cascade_of(Polynomial().fit("sin", -1.3, 1.3), sx=1.3, sy=1.0)
    >>> cascade.amplitude, [step.node for step in cascade.steps]
    (1.0, ['w', 'p1', 'p0', 'out'])
    """
    V, k = curve.half / abs(sx), len(curve.powers) - 1
    sources = {CENTRE: curve.centre / sx} if curve.centre else {}
    if not (curve.parity and k):
        sources[_partial(k)] = math.copysign(V, curve.powers[k])
    return Cascade(amplitude=V, sources=sources, steps=tuple(_steps(curve, sx, sy, V)))


def _partial(j: int) -> str:
    """Return the node of partial sum j of Horner's rule."""
    return f"p{j}"


def _steps(curve: FittedPolynomial, sx: float, sy: float, V: float) -> list[Step]:
    """Return the multipliers, with p_j scaled to amplitude V and U a node difference."""
    a, k, at = curve.powers, len(curve.powers) - 1, np.linspace(-1.0, 1.0, GRID + 1)
    scale = [V / np.abs(polynomial.polyval(at, a[j:])).max() for j in range(k + 1)]
    if curve.parity >= 0:
        scale[0] = 1 / sy
    c = CENTRE if curve.centre else GROUND
    U = (INPUT, c) if sx > 0 else (c, INPUT)
    by = ("w", GROUND) if curve.parity else U
    steps = [
        Step(
            x=by,
            y=(_partial(j + 1), GROUND),
            gain=scale[j] / scale[j + 1],
            constant=scale[j] * a[j],
            node=_partial(j),
        )
        for j in reversed(range(k))
    ]
    if curve.parity and k:  # a_{k-1} + a_k W is a square of U and a constant, too
        gain, constant = 2 * a[k] * scale[k - 1] / V, scale[k - 1] * (a[k - 1] - a[k])
        steps[0] = Step(x=U, y=U, gain=gain, constant=constant, node=_partial(k - 1))
        steps[:0] = [Step(x=U, y=U, gain=2.0, constant=-V, node="w")] if k > 1 else []
    if curve.parity < 0:
        gain = 1 / (sy * scale[0])
        steps.append(Step(x=U, y=(_partial(0), GROUND), gain=gain, constant=0.0, node=OUTPUT))
    return [*steps[:-1], replace(steps[-1], node=OUTPUT)]
