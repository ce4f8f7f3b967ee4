"""``ann-dc export``: export of a network in the formats of external tools.

``ann-dc inspect``: content and verification of a network file or an export.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import typer

from ann_dc.cli.arguments.options import JsonOption, QuietOption, argument, option, timed
from ann_dc.cli.arguments.problem import ProblemOptions, arithmetic_of, pairs_of
from ann_dc.cli.arguments.saved_network import (
    DurationOption,
    check_duration,
    is_network,
    unchanged_network,
)
from ann_dc.cli.arguments.words import PreconditionerOption, preconditioner_of
from ann_dc.cli.terminal import console, finish, notes, progress_line
from ann_dc.progress import Progress
from ann_dc.report.json_file import make_room, write_results


def _list_formats(wanted: bool) -> None:
    if wanted:
        from ann_dc.report.exports import formats_table

        console().print(formats_table())
        raise typer.Exit


@timed
def export(
    *,
    problem: ProblemOptions,
    to: list[str] | None = option(
        "Formats, or all; see --list-formats. Repeatable.",
        metavar="FORMAT,...",
        show_default="weights",
    ),
    output: Path = option(
        "Folder of the exports; each format has a subfolder.",
        default=Path("out/export"),
        metavar="DIR",
    ),
    given: list[str] | None = option(
        "Setting of a format, for instance bits=16; see --list-formats. Repeatable.",
        "--option",
        metavar="NAME=VALUE",
    ),
    preconditioner: PreconditionerOption = None,
    duration: DurationOption = None,
    list_formats: bool = option(
        "List the formats with their content and settings; needs no PROBLEM.",
        "--list-formats",
        default=False,
        is_eager=True,
        callback=_list_formats,
    ),
    json_file: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Export a network as weights or to runtimes, circuits, chips and figures.

    PROBLEM may also be a weight file (.npz, .safetensors) or the folder of an
    export to weights. A folder written by ann-dc solve --save is valid, too
    (./car, if it has the name of a plant). A plant or a problem file is
    designed first, with the preconditioner that --preconditioner names. An earlier
    export in DIR is replaced. Every format includes a test vector, which
    allows the recipient to verify the result, and an index with hashes. Every
    result is checked before it is written, and the check is reported.

    Circuits and integers are scaled by a run that lasts until the network
    settles. A network that does not settle needs the --duration of this run.

    If a format cannot represent a network, the nodes concerned are named.
    With several formats the others are still written.

    Usage examples:

      ann-dc export --list-formats
      ann-dc export car --to onnx --preconditioner multilevel --output out/car
      ann-dc export car --to c99,hdl --option bits=16
      ann-dc export car --to pack --option level=opa192_ad734
      ann-dc export network.npz --to all
      ann-dc export oscillator.npz --to pack --duration 30
      ann-dc inspect out/car

    Exit code: 0 written, 1 some formats cannot represent the network,
    2 bad input, a missing package, or unwritable output.
    """
    with notes(quiet), progress_line(quiet) as progress:
        from ann_dc.export.exporting import export_network, settings_from

        check_duration(duration)
        make_room(json_file)
        names = [name.strip() for names in to or ["weights"] for name in names.split(",")]
        settings = settings_from(names, pairs_of(given or (), "--option", "bits=16"))
        network = _network(problem, preconditioner, progress)
        done = export_network(
            network, names, output, duration=duration, progress=progress, **settings
        )
        written = write_results([asdict(each) for each in done], json_file)
    code = 1 if any(each.why_not for each in done) else 0
    finish(map(_sentence, done), written, quiet=quiet, code=code)


def _sentence(done: Any) -> str:
    """Return the result of a format in one sentence."""
    if done.why_not:
        return f"no {done.name}: {done.why_not}"
    files = ", ".join(str(file.relative_to(done.folder)) for file in done.files)
    return f"wrote {done.folder}: {files}\n  checked: {done.worth}"


def _network(problem: ProblemOptions, preconditioner: str | None, progress: Progress) -> Any:
    """Return the network of a weight file or folder, or design one for a problem."""
    if is_network(problem.problem):
        return unchanged_network(problem, preconditioner)
    declared, kind = problem.declared(), preconditioner_of(preconditioner)

    from ann_dc.cli.arguments.building import network_to_build

    with arithmetic_of(declared.name):
        return network_to_build(declared, kind, simulated=False, progress=progress)


@timed
def inspect(
    *,
    place: Path = argument(
        "Weight file, folder of an export, or folder of several exports.", metavar="PATH"
    ),
    json_file: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Show the content of a file or export, and verify hashes and behaviour.

    Names and hashes of all files of an export are checked. Files that can be
    run are compared with their test vector, in their runtime if that is
    installed. The network of a weight file is run until it settles; for an
    oscillator or a chaotic network, the growth rate and frequency at its
    equilibrium are shown, and a command to run it. Code in a file is never
    executed: torch programs and netlists are not run. Several exports have
    one line each; inspect a single export for all details.

    Usage examples:

      ann-dc inspect network.npz
      ann-dc inspect out/export/onnx
      ann-dc inspect out/export

    Exit code: 0 verified, 1 verification failed, 2 no network file or
    export found.
    """
    with progress_line(quiet) as progress:
        from ann_dc.export.catalogue import inspect_export
        from ann_dc.report.exports import inspection_table, inspections_table

        make_room(json_file)
        found = inspect_export(place, progress=progress)
        content = [asdict(each) | {"good": each.good} for each in found]
        written = write_results(content, json_file)
    shown = inspection_table(found[0]) if len(found) == 1 else inspections_table(found)
    finish([shown], written, quiet=quiet, code=0 if all(each.good for each in found) else 1)
