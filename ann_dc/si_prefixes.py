"""Text form of numbers: with SI prefixes, as on a schematic, and with nouns."""

from __future__ import annotations

import math

PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1, ""), (1e-3, "m"), (1e-6, "u"),
            (1e-9, "n"), (1e-12, "p"), (1e-15, "f"))  # fmt: skip


def engineering(value: float, unit: str, digits: int = 4) -> str:
    """Return a value with an SI prefix of its unit, to a number of significant digits.

    Examples
    --------
    >>> engineering(15227.1, "ohm"), engineering(1.989e-11, "F"), engineering(-0.25, "V")
    ('15.23 kohm', '19.89 pF', '-250 mV')
    >>> engineering(float("inf"), "Hz"), engineering(0.0, "A")
    ('inf Hz', '0 A')
    """
    if value == 0 or not math.isfinite(value):
        return f"{value:g} {unit}"
    nearly = 1 - 0.5 * 10.0**-digits
    factor, prefix = next((p for p in PREFIXES if abs(value) >= nearly * p[0]), PREFIXES[-1])
    return f"{value / factor:.{digits}g} {prefix}{unit}"


def counted(count: int, plural: str) -> str:
    """Return a count with its noun, in the singular for a count of one.

    `plural` is the noun in the plural, which ends with s.

    Examples
    --------
    >>> counted(1, "op amps"), counted(0, "stages"), counted(12, "stages")
    ('1 op amp', '0 stages', '12 stages')
    """
    return f"{count} {plural.removesuffix('s') if count == 1 else plural}"


def lasting(stages: int) -> str:
    """Return a number of stages with the verb of their duration.

    >>> lasting(1), lasting(20)
    ('1 stage lasts', '20 stages last')
    """
    return f"{counted(stages, 'stages')} last{'s' * (stages == 1)}"
