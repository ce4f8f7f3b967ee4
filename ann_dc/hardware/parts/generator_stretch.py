"""Target of a function generator: a function on a range."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.network.functions import function_block

GRID = 400
"""Number of intervals in which a function is sampled and fitted."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretch:
    """Function `function` of a function block on the range from `low` to `high`.

    Raises `UnknownNameError` if the function block does not exist, and `NetworkError` if f is not
    finite on the range or zero throughout.
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
