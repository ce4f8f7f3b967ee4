"""Available values: preferred numbers of IEC 60063, with pairs of resistors.

Pairs are two resistors in series. A weight is the same resistor in every cell, so its relative
error is equal in every cell. Rounding to a series is therefore a correlated error, worse than a
tolerance of that size, and must not be drawn at random. Capacitors are sold in coarser steps; they
change the settling time of a circuit, not its settled point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.conversion import declare_words
from ann_dc.validation import checked

_E24 = (
    *(1.0, 1.1, 1.2, 1.3, 1.5, 1.6, 1.8, 2.0, 2.2, 2.4, 2.7, 3.0),
    *(3.3, 3.6, 3.9, 4.3, 4.7, 5.1, 5.6, 6.2, 6.8, 7.5, 8.2, 9.1),
)


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """Series of preferred numbers [1]_, from 1 to below 10; if empty, every value is available.

    With ``pairs``, two resistors in series form a value.

    References
    ----------
    .. [1] IEC 60063:2015, Preferred number series for resistors and capacitors.

    Examples
    --------
    >>> E24.parts(10_400.0), sum(E24_PAIRS.parts(10_400.0))
    ((10000.0,), 10400.0)
    >>> E96.capacitors.name, E12.capacitors.name
    ('E24', 'E12')
    >>> f"{E96.largest_error:.2%}", E24_PAIRS.largest_error
    ('1.49%', 0.0)
    """

    name: str
    mantissas: tuple[float, ...] = ()
    pairs: bool = False

    @property
    def capacitors(self) -> Series:
        """Series of the capacitors for this resistor series: at most E24, without pairs."""
        return E24 if self.pairs or len(self.mantissas) > len(_E24) else self

    @property
    def largest_error(self) -> float:
        """Largest relative rounding error of a single resistor; zero for pairs and exact values."""
        if not self.mantissas or self.pairs:
            return 0.0
        steps = np.diff(np.log([*self.mantissas, 10 * self.mantissas[0]]))
        return float(np.expm1(steps.max() / 2))

    def nearest(self, values: np.ndarray) -> np.ndarray:
        """Return the nearest available values in ohms or farads; infinite values stay."""
        values = np.asarray(values, float)
        unique, where = np.unique(values, return_inverse=True)
        rounded_to_series = [sum(self.parts(v)) if 0 < v < np.inf else v for v in unique]
        return np.array(rounded_to_series)[where].reshape(values.shape)

    def parts(self, value: float) -> tuple[float, ...]:
        """Return the part for a finite value in ohms or farads, or a pair of resistors."""
        if not self.mantissas:
            return (value,)
        if value < 0:  # a negative resistance: what its op amp has around it
            return tuple(-part for part in self.parts(-value))
        values = self._decades(value, below=4 if self.pairs else 1)
        one = float(values[np.abs(np.log(values / value)).argmin()])
        if not self.pairs:
            return (one,)
        first = values[values < value]
        order = np.searchsorted(values, value - first).clip(1, len(values) - 1)
        both = [(a, b) for at in (order, order - 1) for a, b in zip(first, values[at])]
        a, b = min(both, key=lambda pair: abs(sum(pair) - value))
        alone = abs(one - value) <= abs(a + b - value)
        return (one,) if alone else (float(max(a, b)), float(min(a, b)))

    def _decades(self, value: float, below: int) -> np.ndarray:
        top = int(np.floor(np.log10(value)))
        powers = 10.0 ** np.arange(top - below, top + 2)
        return np.sort(np.outer(powers, self.mantissas).ravel())


def _preferred(count: int) -> tuple[float, ...]:
    return tuple(float(np.round(10 ** (i / count), 2)) for i in range(count))


EXACT = Series(name="exact")
E12 = Series(name="E12", mantissas=_E24[::2])
E24 = Series(name="E24", mantissas=_E24)
E96 = Series(name="E96", mantissas=_preferred(96))
E24_PAIRS = Series(name="E24 pairs", mantissas=_E24, pairs=True)
E96_PAIRS = Series(name="E96 pairs", mantissas=_preferred(96), pairs=True)

SERIES = {series.name: series for series in (EXACT, E12, E24, E96, E24_PAIRS, E96_PAIRS)}
declare_words(Series, SERIES)
