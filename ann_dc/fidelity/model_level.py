"""Levels of the comparison: ideal, single non-idealities, part sets and silicon."""

from __future__ import annotations

import enum
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

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
from ann_dc.hardware.schematic.buildable import with_rails
from ann_dc.network.network import Network
from ann_dc.validation import checked

SLOWEST = 0.3
"""Step of the switched-capacitor level relative to the stability limit at the settled point."""


class Group(enum.Enum):
    """Group of a level in the comparison."""

    DIGITAL = "computed digitally"
    LEVEL = "a level of fidelity"
    ALONE = "one defect alone"


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Rung:
    """Level of the comparison, with its part errors.

    Attributes
    ----------
    name : str
        Name in reports.
    seed : int or None
        Seed of the errors of single parts, drawn from the tolerances of the level.
    series : Series
        Series of the resistors.
    slow : bool
        True if ngspice needs a minute or more.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity import Rung
    >>> preset = ann_dc.presets.get("opa192_ad734")
    >>> Rung(name="my board", level=preset, seed=3).group.value
    'a level of fidelity'
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

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity import Group, rungs
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    >>> probe = ann_dc.OdeBackend(verify=False).run(network).trajectory
    >>> [rung.name for rung in rungs(network, probe) if rung.group is Group.ALONE][:3]
    ['gain 1e+06 alone', 'slew 20 V/us alone', 'rails 14.5 V alone']
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

    def rung(name: str, *, errors: Tolerances | None = None, series=EXACT, **given) -> Rung:
        figures: dict[str, Any] = {"a0": 1e8, "gbw": datasheet.gbw} | given
        parts = Datasheet(**figures, tolerances=errors or Tolerances())
        return Rung(
            name=name,
            group=Group.ALONE,
            level=replace(level, name="macro", datasheet=parts),
            seed=seed if errors else None,
            series=series,
        )

    yield rung(f"gain {datasheet.a0:.0e} alone", a0=datasheet.a0)
    yield rung(f"slew {datasheet.slew * 1e-6:.0f} V/us alone", slew=datasheet.slew)
    yield rung(f"rails {datasheet.rails:g} V alone", rails=datasheet.rails)
    yield rung(
        f"multipliers of {datasheet.multiplier_bandwidth * 1e-6:.0f} MHz alone",
        multiplier_bandwidth=datasheet.multiplier_bandwidth,
        function_bandwidth=datasheet.function_bandwidth,
    )
    yield rung(
        f"op-amp offsets {tolerances.offset * 1e6:.0f} uV alone",
        errors=Tolerances(offset=tolerances.offset),
    )
    yield rung(
        f"resistors {tolerances.resistor:.1%} alone",
        errors=Tolerances(resistor=tolerances.resistor),
    )
    yield rung(
        f"multiplier gains {tolerances.gain:.1%} alone", errors=Tolerances(gain=tolerances.gain)
    )
    yield rung(
        f"multiplier offsets {tolerances.product_offset * 1e3:g} mV alone",
        errors=Tolerances(product_offset=tolerances.product_offset),
    )
    yield rung("E96 resistors alone", series=E96)
