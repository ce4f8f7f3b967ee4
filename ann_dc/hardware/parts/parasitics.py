"""What parts do beside what they are for: capacitances, second poles, leaks, noise, bent products.

Zero, or infinity where a thing limits or leaks less the larger it is, means that there is none; an
ideal part has nothing here. `Parasitics` are those of parts on a board, a `MultiplierLaw` is what a
multiplier of transistors makes of its inputs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

from ann_dc.errors import NetworkError
from ann_dc.validation.checked import checked

LIMITING = {
    "second_pole": "Hz",
    "output_current": "A",
    "capacitor_leakage": "s",
    "switch_leakage": "ohm",
    "bias_doubling": "K",
}
"""Parasitics that are above zero and do no harm at infinity, with their units."""

LARGEST = 1.0
"""Of the others: a farad, an ampere, all of full scale."""
MOST_DOUBLINGS = 1000.0
"""Of a bias current: more are beyond all numbers."""


@checked
@dataclass(frozen=True, kw_only=True)
class Parasitics:
    """What the parts of a circuit have beside what they are for.

    Attributes
    ----------
    input_capacitance : float
        Of an op amp, from its inverting input to ground, in farads.
    stray_capacitance : float
        Of the wiring at every virtual ground, in farads.
    second_pole : float
        Of the op amps, in Hz.
    bias_current : float
        Into the inverting input of every op amp, in amperes, at the level's temperature.
    bias_doubling : float
        What heats that current to twice as much, in kelvins: about 10 for junctions that leak.
    output_current : float
        The largest that an op amp gives or takes, in amperes.
    capacitor_leakage : float
        Insulation resistance times capacitance of the integrating capacitors, in seconds.
    switch_leakage : float
        Resistance of an open reset switch, in ohms.
    switch_capacitance : float
        Of an open reset switch, across the capacitor that it resets, in farads.
    switch_charge : float
        What a reset switch leaves on its capacitor when it opens, in coulombs.
    multiplier_nonlinearity : float
        Largest deviation of a multiplier from a straight line in its first input, over full scale.
    multiplier_feedthrough : float
        What either input adds to the output while the other is zero, over full scale.
    multiplier_capacitance : float
        Of each input of a multiplier, in farads.
    multiplier_noise : float
        At the output of a multiplier, in V/sqrt(Hz), white.
    amplifier_noise : float
        Input voltage noise of the op amps, in V/sqrt(Hz), white.

    Raises
    ------
    NetworkError
        If a number is negative, or one that limits is zero.

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
        """Farads from a virtual ground to ground: the op amp's own and those of the wiring."""
        return self.input_capacitance + self.stray_capacitance

    def hotter(self, kelvins: float) -> Parasitics:
        """The same parts at another temperature: bias currents grow with what leaks.

        Parameters
        ----------
        kelvins : float
            Negative where it gets colder.

        Returns
        -------
        Parasitics

        Raises
        ------
        NetworkError
            If a bias current grows to more than an ampere.

        Examples
        --------
        >>> warm = Parasitics(bias_current=20e-12, bias_doubling=10.0).hotter(20.0)
        >>> f"{warm.bias_current:.2g} A"
        '8e-11 A'
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
"""Parts that do what they are for, and nothing else."""

BOARD_PARAMETERS = {
    "opamp_cin": ("ground", 1e-18),
    "opamp_ib": ("bias_current", 0.0),
    "opamp_pole2": ("second_pole", 1e12),
    "opamp_imax": ("output_current", 1e3),
}
"""Parameters of the op amps of ``circuits/models/board``: the attribute of `Parasitics`, and what
stands for none."""


def board_parameters(parts: Parasitics) -> dict[str, float]:
    """Values of the parameters of op amps on a board; none where these have no parasitics.

    Parameters
    ----------
    parts : Parasitics

    Examples
    --------
    >>> board_parameters(Parasitics(bias_current=1e-9))["opamp_pole2"], board_parameters(NONE)
    (1000000000000.0, {})
    """
    given = {name: float(getattr(parts, a)) for name, (a, _) in BOARD_PARAMETERS.items()}
    there = {name: value for name, value in given.items() if value not in (0.0, math.inf)}
    ideal = {name: none for name, (_, none) in BOARD_PARAMETERS.items()}
    return ideal | there if there else {}


@checked
@dataclass(frozen=True, kw_only=True)
class MultiplierLaw:
    r"""What a multiplier makes of its inputs where all of its parts are as they should be.

    Of a full scale of V volts, with x and y the differences of its pairs of inputs over V, X and Y
    the sums of their volts, and z what is added to the output, it is

    .. math::
        v_{out} = (1 + ge) V x y\,(1 + gain + gain_y + gain_o + bend_x x^2 + bend_y (y V / V_y)^2
                  + tilt_x X + tilt_y Y) + (1 + follow)\,z + offset + bow\,(v_{out}^2 - z^2) .

    Output resistors of V_o = (1 + ge) V make the gain; below ``least_gain`` they stay, and larger
    ones of y, which make V_y of V, do the rest. What depends on the resistors that set a full
    scale is a + b / V + c V, written (a, b, c). The current of a product does not depend on V_o:
    where an op amp of little gain gives it, that costs volts, b of ``gain_o``, also at small gains.

    Attributes
    ----------
    gain, bend_x : (float, float, float)
        Of V: bends are what is left of the voltage-to-current converters' curvature.
    gain_y, bend_y : (float, float, float)
        Of V_y.
    gain_o, follow, offset, bow : (float, float, float)
        Of V_o; the offset in volts, the bow in 1/V.
    tilt_x, tilt_y : float
        In 1/V: by the common mode of an input.
    input_current : float
        Into every input, in amperes, from what drives it.
    output_resistance : float
        In ohms.
    least_gain : float
        1 + ge that the resistors of the output make at least.

    Raises
    ------
    NetworkError
        If a number is not finite.

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
        """The law of one full scale and gain, whose numbers depend on these no more.

        Parameters
        ----------
        volts : float
            V; bends of what comes back are those of shares of it.
        gain : float
            1 + ge.
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
"""A product and nothing else."""
