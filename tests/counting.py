"""Parts of a netlist, counted from its text: for tests of decks and of costs."""

from collections import Counter

from ann_dc.hardware.circuit.cost import (
    CAPACITOR,
    GENERATOR,
    MULTIPLIER,
    OP_AMP,
    OTA,
    RESISTOR,
    SWITCH,
)

LEAVES = {
    **dict.fromkeys(("opamp", "opamp_fd"), OP_AMP),
    **dict.fromkeys(("ota", "ota_diff"), OTA),
    **dict.fromkeys(("mul4q", "mul4q_fd"), MULTIPLIER),
}
"""Subcircuits that are bought as one."""


def cards_of(text: str) -> dict[str, list[list[str]]]:
    """Words of the elements of every subcircuit, and of the top level under ``""``."""
    cards: dict[str, list[list[str]]] = {"": []}
    place = ""
    for line in text.lower().replace("\n+ ", " ").splitlines()[1:]:
        words = [word for word in line.split() if "=" not in word]
        if line.startswith(".subckt"):
            place = words[1]
            cards[place] = []
        elif line.startswith(".ends"):
            place = ""
        elif line[:1] in "xrcs" and words:
            cards[place].append(words)
    return cards


def counted(text: str) -> dict[str, int]:
    """Parts of a netlist, from its top down to elements; it knows nothing of cells by name.

    Not bought: reset switches and their presets (0.1 ohm), output resistances that a model has
    (ro), and stray capacitances (cov).
    """
    cards = cards_of(text)

    def of(name: str) -> Counter:
        return sum((element(words) for words in cards[name]), Counter())

    def element(words: list[str]) -> Counter:
        if words[0][0] == "x":
            kind = words[-1]
            leaf = GENERATOR if kind.startswith("func_") else LEAVES.get(kind)
            return Counter({leaf: 1}) if leaf else of(kind)
        return Counter(
            {
                "r": {RESISTOR: int(words[-1] not in ("0.1", "{ro}"))},
                "c": {CAPACITOR: int(words[-1] != "{cov}")},
                "s": {SWITCH: int("sc_switch" in words)},
            }[words[0][0]]
        )

    return {part: count for part, count in of("").items() if count}
