"""Network file: every number in a named array, every name in a manifest.

The file is a ``.safetensors`` file (layout in `entries`) or an ``.npz`` file (readable with
``numpy.load(path, allow_pickle=False)``). Both forms have the same content: float64 arrays and the
manifest, a JSON text. The manifest is stored in the header (``__metadata__``) of a ``.safetensors``
file and in the uint8 entry ``manifest`` of an ``.npz`` file.

=====================  ==========================================================
``tau/mu.x``           () or (N,) time constant of a neuron
``weight/m.x<-c.x``    () or (N,) weight of a connection, by its name
``input/q_d.x``        (N,) value of an input, in the user's units
``start/q.x``          (N,) initial states
``limits``             (P, 2) saturation limits of the P neurons
``scale_factor``       (P,) user's value of a state of one
``scale_offset``       (P,) user's value of a state of zero, if any neuron has an offset
``input_scale``        (I, 2) factor and offset of every input, likewise
``range``              (I, 2) input ranges of the design, if it used ranges
``gain/0``             (points, C, C) coarse-level neurons of a level, finest first
``stiffness/own``      (N, m, m) stiffness within each cell, over its m primal neurons
``stiffness/...``      ``following``, (N - 1, m, m): stiffness between adjacent cells
=====================  ==========================================================

The manifest has names and wiring without numbers: ``neurons``, ``inputs``, ``blocks``,
``connections``, ``duals``, ``inequality_duals``, ``objectives``, ``chains``, ``fixed``,
``omitted``, ``left_boundary``, ``start``. ``stages`` is N, and ``preconditioner`` has the kind of M
and the number of coarse levels. ``about`` has the equation and the formula of M, and ``tensors``
has the meaning, unit and axes of every array.

``hashes`` are SHA-256 values in hexadecimal digits of JSON texts with sorted keys, as written by
Python's `json.dumps`:

``wiring``
    Manifest without ``schema``, ``title``, ``about``, ``tensors`` and ``hashes``.
``content``
    Same text, followed by every array in the order of the names: ``["name", [shape]]``, then the
    little-endian float64 numbers.
``manifest``
    Manifest without ``hashes``.

Schema 3; other schemas are rejected by name. Equal networks give equal bytes. The content of a file
is never executed.
"""

from __future__ import annotations

import io
import json
import operator
import os
import zipfile
from pathlib import Path

from ann_dc.errors import FileFormatError, NetworkError, OutputError, UnknownNameError
from ann_dc.files import read_whole, write_whole
from ann_dc.network.network import Network
from ann_dc.validation import checked
from ann_dc.weights.entries import BROKEN, NpzEntries, TensorEntries, packed_entries, packed_tensors
from ann_dc.weights.hashes import hashes_of
from ann_dc.weights.reading import MAX_MANIFEST, network_of
from ann_dc.weights.writing import about, arrays_of, manifest_of, words_of

NPZ, SAFETENSORS = ".npz", ".safetensors"
"""File name suffixes of the two forms."""
MAX_BYTES = 2_000_000_000
"""Largest file size in bytes; a network of `MAX_STAGES` cells is far smaller."""


@checked
def save(network: Network, path: str | os.PathLike[str]) -> None:
    """Write a network to a file; the suffix of the file name selects the format.

    Parameters
    ----------
    network : Network
        Network to save.
    path : path-like
        File to write: ``.safetensors`` format for a name with this suffix, ``.npz`` format
        otherwise. An existing file is replaced after the new file is complete.

    Raises
    ------
    OutputError
        If the file cannot be written; an existing file is unchanged.

    Examples
    --------
    >>> import tempfile
    >>> from ann_dc import evaluator
    >>> from ann_dc.network import Cell, Connection, Neuron
    >>> chain = Network(stages=3, cell=Cell(
    ...     neurons=(Neuron(name="x"),),
    ...     connections=(Connection(source="x", target="x", weight=-0.5),)))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(chain, f"{folder}/chain.npz")
    ...     evaluator(load(f"{folder}/chain.npz")).rhs([1, 2, 3]).tolist()
    [-0.5, -1.0, -1.5]
    """
    write_whole(path, packed(network, form_of(path)))


def form_of(path: str | os.PathLike[str]) -> str:
    """Return `SAFETENSORS` for a name with this suffix, otherwise `NPZ`."""
    return SAFETENSORS if os.fspath(path).lower().endswith(SAFETENSORS) else NPZ


def packed(network: Network, form: str = NPZ) -> bytes:
    """Serialise a network to the bytes that `save` writes, in the form `NPZ` or `SAFETENSORS`."""
    manifest, arrays = written(network)
    if form == SAFETENSORS:
        return packed_tensors(manifest, arrays)
    return packed_entries({"manifest": manifest}, arrays)


def written(network: Network) -> tuple[str, dict[str, object]]:
    """Return the manifest of a network as text, and its arrays by name.

    Raises `OutputError` if the manifest is larger than the reader accepts.
    """
    arrays, plain = arrays_of(network), manifest_of(network)
    manifest = plain | {"about": about(network), "tensors": words_of(network, arrays)}
    first = {key: plain[key] for key in ("format", "schema", "title")}
    table = first | {"hashes": hashes_of(manifest, arrays)} | manifest
    text = json.dumps(table, indent=1, default=operator.index)
    if len(text) > MAX_MANIFEST:
        text = json.dumps(table, separators=(",", ":"), default=operator.index)
    if len(text) > MAX_MANIFEST:
        raise OutputError(
            f"names and wires of {network.title!r} take {len(text)} bytes, a file may have "
            f"{MAX_MANIFEST}; use shorter names or fewer fixed and omitted neurons"
        )
    return text, arrays


@checked
def load(path: str | os.PathLike[str]) -> Network:
    """Read a network written by `save`; it behaves exactly as the saved network.

    Parameters
    ----------
    path : path-like
        File to read: ``.safetensors`` format for a name with this suffix, ``.npz`` format
        otherwise.

    Returns
    -------
    Network
        Saved network.

    Raises
    ------
    FileFormatError
        If the file was not written by `save` or was modified afterwards. The message names the file
        and the entry.

    Examples
    --------
    >>> import tempfile
    >>> from ann_dc import plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=3))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(network, f"{folder}/network.npz")
    ...     again = load(f"{folder}/network.npz")
    >>> bool((again.start_state == network.start_state).all()), again.size == network.size
    (True, True)
    """
    file = Path(path)
    remedy = "use the path of a saved network (.npz or .safetensors)"
    return unpacked(read_whole(file, MAX_BYTES, remedy), file)


def unpacked(content: bytes, file: Path) -> Network:
    """Return the network in the content of a file, in the form of its suffix.

    Raises `FileFormatError`, which begins with the file, if `packed` cannot have written it.
    """
    try:
        if form_of(file) == SAFETENSORS:
            entries = TensorEntries(content)
            return network_of(entries.manifest, entries)
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = NpzEntries(archive, len(content))
            return network_of(entries.text("manifest", MAX_MANIFEST), entries)
    except (FileFormatError, NetworkError, UnknownNameError) as error:
        raise FileFormatError(f"{file}: {error}") from error
    except BROKEN as error:
        raise FileFormatError(
            f"{file}: not a complete {form_of(file)} file ({error}); save the network again"
        ) from error
    except (MemoryError, RecursionError) as error:
        raise FileFormatError(
            f"{file}: needs more than the available memory; save the network again"
        ) from error
