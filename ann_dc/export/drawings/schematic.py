"""Schematics of a cell's parts with values, as SVG and PDF."""

from __future__ import annotations

from ann_dc.errors import ExportError
from ann_dc.export.drawings.page import told_of
from ann_dc.export.drawings.sheets import circuit_sheets
from ann_dc.export.netlists.build import build
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
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
    >>> sorted(files)  # doctest: +SKIP
    ['reference_vector.json', 'schematic_1.pdf', 'schematic_1.svg']
    """
    _check_level(level)
    if network.preconditioner.kind is PreconditionerKind.RESISTIVE_GRID:
        primal = ", ".join(n.name for n in network.cell.neurons if n.role is Role.PRIMAL)
        raise ExportError(
            f"schematic: the resistors of a grid between {primal:.200} are not drawn; design the "
            "network with a diagonal, multilevel or cyclic-reduction preconditioner"
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
