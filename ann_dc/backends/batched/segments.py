"""Inputs over time in batches: straight lines from breakpoint to breakpoint of the waveforms.

Between two breakpoints, a driven value is ``value + slope (s - began)``. No step of a lane passes a
breakpoint, and the slope of the state is evaluated again behind it. Right-hand sides are therefore
smooth within every step, and the error estimate is valid.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ann_dc.backends.batched.continuous_code import AT, BEGAN, UNTIL
from ann_dc.backends.batched.memory import TIME, Memory
from ann_dc.evaluation.calls import call
from ann_dc.evaluation.codegen.code import code, key_of
from ann_dc.evaluation.codegen.lanes import Lanes
from ann_dc.evaluation.codegen.memory import lined_up
from ann_dc.evaluation.codegen.writer import Function, Module
from ann_dc.evaluation.drive import breakpoints
from ann_dc.evaluation.formulas import inlined
from ann_dc.network.network import Network
from ann_dc.network.waveforms import Waveform


class Lines(NamedTuple):
    """Driven values of a batch in network units: straight lines between breakpoints."""

    breakpoints: np.ndarray  # network times (S + 1,), from zero to the duration
    values: np.ndarray  # values (S, B or 1, D) at the beginning of each segment
    slopes: np.ndarray  # slopes (S, B or 1, D) of each segment


def lines_of(network: Network, waveforms: Mapping[str, Waveform], duration: float) -> Lines:
    """Return the lines of waveforms with values (K, B or 1, N or 1) over a duration.

    A waveform has one column, or one per stage.
    """
    times = breakpoints(waveforms, duration)
    count = max((one.values.shape[1] for one in waveforms.values()), default=1)
    columns = [np.empty((2, len(times) - 1, count, 0))]
    for name, one in waveforms.items():
        values = network.input_scale(name).network(np.array([one.at(t) for t in times]))
        slopes = np.diff(values, axis=0) / np.diff(times)[:, None, None]
        both = np.stack([values[:-1], slopes if one.hold == "linear" else 0.0 * slopes])
        columns.append(np.broadcast_to(both, (*both.shape[:2], count, both.shape[3])))
    values, slopes = np.concatenate(columns, axis=3)
    return Lines(times, np.ascontiguousarray(values), np.ascontiguousarray(slopes))


class Driven(NamedTuple):
    """Driven values of a group's lanes."""

    drive: int  # address of ``drive``
    table: np.ndarray  # addresses and sizes (6,) that the code reads
    lines: Lines  # driven values of all samples
    here: np.ndarray  # values at the last breakpoint and slopes (2, D, W) of each lane
    segment: np.ndarray  # number (W,) of the segment of each lane
    places: np.ndarray  # columns and addresses of driven table entries (E, 2)
    pins: np.ndarray  # columns and places of driven values in a state (F, 2)

    @classmethod
    def of(
        cls, lanes: Lanes, network: Network, waveforms: Mapping[str, Waveform], lines: Lines
    ) -> Driven:
        """Return the driven values of lanes, which must live as long.

        The lines are those of all samples, from `lines_of`.
        """
        places, pins, columns = [], [], 0
        for name, one in waveforms.items():
            step = int(one.values.shape[2] > 1)
            for table, cell, row, stage in _places(lanes, network, name):
                column = (columns + step * stage) * lanes.lanes
                at = lanes.ghosted_place(cell, row, table)
                if table == "x":
                    pins.append((column, at))
                else:
                    places.append((column, lanes.tables[table].ctypes.data + 8 * at))
            columns += one.values.shape[2]
        found = [np.array(rows, np.int64).reshape(-1, 2) for rows in (places, pins)]
        here = lined_up(np.zeros((2, columns, lanes.lanes)))
        addresses = [array.ctypes.data for array in (*here, *found)]
        sizes = [len(rows) for rows in found]
        return cls(
            drive=_drive_code(lanes.lanes) if columns else 0,
            table=np.array([*addresses, *sizes], np.int64),
            lines=lines,
            here=here,
            segment=np.zeros(lanes.lanes, np.int64),
            places=found[0],
            pins=found[1],
        )


def _places(lanes: Lanes, network: Network, name: str) -> list[tuple[str, int, int, int]]:
    """Return table, cell (-1 before the first), row and stage of all values of an input."""
    plan, nodes = lanes.plan, network.node_index
    row = nodes[name] - plan.neurons
    found = [("inputs", stage, row, stage) for stage in range(network.stages)]
    for pin in network.fixed:
        if pin.input == name:
            found.append(("x", pin.stage, nodes[pin.neuron], pin.stage))
    for node, source in network.left_boundary.items():
        at = nodes[node]
        if source != name:
            continue
        if at < plan.neurons:
            found.append(("x", -1, at, 0))
        elif at < plan.one:
            found.append(("inputs", -1, at - plan.neurons, 0))
        elif at in plan.stored:
            found.append(("work", -1, plan.stored[at], 0))
    return found


def _drive_code(lanes: int) -> int:
    """Return the address of ``drive``.

    ``drive(driven, x, memory)`` writes the values of the times ``AT`` into the tables and ``x``.
    """
    key = key_of(("drive", lanes), Path(__file__).parent)
    return code(key, lambda: _drive_text(lanes), ("drive",))["drive"]


def _drive_text(lanes: int) -> str:
    module = Module()
    f = Function(module, "drive", ("driven", "x", "memory"), width=lanes)
    values, slopes, places, pins = (f.field("%driven", i) for i in range(4))
    counts = [f.field("%driven", i, "i64") for i in (4, 5)]
    memory = Memory(f)
    passed = (memory[AT] - memory[BEGAN]).name
    for is_pin, (table, count) in enumerate(zip((places, pins), counts)):
        with f.loop(count) as number:
            entry = f.address(table, f.integer("mul", number, 2))
            column, at = f.load_integer(entry), f.load_integer(f.address(entry, 1))
            value, slope = (f.load(f.address(base, column)) for base in (values, slopes))
            to = f.address("%x", at) if is_pin else f.value(f"inttoptr i64 {at} to ptr")
            f.store(f.fma(passed, slope, value), to)
    f.done()
    return module.text()


@inlined
def enter_segment(group, driven, lane, number):
    """Enter the lines of a segment of a lane's sample."""
    lines = driven.lines
    own = group.who[lane] if lines.values.shape[1] > 1 else 0
    for i in range(driven.here.shape[1]):
        driven.here[0, i, lane] = lines.values[number, own, i]
        driven.here[1, i, lane] = lines.slopes[number, own, i]
    driven.segment[lane] = number
    group.memory[BEGAN, lane] = lines.breakpoints[number]
    group.memory[UNTIL, lane] = lines.breakpoints[number + 1]


@inlined
def drive(group, driven, x):
    """Write the inputs of the times ``AT`` into the tables and a state."""
    addresses = (driven.table.ctypes.data, x.ctypes.data, group.memory.ctypes.data)
    call(driven.drive, addresses, ())


@inlined
def drive_now(group, driven):
    """Write the inputs of the present times of all lanes, if any, into tables and states."""
    if driven.drive == 0:
        return
    for lane in range(group.who.shape[0]):
        group.memory[AT, lane] = group.memory[TIME, lane]
    drive(group, driven, group.x)
