"""Schematics of a cell's parts with values, as SVG and PDF."""

from __future__ import annotations

from collections.abc import Mapping

from ann_dc.errors import ExportError, FileFormatError
from ann_dc.export.drawings.checking import VECTOR, check_pdf, check_svg, read_vector, told_of
from ann_dc.export.drawings.sheets import circuit_sheets
from ann_dc.export.netlists.build import build
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.hardware.parts import presets
from ann_dc.network.cell import Role
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.validation import checked

FORM = "schematic"


@checked
def schematic_files(
    network: Network, vector: ReferenceVector, *, level: str = "behavioural"
) -> dict[str, bytes]:
    """Draw schematics of a cell's parts with schemdraw: one of each kind, with values.

    The level is ``behavioural``, ``macro``, or the name of a part set: op amps with resistors. The
    files are ``schematic_1.svg`` and ``schematic_1.pdf``, further sheets if needed, and
    ``reference_vector.json``.

    Raises `ExportError` with the reason if the level does not exist or cannot build the network,
    and `ExportPackageMissing` if schemdraw is not installed.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> problem = ann_dc.plants.double_integrator(N=3)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> files = schematic_files(network, reference_vector(network))  # doctest: +SKIP
    >>> schematic_check(files)  # doctest: +SKIP
    '1 sheet of schematics, of the network of the reference vector'
    """
    _check_level(level)
    if network.preconditioner.kind is PreconditionerKind.RESISTIVE_GRID:
        primal = ", ".join(n.name for n in network.cell.neurons if n.role is Role.PRIMAL)
        raise ExportError(
            f"schematic: the resistors of a grid between {primal:.200} are not drawn; design the "
            "network with time constants alone, a pyramid or a tree"
        )
    circuit = build(network, level).circuit
    files, told = {}, told_of(network, FORM, level)
    for number, page in enumerate(circuit_sheets(circuit, level)):
        files |= page.files(f"schematic_{number + 1}", told)
    return {**files, VECTOR: vector.as_json()}


def _check_level(name: str) -> None:
    known = "behavioural", "macro", *presets.names()
    if name not in known:
        raise ExportError(f"level: {name!r} cannot be drawn; choose one of: {', '.join(known)}")


@checked
def schematic_check(files: Mapping[str, bytes]) -> str:
    """Check that schematics are complete and belong to the network of the test vector.

    Returns the result as a sentence. Raises `FileFormatError` if a file is missing, is not a
    schematic, or belongs to another network.
    """
    vector = read_vector(files)
    count = len(files) // 2
    names = [f"schematic_{number + 1}" for number in range(count)]
    expected = {VECTOR, *(f"{name}.{kind}" for name in names for kind in ("svg", "pdf"))}
    if not count or set(files) != expected:
        given = ", ".join(sorted(files))
        raise FileFormatError(f"expected SVG and PDF files of sheets, got {given:.200}")
    for name in names:
        check_svg(f"{name}.svg", files[f"{name}.svg"], FORM, vector)
        check_pdf(f"{name}.pdf", files[f"{name}.pdf"], vector)
    return f"{count} sheet{'s' * (count > 1)} of schematics, of the network of the reference vector"
