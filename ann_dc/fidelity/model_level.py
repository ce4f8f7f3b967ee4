"""Levels of the comparison: ideal, single non-idealities, part sets and silicon."""

from __future__ import annotations

import enum
from collections.abc import Iterator
from dataclasses import dataclass, replace

from ann_dc.analysis.spectra import stability_limit
from ann_dc.backends.trajectory import Trajectory
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.datasheet import Datasheet, Tolerances
from ann_dc.hardware.parts.e_series import E96, EXACT, Series
from ann_dc.hardware.parts.levels import (
    BEHAVIOURAL,
    TRANSISTOR,
    Level,
    macro,
    ota_c,
    switched_capacitor,
)
from ann_dc.hardware.schematic.saturation import with_rails
from ann_dc.network.network import Network
from ann_dc.validation import checked

SLOWEST = 0.3
"""Step of the switched-capacitor level relative to the stability limit at the settled point."""


class Group(enum.Enum):
    """Group of a level in the comparison."""

    DIGITAL = "computed digitally"
    LEVEL = "a level of fidelity"
    ALONE = "one defect alone"


@dataclass(frozen=True, kw_only=True, eq=False)
class Rung:
    """Level of the comparison, with its part errors.

    Attributes
    ----------
    seed : int or None
        Seed of the errors of single parts, drawn from the tolerances of the level.
    series : Series
        Series of the resistors.
    slow : bool
        True if ngspice needs a minute or more.
    """

    name: str
    level: Level
    group: Group = Group.LEVEL
    seed: int | None = None
    series: Series = EXACT
    slow: bool = False


@checked
def rungs(
    network: Network, probe: Trajectory, *, base: str = "opa192_ad734", seed: int = 1
) -> tuple[Rung, ...]:
    """Return the levels: ideal, single non-idealities, part sets and silicon.

    `network` and `probe`, its run in continuous time, give the step of switched capacitors. `base`
    names the part set whose non-idealities are listed separately. `seed` draws the errors of single
    parts. Raises `UnknownNameError` if the part set is unknown.
    """
    step = SLOWEST * stability_limit(probe.network, probe.final)
    boards = {name: with_rails(network, presets.get(name)) for name in presets.names()}
    return (
        Rung(name="behavioural", level=BEHAVIOURAL),
        Rung(name="OTA-C, tanh 30 x full scale", level=ota_c()),
        Rung(name="macro, A0 = 1e6", level=macro()),
        Rung(name="macro, fully differential", level=macro(differential=True)),
        *_alone(with_rails(network, presets.get(base)), seed),
        *(Rung(name=name, level=level, seed=seed) for name, level in boards.items()),
        Rung(
            name="switched-capacitor, A0 = 1e6",
            level=switched_capacitor(a0=1e6, step=step),
            slow=True,
        ),
        Rung(name="transistor", level=TRANSISTOR),
    )


def _alone(level: Level, seed: int) -> Iterator[Rung]:
    """Yield a level for every non-ideality alone, with all else ideal."""
    datasheet, tolerances = level.datasheet, level.tolerances

    figures: dict[str, tuple[str, ...]] = {
        f"gain {datasheet.a0:.0e}": ("a0",),
        f"slew {datasheet.slew * 1e-6:.0f} V/us": ("slew",),
        f"rails {datasheet.rails:g} V": ("rails",),
        f"multipliers of {datasheet.multiplier_bandwidth * 1e-6:.0f} MHz": (
            "multiplier_bandwidth",
            "function_bandwidth",
        ),
    }
    errors = {
        f"op-amp offsets {tolerances.offset * 1e6:.0f} uV": "offset",
        f"resistors {tolerances.resistor:.1%}": "resistor",
        f"multiplier gains {tolerances.gain:.1%}": "gain",
        f"multiplier offsets {tolerances.product_offset * 1e3:g} mV": "product_offset",
    }
    plain = Datasheet(a0=1e8, gbw=datasheet.gbw, tolerances=Tolerances())
    alone = Rung(
        name="E96 resistors alone",
        group=Group.ALONE,
        level=replace(level, name="macro", datasheet=plain),
    )
    for name, fields in figures.items():
        parts = replace(plain, **{field: getattr(datasheet, field) for field in fields})
        yield replace(alone, name=f"{name} alone", level=replace(alone.level, datasheet=parts))
    for name, field in errors.items():
        parts = replace(plain, tolerances=Tolerances(**{field: getattr(tolerances, field)}))
        lone = replace(alone.level, datasheet=parts)
        yield replace(alone, name=f"{name} alone", level=lone, seed=seed)
    yield replace(alone, series=E96)
