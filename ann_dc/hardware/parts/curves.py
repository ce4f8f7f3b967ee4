r"""Function generators made of parts: y = f(u) by multipliers, or by diodes and op amps.

No part is a sine. Multipliers compute a polynomial, rectifiers put together a chain of chords; both
are fitted to a declared range of u and written as one subcircuit of cells of ``circuits/``,

.. math:: v_{out} = (1 + ge)\, f(u) / s_y + oy, \qquad u = s_x v_x ,

in which no behavioural source stands in for the function.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.polynomial import chebyshev, polynomial
from scipy.optimize import linprog

from ann_dc.errors import NetworkError, require_positive
from ann_dc.network.functions import function_block

GRID, FINE = 400, 10
"""Intervals at which a fit is made, and how many finer ones of each it is judged at."""

LOAD = 100e3
"""Smallest resistor at an op amp, in ohms."""

INSIDE = {"mul4q": (1, 0, 0), "breakpoint": (0, 1, 2), "inv": (0, 1, 2), "sum": (0, 1, 1)}
"""Multipliers, op amps and resistors in a cell."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Generated:
    """A function generator: its subcircuit, its largest error over the largest |f|, its parts."""

    text: str
    error: float
    multipliers: int
    op_amps: int
    resistors: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Polynomial:
    r"""Multipliers that compute the best polynomial [1]_ by Horner's rule, p_k = a_k + U p_{k+1}.

    U goes from -1 to 1 over the range. An odd or even f may take powers of W = 2 U^2 - 1 over the
    range made symmetric instead, half as many. The scale of every p_k is such that its largest
    value is the amplitude of the input: inner nodes use full scale, and stay within.

    Attributes
    ----------
    tolerance : float
        Largest error that is accepted, over the largest |f|.
    most_terms : int
        Largest number of coefficients, at least 2.

    References
    ----------
    .. [1] E. W. Cheney, Introduction to Approximation Theory, McGraw-Hill, 1966.

    Examples
    --------
    >>> Polynomial().generator("sine", "sin", -1.3, 1.3, sx=1.3, sy=1.0).multipliers
    4
    """

    tolerance: float = 2e-4
    most_terms: int = 8
    cells = ()  # files of circuits/cells that it needs

    def __post_init__(self) -> None:
        require_positive(tolerance=self.tolerance)
        if self.most_terms < 2:
            raise NetworkError(f"most_terms: expected 2 or more, got {self.most_terms!r}")

    def generator(
        self, name: str, function: str, low: float, high: float, sx: float, sy: float
    ) -> Generated:
        """Write a generator, v(out) = (1 + ge) f(u) / sy + oy with u = sx v(x).

        Parameters
        ----------
        name : str
            Of the subcircuit, ``.subckt <name> x out params: ge=0 oy=0``.
        function : str
            Name of a function block.
        low, high : float
            Range of u in which f is fitted. Nothing clamps u to it.
        sx, sy : float
            Units of u per volt of the input, of f(u) per volt of the output; of any sign.

        Raises
        ------
        NetworkError
            If f is not finite on the range, or no polynomial is close enough.
        """
        wanted, tried = _Wanted(function, low, high, sx, sy), []
        for parity in (0, 1, -1):
            for terms in range(1 + (parity >= 0), self.most_terms + 1):
                fit = _fit(wanted, parity, terms)
                tried += [fit] if fit else []
                if fit is None or fit.error <= self.tolerance:
                    break
        best = min(tried, key=lambda f: (max(f.error, self.tolerance), f.multipliers, f.error))
        if best.error > self.tolerance:
            raise NetworkError(
                f"{wanted}: a polynomial of {self.most_terms} terms is {best.error:.2g} off, the "
                f"tolerance is {self.tolerance:g}; narrow the range, allow more terms or a larger "
                "error, or take Breakpoints"
            )
        return wanted.generated(name, _cascade(best, wanted), best.error)


