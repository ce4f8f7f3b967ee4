"""What stands beside plain numbers: the manifest that says what they are, a reference vector."""

from __future__ import annotations

from collections.abc import Mapping

from ann_dc.errors import ExportError, FileFormatError
from ann_dc.export.reference.vector import EulerWalk, ReferenceVector
from ann_dc.export.weights.hashes import content_hash
from ann_dc.network.network import Network

MANIFEST, VECTOR = "manifest.json", "reference_vector.json"


def check_vector(network: Network, vector: ReferenceVector) -> None:
    """Refuse a vector that is another network's.

    Raises
    ------
    ExportError
    """
    if vector.content != content_hash(network):
        raise ExportError(
            f"vector: it is another network's than {network.title!r}; take "
            "ann_dc.export.reference.reference_vector(network)"
        )


def file_of(files: Mapping[str, bytes], name: str) -> bytes:
    """The content of a file.

    Raises
    ------
    FileFormatError
        If there is none of that name.
    """
    if name not in files:
        raise FileFormatError(f"{name}: missing; export the network again")
    return files[name]


def text_of(files: Mapping[str, bytes], name: str) -> str:
    """The text of a file.

    Raises
    ------
    FileFormatError
        If there is none of that name, or it is not UTF-8.
    """
    try:
        return file_of(files, name).decode("utf-8")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{name}: not UTF-8 text: {error}") from error


def walked(network: Network, files: Mapping[str, bytes]) -> str:
    """Let a network that was read walk as its reference vector does.

    Parameters
    ----------
    network : Network
    files : mapping of file name to bytes
        With the vector.

    Returns
    -------
    str
        How far it came, and how far it was off.

    Raises
    ------
    FileFormatError
        If the vector is another network's, or another walk.
    """
    vector = ReferenceVector.from_json(file_of(files, VECTOR))
    if vector.content != content_hash(network):
        raise FileFormatError(
            f"{VECTOR}: it is another network's; one of the files was changed: export the network "
            "again"
        )
    if vector.start.shape != network.live.shape:
        raise FileFormatError(f"{VECTOR}: its states do not fit the network; export it again")
    walker = EulerWalk(network, vector.step)
    off = vector.check(
        lambda start, count: network.unpack(walker.after(network.pack(start), count))
    )
    return f"{max(vector.early, default=0)} steps within {off:.1e} of the reference vector"
