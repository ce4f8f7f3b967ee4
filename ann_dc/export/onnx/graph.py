"""Graph of ONNX operations under construction: nodes, named constants and loops.

A repeated operation is written once. An operation in the body of a loop that reads nothing of the
body is placed before the loop.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ann_dc.errors import ExportError

OPSET = 18
"""Version of the operator set; supported by every recent runtime."""
IR_VERSION = 9


class Graph:
    """Graph under construction, in which tensors are names.

    Numbers except indices have the type ``dtype``. The body of a loop is a graph whose ``outside``
    is the graph with the loop. ``own`` are the inputs of the graph.
    """

    def __init__(self, dtype: Any, outside: Graph | None = None, own: Iterable[str] = ()) -> None:
        self.dtype, self.outside = np.dtype(dtype), outside
        self.nodes: list[Any] = []
        self.inside = "" if outside is None else f"{outside.inside}body/"
        self._own = set(own)
        self._known: dict[tuple, str] = {}
        self._tables: dict[str, Any] = {} if outside is None else outside._tables
        self._about = "states"

    def about(self, subject: str) -> None:
        """Set the subject of the following operations, which names their tensors."""
        self._about = subject
        if self.outside is not None:
            self.outside.about(subject)

    def op(self, kind: str, *inputs: str, **attributes: Any) -> str:
        """Append an operation of ONNX's default domain and return its output."""
        if self.outside is not None and self._own.isdisjoint(inputs):
            return self.outside.op(kind, *inputs, **attributes)
        key = kind, inputs, tuple(attributes.items())
        if key not in self._known:
            name = f"{self.inside}{self._about}/{kind}_{len(self.nodes)}"
            self._known[key] = self.named(name, kind, *inputs, **attributes)
        return self._known[key]

    def named(self, output: str, kind: str, *inputs: str, **attributes: Any) -> str:
        """Append an operation and return its output under a given name."""
        return self.several([output], kind, *inputs, **attributes)[0]

    def several(
        self, outputs: Sequence[str], kind: str, *inputs: str, **attributes: Any
    ) -> Sequence[str]:
        """Append an operation with several outputs and return them under given names."""
        from onnx import helper

        self.nodes.append(helper.make_node(kind, inputs, outputs, name=outputs[0], **attributes))
        self._own.update(outputs)
        return outputs

    def name_outputs(self, outputs: Mapping[str, str]) -> None:
        """Name the outputs of the graph."""
        for name, tensor in outputs.items():
            self.named(name, "Identity", tensor)

    # ---- constants -----------------------------------------------------------------------------

    def table(self, name: str, values: Any, dtype: Any = None) -> str:
        """Add a named constant, by default of the graph's type.

        Raises `ExportError` if a number is too large for the type.
        """
        from onnx import numpy_helper

        if name not in self._tables:
            wanted = np.asarray(values)
            with np.errstate(over="ignore"):
                array = np.array(wanted, dtype or self.dtype, order="C")
            if np.isfinite(wanted).sum() != np.isfinite(array).sum():
                raise ExportError(
                    f"{name}: {np.abs(wanted).max():.3g} is too large for {array.dtype}; "
                    "export with precision='float64'"
                )
            self._tables[name] = numpy_helper.from_array(array, name)
        return name

    def number(self, value: float) -> str:
        """Add a constant () of the graph's type."""
        return self.table(f"number {float(value)!r}", float(value))

    def integers(self, *values: int) -> str:
        """Add integer constants (count,) for shapes and indices."""
        return self.table(f"integers {' '.join(map(str, values))}", values, np.int64)

    def rows(self, tensor: str, first: int, last: int, every: int = 1) -> str:
        """Return rows ``first .. last - 1`` of a tensor."""
        ends = self.integers(first), self.integers(last)
        return self.op("Slice", tensor, *ends, self.integers(0), self.integers(every))

    def gathered(self, tensor: str, name: str, places: Any) -> str:
        """Return the rows of a tensor at places, a named constant."""
        return self.op("Gather", tensor, self.table(name, places, np.int64), axis=0)

    def stacked(self, *tensors: str) -> str:
        """Concatenate tensors along the first axis."""
        return tensors[0] if len(tensors) == 1 else self.op("Concat", *tensors, axis=0)

    def shaped(self, tensor: str, *shape: int) -> str:
        """Reshape a tensor; -1 denotes the size that follows from the others."""
        return self.op("Reshape", tensor, self.integers(*shape))

    def largest(self, tensor: str, axis: int) -> str:
        """Reduce a tensor to its maxima along an axis, which is removed; nan is unspecified."""
        return self.op("ReduceMax", tensor, self.integers(axis), keepdims=0)

    def loop(
        self,
        body: Graph,
        most: str,
        carried: dict[str, str],
        following: Sequence[str],
        going: str,
        prefix: str = "",
    ) -> Sequence[str]:
        """Append a loop of at most ``most`` turns and return its final carried values.

        The inputs of the body are "turn" and "still", after a prefix that distinguishes nested
        loops, and the names of ``carried``, the initial values. ``following`` are the values after
        a turn, ``going`` is the condition for another one.
        """
        from onnx import helper

        inner = body._typed([(f"{prefix}turn", np.int64, []), (f"{prefix}still", np.bool_, [])])
        inner += [helper.make_empty_tensor_value_info(name) for name in carried]
        outputs = [helper.make_empty_tensor_value_info(name) for name in (going, *following)]
        graph = helper.make_graph(body._used([going, *following]), "body", inner, outputs)
        first = self.table("still at first", True, np.bool_)
        ends = [f"{name} at the end" for name in carried]
        return self.several(ends, "Loop", most, first, *carried.values(), body=graph)

    # ---- the whole -----------------------------------------------------------------------------

    def model(
        self,
        name: str,
        inputs: Sequence[tuple[str, Any, Sequence]],
        outputs: Sequence[tuple[str, Any, Sequence]],
    ) -> Any:
        """Return the model, with its inputs and outputs as (name, type, shape)."""
        from onnx import helper

        nodes = self._used([name for name, _, _ in outputs])
        used = {name for node in nodes for name in _read(node)}
        tables = [table for name, table in self._tables.items() if name in used]
        graph = helper.make_graph(nodes, name, self._typed(inputs), self._typed(outputs), tables)
        return helper.make_model(
            graph,
            opset_imports=[helper.make_opsetid("", OPSET)],
            ir_version=IR_VERSION,
            producer_name="ann_dc",
        )

    def _used(self, outputs: Iterable[str]) -> list[Any]:
        """Return the nodes on which the outputs depend."""
        wanted, nodes = set(outputs), []
        for node in reversed(self.nodes):
            if not wanted.isdisjoint(node.output):
                wanted.update(_read(node))
                nodes.append(node)
        return nodes[::-1]

    @staticmethod
    def _typed(tensors: Iterable[tuple[str, Any, Sequence]]) -> list[Any]:
        from onnx import helper

        return [
            helper.make_tensor_value_info(
                name, helper.np_dtype_to_tensor_dtype(np.dtype(dtype)), shape
            )
            for name, dtype, shape in tensors
        ]


def _read(node: Any) -> set[str]:
    """Return the inputs of a node, including outside tensors that a loop body reads."""
    bodies = [attribute.g for attribute in node.attribute if attribute.HasField("g")]
    inside = {name for body in bodies for inner in body.node for name in _read(inner)}
    return {*node.input, *inside}
