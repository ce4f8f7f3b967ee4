"""Network diagrams for papers: the cell or the cell array, as SVG and PDF."""

from __future__ import annotations

from ann_dc.errors import ExportError
from ann_dc.export.drawings.cell_picture import cell_page
from ann_dc.export.drawings.chain_diagram import chain_page
from ann_dc.export.drawings.labels import short_names
from ann_dc.export.drawings.page import told_of
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.network.network import Network
from ann_dc.validation import checked

PAGES = {"cell": cell_page, "chain": chain_page}
"""Available pictures."""


@checked
def diagram_files(
    network: Network, vector: ReferenceVector, *, of: str = "cell"
) -> dict[str, bytes]:
    """Draw a diagram as SVG and PDF, 180 mm wide, with letters of at least 6 points.

    The cell diagram has a box for every neuron and block, with the weight of each wire at its end;
    the box of a multiplier neuron contains all its nodes. The chain diagram has the first cells and
    the last cell, the neighbour connections, the fixed boundary neurons, and the preconditioner
    above. Numbers are in network units. Names that the picture shortens are in the SVG metadata.
    Argument ``of`` is ``cell`` or ``chain``; another picture raises `ExportError`.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> files = diagram_files(network, reference_vector(network), of="chain")
    >>> sorted(files)
    ['chain.pdf', 'chain.svg', 'reference_vector.json']
    """
    if of not in PAGES:
        raise ExportError(f"of: {of!r} cannot be drawn; choose one of: {', '.join(PAGES)}")
    names = {short: name for name, short in short_names(network.cell).items() if short != name}
    reported = told_of(network, "diagram", of) | {"names": names}
    return {**PAGES[of](network).files(of, reported), VECTOR: vector.as_json()}
