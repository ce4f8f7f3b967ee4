"""Comparison of ONNX files with their test vector by execution in onnxruntime."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ann_dc.errors import FileFormatError
from ann_dc.export.onnx.files import SETTLE, STEP, require
from ann_dc.export.onnx.reading import names_of_inputs, read_model, read_vector, refused
from ann_dc.export.reference.rounding import Precision, compare
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.validation import checked

END = {"float64": 1e-6, "float32": 1e-3}
"""Tolerance of the settled states."""
PRECISIONS: dict[str, Precision] = {"tensor(double)": "float64", "tensor(float)": "float32"}
"""Precision, by onnxruntime's name of the type of the states."""
PATIENCE = 3
"""Maximum number of steps to settle, relative to the vector; rounding may cause a detour."""


@checked
def onnx_check(files: Mapping[str, bytes]) -> str:
    """Run ONNX files and compare them with their test vector.

    The reader is strict: only the operations of `onnx_files`, no external data, and a digest of the
    complete file. The package onnx then checks the files, and onnxruntime parses and runs them; its
    behaviour is outside the control of this package.

    The files are ``step.onnx``, ``settle.onnx`` and ``reference_vector.json``; other files are
    ignored. Returns the result as a sentence. Raises `FileFormatError` if a file is missing,
    invalid, changed, or computes different values, and `ExportPackageMissing` if onnx or
    onnxruntime is not installed.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.onnx import onnx_files
    >>> from ann_dc.export.reference import reference_vector
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> print(onnx_check(onnx_files(network, reference_vector(network))))  # doctest: +ELLIPSIS
    50 steps in onnxruntime (float64) within ... of the reference vector, settled after ...
    """
    require("onnx", "onnxruntime")
    vector = read_vector(files)
    step, settle = (_Session(name, files, vector) for name in (STEP, SETTLE))
    if step.precision != settle.precision:
        raise FileFormatError(f"{STEP}, {SETTLE}: of two precisions; export them together")

    def walked(states: np.ndarray, count: int) -> np.ndarray:
        states = states[..., None]
        for _ in range(count):
            states = step.run(states)[0]
        return states[..., 0]

    def looped(states: np.ndarray, count: int) -> np.ndarray:
        return settle.run(states[..., None], tolerance=0.0, limit=count)[0][..., 0]

    worst = max(compare(vector, walk, settle.precision) for walk in (walked, looped))
    return (
        f"{max(vector.early)} steps in onnxruntime ({step.precision}) within {worst:.1e} of the "
        f"reference vector, {_settled(settle, vector)}"
    )


def _settled(settle: _Session, vector: ReferenceVector) -> str:
    """Compare the result of the loop with the end of the vector.

    In float32 a residual may remain above the tolerance for any number of steps.
    """
    if not vector.settles:
        return "which never settles"
    states, residuals, counts = settle.run(
        vector.start[..., None], tolerance=vector.tolerance, limit=PATIENCE * vector.steps
    )
    residual, count = float(residuals[0]), int(counts[0])
    if settle.precision == "float64" and not residual < vector.tolerance:
        raise FileFormatError(
            f"{SETTLE}: has a residual of {residual:.1e} after {count} steps, the reference vector "
            f"settled after {vector.steps}; export it again"
        )
    apart = np.abs(states[..., 0] - vector.end).max() / max(1.0, np.abs(vector.end).max())
    if not apart <= END[settle.precision]:
        raise FileFormatError(
            f"{SETTLE}: settles {apart:.1e} of the largest state beside the reference vector, "
            f"{END[settle.precision]:g} is allowed; export it again"
        )
    return (
        f"settled after {count} steps, the vector after {vector.steps}, its end within {apart:.1e}"
    )


class _Session:
    """Model in onnxruntime, with the vector's inputs for every sample."""

    def __init__(self, name: str, files: Mapping[str, bytes], vector: ReferenceVector) -> None:
        import onnxruntime

        self.name = name
        model = read_model(files, name, vector)
        names = names_of_inputs(model, vector)
        options = onnxruntime.SessionOptions()
        options.log_severity_level = 4
        options.intra_op_num_threads = 1
        with refused(name):
            self._session = onnxruntime.InferenceSession(
                files[name], options, providers=["CPUExecutionProvider"]
            )
        kind = self._session.get_inputs()[0].type
        if kind not in PRECISIONS:
            raise FileFormatError(f"{name}: states of the type {kind}")
        self.precision: Precision = PRECISIONS[kind]
        self._given: dict[str, Any] = {"step": self._number(vector.step)}
        if names:
            rows = np.array([vector.inputs[name] for name in names])
            self._given["inputs"] = self._number(rows[:, :, None])

    def _number(self, value: Any) -> np.ndarray:
        return np.array(value, self.precision)

    def run(
        self, states: np.ndarray, *, tolerance: float | None = None, limit: int = 0
    ) -> list[np.ndarray]:
        """Return the outputs of the model for states (P, N, B)."""
        given = self._given | {"states": self._number(states)}
        if tolerance is not None:
            given |= {"tolerance": self._number(tolerance), "limit": np.array(limit)}
        with refused(self.name):
            found = [np.asarray(part) for part in self._session.run(None, given)]
        samples = states.shape[-1:]
        if found[0].shape != states.shape or any(part.shape != samples for part in found[1:]):
            raise FileFormatError(f"{self.name}: gives tensors of other shapes than it is given")
        return found
