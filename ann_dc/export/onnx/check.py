"""Strict reading of ONNX files, and their comparison with a test vector in onnxruntime.

A file is rejected if it is too large, is not an ONNX model, or does not match its digest. It is
also rejected for external data, for operations that a network does not need, and for tensors or
loops that are not bounded by the test vector.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from ann_dc.errors import AnnDcError, FileFormatError
from ann_dc.evaluation.rules import BLOCKS, PIVOTS
from ann_dc.export.onnx.files import DIGEST, SETTLE, STEP, digest, metadata, require
from ann_dc.export.onnx.graph import OPSET
from ann_dc.export.reference.contents import file_of
from ann_dc.export.reference.vector import VECTOR, Precision, ReferenceVector, compare
from ann_dc.validation import checked

MOST_BYTES = 2**28
"""Largest file size in bytes; ten thousand stages with a resistive grid need about 2**25."""
REACH = 8
"""Largest number in a shape or an index, relative to the number of neurons of the cell array."""
GIVEN = {
    STEP: ("states", "inputs", "step"),
    SETTLE: ("states", "inputs", "step", "tolerance", "limit"),
}
FOUND = {STEP: ("next_states", "residual"), SETTLE: ("settled_states", "residual", "steps")}
OPERATIONS = {
    "Abs", "Acos", "Add", "And", "Asin", "Atan", "Cast", "Concat", "Cos", "Cosh", "Div", "Equal",
    "Exp", "Expand", "Gather", "Greater", "GreaterOrEqual", "Identity", "Less", "LessOrEqual",
    "Log", "Loop", "MatMul", "Max", "Min", "Mul", "Neg", "Or", "Reciprocal", "ReduceMax",
    "ReduceMin", "ReduceSum", "Reshape", "Shape", "Sin", "Sinh", "Slice", "Sqrt", "Sub", "Tan",
    "Tanh", "Unsqueeze", "Where", "Xor",
}  # fmt: skip
"""Operations that exported networks use; others are rejected."""

SAMPLES = 2
"""Maximum number of samples in one run of a check."""
GROWTH = 8
"""Maximum size of a tensor relative to the states, inputs and the largest table together."""
END = {"float64": 1e-6, "float32": 1e-3}
"""Tolerance of the settled states."""
PRECISIONS: dict[str, Precision] = {"tensor(double)": "float64", "tensor(float)": "float32"}
"""Precision, by onnxruntime's name of the type of the states."""
PATIENCE = 3
"""Maximum number of steps to settle, relative to the vector; rounding may cause a detour."""


@contextmanager
def _refused(name: str) -> Iterator[None]:
    """Convert exceptions of a package that reads or runs a file to `FileFormatError`."""
    try:
        yield
    except AnnDcError:
        raise
    except Exception as error:  # protobuf, onnx and onnxruntime have no base in common
        said = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise FileFormatError(f"{name}: {said:.200}") from error


def _read_model(files: Mapping[str, bytes], name: str, vector: ReferenceVector) -> Any:
    """Read and check a model of the vector's network without running it."""
    import onnx

    content = _content(files, name)
    with _refused(name):
        model = onnx.load_model_from_string(content)
        said = metadata(model)
    if said.get(DIGEST) != digest(model):
        raise FileFormatError(
            f"{name}: its content differs from its digest; export the network again"
        )
    if said.get("content") != vector.content:
        raise FileFormatError(f"{name}: {VECTOR} is of another network")
    if model.functions or model.training_info:
        raise FileFormatError(f"{name}: expected a graph only, got functions or training data")
    _check_graph(name, model.graph)
    _check_tensors(name, model.graph, vector)
    with _refused(name):
        onnx.checker.check_model(model, full_check=True)
        _check_sizes(name, model.graph, vector)
    return model


def _names_of_inputs(model: Any, vector: ReferenceVector) -> list[str]:
    """Return the inputs in the order of the rows of a model's tensor."""
    with _refused("metadata"):
        names = [str(row["name"]) for row in json.loads(metadata(model)["inputs"])]
    if len(names) != len(vector.inputs) or set(names) != set(vector.inputs):
        raise FileFormatError("metadata: its inputs are not those of the reference vector")
    return names


def _content(files: Mapping[str, bytes], name: str) -> bytes:
    content = file_of(files, name)
    if len(content) > MOST_BYTES:
        raise FileFormatError(f"{name}: larger than {MOST_BYTES} bytes")
    return content


