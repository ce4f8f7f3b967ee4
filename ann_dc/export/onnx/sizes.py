"""Bounds of an ONNX model before execution: tensor sizes and loop turns.

The package onnx infers the shape of every tensor from the states and inputs of a check. The body of
a loop is treated as one turn, which must preserve the shapes of its inputs. The settling loop turns
as often as its limit. The loop that determines saturated neurons, nested or alone, has its number
of turns in the file.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from ann_dc.errors import FileFormatError
from ann_dc.evaluation.rules import BLOCKS, PIVOTS
from ann_dc.export.onnx.graph import OPSET
from ann_dc.export.reference.vector import ReferenceVector

SAMPLES = 2
"""Maximum number of samples in one run of a check."""
GROWTH = 8
"""Maximum size of a tensor relative to the states, inputs and the largest table; exported files
need less.
"""
Shape = tuple[int, ...]


def check_sizes(name: str, graph: Any, vector: ReferenceVector) -> None:
    """Raise `FileFormatError` for a large or unknown tensor size, or an endless loop.

    The states and inputs are those of the vector.
    """
    loops = list(loops_in(name, graph))
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
                raise FileFormatError(f"{name}: {after.name!r:.60} grows from turn to turn")


def loops_in(name: str, graph: Any) -> Iterator[tuple[Any, Any]]:
    """Yield a graph and its loop, then those of the loop's body.

    Raises `FileFormatError` if a graph has more than one loop.
    """
    loops = [node for node in graph.node if node.op_type == "Loop"]
    if len(loops) > 1:
        raise FileFormatError(f"{name}: has more than one loop")
    for loop in loops:
        yield graph, loop
        yield from loops_in(name, _body(loop))


def _check_turns(name: str, around: Any, loop: Any, tables: Mapping[str, Any], most: int) -> None:
    """Check the number of turns of a loop.

    The number is ``limit`` plus one, or the number in a table up to ``most``.
    """
    from onnx import numpy_helper

    told = loop.input[0] if loop.input else ""
    if told in tables:
        turns = numpy_helper.to_array(tables[told])
        if turns.ndim == 0 and turns <= most:
            return
    sums = [node for node in around.node if told in node.output]
    bounded = len(sums) == 1 and sums[0].op_type == "Add" and "limit" in sums[0].input
    if not bounded or not set(sums[0].input) <= {"limit", *tables}:
        raise FileFormatError(f"{name}: its loop has no limit")


def _body(loop: Any) -> Any:
    return next(attribute.g for attribute in loop.attribute if attribute.HasField("g"))


def _shapes(name: str, graph: Any, vector: ReferenceVector) -> dict[str, Shape | None]:
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


def _shape(tensor: Any) -> Shape | None:
    kind = tensor.type.tensor_type
    if not kind.HasField("shape") or not all(size.HasField("dim_value") for size in kind.shape.dim):
        return None
    return tuple(size.dim_value for size in kind.shape.dim)
