"""What makes a network this one: a hash of its wiring, and one of its wiring and all numbers.

Weights fit every network of the same wiring, and no other. The hashes are of plain JSON and of
float64 numbers in the order of their names, so that any program can form them.
"""

from __future__ import annotations

import hashlib
import json
import operator
from collections.abc import Mapping

import numpy as np

from ann_dc.export.weights.writing import arrays_of, manifest_of
from ann_dc.hints.checked import checked
from ann_dc.network.network import Network

WORDS = ("title",)
"""What a manifest says that no wire depends on."""


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


def _wiring(manifest: Mapping) -> bytes:
    plain = {key: value for key, value in manifest.items() if key not in WORDS}
    return json.dumps(plain, sort_keys=True, default=operator.index).encode()
