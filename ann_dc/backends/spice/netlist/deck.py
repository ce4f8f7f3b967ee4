"""Netlist of a circuit: one cell subcircuit, N instances, one parameter per part."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ann_dc.backends.spice.netlist.cell_text import CellText, commented, number, wrapped
from ann_dc.backends.spice.netlist.cells import cell_of
from ann_dc.backends.spice.netlist.curves import CURVE_CELLS, check_functions, subcircuit_of
from ann_dc.backends.spice.netlist.timing import (
    Simulation,
    Timing,
    control_cards,
    pwl_card,
    simulation_for,
    timing_of,
)
from ann_dc.backends.spice.netlist.values import BUS, NEGATIVE, SOURCE, Nodes, Values
from ann_dc.backends.spice.pdk.files import PACKAGE
from ann_dc.backends.spice.pdk.place import INSTEAD, place_of
from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.cost import parts_of
from ann_dc.hardware.circuit.deviations import Deviations, checked_deviations
from ann_dc.hardware.circuit.scaling import built_range, slopes_of
from ann_dc.hardware.parts.board_models import on_board
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.technologies import (
    DifferentialPairs,
    OpAmps,
    OtaC,
    SwitchedCapacitors,
)
from ann_dc.hardware.schematic.elements import Adder, Generator, Integrator, Multiplier, PICell
from ann_dc.hardware.schematic.schematic import Schematic
from ann_dc.resources import circuits_path
from ann_dc.scale import IDENTITY
from ann_dc.si_prefixes import counted

Lines = tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Deck:
    """Netlist in sections, with the node names of the network in its results.

    Attributes
    ----------
    head, models, cells, row, inputs : tuple of str
        Lines: comments; parameters, models and cells of the library; subcircuits of this network's
        cells; their instances and negative copies; constant sources, reset and clock.
    library : dict of str to str
        Files of ``circuits`` that are among the models, by their names there.
    options : str
        Options of the simulator.
    signals : dict of (node name, stage) to str
        Top-level node of every part, without fixed and omitted neurons.
    timing : Timing
        Reset, end and steps, in seconds.
    parts : dict of str to int
        Number of components by kind.
    cut : str
        Clause on why the run may end before it settles; empty if no reason is known.
    """

    head: Lines
    models: Lines
    cells: Lines
    row: Lines
    inputs: Lines
    library: dict[str, str]
    options: str
    signals: dict[tuple[str, int], str]
    timing: Timing
    parts: dict[str, int]
    cut: str = ""

    @property
    def end(self) -> float:
        """End of the run in seconds."""
        return self.timing.end

    @property
    def analysis(self) -> Lines:
        """Options, saved variables and transient analysis."""
        step, end = number(self.timing.step), number(self.timing.end)
        saved = " ".join(f"v({node})" for node in self.signals.values())
        return (
            f".options {self.options}",
            wrapped(f".save {saved}"),
            f".tran {step} {end} 0 {step}",
        )

    @cached_property
    def text(self) -> str:
        """Complete netlist."""
        lines = [
            *self.head,
            *((f"* {self.cut}",) if self.cut else ()),
            *self.models,
            "* ---- cells",
            *self.cells,
            "* ---- cell array",
            *self.row,
            "* ---- inputs and reset",
            *self.inputs,
            *self.analysis,
            ".end",
        ]
        return "\n".join(lines) + "\n"


def deck_of(
    circuit: Circuit,
    level: Level,
    *,
    duration: float,
    deviations: Deviations | None = None,
    simulation: Simulation | None = None,
    mismatch: int | None = None,
) -> Deck:
    """Write the netlist of a circuit; the same input gives the same bytes.

    ``duration`` is in units of network time, and ``mismatch`` the seed of the errors of a foundry's
    transistors. Raises `UnknownNameError` if a deviation names no parameter, and `NetworkError` if
    the level's cells do not have such an error.
    """
    off = _deviations(circuit, level, deviations) if deviations else {}
    nodes, values = Nodes(circuit), Values(circuit=circuit, deviations=off)
    chosen = simulation or simulation_for(level)
    timing = timing_of(level.technology, circuit.scaling.time, duration, chosen.points)
    cells = [cell_of(nodes, values, level, stage) for stage in range(nodes.network.stages)]
    body, instances = _instances(cells)
    curves, inner = _curves(nodes, level)
    kinds = sum((cell.kinds for cell in cells), Counter())
    used = sorted({node for cell in cells for node in cell.ports})
    library = _library(level, nodes.schematic)
    place = place_of(level, library, mismatch)
    larger = [f".param area={level.area:.9g}"] if level.area != 1 else []
    figures = [f".param {name}={value:.9g}" for name, value in sorted(level.parameters.items())]
    sources = [_source(nodes, n, timing) for n in used if n in nodes.sources]
    return Deck(
        head=_head(nodes, level),
        models=(*figures, *place.before, *library.values(), *place.behind, *larger, *curves),
        cells=body,
        row=(*instances, *_copies(nodes, level, used)),
        inputs=(*sources, *control_cards(level.technology, timing)),
        library=library,
        options=f"{place.options} {chosen.options}".strip(),
        signals=_signals(nodes),
        timing=timing,
        parts=parts_of(kinds, inner),
    )


def _source(nodes: Nodes, node: str, timing: Timing) -> str:
    """Return the card of a constant source, or of one that follows an input over time."""
    if node not in nodes.driven:
        return f"V_{node} {node} 0 {number(nodes.sources[node])}"
    source, stage, per_value = nodes.driven[node]
    waveform, scale = nodes.network.waveforms[source], nodes.network.input_scale(source)
    values = np.broadcast_to(waveform.values.T, (nodes.network.stages, len(waveform.times)))[stage]
    return pwl_card(node, waveform, per_value * scale.network(values), timing)


def _deviations(circuit: Circuit, level: Level, given: Deviations) -> dict[str, np.ndarray]:
    off = checked_deviations(circuit.parameters, given)
    for parameter in circuit.parameters:
        if parameter.kind in level.technology.without and off.pop(parameter.name, ZERO).any():
            raise NetworkError(
                f"deviation of {parameter.name}: {level.name} cells have no "
                f"{parameter.meaning}; omit it"
            )
    return off


ZERO = np.zeros(1)


def _head(nodes: Nodes, level: Level) -> Lines:
    return (
        f"* {commented(nodes.network.title)}: {counted(nodes.network.stages, 'cells')}, "
        f"{level.name} level",
        "* manual run: ngspice -b -r out.raw <this file>, or in ngspice: source, run, plot",
        *(f"* {commented(line)}" for line in str(nodes.scaling).splitlines()),
        *(
            f"*   {commented(name)} = {_in_user_units(nodes, name, sign)}"
            for name, sign in nodes.schematic.polarity.items()
        ),
    )


def _in_user_units(nodes: Nodes, name: str, sign: int) -> str:
    """Return a formula for the quantity that a node's voltage represents."""
    neurons = nodes.network.neuron_index
    scale = nodes.network.neuron(name).scale if name in neurons else IDENTITY
    per_volt = sign * scale.factor * nodes.scaling.unit[name] / nodes.scaling.full_scale
    zero = f"{scale.offset:.6g} + " if scale.offset else ""
    where = BUS if name in nodes.schematic.shared else "__<stage>"
    return f"{zero}{per_volt:.6g} * v({nodes.alias[name]}{where})"


