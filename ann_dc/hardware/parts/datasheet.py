"""What parts are like: gain, bandwidth, slew rate and rails, and how far each may be off.

`Datasheet` holds what every part of a kind has in common, `Tolerances` the sizes of the errors in
which they differ: bounds of resistors and capacitors, which are sorted out where they are made, and
standard deviations of all else. An infinite value, or a tolerance of zero, is an ideal part.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts.conditions import ROOM, Conditions
from ann_dc.hardware.parts.parasitics import NONE, PRODUCT, MultiplierLaw, Parasitics
from ann_dc.si_prefixes import engineering
from ann_dc.validation.checked import checked
from ann_dc.validation.values import such_as

FOLLOWING = ("rails", "multiplier_rails", "amplifier_power", "multiplier_power")
"""What is in proportion to the supplies."""

SMALLEST_RESISTOR = 10e3
"""What an op amp can drive, in ohms."""

POSITIVE = (
    "a0",
    "slew",
    "rails",
    "multiplier_rails",
    "multiplier_bandwidth",
    "function_bandwidth",
)
"""Numbers of a datasheet that are above zero, and may be infinite."""


class Kind(enum.Enum):
    """What a parameter is; the value is the field of `Tolerances` with the size of its error.

    The errors of ``RESISTOR``, ``CAPACITOR`` and ``GAIN`` are relative, those of ``OFFSET`` and
    ``PRODUCT_OFFSET`` in volts.
    """

    RESISTOR = "resistor"
    CAPACITOR = "capacitor"
    OFFSET = "offset"
    GAIN = "gain"
    PRODUCT_OFFSET = "product_offset"

    @property
    def unit(self) -> str:
        """Unit of its deviation."""
        return "V" if self in (Kind.OFFSET, Kind.PRODUCT_OFFSET) else "1"

    @property
    def parts(self) -> str:
        """What has such an error, in words; that of multipliers is a gain or an offset."""
        return {
            Kind.RESISTOR: "resistors",
            Kind.CAPACITOR: "capacitors",
            Kind.OFFSET: "offsets of op amps",
            Kind.GAIN: "gains of multipliers",
            Kind.PRODUCT_OFFSET: "offsets of multipliers",
        }[self]

    @property
    def bounded(self) -> bool:
        """Whether the size of its error is a bound, within which all errors are as likely."""
        return self in (Kind.RESISTOR, Kind.CAPACITOR)


DRIFTS = {Kind.RESISTOR: "resistor_drift", Kind.OFFSET: "offset_drift"}
"""Kinds that drift with temperature, and the fields of `Tolerances` that say how far."""


@checked
@dataclass(frozen=True, kw_only=True)
class Tolerances:
    r"""Sizes of the errors of single parts, and of their drift with temperature.

    A resistor of tolerance t is sorted out where it is off by more: its error lies anywhere between
    -t and t, of standard deviation :math:`t / \sqrt 3`. Offsets and gains are normal. Each part has
    a temperature coefficient of its own, whatever its error: as far above room temperature as below
    it, a part has drifted as far the other way.

    Attributes
    ----------
    resistor, capacitor : float
        Relative; bounds.
    offset : float
        Input offset of op amps in volts; a standard deviation, as all that follow.
    gain : float
        Gain error of multipliers and function generators, relative.
    product_offset : float
        Offsets of multipliers, at both inputs and at the output, and of function generators at
        the output, in volts.
    resistor_drift : float
        Temperature coefficient of resistors, in 1/K; a bound.
    offset_drift : float
        Temperature coefficient of the op amps' offsets, in V/K; a standard deviation.
    kelvin : float
        Above room temperature, with its sign; zero where nothing drifts.

    Raises
    ------
    NetworkError
        If a size is negative or not finite.

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
                expected = "a finite number" if signed else "a number not below 0"
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
        """How far errors of a kind have drifted since room temperature, with the sign of the way.

        Parameters
        ----------
        kind : Kind

        Returns
        -------
        float
            A bound or a standard deviation, as that of the kind.
        """
        return getattr(self, DRIFTS[kind]) * self.kelvin if kind in DRIFTS else 0.0

    def size(self, kind: Kind) -> float:
        """Bound of the errors of a kind, or their standard deviation, drift and all.

        Parameters
        ----------
        kind : Kind
        """
        own, drift = getattr(self, kind.value), abs(self.drift(kind))
        return own + drift if kind.bounded else math.hypot(own, drift)

    def deviation(self, kind: Kind) -> float:
        """Standard deviation of the errors of a kind.

        Parameters
        ----------
        kind : Kind
        """
        size = math.hypot(getattr(self, kind.value), self.drift(kind))
        return size / math.sqrt(3.0) if kind.bounded else size

    def at(self, conditions: Conditions) -> Tolerances:
        """The same parts at a temperature.

        Parameters
        ----------
        conditions : Conditions

        Returns
        -------
        Tolerances
        """
        drifts = any(getattr(self, name) for name in DRIFTS.values())
        return replace(self, kelvin=conditions.temperature - ROOM if drifts else 0.0)

    def without(self, kinds: Iterable[Kind]) -> Tolerances:
        """Of parts that have no errors of some kinds.

        Parameters
        ----------
        kinds : iterable of Kind

        Returns
        -------
        Tolerances
        """
        kinds = tuple(kinds)
        none = [kind.value for kind in kinds] + [DRIFTS[kind] for kind in kinds if kind in DRIFTS]
        return replace(self, **dict.fromkeys(none, 0.0))


