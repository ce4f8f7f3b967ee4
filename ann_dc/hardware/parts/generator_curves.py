"""Function generators y = f(u) made of multipliers, or of diodes and op amps.

Multipliers compute a polynomial; rectifiers form a chain of chords. Both are fitted to a declared
range of u. A fitting method (`Polynomial`, `Breakpoints`) returns a fitted record, whose error is
known before a circuit exists. The netlist selects the cells that realise the record.

A fitted polynomial is a `Cascade` of multipliers, with node voltages in volts. Every partial sum of
Horner's rule is scaled so that its largest value equals the amplitude of the input. Inner nodes
therefore use full scale and do not exceed it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TypeAlias

import numpy as np
from numpy.polynomial import chebyshev, polynomial
from scipy.optimize import linprog

from ann_dc.errors import NetworkError, require_positive
from ann_dc.network.functions import function_block
from ann_dc.validation import checked

GRID = 400
"""Number of intervals in which a function is sampled and fitted."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretch:
    """Function `function` of a function block on the range from `low` to `high`.

    Raises `UnknownNameError` if the function block does not exist, and `NetworkError` if f is not
    finite on the range, constant or not continuous.
    """

    function: str
    low: float
    high: float

    def __post_init__(self) -> None:
        least, most = function_block(self.function).domain
        if not (least <= self.low < self.high <= most and math.isfinite(self.high - self.low)):
            raise NetworkError(f"{self}: expected a range within {least:g} .. {most:g}")
        at = np.linspace(self.low, self.high, GRID + 1)
        top = at[max(int(np.abs(self.value(at)).argmax()) - 1, 0) :][:3]
        closer = np.abs(self.value(np.linspace(top[0], top[-1], GRID))).max()
        if not (0 < self.peak < math.inf and closer <= 2 * self.peak):
            raise NetworkError(f"{self}: zero throughout, or at a pole; choose another range")
        rises = np.abs(np.diff(self.value(at)))
        place = int(rises.argmax())
        if not rises[place]:
            raise NetworkError(f"{self}: constant throughout; replace it by a bias")
        within = self.value(np.linspace(at[place], at[place + 1], GRID + 1))
        if np.abs(np.diff(within)).max() > 0.5 * rises[place] + 1e-9 * self.peak:
            raise NetworkError(
                f"{self}: jumps near {at[place]:.3g}, but polynomials and chords are "
                "continuous; use a level with subcircuits of functions (behavioural, macro)"
            )

    def __str__(self) -> str:
        return f"{self.function} over {self.low:g} .. {self.high:g}"

    def value(self, u: np.ndarray) -> np.ndarray:
        """Return f(u), of the shape of u; nan or infinite outside the domain."""
        with np.errstate(all="ignore"):
            return function_block(self.function).value(u)

    @cached_property
    def peak(self) -> float:
        """Largest |f| on the range."""
        return float(np.abs(self.value(np.linspace(self.low, self.high, GRID + 1))).max())


FINE = 10
"""Subdivision of each sampling interval when the error of a fit is evaluated."""