@dataclass(frozen=True, kw_only=True, eq=False)
class Breakpoints:
    r"""Precision rectifiers and a summing amplifier: chords between breakpoints [1]_.

    .. math:: f(u) \approx \alpha + \beta u + \sum_{\Delta_j > 0} \Delta_j \max(u - u_j, 0)
              + \sum_{\Delta_j < 0} \Delta_j \max(u_j - u, 0)

    with :math:`\Delta_j` the change of slope at u_j. The breakpoints lie where the errors of all
    chords are equal [2]_, for n chords about (integral of sqrt |f''|)^2 / (16 n^2).

    Attributes
    ----------
    segments : int
        Number of chords, one more than breakpoints.

    References
    ----------
    .. [1] D. H. Sheingold (ed.), Nonlinear Circuits Handbook, Analog Devices, 1976.
    .. [2] C. de Boor, A Practical Guide to Splines, Springer, 1978, chapter XII.

    Examples
    --------
    >>> Breakpoints(segments=20).generator("growth", "exp", -2.0, 2.0, sx=2.0, sy=7.4).op_amps
    21
    """

    segments: int = 20
    cells = ("breakpoint", "inv", "sum")

    def __post_init__(self) -> None:
        require_positive(segments=self.segments)

    def generator(
        self, name: str, function: str, low: float, high: float, sx: float, sy: float
    ) -> Generated:
        """Write a generator; parameters and errors as for `Polynomial.generator`."""
        wanted = _Wanted(function, low, high, sx, sy)
        u, y = _chords(wanted, self.segments)
        fine = np.linspace(low, high, FINE * GRID + 1)
        error = float(np.abs(np.interp(fine, u, y) - wanted.value(fine)).max()) / wanted.peak
        order = np.argsort(u / sx)
        return wanted.generated(name, _rectifiers((u / sx)[order], (y / sy)[order]), error)


@dataclass(frozen=True)
class _Wanted:
    """A function over a range, u = sx v and f = sy v: what is to be built."""

    function: str
    low: float
    high: float
    sx: float
    sy: float

    def __post_init__(self) -> None:
        least, most = function_block(self.function).domain
        if not (least <= self.low < self.high <= most and math.isfinite(self.high - self.low)):
            raise NetworkError(f"{self}: expected a range within {least:g} .. {most:g}")
        if not (0 < abs(self.sx) < math.inf and 0 < abs(self.sy) < math.inf):
            raise NetworkError(f"{self}: sx, sy: expected units, not 0; got {self.sx}, {self.sy}")
        at = np.linspace(self.low, self.high, GRID + 1)
        top = at[max(int(np.abs(self.value(at)).argmax()) - 1, 0) :][:3]
        closer = np.abs(self.value(np.linspace(top[0], top[-1], GRID))).max()
        if not (0 < self.peak < math.inf and closer <= 2 * self.peak):
            raise NetworkError(f"{self}: zero throughout, or at a pole; choose another range")

    def __str__(self) -> str:
        return f"{self.function} over {self.low:g} .. {self.high:g}"

    def value(self, u):
        with np.errstate(all="ignore"):
            return function_block(self.function).value(u)

    @property
    def peak(self) -> float:
        return float(np.abs(self.value(np.linspace(self.low, self.high, GRID + 1))).max())

    def generated(self, name: str, cards: list[str], error: float) -> Generated:
        cells = [INSIDE[word] for card in cards for word in card.split() if word in INSIDE]
        multipliers, op_amps, resistors = np.sum(cells, axis=0).tolist()
        head = f"* {name}: {self}, error {error:.1e}\n.subckt {name} x out params: ge=0 oy=0"
        return Generated(
            text="\n".join([head, *cards, f".ends {name}"]),
            error=error,
            multipliers=multipliers,
            op_amps=op_amps,
            resistors=resistors + sum(card.startswith("R") for card in cards),
        )


@dataclass(frozen=True)
class _Fit:
    """sum a_k U^k of U = (u - centre) / half (parity 0), or sum a_k W^k (even), times U (odd)."""

    parity: int
    centre: float
    half: float
    powers: np.ndarray
    error: float

    @property
    def multipliers(self) -> int:
        steps = len(self.powers) - 1  # one each; one for W, one for the factor U
        return steps + (self.parity != 0 and steps > 1) + (self.parity < 0)


def _fit(wanted: _Wanted, parity: int, terms: int) -> _Fit | None:
    """The polynomial of smallest largest error; None where f is not of this parity."""
    low, high = wanted.low, wanted.high
    centre, half = 0.5 * (low + high), 0.5 * (high - low)
    places = U = np.cos(np.linspace(0.0, np.pi, FINE * GRID + 1))
    if parity:
        centre, half, U = 0.0, max(abs(low), abs(high)), np.sqrt((1 + places) / 2)
    f = wanted.value(centre + half * U)
    mirrored = parity * wanted.value(-half * U) if parity else f
    if not (np.isfinite(f).all() and np.allclose(f, mirrored, rtol=1e-12)):
        return None
    basis = chebyshev.chebvander(places, terms - 1) * (U[:, None] if parity < 0 else 1.0)
    series = _minimax(basis[::FINE], f[::FINE])
    error = float(np.abs(f - basis @ series).max() / wanted.peak)
    return _Fit(parity, centre, half, chebyshev.cheb2poly(series), error)