TYPICAL = Tolerances(resistor=1e-2, offset=1e-3, gain=1e-2, product_offset=1e-3)
"""One per cent and a millivolt: what is assumed where nothing else is known."""


@checked
@such_as("ann_dc.hardware.parts.Datasheet()")
@dataclass(frozen=True, kw_only=True)
class Datasheet:
    """What the parts of a circuit have in common.

    Attributes
    ----------
    a0 : float
        Open-loop gain of the op amps without a load.
    gbw : float
        Their gain-bandwidth product in Hz; finite, because it sets the time scale.
    slew : float
        Slew rate in V/s.
    rails, multiplier_rails : float
        Saturation of op amps, and of multipliers and function generators, in volts.
    rout : float
        Output resistance of the op amps in ohms; with what they drive it divides a0.
    stage_resistance : float
        Resistance in ohms at the output of op amps without a buffer, inside their compensation: a
        load lowers a0, and leaves gbw as it is.
    systematic_offset : float
        Input offset that all op amps have, of either sign, in volts.
    multiplier_bandwidth, function_bandwidth : float
        In Hz.
    multiplier_law : MultiplierLaw
        What multipliers do where all of their parts are as they should be.
    amplifier_power, multiplier_power : float
        Watts that one draws; nan where it is not known.
    tolerances : Tolerances or None
        How far single parts may be off; None where it is not known.
    parasitics : Parasitics
        What parts have beside what they are for.

    Raises
    ------
    NetworkError
        If a number is out of its range.

    Examples
    --------
    >>> Datasheet(gbw=10e6, multiplier_bandwidth=1e6).usable_bandwidth
    3000000.0
    """

    a0: float = math.inf
    gbw: float = 10e6
    slew: float = math.inf
    rails: float = math.inf
    multiplier_rails: float = math.inf
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
        for name in POSITIVE:
            if not getattr(self, name) > 0:
                raise _out_of_range(name, "a positive number", getattr(self, name))
        if not 0 < self.gbw < math.inf:
            raise _out_of_range("gbw", "a positive number of Hz", self.gbw)
        for name in ("rout", "stage_resistance"):
            if not 0 <= getattr(self, name) < math.inf:
                raise _out_of_range(name, "a number not below 0 of ohms", getattr(self, name))
        self._check_powers()
        if not math.isfinite(self.systematic_offset):
            raise _out_of_range("systematic_offset", "a number of volts", self.systematic_offset)

    def _check_powers(self) -> None:
        for name in ("amplifier_power", "multiplier_power"):
            power = getattr(self, name)
            if not (math.isnan(power) or 0 <= power < math.inf):
                raise _out_of_range(name, "a number of watts not below 0, or nan", power)

    def __str__(self) -> str:
        known = {
            "gain": f"{self.a0:.3g}",
            "op amps": engineering(self.gbw, "Hz", 3),
            "slew": engineering(self.slew, "V/s", 3),
            "rails": engineering(self.rails, "V", 3),
            "multipliers": engineering(self.multiplier_bandwidth, "Hz", 3),
            "their rails": engineering(self.multiplier_rails, "V", 3),
            "at virtual grounds": engineering(self.parasitics.ground, "F", 3),
            "bias": engineering(self.parasitics.bias_current, "A", 3),
        }
        return ", ".join(f"{n} {v}" for n, v in known.items() if v[:2] != "0 " and v[:3] != "inf")

    @property
    def usable_bandwidth(self) -> float:
        """Hz by which network time is scaled: op amps, or three times slower multipliers."""
        return min(self.gbw, 3 * self.multiplier_bandwidth, 3 * self.function_bandwidth)

    def at(self, now: Conditions, before: Conditions) -> Datasheet:
        """The same parts elsewhere: rails and power follow supplies, bias currents grow with heat.

        Parameters
        ----------
        now, before : Conditions
            Where they are to stand, and where these figures hold.

        Returns
        -------
        Datasheet
        """
        share = now.supply / before.supply
        follow = {name: getattr(self, name) for name in FOLLOWING}
        return replace(
            self,
            **{name: value * share for name, value in follow.items() if math.isfinite(value)},
            parasitics=self.parasitics.hotter(now.temperature - before.temperature),
        )


def _out_of_range(name: str, expected: str, given: float) -> NetworkError:
    return NetworkError(f"{name}: expected {expected}, got {given!r}")
