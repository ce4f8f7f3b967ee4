"""A network as a file: every number in a named array, every name in a manifest.

The file is a ``.safetensors`` (`tensor_file` has its layout) or an ``.npz`` (read it with
``numpy.load(path, allow_pickle=False)``), and holds the same in both forms: float64 arrays, and the
manifest, a JSON text, which lies in the header of the one (``__metadata__``) and is the uint8 entry
``manifest`` of the other.

=====================  ==========================================================
``tau/mu.x``           () or (N,) time constant of a neuron
``weight/m.x<-c.x``    () or (N,) weight of a connection, by its name
``input/q_d.x``        (N,) value of an input, in the user's units
``start/q.x``          (N,) initial states
``rails``, ``unit``    (P, 2) limiters and (P,) units of the P neurons
``zero``               (P,) offsets of their units, where one has any
``input_scale``        (I, 2) factor and offset of every input, likewise
``range``              (I, 2) for which inputs it was designed, where it was for some
``gain/0``             (points, C, C) coordinators of a level, finest first
``grid/own``           (N, m, m) stiffness within each cell, over its m primal neurons; ``tree/own``
``grid/following``     (N - 1, m, m) and between a cell and the next; ``tree/following``
=====================  ==========================================================

The manifest has names and wires, no numbers: ``neurons``, ``inputs``, ``blocks``, ``connections``,
``duals``, ``diodes``, ``objectives``, ``chains``, ``pins``, ``absent``, ``left``, ``start``;
``stages`` is N, ``levels`` and ``metric`` say which coordinators or stiffness there are, ``about``
has the equation and the formula of M, ``tensors`` the meaning, unit and axes of every array.
``hashes`` are SHA-256, in hexadecimal digits, of JSON texts with sorted keys as Python's
`json.dumps` writes them:

``wiring``
    of the manifest without ``schema``, ``title``, ``about``, ``tensors`` and ``hashes``;
``content``
    of the same, followed by every array in the order of the names: ``["name", [shape]]``, and its
    little-endian float64 numbers;
``manifest``
    of the manifest without ``hashes``.

Files of schema 1 have no hashes, no ``about`` and no ``tensors``. Equal networks give equal bytes,
and nothing in a file is ever executed.
"""

from __future__ import annotations

import io
import json
import operator
import os
import zipfile
from pathlib import Path

from ann_dc.atomic_files import read_whole, write_whole
from ann_dc.errors import FileFormatError, NetworkError, OutputError, UnknownNameError
from ann_dc.network.network import Network
from ann_dc.validation.checked import checked
from ann_dc.weights.hashes import hashes_of
from ann_dc.weights.npz import BROKEN, NpzEntries, packed_entries
from ann_dc.weights.reading import MAX_MANIFEST, network_of
from ann_dc.weights.tensor_file import TensorEntries, packed_tensors
from ann_dc.weights.writing import about, arrays_of, manifest_of, words_of

NPZ, SAFETENSORS = ".npz", ".safetensors"
"""The two forms, by the end of a file's name."""
MAX_BYTES = 2_000_000_000
"""Largest file in bytes; a row of `MAX_STAGES` stays far below it."""


@checked
def save(network: Network, path: str | os.PathLike[str]) -> None:
    """Write a network to one file, of the form that the end of its name says.

    Parameters
    ----------
    network : Network
    path : path-like
        The file: a name that ends in ``.safetensors`` gives that form, any other an ``.npz``. One
        that exists is replaced once the new one is complete.

    Raises
    ------
    OutputError
        If the file cannot be written there; what was there before stays.

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
    """`SAFETENSORS` where the name ends so, else `NPZ`."""
    return SAFETENSORS if os.fspath(path).lower().endswith(SAFETENSORS) else NPZ


def packed(network: Network, form: str = NPZ) -> bytes:
    """The content of the file that `save` writes.

    Parameters
    ----------
    network : Network
    form : str
        `NPZ` or `SAFETENSORS`.

    Raises
    ------
    OutputError
        If a name is not printable, or there are more names than a file may have.
    """
    manifest, arrays = written(network)
    if form == SAFETENSORS:
        return packed_tensors(manifest, arrays)
    return packed_entries({"manifest": manifest}, arrays)


def written(network: Network) -> tuple[str, dict[str, object]]:
    """The manifest of a network, as text, and its arrays by name.

    Parameters
    ----------
    network : Network

    Raises
    ------
    OutputError
        If the manifest is larger than what is read again.
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
            f"{MAX_MANIFEST}; give it shorter names or fewer pinned and absent neurons"
        )
    return text, arrays


@checked
def load(path: str | os.PathLike[str]) -> Network:
    """Read a network that `save` wrote; it runs exactly as the saved one.

    Parameters
    ----------
    path : path-like
        One that ends in ``.safetensors`` is read as that, any other as an ``.npz``.

    Returns
    -------
    Network

    Raises
    ------
    FileFormatError
        If the file is not one that `save` wrote, or was changed since; the message names the file
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
    remedy = "give the path of a saved network (.npz or .safetensors)"
    return unpacked(read_whole(file, MAX_BYTES, remedy), file)


def unpacked(content: bytes, file: Path) -> Network:
    """The network that a file's content describes.

    Parameters
    ----------
    content : bytes
    file : Path
        Where it is from: the end of its name says the form; errors begin with it.

    Raises
    ------
    FileFormatError
        If it is not what `packed` gives.
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
            f"{file}: asks for more memory than there is; save the network again"
        ) from error