CELLS = {
    OpAmps: ("integ", "pi_cell", "sum", "inv"),
    DifferentialPairs: ("integ_fd", "pi_cell_fd", "sum_fd", "mul4q_fd"),
    OtaC: ("ota", "ota_diff", "ota_node", "ota_pi", "ota_sum"),
    SwitchedCapacitors: ("sc_integ", "sum", "sc_branch", "sc_static", "clk2"),
}
"""Files of ``circuits/cells`` of which a technology is built."""

MODELS = {
    OpAmps: ("opamp", "mul4q", "func"),
    DifferentialPairs: ("opamp_fd", "mul4q", "func"),
    OtaC: ("mul4q", "func"),
    SwitchedCapacitors: ("opamp", "mul4q", "func"),
}
"""Files of ``circuits/models/<models>``."""


def _library(level: Level, schematic: Schematic) -> dict[str, str]:
    """Return models and cells of the library, since decks include no other file."""
    folder, built, extra = circuits_path(), type(level.technology), level.functions
    parts = schematic.parts
    diodes = ["pi_diode"] if schematic.diode_neurons else []
    models = [m for m in MODELS[built] if not (m == "func" and extra)]
    models += ["clamp"] if schematic.limited else []
    multiplied = any(isinstance(part, (Multiplier, Generator)) for part in parts)
    models += ["mul4q_base"] if diodes and multiplied and level.transistors else []
    more = CURVE_CELLS[type(extra)] if extra else ()
    cells = dict.fromkeys((*CELLS[built], *diodes, *more))
    files = (
        *(f"models/{level.models}/{model}.lib" for model in models),
        "models/switch.lib",
        *(f"cells/{cell}.cir" for cell in cells),
    )
    own = INSTEAD if level.models == PACKAGE else {}
    names = dict.fromkeys(own.get(n, on_board(n, level.parameters)) for n in files)
    if own and not multiplied:
        del names[f"models/{PACKAGE}/mul4q.lib"]  # its bias has a multiplier of its own
    library = {name: (folder / name).read_text(encoding="utf-8").rstrip() for name in names}
    if not extra:
        check_functions(schematic, library.values())
    return library


