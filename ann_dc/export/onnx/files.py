"""ONNX export of a network as two models, written from its record without tracing.

The metadata of a file contain the network, its units, and a digest of the complete file, by which a
changed bit is detected without the network.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
from typing import Any

from ann_dc.errors import ExportPackageMissing
from ann_dc.export.onnx.models import settle_model, step_model
from ann_dc.export.reference.sidecar import check_vector
from ann_dc.export.reference.vector import VECTOR, Precision, ReferenceVector
from ann_dc.network.network import Network
from ann_dc.validation import checked
from ann_dc.weights.hashes import content_hash, wiring_hash

STEP, SETTLE = "step.onnx", "settle.onnx"


@checked
def onnx_files(
    network: Network, vector: ReferenceVector, *, precision: Precision = "float64"
) -> dict[str, bytes]:
    """Export a network as ONNX: one step, and the loop to settling.

    With P neurons, N stages, I inputs and any number B of samples:

    ``step.onnx``
        Maps states (P, N, B), inputs (I, N, B), step () to next_states (P, N, B) and residual (B,).
        The residual is that of the given states.
    ``settle.onnx``
        Maps states, inputs, step, tolerance (), limit () to settled_states (P, N, B), residual
        (B,), steps (B,). A sample stops when its residual is below the tolerance, or after
        ``limit`` steps, an int64. It also stops with an infinite residual when it leaves the domain
        of a function or diverges.

    A network without inputs has no such tensor. Inputs may be (I, N, 1), equal for all samples.
    Numbers are in network units. The metadata of the files contain factor and offset of every
    neuron and input, the title, and the hashes of wiring and content. State entries of fixed and
    omitted neurons are not read. Weights, time constants, saturation limits and gains are
    initializers with the names of the network. Every wiring and every preconditioner kind is
    supported.

    The ``precision`` of all numbers except counts is ``"float64"`` or ``"float32"``. The files are
    ``step.onnx``, ``settle.onnx`` and ``reference_vector.json``. Raises `ExportError` if the vector
    belongs to another network or a number is too large for float32, and `ExportPackageMissing` if
    the package onnx is not installed.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> sorted(onnx_files(network, reference_vector(network)))
    ['reference_vector.json', 'settle.onnx', 'step.onnx']

    References
    ----------
    ONNX operator set 18. Paper equations (16), (17), corrected.
    """
    require("onnx")
    check_vector(network, vector)
    files = {}
    for name, written in ((STEP, step_model), (SETTLE, settle_model)):
        model = written(network, precision)
        _describe(model, network)
        files[name] = model.SerializeToString(deterministic=True)
    return files | {VECTOR: vector.as_json()}


def require(*packages: str) -> None:
    """Raise `ExportPackageMissing` with the install command if a package is missing."""
    for package in packages:
        if importlib.util.find_spec(package) is None:
            raise ExportPackageMissing(
                f"ONNX files need {package}, which is not installed: pip install 'ann-dc[export]'"
            )


DIGEST = "digest"
LAYOUT = (
    "states (neurons, stages, samples), inputs (inputs, stages, samples), in network units; a "
    "user's value is offset + factor * the network's; step is in units of network time"
)


def _describe(model: Any, network: Network) -> None:
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
