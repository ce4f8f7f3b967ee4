"""What parts are like: gain, bandwidth, slew rate and rails, and how far each may be off.

`Datasheet` holds what every part of a kind has in common, `Tolerances` the sizes of the errors in
which they differ. An infinite value, or a tolerance of zero, is an ideal part.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, fields

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts.parasitics import NONE, Parasitics
from ann_dc.hints.checked import checked
from ann_dc.hints.words import such_as

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


@checked
@dataclass(frozen=True, kw_only=True)
class Tolerances:
    """Standard deviations of the errors of single parts.

    Attributes
    ----------
    resistor, capacitor : float
        Relative.
    offset : float
        Input offset of op amps in volts.
    gain : float
        Gain error of multipliers and function generators, relative.
    product_offset : float
        Offsets of multipliers, at both inputs and at the output, and of function generators at
        the output, in volts.

    Raises
    ------
    NetworkError
        If a number is negative or not finite.

    References
    ----------
    .. [1] M. J. M. Pelgrom, A. C. J. Duinmaijer, A. P. G. Welbers, Matching properties of MOS
       transistors, IEEE Journal of Solid-State Circuits 24, 1989, 1433-1439.
    """

    resistor: float = 0.0
    capacitor: float = 0.0
    offset: float = 0.0
    gain: float = 0.0
    product_offset: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0 <= value < math.inf:
                raise NetworkError(
                    f"tolerances, {field.name}: expected a number not below 0, got {value!r}"
                )


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
    multiplier_bandwidth, function_bandwidth : float
        In Hz.
    amplifier_power, multiplier_power : float
        Watts that one draws; nan where it is not known.
    tolerances : Tolerances
        How far single parts may be off.
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
    multiplier_bandwidth: float = math.inf
    function_bandwidth: float = math.inf
    amplifier_power: float = math.nan
    multiplier_power: float = math.nan
    tolerances: Tolerances = Tolerances()
    parasitics: Parasitics = NONE

    def __post_init__(self) -> None:
        for name in POSITIVE:
            if not getattr(self, name) > 0:
                raise _out_of_range(name, "a positive number", getattr(self, name))
        if not 0 < self.gbw < math.inf:
            raise _out_of_range("gbw", "a positive number of Hz", self.gbw)
        if not 0 <= self.rout < math.inf:
            raise _out_of_range("rout", "a number not below 0 of ohms", self.rout)

    @property
    def usable_bandwidth(self) -> float:
        """Hz by which network time is scaled: op amps, or three times slower multipliers."""
        return min(self.gbw, 3 * self.multiplier_bandwidth, 3 * self.function_bandwidth)


def _out_of_range(name: str, expected: str, given: float) -> NetworkError:
    return NetworkError(f"{name}: expected {expected}, got {given!r}")