LOAD = 100e3
"""Smallest resistor at an op amp in ohms; the multiplier of a divider drives half of this value."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedPolynomial:
    r"""Polynomial of U = (u - centre) / half, which ranges from -1 to 1.

    .. math:: \sum_k a_k U^k \;\text{(parity 0)}, \qquad \sum_k a_k W^k \;\text{(even)}, \qquad
              U \sum_k a_k W^k \;\text{(odd)}, \qquad W = 2 U^2 - 1 .

    The ``parity`` is 1 for even, -1 for odd, 0 otherwise. The range of the centre and half-width is
    extended to a symmetric one for an even or odd function. ``powers`` are the coefficients a,
    beginning with the lowest power. The largest ``error`` is relative to the largest |f|.
    """

    stretch: Stretch
    parity: int
    centre: float
    half: float
    powers: np.ndarray
    error: float

    @property
    def inputs(self) -> int:
        """Number of multiplier inputs connected to U."""
        steps = len(self.powers) - 1
        if not self.parity or not steps:
            return steps + (self.parity < 0)
        return 2 * (1 + (steps > 1)) + (self.parity < 0)

    @property
    def multipliers(self) -> int:
        """Number of multipliers that are needed."""
        steps = len(self.powers) - 1  # one each; one for W, one for the factor U
        return steps + (self.parity != 0 and steps > 1) + (self.parity < 0)


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedChords:
    """Chain of n chords.

    ``ends`` (n + 1,) go from the low end of the range to the high end; ``values`` (n + 1,) are
    those of the chain. The largest ``error`` is relative to the largest |f|.
    """

    stretch: Stretch
    ends: np.ndarray
    values: np.ndarray
    error: float


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedQuotient:
    """Reciprocal 1/u computed by a divider, whose range excludes zero.

    An op amp controls y so that a multiplier's product u y is constant. The fit is exact, and one
    multiplier input is connected to u.
    """

    stretch: Stretch
    error: float = 0.0
    inputs: int = 1


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Polynomial:
    """Minimax polynomial [1]_ computed by multipliers with Horner's rule.

    The rule is p_k = a_k + U p_{k+1}, with U from -1 to 1 over the range. An odd or even f may use
    powers of W = 2 U^2 - 1 over a symmetric range, which halves the number of powers. The
    reciprocal 1/u becomes a divider if no polynomial meets the tolerance. Raises `NetworkError` if
    the tolerance is not positive or fewer than two terms are allowed.

    Attributes
    ----------
    tolerance : float
        Largest accepted error relative to the largest |f|.
    most_terms : int
        Largest number of coefficients, at least 2.

    References
    ----------
    .. [1] E. W. Cheney, Introduction to Approximation Theory, McGraw-Hill, 1966.

    Examples
    --------
    >>> Polynomial().fit("sin", -1.3, 1.3).multipliers
    4
    """

    tolerance: float = 2e-4
    most_terms: int = 8

    def __post_init__(self) -> None:
        require_positive(tolerance=self.tolerance)
        if self.most_terms < 2:
            raise NetworkError(f"most_terms: expected 2 or more, got {self.most_terms!r}")

    def fit(self, function: str, low: float, high: float) -> FittedPolynomial | FittedQuotient:
        """Return the polynomial of fewest multipliers within the tolerance, or a divider.

        The name of a function block and the range of u define the target; a circuit does not clamp
        u to the range. Raises `UnknownNameError` if the function block does not exist, and
        `NetworkError` if f is not finite on the range or no polynomial meets the tolerance.
        """
        return _fitted(self.tolerance, self.most_terms, function, low, high)


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Breakpoints:
    r"""Chords between breakpoints by precision rectifiers and a summing amplifier [1]_.

    .. math:: f(u) \approx \alpha + \beta u + \sum_{\Delta_j > 0} \Delta_j \max(u - u_j, 0)
              + \sum_{\Delta_j < 0} \Delta_j \max(u_j - u, 0)

    with :math:`\Delta_j` the change of slope at u_j. The breakpoints equalise the errors of all
    chords [2]_. The error of n chords is about (integral of sqrt |f''|)^2 / (16 n^2). Raises
    `NetworkError` if the number of segments is not positive.

    Attributes
    ----------
    segments : int
        Number of chords, one more than the number of breakpoints.

    References
    ----------
    .. [1] D. H. Sheingold (ed.), Nonlinear Circuits Handbook, Analog Devices, 1976.
    .. [2] C. de Boor, A Practical Guide to Splines, Springer, 1978, chapter XII.

    Examples
    --------
    >>> fit = Breakpoints(segments=20).fit("exp", -2.0, 2.0)
    >>> len(fit.ends), f"{fit.error:.0e}"
    (21, '5e-04')
    """

    segments: int = 20

    def __post_init__(self) -> None:
        require_positive(segments=self.segments)

    def fit(self, function: str, low: float, high: float) -> FittedChords:
        """Return the chain of chords of a function on a range of u.

        The name of a function block and the range define the target; a circuit does not clamp u to
        the range. Raises `UnknownNameError` if the function block does not exist, and
        `NetworkError` if f is not finite on the range.
        """
        stretch = Stretch(function=function, low=low, high=high)
        u, y = _chords(stretch, self.segments)
        fine = np.linspace(low, high, FINE * GRID + 1)
        error = float(np.abs(np.interp(fine, u, y) - stretch.value(fine)).max()) / stretch.peak
        return FittedChords(stretch=stretch, ends=u, values=y, error=error)


Curves: TypeAlias = Polynomial | Breakpoints
"""Fitting methods for function generators."""

Curve: TypeAlias = FittedPolynomial | FittedQuotient | FittedChords
"""Fitted function generators."""


@lru_cache(maxsize=1024)
def _fitted(
    tolerance: float, most_terms: int, function: str, low: float, high: float
) -> FittedPolynomial | FittedQuotient:
    """Return the result of `Polynomial.fit`, cached for repeated emulations."""
    stretch, tried = Stretch(function=function, low=low, high=high), []
    for parity in (0, 1, -1):
        for terms in range(1 + (parity >= 0), most_terms + 1):
            fit = _best_polynomial(stretch, parity, terms)
            tried += [fit] if fit else []
            if fit is None or fit.error <= tolerance:
                break
    best = min(tried, key=lambda f: (max(f.error, tolerance), f.multipliers, f.error))
    if best.error > tolerance and function == "reciprocal":
        return FittedQuotient(stretch=stretch)
    if best.error > tolerance:
        raise NetworkError(
            f"{stretch}: a polynomial of {most_terms} terms is {best.error:.2g} off, the "
            f"tolerance is {tolerance:g}; narrow the range, allow more terms or a larger error, "
            "or use Breakpoints"
        )
    return best


def _best_polynomial(stretch: Stretch, parity: int, terms: int) -> FittedPolynomial | None:
    """Return the minimax polynomial, or None if f does not have this parity."""
    low, high = stretch.low, stretch.high
    centre, half = 0.5 * (low + high), 0.5 * (high - low)
    places = U = np.cos(np.linspace(0.0, np.pi, FINE * GRID + 1))
    if parity:
        centre, half, U = 0.0, max(abs(low), abs(high)), np.sqrt((1 + places) / 2)
    f = stretch.value(centre + half * U)
    mirrored = parity * stretch.value(-half * U) if parity else f
    if not (np.isfinite(f).all() and np.allclose(f, mirrored, rtol=1e-12)):
        return None
    basis = chebyshev.chebvander(places, terms - 1) * (U[:, None] if parity < 0 else 1.0)
    series = _minimax(basis[::FINE], f[::FINE])
    error = float(np.abs(f - basis @ series).max() / stretch.peak)
    return FittedPolynomial(
        stretch=stretch,
        parity=parity,
        centre=centre,
        half=half,
        powers=chebyshev.cheb2poly(series),
        error=error,
    )


def _chords(stretch: Stretch, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return breakpoints and values of n chords, spread by curvature, then equalised."""
    places = np.linspace(stretch.low, stretch.high, FINE * GRID + 1)
    share = np.sqrt(np.abs(np.gradient(np.gradient(stretch.value(places)))))[1:]
    u = f = hats = np.zeros(0)
    for _ in range(8):
        passed = np.append(0.0, np.cumsum(share + 1e-2 * share.max() + 1e-300))
        u = places = np.interp(np.linspace(0.0, passed[-1], n + 1), passed, places)
        at = np.interp(np.linspace(0, n, 16 * n + 1), np.arange(n + 1), u)
        hats, f = np.array([np.interp(at, u, one) for one in np.eye(n + 1)]).T, stretch.value(at)
        error = np.abs(f - hats @ np.linalg.lstsq(hats, f, rcond=None)[0])
        share = np.sqrt(np.maximum(error[1:], error[:-1]).reshape(n, 16).max(axis=1))
    return u, _minimax(hats, f)


