"""Identity of a network: hashes of its wiring, its numbers and its manifest.

Weights fit every network with the same wiring and no other network. The hashes are computed from
plain JSON and from float64 numbers in the order of their names, so that any program can compute
them.
"""

from __future__ import annotations

import hashlib
import json
import operator
from collections.abc import Mapping

import numpy as np

from ann_dc.errors import FileFormatError
from ann_dc.network.network import Network
from ann_dc.validation import checked
from ann_dc.weights.manifest import Table
from ann_dc.weights.writing import arrays_of, manifest_of

WORDS = ("schema", "title", "about", "tensors", "hashes")
"""Manifest entries that do not depend on the wiring."""
NUMBERS = ("waveforms",)
"""Manifest entries that describe numbers; the wiring does not depend on them either."""
FRAME = ("limits", "scale_factor", "scale_offset", "input_scale", "stiffness")
"""Arrays without gains and weights, by the first part of their names."""


@checked
def wiring_hash(network: Network) -> str:
    """Compute the SHA-256 of names and connections, without numbers and title, in hexadecimal."""
    return _wiring(manifest_of(network))


@checked
def content_hash(network: Network) -> str:
    """Compute the SHA-256 of names, connections and all numbers, without the title."""
    return hash_of(manifest_of(network), arrays_of(network))


@checked
def frame_hash(network: Network) -> str:
    """Compute the SHA-256 of connections, saturation limits, units and stiffness.

    These are the parts of a network into which gains and weights are set.
    """
    frame = {n: v for n, v in arrays_of(network).items() if n.partition("/")[0] in FRAME}
    manifest = manifest_of(network)
    return hash_of({n: v for n, v in manifest.items() if n not in NUMBERS}, frame)


def hash_of(manifest: Mapping, arrays: Mapping[str, object]) -> str:
    """Compute the content hash of a manifest (see `manifest_of`) and its arrays."""
    found = hashlib.sha256(_without(manifest, WORDS))
    for name in sorted(arrays):
        values = np.array(arrays[name], "<f8", order="C")
        found.update(json.dumps([name, values.shape]).encode())
        found.update(values.tobytes())
    return found.hexdigest()


def hashes_of(manifest: Mapping, arrays: Mapping[str, object]) -> dict[str, str]:
    """Compute the three hashes of a manifest and its arrays, by name."""
    return {
        "wiring": _wiring(manifest),
        "content": hash_of(manifest, arrays),
        "manifest": hashlib.sha256(_without(manifest, ("hashes",))).hexdigest(),
    }


def check_hashes(table: Table, arrays: Mapping[str, object]) -> None:
    """Raise `FileFormatError` if a manifest or its arrays differ from the hashes in it."""
    reported = table.get("tensors", dict)
    if reported.keys() != arrays.keys():
        odd = ", ".join(sorted(reported.keys() ^ arrays.keys()))
        raise FileFormatError(f"manifest.tensors: the file and its manifest differ in {odd:.300}")
    given = table.inner("hashes")
    hashes = hashes_of(table.given, arrays)
    given.only(" ".join(hashes))
    for name, found in hashes.items():
        if given.get(name, str) != found:
            raise FileFormatError(
                f"manifest.hashes.{name}: the file was changed after it was saved; save the "
                "network again"
            )


def _wiring(manifest: Mapping) -> str:
    return hashlib.sha256(_without(manifest, (*WORDS, *NUMBERS))).hexdigest()


def _without(manifest: Mapping, keys: tuple[str, ...]) -> bytes:
    """Return JSON with sorted keys, without the given keys."""
    plain = {key: value for key, value in manifest.items() if key not in keys}
    return json.dumps(plain, sort_keys=True, default=operator.index).encode()
