"""Arguments for networks in files: a weight file or folder in place of a problem, --duration."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ann_dc.errors import ProblemError, require_positive

NETWORKS = (".npz", ".safetensors")
"""File name extensions of a network."""

DurationOption = Annotated[
    float | None,
    typer.Option(
        "--duration",
        metavar="T",
        help="Network time of the run (unit time constants), for a network that need not settle: "
        "an oscillator, chaos.",
        show_default="until it settles",
    ),
]


def check_duration(duration: float | None) -> None:
    """Raise `ProblemError` if --duration is not a positive number."""
    if duration is not None:
        require_positive(ProblemError, **{"--duration": duration})


def is_network(word: str) -> bool:
    """Return True for a weight file or a folder; the name of a plant is a plant."""
    from ann_dc.problem import plants

    place = Path(word)
    return word not in plants.names() and (place.suffix in NETWORKS or place.is_dir())


def saved_network(word: str):
    """Return the network of a weight file, an export to weights or a saved solution.

    Raises `ProblemError` for a folder with exports in it, and `FileFormatError` for other content.
    """
    from ann_dc.export.index import INDEX, exported_network

    place = Path(word)
    if (place / INDEX).is_file():
        return exported_network(place)
    if next(place.glob(f"*/{INDEX}"), None):
        raise ProblemError(
            f"{place} has exports in it, and a network is read from one to weights: give "
            f"{place / 'weights'}, a weight file, or the problem"
        )
    if place.is_dir():
        from ann_dc.solution.loading import load_solution

        return load_solution(place).network

    from ann_dc.weights.network_file import load

    return load(place)