def _minimax(basis: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Return minimax coefficients by linear programming on the least-squares residual."""
    series = np.linalg.lstsq(basis, f, rcond=None)[0]
    rest = f - basis @ series
    size = float(np.abs(rest).max()) or 1.0
    sides = np.concatenate([basis, -basis])
    A = np.insert(sides, sides.shape[1], -1.0, axis=1)
    b = np.concatenate([rest, -rest]) / size
    found = linprog(np.eye(A.shape[1])[-1], A_ub=A, b_ub=b, bounds=(None, None))
    return series + size * found.x[:-1]


INPUT, CENTRE, GROUND, OUTPUT = "x", "c", "0", "out"
"""Nodes of a cascade: input, centre of the input range, ground and output."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """Multiplier of a cascade: gain x y / V + constant (in volts), with a gain of any sign.

    Each input is the voltage between a pair of nodes. The output ``node`` of the last multiplier is
    `OUTPUT`.
    """

    x: tuple[str, str]
    y: tuple[str, str]
    gain: float
    constant: float
    node: str


@dataclass(frozen=True, kw_only=True)
class Cascade:
    """Multipliers of full scale V (``amplitude``, in volts) in series.

    ``sources`` are the voltages of the constant nodes. The steps begin with the highest power.
    """

    amplitude: float
    sources: dict[str, float]
    steps: tuple[Step, ...]


def cascade_of(curve: FittedPolynomial, sx: float, sy: float) -> Cascade:
    """Return the multipliers of a generator, v(out) = f(u) / sy with u = sx v(x).

    The scales ``sx`` (units of u per volt of the input) and ``sy`` (units of f(u) per volt of the
    output) have any sign.
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
