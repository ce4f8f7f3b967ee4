"""A network as a diagram for a paper: its cell, or the row of cells, as SVG and PDF."""

from __future__ import annotations

from collections.abc import Mapping

from ann_dc.errors import ExportError, FileFormatError
from ann_dc.export.drawings.cell_picture import cell_page
from ann_dc.export.drawings.chain_diagram import chain_page
from ann_dc.export.drawings.checking import VECTOR, check_pdf, check_svg, read_vector, told_of
from ann_dc.export.drawings.labels import short_names
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.network.network import Network
from ann_dc.validation.checked import checked

FORM = "diagram"
PAGES = {"cell": cell_page, "chain": chain_page}
"""What can be drawn."""


@checked
def diagram_files(
    network: Network, vector: ReferenceVector, *, of: str = "cell"
) -> dict[str, bytes]:
    """A diagram as SVG and PDF, 180 mm wide, with letters of 6 points or more.

    The cell has a box for every neuron and block, with the weight of each wire where it ends;
    that of a multiplier holds all its nodes. The chain has the first cells and the last, what
    goes between neighbours, the pinned ends, and the metric above. Numbers are in network units.

    Parameters
    ----------
    network : Network
    vector : ReferenceVector
        Of the network.
    of : str
        ``cell`` or ``chain``.

    Returns
    -------
    dict of str to bytes
        'cell.svg' and 'cell.pdf', or 'chain.svg' and 'chain.pdf', and
        'reference_vector.json'. Names that the picture shortens are in the SVG's metadata.

    Raises
    ------
    ExportError
        If there is no such picture.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> files = diagram_files(network, reference_vector(network), of="chain")
    >>> sorted(files)
    ['chain.pdf', 'chain.svg', 'reference_vector.json']
    >>> diagram_check(files)
    'a diagram of the chain, of the network of the reference vector'
    """
    if of not in PAGES:
        raise ExportError(f"of: {of!r} cannot be drawn; choose one of: {', '.join(PAGES)}")
    names = {short: name for name, short in short_names(network.cell).items() if short != name}
    told = told_of(network, FORM, of) | {"names": names}
    return {**PAGES[of](network).files(of, told), VECTOR: vector.as_json()}


@checked
def diagram_check(files: Mapping[str, bytes]) -> str:
    """Whether diagrams are whole, and of the network of the reference vector beside them.

    Parameters
    ----------
    files : mapping of file name to bytes
        As `diagram_files` gives them.

    Returns
    -------
    str
        What was found.

    Raises
    ------
    FileFormatError
        If a file is missing, is no diagram, or one of another network.
    """
    vector = read_vector(files)
    name = next((name for name in PAGES if f"{name}.svg" in files), None)
    if name is None or set(files) != {f"{name}.svg", f"{name}.pdf", VECTOR}:
        given = ", ".join(sorted(files))
        raise FileFormatError(f"expected an SVG and a PDF file of a diagram, got {given:.200}")
    table = check_svg(f"{name}.svg", files[f"{name}.svg"], FORM, vector)
    if table.get("of", str) != name:
        raise FileFormatError(f"{name}.svg: says that it is of something else")
    check_pdf(f"{name}.pdf", files[f"{name}.pdf"], vector)
    return f"a diagram of the {name}, of the network of the reference vector"
