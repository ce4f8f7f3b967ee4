"""Part data: gain, bandwidth, slew rate, output swing, tolerances.

`Datasheet` contains the values common to all parts of a kind. `Tolerances` contains the sizes of
the errors in which the parts differ: bounds for resistors and capacitors, which are sorted in
manufacture, and standard deviations for all other quantities. An infinite value or a tolerance of
zero denotes an ideal part.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace

from ann_dc.errors import NetworkError, such_as
from ann_dc.hardware.parts.conditions import ROOM, Conditions
from ann_dc.hardware.parts.parasitics import NONE, PRODUCT, MultiplierLaw, Parasitics
from ann_dc.si_prefixes import engineering
from ann_dc.validation import checked

FOLLOWING = ("output_swing", "multiplier_output_swing", "amplifier_power", "multiplier_power")
"""Quantities proportional to the supplies."""

SMALLEST_RESISTOR = 10e3
"""Smallest resistor in ohms that an op amp can drive."""


class Kind(enum.Enum):
    """Kind of a parameter; the value is the field of `Tolerances` with its error size.

    Errors of ``RESISTOR``, ``CAPACITOR`` and ``GAIN`` are relative; those of ``OFFSET`` and
    ``PRODUCT_OFFSET`` are in volts.
    """

    RESISTOR = "resistor"
    CAPACITOR = "capacitor"
    OFFSET = "offset"
    GAIN = "gain"
    PRODUCT_OFFSET = "product_offset"

    @property
    def unit(self) -> str:
        """Unit of the deviation."""
        return "V" if self in (Kind.OFFSET, Kind.PRODUCT_OFFSET) else "1"

    @property
    def parts(self) -> str:
        """Description of the parts with this error; multipliers have gains and offsets."""
        return {
            Kind.RESISTOR: "resistors",
            Kind.CAPACITOR: "capacitors",
            Kind.OFFSET: "offsets of op amps",
            Kind.GAIN: "gains of multipliers",
            Kind.PRODUCT_OFFSET: "offsets of multipliers",
        }[self]

    @property
    def bounded(self) -> bool:
        """True if the error size is a bound within which all errors are equally likely."""
        return self in (Kind.RESISTOR, Kind.CAPACITOR)


DRIFTS = {Kind.RESISTOR: "resistor_drift", Kind.OFFSET: "offset_drift"}
"""Kinds that drift with temperature, and the fields of `Tolerances` with their coefficients."""


@checked
@dataclass(frozen=True, kw_only=True)
class Tolerances:
    r"""Error sizes of single parts, and their drift with temperature.

    A resistor of tolerance t is rejected in manufacture if it deviates by more, so its error is
    uniform between -t and t, with standard deviation :math:`t / \sqrt 3`. Offsets and gains are
    normal [1]_. Each part has an individual temperature coefficient, independent of its error.
    Drift at equal distances above and below room temperature has opposite signs. Raises
    `NetworkError` if a size is negative or not finite.

    Attributes
    ----------
    resistor, capacitor : float
        Bounds of relative errors.
    offset : float
        Standard deviation of the op amps' input offset, in volts. The remaining sizes are standard
        deviations unless stated otherwise.
    gain : float
        Relative gain error of multipliers and function generators.
    product_offset : float
        Offsets of multipliers at both inputs and the output, and of function generators at the
        output, in volts.
    resistor_drift : float
        Bound of the temperature coefficient of resistors, in 1/K.
    offset_drift : float
        Standard deviation of the temperature coefficient of the op amps' offsets, in V/K.
    kelvin : float
        Signed difference to room temperature in kelvin; zero for no drift.

    References
    ----------
    .. [1] M. J. M. Pelgrom, A. C. J. Duinmaijer, A. P. G. Welbers, Matching properties of MOS
       transistors, IEEE Journal of Solid-State Circuits 24, 1989, 1433-1439.

    Examples
    --------
    >>> parts = Tolerances(resistor=1e-3, offset=3e-5, resistor_drift=1e-5, offset_drift=4e-7)
    >>> hot = parts.at(Conditions(temperature=127.0))
    >>> f"{hot.size(Kind.RESISTOR):.2e}", f"{hot.size(Kind.OFFSET):.2e}"
    ('2.00e-03', '5.00e-05')
    >>> f"{parts.at(Conditions(temperature=-23.0)).drift(Kind.OFFSET):.2e}"
    '-2.00e-05'
    """

    resistor: float = 0.0
    capacitor: float = 0.0
    offset: float = 0.0
    gain: float = 0.0
    product_offset: float = 0.0
    resistor_drift: float = 0.0
    offset_drift: float = 0.0
    kelvin: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            signed = field.name == "kelvin"
            if not math.isfinite(value) or (value < 0 and not signed):
                expected = "a finite number" if signed else "a number of at least 0"
                raise NetworkError(f"tolerances, {field.name}: expected {expected}, got {value!r}")

    def __str__(self) -> str:
        sizes = {kind: self.size(kind) for kind in Kind}
        return ", ".join(
            f"{kind.parts} "
            + (engineering(size, "V", 3) if kind.unit == "V" else f"{100 * size:g} %")
            for kind, size in sizes.items()
            if size
        )

    def drift(self, kind: Kind) -> float:
        """Return the signed drift since room temperature, as a bound or a standard deviation."""
        return getattr(self, DRIFTS[kind]) * self.kelvin if kind in DRIFTS else 0.0

    def size(self, kind: Kind) -> float:
        """Return the bound or standard deviation of the errors of a kind, including drift."""
        own, drift = getattr(self, kind.value), abs(self.drift(kind))
        return own + drift if kind.bounded else math.hypot(own, drift)

    def deviation(self, kind: Kind) -> float:
        """Return the standard deviation of the errors of a kind."""
        size = math.hypot(getattr(self, kind.value), self.drift(kind))
        return size / math.sqrt(3.0) if kind.bounded else size

    def at(self, conditions: Conditions) -> Tolerances:
        """Return the tolerances of the parts at the temperature of some conditions, with drift."""
        drifts = any(getattr(self, name) for name in DRIFTS.values())
        return replace(self, kelvin=conditions.temperature - ROOM if drifts else 0.0)

    def without(self, kinds: Iterable[Kind]) -> Tolerances:
        """Return the tolerances without the errors of some kinds."""
        kinds = tuple(kinds)
        none = [kind.value for kind in kinds] + [DRIFTS[kind] for kind in kinds if kind in DRIFTS]
        return replace(self, **dict.fromkeys(none, 0.0))


TYPICAL = Tolerances(resistor=1e-2, offset=1e-3, gain=1e-2, product_offset=1e-3)
"""Default tolerances for unknown parts: one per cent and one millivolt."""


RANGES: Mapping[str, tuple[str, Callable[[float], bool]]] = {
    **dict.fromkeys(
        (
            *("a0", "slew", "output_swing", "multiplier_output_swing"),
            *("multiplier_bandwidth", "function_bandwidth"),
        ),
        ("a positive number", lambda value: value > 0),
    ),
    "gbw": ("a positive number of Hz", lambda value: 0 < value < math.inf),
    **dict.fromkeys(
        ("rout", "stage_resistance"),
        ("a number of at least 0 of ohms", lambda value: 0 <= value < math.inf),
    ),
    **dict.fromkeys(
        ("amplifier_power", "multiplier_power"),
        (
            "a number of watts not below 0, or nan",
            lambda value: math.isnan(value) or 0 <= value < math.inf,
        ),
    ),
    "systematic_offset": ("a number of volts", math.isfinite),
}
"""Valid numbers of a datasheet, in words and as a condition."""


@checked
@such_as("ann_dc.hardware.parts.Datasheet()")
@dataclass(frozen=True, kw_only=True)
class Datasheet:
    """Values that are common to the parts of a circuit.

    Raises `NetworkError` if a number is out of its range.

    Attributes
    ----------
    a0 : float
        Open-loop gain of the unloaded op amps.
    gbw : float
        Gain-bandwidth product of the op amps in Hz; finite, because it sets the time scale.
    slew : float
        Slew rate in V/s.
    output_swing, multiplier_output_swing : float
        Saturation voltage of op amps, and of multipliers and function generators.
    rout : float
        Output resistance of the op amps in ohms; a load reduces a0 by this divider.
    stage_resistance : float
        Output resistance in ohms of op amps without a buffer, inside their compensation. A load
        reduces a0 but not gbw.
    systematic_offset : float
        Input offset common to all op amps, of either sign, in volts.
    multiplier_bandwidth, function_bandwidth : float
        Bandwidth in Hz.
    multiplier_law : MultiplierLaw
        Law of multipliers with nominal parts.
    amplifier_power, multiplier_power : float
        Power per part in watts; nan if unknown.
    tolerances : Tolerances or None
        Tolerances of single parts; None if unknown.
    parasitics : Parasitics
        Parasitic quantities of the parts.

    Examples
    --------
    >>> Datasheet(gbw=10e6, multiplier_bandwidth=1e6).usable_bandwidth
    3000000.0
    """

    a0: float = math.inf
    gbw: float = 10e6
    slew: float = math.inf
    output_swing: float = math.inf
    multiplier_output_swing: float = math.inf
    rout: float = 0.0
    stage_resistance: float = 0.0
    systematic_offset: float = 0.0
    multiplier_bandwidth: float = math.inf
    function_bandwidth: float = math.inf
    multiplier_law: MultiplierLaw = PRODUCT
    amplifier_power: float = math.nan
    multiplier_power: float = math.nan
    tolerances: Tolerances | None = None
    parasitics: Parasitics = NONE

    def __post_init__(self) -> None:
        for name, (expected, is_valid) in RANGES.items():
            if not is_valid(value := getattr(self, name)):
                raise NetworkError(f"{name}: expected {expected}, got {value!r}")

    def __str__(self) -> str:
        known = {
            "gain": f"{self.a0:.3g}",
            "op amps": engineering(self.gbw, "Hz", 3),
            "slew": engineering(self.slew, "V/s", 3),
            "output swing": engineering(self.output_swing, "V", 3),
            "multipliers": engineering(self.multiplier_bandwidth, "Hz", 3),
            "their output swing": engineering(self.multiplier_output_swing, "V", 3),
            "at virtual grounds": engineering(self.parasitics.ground, "F", 3),
            "bias": engineering(self.parasitics.bias_current, "A", 3),
        }
        return ", ".join(f"{n} {v}" for n, v in known.items() if v[:2] != "0 " and v[:3] != "inf")

    @property
    def usable_bandwidth(self) -> float:
        """Bandwidth in Hz that scales network time.

        It is the smallest of that of op amps and three times that of multipliers and function
        generators.
        """
        return min(self.gbw, 3 * self.multiplier_bandwidth, 3 * self.function_bandwidth)

    def at(self, now: Conditions, before: Conditions) -> Datasheet:
        """Return the datasheet at other operating conditions.

        Output swing and power follow the supplies; bias currents grow with temperature. The
        conditions are ``now``; those of the datasheet are ``before``.
        """
        share = now.supply / before.supply
        follow = {name: getattr(self, name) for name in FOLLOWING}
        return replace(
            self,
            **{name: value * share for name, value in follow.items() if math.isfinite(value)},
            parasitics=self.parasitics.hotter(now.temperature - before.temperature),
        )
