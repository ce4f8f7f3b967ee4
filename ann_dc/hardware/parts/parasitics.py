"""Parasitics of parts: capacitances, second poles, leaks, noise, nonlinearity.

Zero, or infinity for quantities that cause less harm the larger they are, denotes the absence of a
parasitic. Ideal parts have none. `Parasitics` describes parts on a board, and `MultiplierLaw` the
output of a transistor multiplier as a function of its inputs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

from ann_dc.errors import NetworkError
from ann_dc.validation import checked

LIMITING = {
    "second_pole": "Hz",
    "output_current": "A",
    "capacitor_leakage": "s",
    "switch_leakage": "ohm",
    "bias_doubling": "K",
}
"""Parasitics that are positive and harmless at infinity, with their units."""

LARGEST = 1.0
"""Maximum of the other parasitics: one farad, one ampere or full scale."""
MOST_DOUBLINGS = 1000.0
"""Maximum number of doublings of a bias current, for floating-point range."""


@checked
@dataclass(frozen=True, kw_only=True)
class Parasitics:
    """Parasitic quantities of the parts of a circuit.

    Raises `NetworkError` if a number is negative, or zero for a limiting quantity. Zero or infinity
    is the default of each.

    Attributes
    ----------
    input_capacitance : float
        Capacitance of an op amp from its inverting input to ground, in farads.
    stray_capacitance : float
        Capacitance of the wiring at every virtual ground, in farads.
    second_pole : float
        Second pole of the op amps in Hz.
    bias_current : float
        Current into the inverting input of every op amp in amperes, at the temperature of the
        level.
    bias_doubling : float
        Temperature rise that doubles the bias current, in kelvins; about 10 for leaking junctions.
    output_current : float
        Largest output current of an op amp in amperes, of either sign.
    capacitor_leakage : float
        Insulation resistance times capacitance of the integrating capacitors, in seconds.
    switch_leakage : float
        Resistance of an open reset switch in ohms.
    switch_capacitance : float
        Capacitance of an open reset switch across its capacitor, in farads.
    switch_charge : float
        Charge that an opening reset switch leaves on its capacitor, in coulombs.
    multiplier_nonlinearity : float
        Largest deviation of a multiplier from a straight line in its first input, relative to full
        scale.
    multiplier_feedthrough : float
        Contribution of either input to the output while the other input is zero, relative to full
        scale.
    multiplier_capacitance : float
        Capacitance of each input of a multiplier in farads.
    multiplier_noise : float
        White noise at the output of a multiplier in V/sqrt(Hz).
    amplifier_noise : float
        White input voltage noise of the op amps in V/sqrt(Hz).

    Examples
    --------
    >>> Parasitics(input_capacitance=8e-12, stray_capacitance=3e-12).ground
    1.1e-11
    """

    input_capacitance: float = 0.0
    stray_capacitance: float = 0.0
    second_pole: float = math.inf
    bias_current: float = 0.0
    bias_doubling: float = math.inf
    output_current: float = math.inf
    capacitor_leakage: float = math.inf
    switch_leakage: float = math.inf
    switch_capacitance: float = 0.0
    switch_charge: float = 0.0
    multiplier_nonlinearity: float = 0.0
    multiplier_feedthrough: float = 0.0
    multiplier_capacitance: float = 0.0
    multiplier_noise: float = 0.0
    amplifier_noise: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            name, value = field.name, getattr(self, field.name)
            if name in LIMITING and not value > 0:
                unit = LIMITING[name]
                raise NetworkError(
                    f"parasitics, {name}: expected a number of {unit} above 0, got {value!r}"
                )
            if name not in LIMITING and not 0 <= value <= LARGEST:
                raise NetworkError(
                    f"parasitics, {name}: expected a number from 0 to {LARGEST:g} of farads, "
                    f"amperes, coulombs, V/rtHz or full scale (8 pF is 8e-12), got {value!r}"
                )

    @property
    def ground(self) -> float:
        """Capacitance of a virtual ground in farads: op amp input plus wiring."""
        return self.input_capacitance + self.stray_capacitance

    def hotter(self, kelvins: float) -> Parasitics:
        """Return the parasitics at a temperature ``kelvins`` higher, or lower if negative.

        Bias currents double every `bias_doubling` kelvins. Raises `NetworkError` if a bias current
        exceeds one ampere.
        """
        grown = self.bias_current * 2.0 ** min(kelvins / self.bias_doubling, MOST_DOUBLINGS)
        if grown > LARGEST:
            raise NetworkError(
                f"parasitics, bias_doubling: {self.bias_current:.3g} A that double every "
                f"{self.bias_doubling:g} K are {grown:.2g} A after {kelvins:g} K; give the current "
                "at room temperature, and more kelvins"
            )
        return replace(self, bias_current=grown)


NONE = Parasitics()
"""Parts without parasitics."""


@checked
@dataclass(frozen=True, kw_only=True)
class MultiplierLaw:
    r"""Output of a multiplier with nominal parts as a function of its inputs.

    Let V be the full scale in volts, and x and y the differences of the input pairs over V. X and Y
    are the sums of the input volts, and z is the voltage added to the output. The output is

    .. math::
        v_{out} = (1 + ge) V x y\,(1 + gain + gain_y + gain_o + bend_x x^2 + bend_y (y V / V_y)^2
                  + tilt_x X + tilt_y Y) + (1 + follow)\,z + offset + bow\,(v_{out}^2 - z^2) .

    Output resistors of V_o = (1 + ge) V realise the gain. Below ``least_gain`` they stay constant
    and larger resistors of y, which make V_y of V, provide the remainder. Coefficients that depend
    on the resistors of a full scale have the form a + b / V + c V, written (a, b, c). The current
    of a product does not depend on V_o. If an op amp of small gain supplies this current, the loss
    in volts, b of ``gain_o``, also occurs at small gains. Raises `NetworkError` if a number is not
    finite.

    Attributes
    ----------
    gain, bend_x : (float, float, float)
        Functions of V. A bend is the remaining curvature of the voltage-to-current converters.
    gain_y, bend_y : (float, float, float)
        Functions of V_y.
    gain_o, follow, offset, bow : (float, float, float)
        Functions of V_o; offset in volts, bow in 1/V.
    tilt_x, tilt_y : float
        Gain per common-mode volt of an input, in 1/V.
    input_current : float
        Current into every input in amperes, from its driver.
    output_resistance : float
        Output resistance in ohms.
    least_gain : float
        Smallest 1 + ge that the output resistors realise.

    Examples
    --------
    >>> MultiplierLaw(gain=(1e-3, 2e-4, 0.0)).at(0.5).gain[0]
    0.0014
    """

    gain: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gain_y: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gain_o: tuple[float, float, float] = (0.0, 0.0, 0.0)
    bend_x: tuple[float, float, float] = (0.0, 0.0, 0.0)
    bend_y: tuple[float, float, float] = (0.0, 0.0, 0.0)
    follow: tuple[float, float, float] = (0.0, 0.0, 0.0)
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    bow: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt_x: float = 0.0
    tilt_y: float = 0.0
    input_current: float = 0.0
    output_resistance: float = 0.0
    least_gain: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not all(math.isfinite(number) for number in _numbers(value)):
                raise NetworkError(f"multiplier_law, {field.name}: expected numbers, got {value!r}")

    def at(self, volts: float, gain: float = 1.0) -> MultiplierLaw:
        """Return the law for a full scale V (``volts``) and a gain 1 + ge.

        The numbers of the result are constant, and its bends apply to inputs relative to V.
        """
        y, output = volts * max(1.0, self.least_gain / gain), volts * max(self.least_gain, gain)
        scales = {"gain_y": y, "bend_y": y}
        scales |= dict.fromkeys(("gain_o", "follow", "offset", "bow"), output)
        there = {}
        for field in fields(self):
            numbers, scale = _numbers(getattr(self, field.name)), scales.get(field.name, volts)
            if len(numbers) == 3:
                a, b, c = numbers
                there[field.name] = a + b / scale + c * scale
        there["bend_y"] *= (volts / y) ** 2
        return replace(self, **{name: (value, 0.0, 0.0) for name, value in there.items()})


def _numbers(value: float | tuple[float, ...]) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,)


PRODUCT = MultiplierLaw()
"""Ideal product."""
