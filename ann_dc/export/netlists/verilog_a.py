"""Verilog-A export: the behavioural deck, card by card, as modules of equal names.

A cell of the cell array is a module with its resistors and capacitors as parameters; the network is
a module of cells. The modules have not been run in a simulator. OpenVAF, a compiler of compact
models, accepts the text and drops all instances.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from ann_dc.backends.spice.netlist.timing import reset_card
from ann_dc.errors import ExportError
from ann_dc.export.netlists.build import Build, build
from ann_dc.export.netlists.flat_reader import logical_lines
from ann_dc.export.netlists.pack import accuracy_text, claims_of, expected_text, plain, scaling_text
from ann_dc.export.netlists.verilog_library import LIBRARY, module_text
from ann_dc.export.reference.contents import README, with_sums
from ann_dc.export.reference.sidecar import check_vector
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.network.functions import CODE
from ann_dc.network.network import Network
from ann_dc.si_prefixes import counted
from ann_dc.validation import checked

MODULES, LEVEL = "network.va", "behavioural"
GROUND = "gnd"
REFERENCE = f"  electrical {GROUND};\n  ground {GROUND};"

KEYWORDS = frozenset(
    re.findall(
        r"\w+",
        """
        abs abstol access acos acosh ac_stim analog analysis and asin asinh assign atan atan2 atanh
        begin branch case cos cosh cross ddt ddx default delay discipline domain electrical else
        end endcase endfunction endmodule exclude exp flicker_noise flow for forever from function
        generate ground hypot idt idtmod if inf initial inout input integer laplace_nd
        last_crossing limexp ln log max min module nature negedge net noise_table not or output
        parameter posedge potential pow real reg repeat signed sin sinh slew sqrt string table tan
        tanh time timer transition units vt white_noise while wire
        """,
    )
)
"""Reserved words that are not permitted as node names."""


@checked
def verilog_a_files(
    network: Network, vector: ReferenceVector, *, series: str = "exact"
) -> dict[str, bytes]:
    """Export a circuit as Verilog-A modules at the behavioural level.

    The modules have not been run in a simulator. The resistor ``series`` is that of `pack_files`.
    The files are 'network.va', 'scaling.csv', 'expected_controls.csv', 'README.md',
    'reference_vector.json' and ``SHA256SUMS``.

    Raises `ExportError` with the reason if the network cannot be built at the behavioural level,
    and `UnknownNameError` for an unknown series.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> problem = ann_dc.plants.double_integrator(N=3)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> files = verilog_a_files(network, reference_vector(network))
    >>> files["network.va"].count(b"endmodule")
    7
    """
    check_vector(network, vector)
    made = build(network, LEVEL, series, vector.duration)
    texts = {
        MODULES: _text(made),
        "scaling.csv": scaling_text(made),
        "expected_controls.csv": expected_text(made),
        README: _readme(made),
    }
    files = {name: text.encode() for name, text in texts.items()}
    return with_sums({**files, VECTOR: vector.as_json()})


def _text(made: Build) -> str:
    deck = made.deck
    cells = [*_cells(logical_lines("\n".join(deck.cells), {}))]
    network = _network(made, logical_lines("\n".join((*deck.row, *deck.inputs)), {}))
    own = "\n".join((*cells, network))
    placed = {*re.findall(r"^  (\w+) ", own, re.MULTILINE)}
    names = [name for name in (*LIBRARY, *(f"func_{name}" for name in CODE)) if name in placed]
    used = [text for name in names if (text := module_text(name))]
    head = (
        f"// {plain(made.network.title)}: {counted(made.network.stages, 'cells')}, {LEVEL} level\n"
        + "".join(f"// {words}\n" for words in claims_of(made))
        + '`include "constants.vams"\n`include "disciplines.vams"\n'
    )
    return "\n".join((head, *used, own))


def _identifier(node: str) -> str:
    if node == "0":
        return GROUND
    return node + "_" if node in KEYWORDS else node


def _cells(lines: Iterator[str]) -> Iterator[str]:
    """Yield a module for every subcircuit."""
    head: list[str] = []
    body: list[list[str]] = []
    for line in lines:
        words = line.split()
        if words[0] == ".subckt":
            head, body = words, []
        elif words[0] == ".ends":
            yield _cell(head, body)
        else:
            body.append(words)


def _cell(head: list[str], cards: list[list[str]]) -> str:
    place = head.index("params:")
    ports = [_identifier(port) for port in head[2:place]]
    given = dict(word.split("=") for word in head[place + 1 :])
    resistors = [card for card in cards if card[0].startswith("r")]
    instances = [*_instances([card for card in cards if card[0].startswith("x")])]
    ends = [_identifier(node) for card in resistors for node in card[1:3]]
    inside = sorted({*ends, *(net for _, _, nets, _ in instances for net in nets)} - {*ports})
    lines = [
        _head(head[1], ports),
        _declared("electrical", [*ports, *(node for node in inside if node != GROUND)]),
        REFERENCE,
        *(f"  parameter real {name} = {value};" for name, value in given.items()),
        *(_instance(*instance) for instance in instances),
        "  analog begin",
        *(_resistor(card) for card in resistors),
        "  end",
        "endmodule\n",
    ]
    return "\n".join(lines)


def _head(name: str, ports: list[str]) -> str:
    return _wrapped(f"module {name}({', '.join(ports)});") + "\n" + _declared("inout", ports)


def _declared(kind: str, names: list[str]) -> str:
    return _wrapped(f"  {kind} {', '.join(names)};")


def _wrapped(line: str) -> str:
    rows, row = [], ""
    for word in line.split(" "):
        if len(row) + len(word) > 98:
            rows.append(row)
            row = "   "
        row = f"{row} {word}" if row else word
    return "\n".join([*rows, row]) if line[:1] != " " else _indented(rows, row)


def _indented(rows: list[str], row: str) -> str:
    first, *more = [*rows, row]
    return "\n".join([f"  {first.strip()}", *more])


def _resistor(card: list[str]) -> str:
    source, summing, ohms = _identifier(card[1]), _identifier(card[2]), card[3].strip("{}")
    return f"    I({source}, {summing}) <+ V({source}, {summing}) / {ohms};"


Instance = tuple[str, str, tuple[str, ...], dict[str, str]]
"""Module, name, nets, parameters."""

CLAMPS = ("clamp_low", "clamp_high")


def _instances(cards: list[list[str]]) -> Iterator[Instance]:
    """Yield subcircuit cards as instances; an integrator and its limits are one."""
    rails: dict[tuple[str, ...], dict[str, str]] = {}
    for card in cards:
        module, nets, given = _read(card)
        if module in CLAMPS:
            rails.setdefault(nets, {}).update(given)
    for card in cards:
        module, nets, given = _read(card)
        if module in CLAMPS:
            continue
        if nets[:2] in rails:
            module, given = "integ_railed", given | rails[nets[:2]]
        if module_text(module) is None:
            raise ExportError(f"verilog-a: {card[0]} is a {module}, which has no module")
        yield module, card[0], nets, given


def _read(card: list[str]) -> tuple[str, tuple[str, ...], dict[str, str]]:
    names = [word for word in card[1:] if "=" not in word]
    given = dict(word.split("=", 1) for word in card[1:] if "=" in word)
    nets = tuple(_identifier(node) for node in names[:-1])
    return names[-1], nets, {name: value.strip("{}") for name, value in given.items()}


def _instance(module: str, name: str, nets: tuple[str, ...], given: Mapping[str, str]) -> str:
    values = ", ".join(f".{key}({value})" for key, value in given.items())
    parameters = f"#({values}) " if given else ""
    return _wrapped(f"  {module} {parameters}{name} ({', '.join(nets)});")


def _network(made: Build, lines: Iterator[str]) -> str:
    """Return the module of the cell array: its cells and the constants that they read."""
    ports = ["rst", *(_identifier(reading.node) for reading in made.controls)]
    instances: list[str] = []
    constants: list[tuple[str, str]] = []
    nodes: dict[str, None] = {}
    for line in lines:
        words = line.split()
        if words[0].startswith("x"):
            module, nets, given = _read(words)
            instances.append(_instance(module, words[0], nets, given))
            nodes.update(dict.fromkeys(nets))
        elif words[0] != "v_rst":
            constants.append((_identifier(words[1]), words[3]))
    inside = [node for node in nodes if node not in (*ports, GROUND)]
    lines_out = [
        _head("network", ports),
        _declared("electrical", [*ports, *inside]),
        REFERENCE,
        *instances,
        "  analog begin",
        *(f"    V({node}) <+ {volts};" for node, volts in constants),
        "  end",
        "endmodule\n",
    ]
    return "\n".join(lines_out)


def _readme(made: Build) -> str:
    timing, first = made.deck.timing, made.controls[0]
    value = made.final(first)
    cells = counted(made.network.stages, "cells")
    return f"""# {plain(made.network.title)}: Verilog-A modules of {cells}

{accuracy_text(made)}

`{MODULES}` has the module `network` of cells, each of integrators, PI cells, multipliers and
function generators. Resistors in ohms, capacitors in farads, presets in volts are parameters
with the names that they have in the SPICE decks; `scaling.csv` has the value of a volt.

Ports of `network`: `rst`, which holds the circuit at its start while it is above 2.5 V, and the
controls. For the run that is expected here drive it like this, and wait until {timing.end:.4g} s:

    {reset_card(timing.release)}

`expected_controls.csv` has the controls at the end: {plain(first.name)} of stage
{first.stage} is {value:.6g}, {first.scale.network(value):.6g} V at `{first.node}`.

**No simulator has run this file.** It uses `idt` with a condition, branches to ground, and modules
within modules, as the Verilog-AMS manual has them: use a simulator of Verilog-AMS that elaborates
instances. **Do not compile it as a compact model:** OpenVAF (openvaf-py 0.1.5) accepts it without a
word and drops every instance, so that `network` has no equation that couples its nodes. The export
`onnx`, or `manifest.json` of the export `weights`, has the equations without hierarchy.
"""
