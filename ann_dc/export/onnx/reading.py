"""Strict reader of ONNX files: it accepts only content that the exporter writes.

A file is rejected if it is too large, is not an ONNX model, or does not match its digest. It is
also rejected for external data, for operations that a network does not need, and for input or
output tensors that differ from its test vector.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from ann_dc.errors import AnnDcError, FileFormatError
from ann_dc.export.onnx.files import SETTLE, STEP
from ann_dc.export.onnx.metadata import DIGEST, digest, metadata
from ann_dc.export.onnx.sizes import check_sizes, loops_in
from ann_dc.export.reference.contents import file_of
from ann_dc.export.reference.vector import VECTOR, ReferenceVector

MOST_BYTES = 2**28
"""Largest file size in bytes; a network of ten thousand stages with a resistive grid has about
2**25.
"""
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


@contextmanager
def refused(name: str) -> Iterator[None]:
    """Convert exceptions of a package that reads or runs a file to `FileFormatError`."""
    try:
        yield
    except AnnDcError:
        raise
    except Exception as error:  # protobuf, onnx and onnxruntime have no base in common
        said = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise FileFormatError(f"{name}: {said:.200}") from error


def read_vector(files: Mapping[str, bytes]) -> ReferenceVector:
    """Read the test vector from the files.

    Raises `FileFormatError` if the vector is missing or unreadable.
    """
    return ReferenceVector.from_json(_content(files, VECTOR))


def read_model(files: Mapping[str, bytes], name: str, vector: ReferenceVector) -> Any:
    """Read and check a model without running it.

    The model must belong to the network of the vector. Raises `FileFormatError` otherwise.
    """
    import onnx

    content = _content(files, name)
    with refused(name):
        model = onnx.load_model_from_string(content)
        said = metadata(model)
    if said.get(DIGEST) != digest(model):
        raise FileFormatError(f"{name}: its content is not what its digest says: export it again")
    if said.get("content") != vector.content:
        raise FileFormatError(f"{name}: {VECTOR} is of another network")
    if model.functions or model.training_info:
        raise FileFormatError(f"{name}: has functions or training beside its graph")
    _check_graph(name, model.graph)
    _check_tensors(name, model.graph, vector)
    with refused(name):
        onnx.checker.check_model(model, full_check=True)
        check_sizes(name, model.graph, vector)
    return model


def names_of_inputs(model: Any, vector: ReferenceVector) -> list[str]:
    """Return the inputs in the order of the rows of a model's tensor.

    Raises `FileFormatError` if they are not those of the vector.
    """
    with refused("metadata"):
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
            raise FileFormatError(f"{name}: the operation {node.op_type!r:.40} is none of ours")
        for attribute in node.attribute:
            _check_attribute(name, node.op_type, attribute, depth)
    if graph.sparse_initializer:
        raise FileFormatError(f"{name}: has sparse numbers")
    for table in graph.initializer:
        if table.external_data or table.data_location == TensorProto.EXTERNAL:
            raise FileFormatError(f"{name}: {table.name!r:.40} keeps its numbers in another file")


def _check_attribute(name: str, kind: str, attribute: Any, depth: int) -> None:
    """Check an attribute: numbers, types, or a loop body at most two loops deep."""
    if attribute.HasField("t") or attribute.tensors or attribute.graphs:
        raise FileFormatError(f"{name}: {kind} has tensors of its own")
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
    turns = {loop.input[0] for _, loop in loops_in(name, graph) if loop.input}
    for table in graph.initializer:
        if table.data_type != TensorProto.INT64 or table.name in turns:  # a loop's: see `sizes`
            continue
        with refused(name):
            values = numpy_helper.to_array(table)
        if not (np.abs(values) <= most).all():
            raise FileFormatError(f"{name}: {table.name!r:.40} reaches beyond the states")
