"""Operating conditions of a circuit: temperature, supplies and process corner."""

from __future__ import annotations

from dataclasses import dataclass

from ann_dc.errors import NetworkError
from ann_dc.validation import checked

ROOM = 27.0
"""Temperature in degrees Celsius of part data, and default for simulations."""

COLDEST, HOTTEST = -55.0, 150.0
"""Temperature range of part models in degrees Celsius."""

SUPPLY_RANGE = (0.5, 1.5)
"""Range of valid supplies relative to their nominal value."""

CORNERS = ("tt", "ss", "ff", "sf", "fs")
"""Process corners: n- and p-channel devices typical, slow or fast."""


@checked
@dataclass(frozen=True, kw_only=True)
class Conditions:
    """Temperature, supplies and process.

    Raises `NetworkError` if the temperature is outside the range of the models, the supply is
    outside its valid range, or the corner is unknown.

    Attributes
    ----------
    temperature : float
        Temperature of the entire circuit in degrees Celsius.
    supply : float
        All supplies relative to their nominal values.
    process : str
        Element of `CORNERS`; boards of discrete parts support only the first.

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
                f"temperature: models are valid for {COLDEST:g} to {HOTTEST:g} C, got "
                f"{self.temperature!r}"
            )
        low, high = SUPPLY_RANGE
        if not low <= self.supply <= high:
            raise NetworkError(
                f"supply: expected {low:g} to {high:g} times the nominal supply, got "
                f"{self.supply!r}"
            )
        if self.process not in CORNERS:
            known = ", ".join(CORNERS)
            raise NetworkError(f"process: expected one of {known}; got {self.process!r}")

    @property
    def kelvin(self) -> float:
        """Temperature in kelvin."""
        return self.temperature + 273.15


NOMINAL = Conditions()
"""Room temperature, nominal supplies, typical devices."""
