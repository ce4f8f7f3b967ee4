"""A network as two ONNX models, written from its record and not traced."""

from __future__ import annotations

import importlib.util

from ann_dc.errors import ExportPackageMissing
from ann_dc.export.onnx.metadata import describe
from ann_dc.export.onnx.models import settle_model, step_model
from ann_dc.export.reference.rounding import Precision
from ann_dc.export.reference.sidecar import check_vector
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.network.network import Network
from ann_dc.validation.checked import checked

STEP, SETTLE = "step.onnx", "settle.onnx"


@checked
def onnx_files(
    network: Network,
    vector: ReferenceVector,
    *,
    precision: Precision = "float64",
) -> dict[str, bytes]:
    """A network as ONNX: one step, and the loop to settling.

    With P neurons, N stages, I inputs and any number B of samples:

    ``step.onnx``
        states (P, N, B), inputs (I, N, B), step () to next_states (P, N, B), residual (B,) of the
        states that were given.
    ``settle.onnx``
        states, inputs, step, tolerance (), limit () to settled_states (P, N, B), residual (B,),
        steps (B,). Every sample stops where its residual is first below the tolerance, where it
        leaves the domain of a function or diverges (its residual is infinite then), or after
        ``limit`` steps, an int64.

    A network without inputs has none. Inputs may be (I, N, 1), the same for all samples. Numbers
    are in network units; the metadata of the files has factor and offset of every neuron and input,
    the title, and the hashes of wiring and content. What a state says of pinned and absent neurons
    is not read. Weights, time constants, rails and gains are initializers with the names of the
    network. Every wiring and every kind of metric can be carried.

    Parameters
    ----------
    network : Network
    vector : ReferenceVector
        Of this network; it goes along.
    precision : str
        ``"float64"`` or ``"float32"``, of all numbers but counts.

    Returns
    -------
    dict of str to bytes
        ``step.onnx``, ``settle.onnx``, ``reference_vector.json``.

    Raises
    ------
    ExportError
        If the vector is another network's, or a number is too large for float32.
    ExportPackageMissing
        If the package onnx is not installed.

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
    """Refuse to go on where a package is not installed.

    Raises
    ------
    ExportPackageMissing
        With the line that installs it.
    """
    for package in packages:
        if importlib.util.find_spec(package) is None:
            raise ExportPackageMissing(
                f"ONNX files need {package}, which is not installed: pip install 'ann-dc[export]'"
            )
