"""What makes a network this one: a hash of its wiring, and one of its wiring and all numbers.

Weights fit every network of the same wiring, and no other. The hashes are of plain JSON and of
float64 numbers in the order of their names, so that any program can form them. A file has both, and
a third of all that its manifest says, words and title too.
"""

from __future__ import annotations

import hashlib
import json
import operator
from collections.abc import Mapping

import numpy as np

from ann_dc.errors import FileFormatError
from ann_dc.network.network import Network
from ann_dc.validation.checked import checked
from ann_dc.weights.manifest import Table
from ann_dc.weights.writing import STIFFNESSES, arrays_of, manifest_of

WORDS = ("schema", "title", "about", "tensors", "hashes")
"""What a manifest says that no wire depends on."""
FRAME = ("rails", "unit", "zero", "input_scale", *STIFFNESSES)
"""Arrays that no gain and no weight is in, by the first part of their names."""


@checked
def wiring_hash(network: Network) -> str:
    """SHA-256 of names and wires, without numbers and without the title.

    Parameters
    ----------
    network : Network

    Returns
    -------
    str
        64 hexadecimal digits.

    Examples
    --------
    >>> import ann_dc
    >>> one, other = (
    ...     ann_dc.synthesize(ann_dc.plants.car(D=wheelbase)) for wheelbase in (0.5, 1.0)
    ... )
    >>> wiring_hash(one) == wiring_hash(other), content_hash(one) == content_hash(other)
    (True, False)
    """
    return hashlib.sha256(_wiring(manifest_of(network))).hexdigest()


@checked
def content_hash(network: Network) -> str:
    """SHA-256 of names, wires, and every number; of all but the title.

    Parameters
    ----------
    network : Network

    Returns
    -------
    str
        64 hexadecimal digits.
    """
    return hash_of(manifest_of(network), arrays_of(network))


@checked
def frame_hash(network: Network) -> str:
    """SHA-256 of wires, rails, units and stiffness: of all that gains and weights are set into.

    Parameters
    ----------
    network : Network

    Returns
    -------
    str
        64 hexadecimal digits.
    """
    frame = {n: v for n, v in arrays_of(network).items() if n.partition("/")[0] in FRAME}
    return hash_of(manifest_of(network), frame)


def hash_of(manifest: Mapping, arrays: Mapping[str, object]) -> str:
    """The content hash of a manifest and the arrays beside it.

    Parameters
    ----------
    manifest : mapping
        As `manifest_of` gives it.
    arrays : mapping of entry name to array

    Returns
    -------
    str
    """
    found = hashlib.sha256(_wiring(manifest))
    for name in sorted(arrays):
        values = np.array(arrays[name], "<f8", order="C")
        found.update(json.dumps([name, values.shape]).encode())
        found.update(values.tobytes())
    return found.hexdigest()


def hashes_of(manifest: Mapping, arrays: Mapping[str, object]) -> dict[str, str]:
    """The three hashes of a manifest and the arrays beside it, by name.

    Parameters
    ----------
    manifest : mapping
    arrays : mapping of entry name to array

    Returns
    -------
    dict
    """
    return {
        "wiring": hashlib.sha256(_wiring(manifest)).hexdigest(),
        "content": hash_of(manifest, arrays),
        "manifest": hashlib.sha256(_without(manifest, ("hashes",))).hexdigest(),
    }


def check_hashes(table: Table, arrays: Mapping[str, object]) -> None:
    """Refuse a manifest whose hashes are not those of itself and of the arrays beside it.

    Parameters
    ----------
    table : Table
    arrays : mapping of entry name to array

    Raises
    ------
    FileFormatError
        Naming the hash, or the arrays that it does not tell of.
    """
    told = table.get("tensors", dict)
    if told.keys() != arrays.keys():
        odd = ", ".join(sorted(told.keys() ^ arrays.keys()))
        raise FileFormatError(f"manifest.tensors: the file and its manifest differ in {odd:.300}")
    given = Table("manifest.hashes", table.get("hashes", dict))
    hashes = hashes_of(table.given, arrays)
    given.only(" ".join(hashes))
    for name, found in hashes.items():
        if given.get(name, str) != found:
            raise FileFormatError(
                f"manifest.hashes.{name}: the file was changed after it was saved; save the "
                "network again"
            )


def _wiring(manifest: Mapping) -> bytes:
    return _without(manifest, WORDS)


def _without(manifest: Mapping, keys: tuple[str, ...]) -> bytes:
    """JSON with sorted keys, without some of them."""
    plain = {key: value for key, value in manifest.items() if key not in keys}
    return json.dumps(plain, sort_keys=True, default=operator.index).encode()
