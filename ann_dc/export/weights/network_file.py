"""A network as a file: every number in a named array, every name in a manifest.

The file is an ``.npz`` (read it with ``numpy.load(path, allow_pickle=False)``). Its entries:

=====================  ==========================================================
``manifest``           uint8, the UTF-8 text of a JSON table: names and wiring, no numbers
``tau/mu.x``           () or (N,) time constant of a neuron
``weight/m.x<-c.x``    () or (N,) weight of a connection, by its name
``input/q_d.x``        (N,) value of an input
``start/q.x``          (N,) initial states
``rails``, ``unit``    (P, 2) limiters and (P,) units of the P neurons
``gain/0``             (points, C, C) coordinators of a level, finest first
``grid/own``           (N, m, m) stiffness within each cell, over its m primal neurons; ``tree/own``
``grid/following``     (N - 1, m, m) and between a cell and the next; ``tree/following``
=====================  ==========================================================

Equal networks give equal bytes, and nothing in a file is ever executed.
"""

from __future__ import annotations

import io
import json
import operator
import os
import zipfile
from pathlib import Path

from ann_dc.errors import FileFormatError, NetworkError, UnknownNameError
from ann_dc.export.weights.npz import BROKEN, Entries, packed_entries
from ann_dc.export.weights.reading import network_of
from ann_dc.export.weights.writing import arrays_of, manifest_of
from ann_dc.hints.checked import checked
from ann_dc.network.network import Network
from ann_dc.whole_files.files import read_whole, write_whole

MAX_BYTES = 2_000_000_000
"""Largest file in bytes; a row of `MAX_STAGES` stays far below it."""


@checked
def save(network: Network, path: str | os.PathLike[str]) -> None:
    """Write a network to one ``.npz`` file.

    Parameters
    ----------
    network : Network
    path : path-like
        The file; one that exists is replaced once the new one is complete.

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
    write_whole(path, packed(network))


def packed(network: Network) -> bytes:
    """The content of the file that `save` writes.

    Parameters
    ----------
    network : Network

    Raises
    ------
    OutputError
        If a name is not printable.
    """
    manifest = json.dumps(manifest_of(network), indent=1, default=operator.index)
    return packed_entries({"manifest": manifest}, arrays_of(network))


@checked
def load(path: str | os.PathLike[str]) -> Network:
    """Read a network that `save` wrote; it runs exactly as the saved one.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    Network

    Raises
    ------
    FileFormatError
        If the file is not one that `save` wrote; the message names the file and the entry.

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
    return unpacked(read_whole(file, MAX_BYTES, "give the path of a saved network (.npz)"), file)


def unpacked(content: bytes, file: Path) -> Network:
    """The network that a file's content describes.

    Parameters
    ----------
    content : bytes
    file : Path
        Where it is from; errors begin with it.

    Raises
    ------
    FileFormatError
        If it is not what `packed` gives.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return network_of(Entries(archive, len(content)))
    except (FileFormatError, NetworkError, UnknownNameError) as error:
        raise FileFormatError(f"{file}: {error}") from error
    except BROKEN as error:
        raise FileFormatError(
            f"{file}: not a complete .npz file ({error}); save the network again"
        ) from error
