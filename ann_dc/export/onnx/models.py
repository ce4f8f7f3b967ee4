r"""ONNX models of a network: one step, and the loop to settling.

.. math:: x_{k+1} = \mathrm{clip}(x_k + h\, M\, d(x_k)) .

States are tensors (P, N, B) of neurons, stages, samples, in network units. Samples are the last
axis, so that every operation is vectorised over them. State entries of fixed and omitted neurons
are not read. A shared neuron has the value of the last cell.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ann_dc.backends.status import OVERFLOW
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.rules import FLOOR, SMALLEST_POSITION, RoleRows
from ann_dc.export.onnx.cell import CellReading
from ann_dc.export.onnx.graph import Graph
from ann_dc.export.onnx.preconditioners import clamped, derivatives, there, where_there
from ann_dc.network.network import Network
from ann_dc.network.selection import clamped_rows

BATCH = "B"


def step_model(network: Network, dtype: Any) -> Any:
    """Return the model (states, inputs, step) -> (next_states, residual of the given states)."""
    graph = Graph(dtype, own=["states", "inputs", "step"])
    flow = _Flow(network, graph)
    state = flow.filled("states")
    following, residual, _ = flow.step(graph, state, {})
    graph.name_outputs({"next_states": flow.unfolded(graph, following), "residual": residual})
    given = [*_given(network, graph), ("step", graph.dtype, [])]
    found = [_states(network, graph, "next_states"), ("residual", graph.dtype, [BATCH])]
    return graph.model("step", given, found)


def settle_model(network: Network, dtype: Any) -> Any:
    """Return the loop to settling, with a tolerance and a limit, which counts the steps.

    It maps (states, inputs, step, tolerance, limit) to (settled_states, residual, steps). A sample
    takes steps until its residual is below the tolerance or infinite, at most ``limit`` steps, and
    then remains constant. A residual is infinite if a number is infinite, a function is outside its
    domain, or the state has grown far beyond the start.
    """
    from onnx import TensorProto

    graph = Graph(dtype, own=["states", "inputs", "step", "tolerance", "limit"])
    flow = _Flow(network, graph)
    start = flow.filled("states")
    sides = flow.reading(graph, start).sides()
    graph.about("settling")
    most = graph.op("Max", flow.size(graph, start), graph.number(1.0))
    most = graph.op("Mul", most, graph.number(OVERFLOW))
    none = graph.op("Expand", graph.number(0.0), flow.batch)
    carried = {
        "state": start,
        "distance": none,
        "count": graph.op("Cast", none, to=TensorProto.INT64),
    }
    body = Graph(dtype, graph, own=["turn", "still", *carried])
    following, residual, size = flow.step(body, "state", sides)
    body.about("settling")
    infinite = body.number(np.inf)
    residual = body.op("Where", body.op("Less", size, most), residual, infinite)
    above = body.op("GreaterOrEqual", residual, "tolerance")
    runs = body.op("And", above, body.op("Less", residual, infinite))
    runs = body.op("And", runs, body.op("Less", "turn", "limit"))
    moved = body.op("Cast", runs, to=TensorProto.INT64)
    ends = {
        "following state": body.op("Where", runs, following, "state"),
        "following distance": residual,
        "following count": body.op("Add", "count", moved),
    }
    going = body.op("ReduceMax", moved, keepdims=0)
    ends["going"] = body.op("Cast", going, to=TensorProto.BOOL)
    body.name_outputs(ends)
    turns = graph.op("Add", "limit", graph.table("one more", 1, np.int64))
    state, distance, count = graph.loop(body, turns, carried, [*ends][:3], "going")
    outputs = {"settled_states": flow.unfolded(graph, state), "residual": distance, "steps": count}
    graph.name_outputs(outputs)
    numbers = [("step", graph.dtype, []), ("tolerance", graph.dtype, []), ("limit", np.int64, [])]
    found = [
        _states(network, graph, "settled_states"),
        ("residual", graph.dtype, [BATCH]),
        ("steps", np.int64, [BATCH]),
    ]
    return graph.model("settle", [*_given(network, graph), *numbers], found)


def _states(network: Network, graph: Graph, name: str) -> tuple[str, Any, list]:
    return name, graph.dtype, [*network.live.shape, BATCH]


def _given(network: Network, graph: Graph) -> list[tuple[str, Any, list]]:
    """Return the graph inputs: states, and inputs if there are any."""
    inputs = "inputs", graph.dtype, [len(network.cell.inputs), network.stages, f"{BATCH} or 1"]
    return [_states(network, graph, "states"), inputs][: 1 + bool(network.cell.inputs)]


class _Flow:
    """Network equations for the inputs of a graph; an internal state is (P N, B)."""

    def __init__(self, network: Network, graph: Graph) -> None:
        self.network, self.batch = network, graph.op("Shape", "states", start=2)
        self._inputs = []
        for number, name in enumerate(network.cell.inputs):
            every = graph.op("Expand", "inputs", self.batch)
            self._inputs.append(graph.gathered(every, f"input.{name}", number))
        self._outer, self._clamped = graph, clamped_rows(network)

    def filled(self, states: str) -> str:
        """Return the state (P N, B) from states (P, N, B), with fixed and omitted neurons."""
        graph, network = self._outer, self.network
        rows = []
        for number, neuron in enumerate(network.cell.neurons):
            graph.about(neuron.name)
            row = graph.gathered(states, f"neuron.{neuron.name}", number)
            if neuron.shared:
                row = graph.rows(row, network.stages - 1, network.stages)
                shape = graph.stacked(graph.integers(network.stages), self.batch)
                row = graph.op("Expand", row, shape)
            rows.append(self._pinned(where_there(network, graph, number, row), neuron.name))
        return graph.stacked(*rows)

    def _pinned(self, row: str, neuron: str) -> str:
        graph, stage = self._outer, np.arange(self.network.stages)
        inputs = dict(zip(self.network.cell.inputs, self._inputs))
        for pin in self.network.fixed:
            if pin.neuron == neuron:
                here = (stage == pin.stage)[:, None]
                here = graph.table(f"pin.{neuron}.{pin.stage}", here, np.bool_)
                row = graph.op("Where", here, inputs[pin.input], row)
        return row

    def unfolded(self, graph: Graph, rows: str) -> str:
        """Reshape rows (P N, B) to (P, N, B)."""
        return graph.shaped(rows, *self.network.live.shape, -1)

    def reading(self, graph: Graph, state: str) -> CellReading:
        """Return the node values of the cell at a state (P N, B)."""
        stages, neurons = self.network.stages, []
        for number, neuron in enumerate(self.network.cell.neurons):
            graph.about(neuron.name)
            neurons.append(graph.rows(state, number * stages, (number + 1) * stages))
        return CellReading(
            self.network, graph, neurons=neurons, inputs=self._inputs, batch=self.batch
        )

    def step(self, graph: Graph, state: str, sides: dict[str, str]) -> tuple[str, str, str]:
        """Return the state after a step, the residual (B,) before it, and the state's size (B,)."""
        network, reading = self.network, self.reading(graph, state)
        rows, arriving = [], []
        for number, drive in enumerate(reading.drives()):
            cut = self._cut(graph, number, drive, reading)
            rows.append(where_there(network, graph, number, cut))
            own = drive if number in self._clamped else cut
            arriving.append(where_there(network, graph, number, own))
        graph.about("preconditioner")
        drives = graph.stacked(*rows)
        if len(self._clamped):
            moved = self._projected(graph, state, graph.stacked(*arriving))
        else:
            moved = derivatives(network, graph, drives)
        moved = graph.op("Mul", moved, "step")
        following = self._clip_to_limits(graph, graph.op("Add", state, moved))
        is_inside = reading.is_inside(sides)
        graph.about("residual")
        sizes = self._largest(graph, state)
        residual = self._residual(graph, drives, sizes, is_inside)
        return following, residual, graph.largest(sizes, 0)

    def size(self, graph: Graph, state: str) -> str:
        """Return max |x| (B,) of a state."""
        return graph.largest(self._largest(graph, state), 0)

    # ---- rails -----------------------------------------------------------------------------------

    def _cut(self, graph: Graph, number: int, drive: str, reading: CellReading) -> str:
        """Return the net input (N, B) of a neuron, zero if it pushes against its limit."""
        limiter, state = self.network.cell.neurons[number].limiter, reading.neuron(number)
        zero = graph.number(0.0)
        for rail, beyond, pushes in (
            (limiter.low, "LessOrEqual", "Less"),
            (limiter.high, "GreaterOrEqual", "Greater"),
        ):
            if np.isfinite(rail):
                stands = graph.op(beyond, state, graph.number(rail))
                stopped = graph.op("And", stands, graph.op(pushes, drive, zero))
                drive = graph.op("Where", stopped, zero, drive)
        return drive

    def _projected(self, graph: Graph, state: str, drives: str) -> str:
        """Return derivatives (P N, B): the projection of M d onto permitted directions.

        The net inputs of coupled neurons are those without limits.
        """
        network, zero = self.network, graph.number(0.0)
        component = np.flatnonzero(np.isin(network.places[:, 0], self._clamped))
        places, count = network.places[component] @ [network.stages, 1], len(component)
        limits = evaluator(network).tape.limits[network.places[component, 0]]
        within = network.preconditioner.derivatives(
            network.layout, np.eye(network.size)[component]
        )[:, component]
        place = graph.table("clamp.places", places, np.int64)
        free = derivatives(network, graph, drives)
        x, pull, given = (graph.op("Gather", rows, place, axis=0) for rows in (state, free, drives))
        at_limits = (
            graph.op("LessOrEqual", x, graph.table("clamp.low", limits[:, :1])),
            graph.op("GreaterOrEqual", x, graph.table("clamp.high", limits[:, 1:])),
        )
        shape = graph.stacked(graph.integers(count, count), self.batch)
        table = graph.op("Expand", graph.table("clamp.preconditioner", within[:, :, None]), shape)
        table = graph.op("Concat", table, graph.op("Unsqueeze", pull, graph.integers(1)), axis=1)
        held, currents = clamped(graph, count, table, given, at_limits, self.batch)
        own = np.full(network.live.size, count)
        own[places.astype(int)] = np.arange(count)
        numbers = graph.table("clamp.numbers", own, np.int64)
        elsewhere = graph.op("Mul", graph.rows(currents, 0, 1), zero)
        pushed = graph.op("Gather", graph.stacked(currents, elsewhere), numbers, axis=0)
        held = graph.stacked(graph.op("Where", held, graph.number(1.0), zero), elsewhere)
        held = graph.op("Greater", graph.op("Gather", held, numbers, axis=0), zero)
        moved = derivatives(network, graph, graph.op("Add", drives, pushed))
        return graph.op("Where", held, zero, moved)

    def _clip_to_limits(self, graph: Graph, state: str) -> str:
        """Clip the state to the saturation limits of the neurons; inputs have none."""
        limiters = [neuron.limiter for neuron in self.network.cell.neurons]
        live = there(self.network)
        for kind, name, rails, none in (
            ("Max", "rail.low", [limiter.low for limiter in limiters], -np.inf),
            ("Min", "rail.high", [limiter.high for limiter in limiters], np.inf),
        ):
            if np.isfinite(rails).any():
                table = np.where(live, np.array(rails)[:, None], none).reshape(-1, 1)
                state = graph.op(kind, state, graph.table(name, table))
        return state

    # ---- residual --------------------------------------------------------------------------------

    def _largest(self, graph: Graph, rows: str) -> str:
        """Return max |.| over the stages, (P, B), of rows (P N, B)."""
        return graph.largest(self.unfolded(graph, graph.op("Abs", rows)), 1)

    def _residual(self, graph: Graph, drives: str, sizes: str, is_inside: str | None) -> str:
        """Return the larger residual (B,) of `ann_dc.evaluation.rules.residuals`."""
        roles = RoleRows.of(evaluator(self.network).tape.roles)
        pushes = self._largest(graph, drives)
        ratios = []
        for pushed, against, least in (
            (roles.duals, roles.positions, SMALLEST_POSITION),
            (roles.primal, roles.duals, FLOOR),
            (roles.states, roles.states, 1.0),
        ):
            if len(pushed):
                size = self._of_rows(graph, sizes, against, least)
                ratios.append(graph.op("Div", self._of_rows(graph, pushes, pushed, 0.0), size))
        residual = ratios[0] if len(ratios) == 1 else graph.op("Max", *ratios)
        infinite = graph.number(np.inf)
        # a maximum may pass over what is no number, a sum does not
        total = graph.op("ReduceSum", graph.op("Abs", drives), graph.integers(0), keepdims=0)
        sound = graph.op("Less", total, infinite)
        if is_inside:
            sound = graph.op("And", sound, is_inside)
        return graph.op("Where", sound, residual, infinite)

    def _of_rows(self, graph: Graph, values: str, rows: np.ndarray, least: float) -> str:
        """Return the largest value (B,) in rows of values (P, B), at least ``least``."""
        if not len(rows):
            return graph.number(least)
        names = " ".join(map(str, rows))
        most = graph.largest(graph.gathered(values, f"roles {names}", rows), 0)
        return graph.op("Max", most, graph.number(least))
