"""Text files of the C99 and SystemVerilog exports, from the texts in the folder ``texts``.

A word between @ signs in a text is the name of a value.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from importlib import resources

from ann_dc.export.fixed_point.golden import LEAST, WRONG, FixedPoint, Port


def written(
    language: str, network: FixedPoint, names: Sequence[str], values: Mapping[str, object]
) -> dict[str, bytes]:
    """Return the named texts of a language; names in them begin with the network's prefix."""
    given = {**_facts(network), **values}
    for part in ("inputs", "words"):
        given[f"about_{part}"] = _filled(f"{part}.md", given).rstrip()
    texts = {name: _filled(f"{language}/{name}", given) for name in names}
    prefix = network.prefix
    return {_named(name, prefix): _named(text, prefix).encode() for name, text in texts.items()}


def _filled(name: str, values: Mapping[str, object]) -> str:
    place = resources.files("ann_dc.export.fixed_point") / "texts" / name
    text = place.read_text(encoding="utf-8")
    return re.sub(r"@(\w+)@", lambda found: str(values[found[1]]), text)


def _named(text: str, prefix: str) -> str:
    small = re.sub(r"\bann_dc_", f"{prefix}_", text)
    return re.sub(r"\bANN_DC_", f"{prefix.upper()}_", small)


def _facts(network: FixedPoint) -> dict[str, object]:
    """Return the values that the texts of both languages contain."""
    machine = network.machine
    own = "Inputs without a range had the values of the exported network."
    return {
        "title": plain(network.title),
        "wiring": plain(network.wiring),
        "content": plain(network.content),
        "covers": plain(network.covers),
        "worth": plain(network.worth.removeprefix("words chosen for "), "%;"),
        "own": own if network.ranges else "Set ranges with `over=`, or design with `--range`.",
        "wrong": f"{WRONG * network.accuracy:g}",
        "least": f"{LEAST:g}",
        "bits": machine.bits,
        "guard": machine.guard,
        "wide": machine.wide,
        "period": machine.period,
        "words": len(machine.words),
        "neurons": len(machine.neurons),
        "operations": len(machine.operations),
        "vectors": len(network.vectors),
        "steps": network.steps,
        "limit": network.limit,
        "error": f"{network.error:.1e}",
        "input_rows": _port_rows(network, network.inputs),
        "control_rows": _port_rows(network, network.controls),
        "held_rows": "\n".join(
            f"| {index} | {plain(port.name)} | {low:.12g} | {high:.12g} |"
            for index, port in enumerate(network.inputs)
            for low, high in [network.held(port)]
        ),
    }


def _port_rows(network: FixedPoint, ports: Sequence[Port]) -> str:
    """Return Markdown rows of ports: number, name, fraction bits, factor and offset."""
    return "\n".join(
        f"| {index} | {plain(port.name)} | {network.fraction[port.words[0]]} "
        f"| {port.scale.factor!r} | {port.scale.offset!r} |"
        for index, port in enumerate(ports)
    )


def plain(text: str, more: str = "") -> str:
    """Return text that cannot end a comment: letters, digits, a few marks and those in ``more``."""
    return re.sub(rf"[^A-Za-z0-9_.,:()\[\] =+{more}-]", " ", text)
