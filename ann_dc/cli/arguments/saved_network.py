"""Arguments for networks in files: a file in place of a problem, --input and --duration."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from ann_dc.cli.arguments.options import option
from ann_dc.cli.arguments.problem import ProblemOptions, number_of, pairs_of
from ann_dc.errors import ProblemError, require_positive

NETWORKS = (".npz", ".safetensors")
"""File name extensions of a network."""

DurationOption = Annotated[
    float | None,
    typer.Option(
        "--duration",
        metavar="T",
        help="Network time of the run (unit time constants), for a network that does not settle.",
        show_default="until it settles",
    ),
]


@dataclass(frozen=True, kw_only=True)
class NetworkOptions:
    """Options of the run of a network in a file: its inputs and its duration."""

    duration: DurationOption = None
    inputs: list[str] | None = option(
        "Input of the network: one value, N values (1,2,3), or a column of a CSV file with a "
        "column `time` (target.csv:x). Repeatable.",
        "--input",
        metavar="NAME=VALUE",
    )

    def applied_to(self, network: Any):
        """Return the network with the values of --input; `ProblemError` for an invalid value."""
        from ann_dc.network.waveforms import Waveform

        values: dict[str, Any] = {}
        for name, text in pairs_of(self.inputs or (), "--input", "load=0.5").items():
            file, is_file, column = text.rpartition(".csv:")
            if is_file:
                values[name] = Waveform.from_csv(f"{file}.csv", column)
                continue
            if text.endswith(".csv"):
                raise ProblemError(f"--input {name}: add the column, {name}={text}:COLUMN")
            numbers = [number_of(f"--input {name}", word.strip()) for word in text.split(",")]
            if len(numbers) not in (1, network.stages):
                raise ProblemError(
                    f"--input {name}: expected 1 or {network.stages} numbers, got {text!r}"
                )
            values[name] = numbers[0] if len(numbers) == 1 else numbers
        return network.with_inputs(values) if values else network


def check_duration(duration: float | None) -> None:
    """Raise `ProblemError` if --duration is not a positive number."""
    if duration is not None:
        require_positive(ProblemError, **{"--duration": duration})


def unchanged_network(problem: ProblemOptions, preconditioner: str | None):
    """Return the network of a file given as PROBLEM.

    Raises `ProblemError` for options of a problem or of its design.
    """
    if any((problem.settings, problem.horizon, problem.q_0, problem.q_d, preconditioner)):
        raise ProblemError(
            f"{problem.problem}: a stored network cannot be changed; omit --set, --horizon, "
            "--q-0, --q-d and --preconditioner"
        )
    return saved_network(problem.problem)


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
            f"{place} contains exports; a network is read from the export to weights: give "
            f"{place / 'weights'}, a weight file, or the problem"
        )
    if place.is_dir():
        from ann_dc.solution.loading import load_solution

        return load_solution(place).network

    from ann_dc.weights.network_file import load

    return load(place)
