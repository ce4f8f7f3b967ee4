r"""The equations of a network as LaTeX: what every neuron and block of a cell adds up.

.. math:: \tau\, \frac{dx}{ds} = \sum_e w_e\, s_e .

A neuron ``mu.phi`` of stage k is :math:`\mu^{\varphi}_k` and a state ``q.phi`` just
:math:`\varphi_k`, as in the stage equations; products are numbered. All follows from the network
alone, so that one that was loaded has its equations too.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from ann_dc.errors import FileFormatError
from ann_dc.export.drawings import check_structure, document_of
from ann_dc.export.drawings.checking import VECTOR, read_vector
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.network.network import Network
from ann_dc.validation.checked import checked

TEX = "equations.tex"


@checked
def latex_files(network: Network, vector: ReferenceVector) -> dict[str, bytes]:
    r"""The equations of a cell as a document, with tables of weights, time constants and inputs.

    It needs no more than ``amsmath``, ``longtable`` and ``geometry``. Numbers are in network
    units; those that differ from stage to stage are told by their range.

    Parameters
    ----------
    network : Network
    vector : ReferenceVector
        Of the network.

    Returns
    -------
    dict of str to bytes
        'equations.tex' and 'reference_vector.json'.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> network = ann_dc.synthesize(ann_dc.plants.double_integrator(N=3))
    >>> files = latex_files(network, reference_vector(network))
    >>> lines = files["equations.tex"].decode().splitlines()
    >>> print(*(line for line in lines if "d {a}_{k}" in line))
    \tau\,\frac{d {a}_{k}}{ds} &= -{a}_{k} - {m}^{{v}}_{k} \\
    >>> latex_check(files)
    'equations of 9 neurons, of the network of the reference vector'
    """
    text = "\n".join(document_of(network))
    return {TEX: (text + "\n").encode("ascii"), VECTOR: vector.as_json()}


@checked
def latex_check(files: Mapping[str, bytes]) -> str:
    """Whether equations are whole, safe to typeset, and of the network of the reference vector.

    Parameters
    ----------
    files : mapping of file name to bytes
        As `latex_files` gives them.

    Returns
    -------
    str
        What was found.

    Raises
    ------
    FileFormatError
        If a file is missing, braces or environments do not match, a command is none that such
        files use, or the equations are of another network.
    """
    vector = read_vector(files)
    if set(files) != {TEX, VECTOR}:
        raise FileFormatError(f"expected {TEX} and {VECTOR}, got {', '.join(sorted(files)):.200}")
    try:
        text = files[TEX].decode("ascii")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{TEX}: not plain ASCII: {error}") from error
    head = dict(re.findall(r"^% (wiring|content): ([0-9a-f]{64})$", text, re.MULTILINE))
    if head != {"wiring": vector.wiring, "content": vector.content}:
        raise FileFormatError(f"{TEX}: its hashes are not those of {VECTOR}; export them together")
    check_structure(TEX, text)
    count = len(re.findall(r"^\\tau\\,\\frac", text, re.MULTILINE))
    if count != len(vector.start):
        raise FileFormatError(f"{TEX}: {count} neurons, but the network has {len(vector.start)}")
    return f"equations of {count} neurons, of the network of the reference vector"
