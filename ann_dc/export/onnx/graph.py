"""A graph of ONNX operations while it is written: nodes, constants with names, and loops in it.

An operation that was written once is not written again, and one in the body of a loop that reads
nothing of the body stands before the loop.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ann_dc.errors import ExportError

OPSET = 18
"""Of the operations; every runtime of the last years has it."""
IR_VERSION = 9


class Graph:
    """What is written so far. Tensors are names.

    Parameters
    ----------
    dtype : dtype
        Of all numbers that are no indices.
    outside : Graph, optional
        What the graph is the body of a loop in.
    own : iterable of str
        What the graph is given.

    Examples
    --------
    >>> graph = Graph(np.float64, own=["x"])
    >>> graph.op("Add", "x", graph.number(2.0)) == graph.op("Add", "x", graph.number(2.0))
    True
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
        """What the operations that follow are about: their tensors are named after it."""
        self._about = subject
        if self.outside is not None:
            self.outside.about(subject)

    def op(self, kind: str, *inputs: str, **attributes: Any) -> str:
        """The output of an operation.

        Parameters
        ----------
        kind : str
            Of the default domain of ONNX.
        *inputs : str
        **attributes
            Of the operation.
        """
        if self.outside is not None and self._own.isdisjoint(inputs):
            return self.outside.op(kind, *inputs, **attributes)
        key = kind, inputs, tuple(attributes.items())
        if key not in self._known:
            name = f"{self.inside}{self._about}/{kind}_{len(self.nodes)}"
            self._known[key] = self.named(name, kind, *inputs, **attributes)
        return self._known[key]

    def named(self, output: str, kind: str, *inputs: str, **attributes: Any) -> str:
        """The output of an operation, under a name of its own."""
        return self.several([output], kind, *inputs, **attributes)[0]

    def several(
        self, outputs: Sequence[str], kind: str, *inputs: str, **attributes: Any
    ) -> Sequence[str]:
        """The outputs of an operation that has more than one, under names of their own."""
        from onnx import helper

        self.nodes.append(helper.make_node(kind, inputs, outputs, name=outputs[0], **attributes))
        self._own.update(outputs)
        return outputs

    # ---- constants -----------------------------------------------------------------------------

    def table(self, name: str, values: Any, dtype: Any = None) -> str:
        """A constant under a name; of the graph's own type by default.

        Raises
        ------
        ExportError
            If a number is too large for the type.
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
        """A constant () of the graph's own type."""
        return self.table(f"number {float(value)!r}", float(value))

    def integers(self, *values: int) -> str:
        """Constants (count,) that shapes and places are made of."""
        return self.table(f"integers {' '.join(map(str, values))}", values, np.int64)

    # ---- what is written often -----------------------------------------------------------------

    def rows(self, tensor: str, first: int, last: int, every: int = 1) -> str:
        """Rows ``first .. last - 1`` of a tensor."""
        ends = self.integers(first), self.integers(last)
        return self.op("Slice", tensor, *ends, self.integers(0), self.integers(every))

    def stacked(self, *tensors: str) -> str:
        """Tensors one after the other along the first axis."""
        return tensors[0] if len(tensors) == 1 else self.op("Concat", *tensors, axis=0)

    def shaped(self, tensor: str, *shape: int) -> str:
        """The tensor in another shape, -1 for one size that follows."""
        return self.op("Reshape", tensor, self.integers(*shape))

    def largest(self, tensor: str, axis: int) -> str:
        """Maxima along an axis, which goes; of what is no number nothing is told."""
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
        """What a loop carries, at its end.

        Parameters
        ----------
        body : Graph
            That was given the names "turn" and "still", after the prefix, and those of ``carried``.
        most : str
            Number of turns, at most.
        carried : dict of str to str
            What each starts from.
        following : sequence of str
            What each is after a turn.
        going : str
            Whether there is another turn.
        prefix : str
            Of names that another loop in the graph or around it has too.
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
        """The model, with what it is given and gives: (name, type, shape) each."""
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
        """The nodes that the outputs depend on."""
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
    """What a node reads, with what the body of a loop reads from outside."""
    bodies = [attribute.g for attribute in node.attribute if attribute.HasField("g")]
    inside = {name for body in bodies for inner in body.node for name in _read(inner)}
    return {*node.input, *inside}
