"""Weight file with its manifest, for programs that read arrays by name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ann_dc.errors import FileFormatError, UnknownNameError
from ann_dc.export.reference.contents import file_of, text_of
from ann_dc.export.reference.sidecar import MANIFEST, check_vector, walked
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.network.network import Network
from ann_dc.validation import checked
from ann_dc.weights.hashes import check_hashes
from ann_dc.weights.manifest import read_manifest
from ann_dc.weights.network_file import packed, unpacked, written
from ann_dc.weights.writing import arrays_of

FORMS = {"safetensors": "network.safetensors", "npz": "network.npz"}
"""Names of the weight file."""


@checked
def weights_files(
    network: Network, vector: ReferenceVector, *, form: str = "safetensors"
) -> dict[str, bytes]:
    """Export the file that `save` writes, its manifest as text, and the test vector.

    The ``form`` is ``safetensors`` or ``npz``. Raises `UnknownNameError` for another form,
    `ExportError` if the vector belongs to another network, and `OutputError` if a node has a name
    that a file cannot have.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> files = weights_files(network, reference_vector(network))
    >>> sorted(files)
    ['manifest.json', 'network.safetensors', 'reference_vector.json']
    >>> weights_check(files)
    'network.safetensors: 61 arrays as hashed; 50 steps within 0.0e+00 of the reference vector'
    """
    if form not in FORMS:
        raise UnknownNameError.of("form", form, FORMS)
    check_vector(network, vector)
    manifest, _ = written(network)
    return {
        FORMS[form]: packed(network, f".{form}"),
        MANIFEST: f"{manifest}\n".encode(),
        VECTOR: vector.as_json(),
    }


@checked
def weights_check(files: Mapping[str, bytes]) -> str:
    """Read a weight file, compare its manifest, and repeat the steps of the vector.

    Returns the result as a sentence. Raises `FileFormatError` if a file is missing or differs from
    the export.
    """
    there = [name for name in FORMS.values() if name in files]
    if len(there) != 1:
        raise FileFormatError(
            f"expected one of {', '.join(FORMS.values())}, got {' and '.join(there) or 'none'}; "
            "export the network again"
        )
    network = unpacked(file_of(files, there[0]), Path(there[0]))
    arrays = arrays_of(network)
    check_hashes(read_manifest(text_of(files, MANIFEST)), arrays)
    return f"{there[0]}: {len(arrays)} arrays as hashed; {walked(network, files)}"