def _curves(nodes: Nodes, level: Level) -> tuple[Lines, int]:
    """Return a subcircuit per function generator built of parts, and the multipliers."""
    lines: list[str] = []
    inner = 0
    if level.functions is not None:
        for part in nodes.schematic.parts:
            if isinstance(part, Generator):
                name = f"curve_{nodes.alias[part.name]}"
                fitted = level.functions.fit(part.function, *built_range(part, nodes.scaling))
                curve = subcircuit_of(
                    name, fitted, *slopes_of(nodes.schematic, nodes.scaling, part)
                )
                lines += [curve.text.rstrip(), ""]
                inner += curve.multipliers * int(nodes.schematic.alive_at(part.name).sum())
    return tuple(lines), inner


def _instances(cells: list[CellText]) -> tuple[Lines, Lines]:
    """Return subcircuits of the distinct cells, and a card for every cell."""
    groups: dict[tuple, list[CellText]] = {}
    for cell in cells:
        groups.setdefault(cell.shape, []).append(cell)
    body: list[str] = []
    instances: list[str] = []
    for position, members in enumerate(groups.values()):
        name = f"cell_{position}"
        body += members[0].subcircuit(name)
        instances += [m.instance(f"X_cell_{m.stage}", name, members[0]) for m in members]
    return tuple(body), tuple(instances)


def _copies(nodes: Nodes, level: Level, used: list[str]) -> Lines:
    """Return cards of missing negative outputs of parts in a differential circuit."""
    if not level.technology.differential:
        return ()
    both = isinstance(level.technology, DifferentialPairs)
    native = {Integrator, PICell, Adder, Multiplier} if both else set()
    kinds = {nodes.alias[part.name]: type(part) for part in nodes.schematic.parts}
    lines = [
        f"E_{node} {node} 0 {node.removesuffix(NEGATIVE)} 0 -1"
        for node in used
        if node.endswith(NEGATIVE)
        and not node.startswith(SOURCE)
        and kinds[node.split("__")[0]] not in native
    ]
    return ("* negative copies of a differential circuit", *lines) if lines else ()


def _signals(nodes: Nodes) -> dict[tuple[str, int], str]:
    return {
        (name, stage): nodes.own(name, stage)
        for name in nodes.schematic.polarity
        for stage in range(nodes.network.stages)
        if nodes.schematic.alive(name, stage) and (name, stage) not in nodes.schematic.pins
    }
