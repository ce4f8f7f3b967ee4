"""Check of a NIR graph file before it is read: permitted datasets of known sizes."""

from __future__ import annotations

import io
import math
import zlib
from collections.abc import Iterator, Mapping
from typing import Any

from ann_dc.errors import ExportPackageMissing, FileFormatError

NODES = ["input", "input_weights", "synapses", "preconditioner", "neurons", "output"]
GROUPS = {"node", "node/nodes", *(f"node/nodes/{name}" for name in NODES)}
EDGES = 8
"""Maximum number of edges of a graph; an exported graph has five to seven."""


def check_file(name: str, content: bytes, size: int, inputs: int) -> None:
    """Check a NIR file before its content is read.

    The states have ``size`` components and all inputs have ``inputs`` components. Raises
    `FileFormatError` for a dataset of unexpected shape or type, in another file, behind a link, or
    larger than declared when unpacked. Raises `ExportPackageMissing` if h5py, which is installed
    with nir, is missing.
    """
    try:
        import h5py
    except ImportError as error:
        raise ExportPackageMissing(
            "nir is not installed; install it with: pip install 'ann-dc[export]'"
        ) from error
    shapes = _shapes(size, inputs)
    try:
        with h5py.File(io.BytesIO(content), "r") as file:
            for path, dataset in _datasets(name, file):
                _check_dataset(f"{name}: {path}", dataset, shapes.get(path))
    except FileFormatError:
        raise
    except Exception as error:  # whatever h5py makes of another file
        raise FileFormatError(f"{name}: no NIR graph: {error}") from error


def _shapes(size: int, inputs: int) -> Mapping[str, tuple[str, tuple[int, ...]]]:
    """Return the kind of values and the shape of every dataset."""
    found: dict[str, tuple[str, tuple[int, ...]]] = {
        "version": ("O", ()),
        "node/type": ("O", ()),
        "node/edges": ("O", (EDGES, 2)),
        "node/nodes/input/shape": ("i", (1,)),
        "node/nodes/output/shape": ("i", (1,)),
        "node/nodes/input_weights/weight": ("f", (size, inputs)),
        "node/nodes/synapses/weight": ("f", (size, size)),
        "node/nodes/synapses/bias": ("f", (size,)),
        "node/nodes/preconditioner/weight": ("f", (size, size)),
        "node/nodes/neurons/r": ("f", (size,)),
    }
    return found | {f"node/nodes/{node}/type": ("O", ()) for node in NODES}


def _datasets(name: str, group: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield all datasets with their paths; links are rejected."""
    import h5py

    for key in group:
        place = f"{path}{key}"
        if not isinstance(group.get(key, getlink=True), h5py.HardLink):
            raise FileFormatError(f"{name}: {place:.80} is a link")
        item = group[key]
        if isinstance(item, h5py.Dataset):
            yield place, item
        elif place in GROUPS:
            yield from _datasets(name, item, f"{place}/")
        else:
            raise FileFormatError(f"{name}: {place:.80} is in no exported network")


def _check_dataset(place: str, dataset: Any, wanted: tuple[str, tuple[int, ...]] | None) -> None:
    kind, shape = wanted or ("", ())
    fits = dataset.shape == shape
    if place.endswith("edges") and len(dataset.shape) == 2:
        fits = dataset.shape[0] <= EDGES and dataset.shape[1] == 2
    if dataset.dtype.kind != kind or dataset.dtype.itemsize > 8 or not fits:
        raise FileFormatError(
            f"{place:.100}: {dataset.shape} of {dataset.dtype!s:.20} does not fit the network"
        )
    if dataset.is_virtual or dataset.external:
        raise FileFormatError(f"{place:.100}: its numbers lie in another file")
    if dataset.id.get_create_plist().get_nfilters() != (dataset.compression == "gzip"):
        raise FileFormatError(f"{place:.100}: is packed in a way of its own")
    if dataset.chunks:
        _check_chunks(place, dataset)


def _check_chunks(place: str, dataset: Any) -> None:
    """Raise `FileFormatError` for chunks that unpack to more than their size."""
    whole = math.prod(dataset.chunks) * dataset.dtype.itemsize
    if any(chunk > length for chunk, length in zip(dataset.chunks, dataset.shape)):
        raise FileFormatError(f"{place:.100}: its chunks are larger than itself")
    for number in range(dataset.id.get_num_chunks()):
        _, packed = dataset.id.read_direct_chunk(dataset.id.get_chunk_info(number).chunk_offset)
        if dataset.compression and len(zlib.decompressobj().decompress(packed, whole + 1)) > whole:
            raise FileFormatError(f"{place:.100}: a chunk unpacks to more than it has")
