r"""LaTeX equations of a network: the sum of every neuron and block of a cell.

.. math:: \tau\, \frac{dx}{ds} = \sum_e w_e\, s_e .

A neuron ``mu.phi`` of stage k is written :math:`\mu^{\varphi}_k` and a state ``q.phi`` is written
:math:`\varphi_k`, as in the stage equations. Products are numbered. The equations need only the
network, so they are also available for a loaded network.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from ann_dc.errors import FileFormatError
from ann_dc.export.drawings import check_structure, document_of
from ann_dc.export.drawings.checking import VECTOR, read_vector
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.network.network import Network
from ann_dc.validation import checked

TEX = "equations.tex"


@checked
def latex_files(network: Network, vector: ReferenceVector) -> dict[str, bytes]:
    r"""Write the equations of a cell as a document with tables of its numbers.

    The tables list weights, time constants and inputs. The document needs only ``amsmath``,
    ``longtable`` and ``geometry``. Numbers are in network units; a range is given for numbers that
    differ between stages. The files are 'equations.tex' and 'reference_vector.json'.

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
    """Check that equations are complete, safe to typeset, and match the test vector.

    Returns the result as a sentence. Raises `FileFormatError` if a file is missing, braces or
    environments do not match, an unknown command occurs, or the equations belong to another
    network.
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
