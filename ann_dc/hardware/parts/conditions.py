"""Where a circuit stands: its temperature, its supplies, and the process corner of its chip."""

from __future__ import annotations

from dataclasses import dataclass

from ann_dc.errors import NetworkError
from ann_dc.validation.checked import checked

ROOM = 27.0
"""Degrees Celsius at which parts are described, and simulated where nothing else is asked for."""

COLDEST, HOTTEST = -55.0, 150.0
"""Degrees Celsius that models of parts are made for."""

SUPPLY_RANGE = (0.5, 1.5)
"""Supplies over their nominal value that make sense."""

CORNERS = ("tt", "ss", "ff", "sf", "fs")
"""Process corners: n- and p-channel devices typical, slow or fast."""


@checked
@dataclass(frozen=True, kw_only=True)
class Conditions:
    """Temperature, supplies and process.

    Attributes
    ----------
    temperature : float
        Of the whole circuit, in degrees Celsius.
    supply : float
        All supplies over their nominal values.
    process : str
        One of `CORNERS`; boards of bought parts know only the first.

    Raises
    ------
    NetworkError
        If the temperature is outside what models are made for, a supply senseless, or the corner
        unknown.

    Examples
    --------
    >>> Conditions(temperature=85.0, supply=0.9).process
    'tt'
    """

    temperature: float = ROOM
    supply: float = 1.0
    process: str = CORNERS[0]

    def __post_init__(self) -> None:
        if not COLDEST <= self.temperature <= HOTTEST:
            raise NetworkError(
                f"temperature: models are made for {COLDEST:g} to {HOTTEST:g} C, got "
                f"{self.temperature!r}"
            )
        low, high = SUPPLY_RANGE
        if not low <= self.supply <= high:
            raise NetworkError(
                f"supply: expected {low:g} to {high:g} times the nominal one, got {self.supply!r}"
            )
        if self.process not in CORNERS:
            known = ", ".join(CORNERS)
            raise NetworkError(f"process: expected one of {known}; got {self.process!r}")

    @property
    def kelvin(self) -> float:
        """The temperature in kelvin."""
        return self.temperature + 273.15


NOMINAL = Conditions()
"""Room temperature, nominal supplies, typical devices."""