def _check_graph(name: str, graph: Any, depth: int = 0) -> None:
    """Check that a graph has only known operations and no external data."""
    from onnx import TensorProto

    for node in graph.node:
        if node.op_type not in OPERATIONS or node.domain not in ("", "ai.onnx"):
            raise FileFormatError(
                f"{name}: the operation {node.op_type!r:.40} is not used by exports"
            )
        for attribute in node.attribute:
            _check_attribute(name, node.op_type, attribute, depth)
    if graph.sparse_initializer:
        raise FileFormatError(f"{name}: has sparse numbers")
    for table in graph.initializer:
        if table.external_data or table.data_location == TensorProto.EXTERNAL:
            raise FileFormatError(f"{name}: {table.name!r:.40} stores its numbers in another file")


def _check_attribute(name: str, kind: str, attribute: Any, depth: int) -> None:
    """Check an attribute: numbers, types, or a loop body at most two loops deep."""
    if attribute.HasField("t") or attribute.tensors or attribute.graphs:
        raise FileFormatError(f"{name}: {kind} has local tensors")
    if attribute.HasField("g"):
        if kind != "Loop" or depth > 1:
            raise FileFormatError(f"{name}: a graph in {kind}")
        _check_graph(name, attribute.g, depth + 1)


def _check_tensors(name: str, graph: Any, vector: ReferenceVector) -> None:
    """Check the input and output tensors of a model, and its indices and shapes."""
    from onnx import TensorProto, numpy_helper

    wanted = [tensor for tensor in GIVEN[name] if tensor != "inputs" or vector.inputs]
    if [tensor.name for tensor in graph.input] != wanted:
        raise FileFormatError(f"{name}: expected the inputs {', '.join(wanted)}")
    if tuple(tensor.name for tensor in graph.output) != FOUND[name]:
        raise FileFormatError(f"{name}: expected the outputs {', '.join(FOUND[name])}")
    sizes = [size.dim_value for size in graph.input[0].type.tensor_type.shape.dim]
    if sizes[:2] != list(vector.start.shape) or len(sizes) != 3:
        raise FileFormatError(f"{name}: expected states {vector.start.shape} a sample")
    most = REACH * (vector.start.size + 8)
    turns = {loop.input[0] for _, loop in _loops_in(name, graph) if loop.input}
    for table in graph.initializer:
        if table.data_type != TensorProto.INT64 or table.name in turns:  # see `_check_turns`
            continue
        with _refused(name):
            values = numpy_helper.to_array(table)
        if not (np.abs(values) <= most).all():
            raise FileFormatError(f"{name}: {table.name!r:.40} reaches beyond the states")


def _check_sizes(name: str, graph: Any, vector: ReferenceVector) -> None:
    """Raise `FileFormatError` for a large or unknown tensor size, or an endless loop.

    The package onnx infers the shapes from the states and inputs of the vector. The body of a loop
    is treated as one turn, which must preserve the shapes of its inputs.
    """
    loops = list(_loops_in(name, graph))
    tables = {table.name: table for table in graph.initializer}
    for around, loop in loops:
        _check_turns(name, around, loop, tables, BLOCKS * vector.start.size + PIVOTS)
    shapes = _shapes(name, graph, vector)
    largest = max((math.prod(table.dims) for table in graph.initializer), default=0)
    given = SAMPLES * (vector.start.size + sum(map(len, vector.inputs.values())))
    most = GROWTH * (given + largest)
    for tensor, shape in shapes.items():
        if shape is None or math.prod(shape) > most:
            raise FileFormatError(f"{name}: {tensor!r:.60} is large, or of unknown size")
    for _, loop in loops:
        body = _body(loop)
        for before, after in zip(loop.input[2:], body.output[1:]):
            if shapes[before] != shapes[after.name]:
                raise FileFormatError(f"{name}: {after.name!r:.60} grows with the iterations")


def _loops_in(name: str, graph: Any) -> Iterator[tuple[Any, Any]]:
    """Yield a graph and its loop, then those of the loop's body."""
    loops = [node for node in graph.node if node.op_type == "Loop"]
    if len(loops) > 1:
        raise FileFormatError(f"{name}: has more than one loop")
    for loop in loops:
        yield graph, loop
        yield from _loops_in(name, _body(loop))