def _minimax(basis: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Coefficients of the smallest largest deviation, by linear programming on the remainder."""
    series = np.linalg.lstsq(basis, f, rcond=None)[0]
    rest = f - basis @ series
    size = float(np.abs(rest).max()) or 1.0
    sides = np.concatenate([basis, -basis])
    A = np.insert(sides, sides.shape[1], -1.0, axis=1)
    b = np.concatenate([rest, -rest]) / size
    found = linprog(np.eye(A.shape[1])[-1], A_ub=A, b_ub=b, bounds=(None, None))
    return series + size * found.x[:-1]


def _cascade(fit: _Fit, wanted: _Wanted) -> list[str]:
    """Cards of a polynomial; U is the voltage between two nodes, of amplitude V."""
    a, k, V = fit.powers, len(fit.powers) - 1, fit.half / abs(wanted.sx)
    at = np.linspace(-1.0, 1.0, GRID + 1)
    scale = [V / np.abs(polynomial.polyval(at, a[j:])).max() for j in range(k + 1)]
    if fit.parity >= 0:
        scale[0] = 1 / wanted.sy
    c = "c" if fit.centre else "0"
    U = ("x", c) if wanted.sx > 0 else (c, "x")
    by = ("w", "0") if fit.parity else U
    steps = [  # factor, factor, gain, constant, output; the highest power first
        (by, (f"p{j + 1}", "0"), scale[j] / scale[j + 1], scale[j] * a[j], f"p{j}")
        for j in reversed(range(k))
    ]
    cards = [f"Vc c 0 {fit.centre / wanted.sx:.9g}"] if fit.centre else []
    if fit.parity and k:  # a_{k-1} + a_k W is a square of U and a constant, too
        gain, constant = 2 * a[k] * scale[k - 1] / V, scale[k - 1] * (a[k - 1] - a[k])
        steps[0] = (U, U, gain, constant, f"p{k - 1}")
        steps[:0] = [(U, U, 2.0, -V, "w")] if k > 1 else []
    else:
        cards.append(f"Vp p{k} 0 {math.copysign(V, a[k]):.9g}")
    if fit.parity < 0:
        steps.append((U, ("p0", "0"), 1 / (wanted.sy * scale[0]), 0.0, "out"))
    for x, y, gain, constant, node in steps:
        last = node == steps[-1][-1]
        out, z, factor = "out" if last else node, f"{constant:.9g}", f"{abs(gain):.9g}"
        z, factor = (f"{{{z}*(1+ge)+oy}}", f"(1+ge)*{factor}") if last else (z, factor)
        pins = " ".join([*(x if gain > 0 else x[::-1]), *y, f"z_{out}", out])
        cards.append(f"V{out} z_{out} 0 {z}")
        cards.append(f"X{out} {pins} mul4q vm={V:.9g} ge={{{factor}-1}}")
    return cards


def _chords(wanted: _Wanted, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Breakpoints and values of n chords: spread by curvature, then until errors are equal."""
    places = np.linspace(wanted.low, wanted.high, FINE * GRID + 1)
    share = np.sqrt(np.abs(np.gradient(np.gradient(wanted.value(places)))))[1:]
    u = f = hats = np.zeros(0)
    for _ in range(8):
        passed = np.append(0.0, np.cumsum(share + 1e-2 * share.max() + 1e-300))
        u = places = np.interp(np.linspace(0.0, passed[-1], n + 1), passed, places)
        at = np.interp(np.linspace(0, n, 16 * n + 1), np.arange(n + 1), u)
        hats, f = np.array([np.interp(at, u, one) for one in np.eye(n + 1)]).T, wanted.value(at)
        error = np.abs(f - hats @ np.linalg.lstsq(hats, f, rcond=None)[0])
        share = np.sqrt(np.maximum(error[1:], error[:-1]).reshape(n, 16).max(axis=1))
    return u, _minimax(hats, f)


def _rectifiers(v: np.ndarray, y: np.ndarray) -> list[str]:
    """Cards of a chain of chords, from volts in rising order to volts."""
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


class Curves(Protocol):
    """How function generators are made of parts; see `ann_dc.hardware.parts.curves`."""

    @property
    def cells(self) -> tuple[str, ...]:
        """Files of ``circuits/cells`` that they need."""
        ...

    def generator(
        self, name: str, function: str, low: float, high: float, sx: float, sy: float
    ) -> Generated:
        """The subcircuit of a function over a range; a volt at the input stands for ``sx``."""
        ...
