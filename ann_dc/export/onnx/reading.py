"""ONNX files, read with distrust: nothing is run that an exporter here would not have written.

A file is refused where it is too large, is no ONNX model, is not what its own digest says, keeps
numbers elsewhere, has operations that no network needs, or expects and gives other tensors than the
reference vector beside it has.
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
from ann_dc.export.reference.sidecar import file_of
from ann_dc.export.reference.vector import VECTOR, ReferenceVector

MOST_BYTES = 2**28
"""Of a file; a row of ten thousand stages with a grid has some 2**25."""
REACH = 8
"""Largest number in a shape or a place, over the neurons of the row."""
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
"""All that a network is written with."""


@contextmanager
def refused(name: str) -> Iterator[None]:
    """Whatever goes wrong in a package that reads or runs a file is the file's fault.

    Raises
    ------
    FileFormatError
    """
    try:
        yield
    except AnnDcError:
        raise
    except Exception as error:  # protobuf, onnx and onnxruntime have no base in common
        said = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise FileFormatError(f"{name}: {said:.200}") from error


def read_vector(files: Mapping[str, bytes]) -> ReferenceVector:
    """The reference vector among the files.

    Raises
    ------
    FileFormatError
        If there is none, or one that does not read.
    """
    return ReferenceVector.from_json(_content(files, VECTOR))


def read_model(files: Mapping[str, bytes], name: str, vector: ReferenceVector) -> Any:
    """A model among the files, checked but not yet run.

    Parameters
    ----------
    files : mapping of str to bytes
    name : str
    vector : ReferenceVector
        Whose network it has to be.

    Returns
    -------
    onnx.ModelProto

    Raises
    ------
    FileFormatError
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
    """The inputs in the order of the rows of a model's tensor.

    Raises
    ------
    FileFormatError
        If they are not those of the vector.
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
    """Known operations only, and all numbers in the file itself."""
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
    """Numbers and types; of a loop that is in one other at most, its body."""
    if attribute.HasField("t") or attribute.tensors or attribute.graphs:
        raise FileFormatError(f"{name}: {kind} has tensors of its own")
    if attribute.HasField("g"):
        if kind != "Loop" or depth > 1:
            raise FileFormatError(f"{name}: a graph in {kind}")
        _check_graph(name, attribute.g, depth + 1)


def _check_tensors(name: str, graph: Any, vector: ReferenceVector) -> None:
    """The tensors that a model is given and gives, and how far its places and shapes reach."""
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
