"""ONNX export of a network as two models, written from its record without tracing."""

from __future__ import annotations

import importlib.util

from ann_dc.errors import ExportPackageMissing
from ann_dc.export.onnx.metadata import describe
from ann_dc.export.onnx.models import settle_model, step_model
from ann_dc.export.reference.rounding import Precision
from ann_dc.export.reference.sidecar import check_vector
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.network.network import Network
from ann_dc.validation import checked

STEP, SETTLE = "step.onnx", "settle.onnx"


@checked
def onnx_files(
    network: Network,
    vector: ReferenceVector,
    *,
    precision: Precision = "float64",
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
        describe(model, network)
        files[name] = model.SerializeToString(deterministic=True)
    return files | {VECTOR: vector.as_json()}


def require(*packages: str) -> None:
    """Raise `ExportPackageMissing` with the install command if a package is missing."""
    for package in packages:
        if importlib.util.find_spec(package) is None:
            raise ExportPackageMissing(
                f"ONNX files need {package}, which is not installed: pip install 'ann-dc[export]'"
            )
