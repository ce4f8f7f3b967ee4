"""Metadata of an ONNX file: network, units, and a digest of the complete file.

The digest is computed from the content of the file. A changed bit is therefore detected without the
network from which the file was written.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any

from ann_dc.network.network import Network
from ann_dc.weights.hashes import content_hash, wiring_hash

DIGEST = "digest"
LAYOUT = (
    "states (neurons, stages, samples), inputs (inputs, stages, samples), in network units; a "
    "user's value is offset + factor * the network's; step is in units of network time"
)


def describe(model: Any, network: Network) -> None:
    """Write title, hashes, names, units and digest into a model's metadata."""
    from onnx import helper

    neurons = [(neuron.name, neuron.scale) for neuron in network.cell.neurons]
    inputs = [(name, network.input_scale(name)) for name in network.cell.inputs]
    said = {
        "title": network.title,
        "wiring": wiring_hash(network),
        "content": content_hash(network),
        "layout": LAYOUT,
        "neurons": _scales(neurons),
        "inputs": _scales(inputs),
    }
    helper.set_model_props(model, said)
    helper.set_model_props(model, said | {DIGEST: digest(model)})


def _scales(named: list) -> str:
    rows = [{"name": name, "factor": s.factor, "offset": s.offset} for name, s in named]
    return json.dumps(rows)


def digest(model: Any) -> str:
    """Compute the SHA-256 of a model without its digest."""
    plain = type(model)()
    plain.CopyFrom(model)
    kept = [entry for entry in model.metadata_props if entry.key != DIGEST]
    del plain.metadata_props[:]
    plain.metadata_props.extend(kept)
    return hashlib.sha256(plain.SerializeToString(deterministic=True)).hexdigest()


def metadata(model: Any) -> dict[str, str]:
    """Return the metadata of a model, by key."""
    return {entry.key: entry.value for entry in model.metadata_props}