def _check_turns(name: str, around: Any, loop: Any, tables: Mapping[str, Any], most: int) -> None:
    """Check that a loop has ``limit`` plus one turns, or the number in a table up to ``most``."""
    from onnx import numpy_helper

    reported = loop.input[0] if loop.input else ""
    if reported in tables:
        turns = numpy_helper.to_array(tables[reported])
        if turns.ndim == 0 and turns <= most:
            return
    sums = [node for node in around.node if reported in node.output]
    bounded = len(sums) == 1 and sums[0].op_type == "Add" and "limit" in sums[0].input
    if not bounded or not set(sums[0].input) <= {"limit", *tables}:
        raise FileFormatError(f"{name}: its loop has no limit")


def _body(loop: Any) -> Any:
    return next(attribute.g for attribute in loop.attribute if attribute.HasField("g"))


def _shapes(name: str, graph: Any, vector: ReferenceVector) -> dict[str, tuple[int, ...] | None]:
    """Return the shape of every tensor, or None if it is unknown."""
    from onnx import helper, shape_inference

    flat = type(graph)()
    flat.CopyFrom(graph)
    del flat.node[:], flat.value_info[:], flat.output[:]
    flat.node.extend(_unrolled(graph, flat))
    sizes = {"states": (*vector.start.shape, SAMPLES)}
    sizes["inputs"] = (len(vector.inputs), vector.start.shape[1], 1)
    for tensor in flat.input:
        del tensor.type.tensor_type.shape.dim[:]
        for length in sizes.get(tensor.name, ()):
            tensor.type.tensor_type.shape.dim.add().dim_value = length
    model = helper.make_model(flat, opset_imports=[helper.make_opsetid("", OPSET)])
    try:
        found = shape_inference.infer_shapes(model, strict_mode=True, data_prop=True).graph
    except Exception as error:
        raise FileFormatError(f"{name}: its shapes do not fit: {error!s:.200}") from error
    known = {tensor.name: _shape(tensor) for tensor in (*found.input, *found.value_info)}
    known |= {table.name: tuple(table.dims) for table in found.initializer}
    return known | {out: known.get(out) for node in flat.node for out in node.output}


def _unrolled(graph: Any, flat: Any) -> Iterator[Any]:
    """Yield the nodes of a graph, with one turn of every loop in its place."""
    from onnx import TensorProto, helper

    for node in graph.node:
        if node.op_type != "Loop":
            yield node
            continue
        body = _body(node)
        kinds = (TensorProto.INT64, TensorProto.BOOL)
        flat.input.extend(
            helper.make_tensor_value_info(own.name, kind, [])
            for own, kind in zip(body.input, kinds)
        )
        flat.initializer.extend(body.initializer)
        for carried, own in zip(node.input[2:], body.input[2:]):
            yield helper.make_node("Identity", [carried], [own.name])
        yield from _unrolled(body, flat)
        for own, ended in zip(body.output[1:], node.output):
            yield helper.make_node("Identity", [own.name], [ended])


def _shape(tensor: Any) -> tuple[int, ...] | None:
    kind = tensor.type.tensor_type
    if not kind.HasField("shape") or not all(size.HasField("dim_value") for size in kind.shape.dim):
        return None
    return tuple(size.dim_value for size in kind.shape.dim)


@checked
def onnx_check(files: Mapping[str, bytes]) -> str:
    """Run ONNX files and compare them with their test vector.

    The reader is strict: only the operations of `onnx_files`, no external data, and a digest of the
    complete file. The package onnx then checks the files, and onnxruntime parses and runs them; its
    behaviour is outside the control of this package.

    Returns the result as a sentence. Raises `FileFormatError` if a file is missing, invalid,
    changed, or computes different values.
    """
    require("onnx", "onnxruntime")
    vector = ReferenceVector.from_json(_content(files, VECTOR))
    step, settle = (_Session(name, files, vector) for name in (STEP, SETTLE))
    if step.precision != settle.precision:
        raise FileFormatError(f"{STEP}, {SETTLE}: the precisions differ; export both together")

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
        return "which does not settle"
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
            f"{SETTLE}: settles {apart:.1e} of the largest state from the reference vector, "
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
        model = _read_model(files, name, vector)
        names = _names_of_inputs(model, vector)
        options = onnxruntime.SessionOptions()
        options.log_severity_level = 4
        options.intra_op_num_threads = 1
        with _refused(name):
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
        with _refused(self.name):
            found = [np.asarray(part) for part in self._session.run(None, given)]
        samples = states.shape[-1:]
        if found[0].shape != states.shape or any(part.shape != samples for part in found[1:]):
            raise FileFormatError(f"{self.name}: gives tensors of other shapes than it is given")
        return found
