"""A family of inputs, as words: ``--over q_d.x=3:7``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import typer

from ann_dc.network.inputs import ranges_of as network_ranges_of

OverOption = Annotated[
    list[str] | None,
    typer.Option(
        "--over",
        metavar="INPUT=LOW:HIGH",
        help="Design one network for a range of an input: q_d.x=3:7, q_0.phi=-0.5:0.5, or an input "
        "that the problem declares. Repeatable.",
    ),
]


@dataclass(frozen=True, kw_only=True)
class FamilyOptions:
    """The words that describe a family of inputs."""

    over: OverOption = None
    held_out: Annotated[
        int, typer.Option("--held-out", min=1, help="With --over: inputs of the validation.")
    ] = 1000


def ranges_of(words: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Ranges by the name of an input.

    Parameters
    ----------
    words : sequence of str
        Each ``INPUT=LOW:HIGH``.

    Returns
    -------
    dict of str to (float, float)

    Raises
    ------
    ProblemError
        If a word is no range, or names an input for the second time.

    Examples
    --------
    >>> ranges_of(["q_d.x=3:7", "q_0.phi=-0.5:0.5"])
    {'q_d.x': (3.0, 7.0), 'q_0.phi': (-0.5, 0.5)}
    """
    return network_ranges_of(words, "--over")
