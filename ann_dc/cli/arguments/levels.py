"""Words of the circuit command: levels, presets, resistor series."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ann_dc.cli.arguments.lookup import named
from ann_dc.errors import ProblemError

if TYPE_CHECKING:
    from ann_dc.hardware.parts.e_series import Series
    from ann_dc.hardware.parts.levels import Level
    from ann_dc.network.network import Network

LADDER = "ladder"
"""Instead of a level: all of them, in a report."""

ADJUSTABLE = ("macro", "differential", "ota-c", "switched-capacitor")
"""Levels whose op amps the user may choose."""

STEP = 0.3
"""Step of a switched-capacitor circuit over the stability limit at the start."""


def level_of(word: str, a0: float | None, gbw: float | None) -> Callable[[Network], Level]:
    """The level that a word names, made for a network.

    Raises
    ------
    UnknownNameError
        With the levels and presets that there are.
    ProblemError
        If op amps are chosen for a level that has its own.
    """
    from ann_dc.hardware.parts import presets
    from ann_dc.hardware.parts.levels import BEHAVIOURAL, TRANSISTOR, macro, ota_c

    given: dict[str, Any] = {
        name: value for name, value in (("a0", a0), ("gbw", gbw)) if value is not None
    }
    levels: dict[str, Callable[[Network], Level]] = {
        "behavioural": lambda network: BEHAVIOURAL,
        "ota-c": lambda network: ota_c(**given),
        "macro": lambda network: macro(**given),
        "differential": lambda network: macro(differential=True, **given),
        "switched-capacitor": lambda network: _switched(network, given),
        "transistor": lambda network: TRANSISTOR,
    }
    levels |= {name: lambda network, name=name: presets.get(name) for name in presets.names()}
    chosen = named("--level", word, levels | {LADDER: levels["macro"]})
    if given and word.lower() not in ADJUSTABLE:
        raise ProblemError(
            f"--{', --'.join(given)}: the parts of level {word} are given; choose them with "
            f"{', '.join(ADJUSTABLE)}"
        )
    return chosen


def _switched(network: Network, given: dict[str, Any]) -> Level:
    from ann_dc.analysis.spectra import stability_limit
    from ann_dc.hardware.parts.levels import switched_capacitor

    step = STEP * stability_limit(network, network.start_state)
    return switched_capacitor(step=step, **({"a0": 1e6} | given))


def series_of(word: str) -> Series:
    """The resistor series that a word names: ``E96-pairs`` is two E96 resistors in series.

    >>> series_of("e24-pairs").name
    'E24 pairs'
    """
    from ann_dc.hardware.parts.e_series import SERIES

    return named("--resistors", word, {name.replace(" ", "-"): s for name, s in SERIES.items()})
