"""Cost of a netlist: numbers of op amps, multipliers and resistors, and power."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from ann_dc.hardware.parts.datasheet import Datasheet
from ann_dc.validation import FloatOrNan, checked

OP_AMP, OTA, MULTIPLIER = "op amps", "transconductors", "multipliers"
INNER = "multipliers in generators"
GENERATOR, RESISTOR, CAPACITOR = "function generators", "resistors", "capacitors"
SWITCH = "switches"
NEGATIVE = "negative resistances"

PARTS: Mapping[str, Mapping[str, int]] = {
    "resistor": {RESISTOR: 1},
    "function": {GENERATOR: 1},
    "integ": {OP_AMP: 1, CAPACITOR: 1},
    "pi_cell": {OP_AMP: 1, RESISTOR: 1, CAPACITOR: 1},
    "pi_diode": {OP_AMP: 1, RESISTOR: 2, CAPACITOR: 1},
    "clamp_low": {OP_AMP: 1, RESISTOR: 3, CAPACITOR: 1},
    "clamp_high": {OP_AMP: 1, RESISTOR: 3, CAPACITOR: 1},
    "sum": {OP_AMP: 1, RESISTOR: 1},
    "inv": {OP_AMP: 1, RESISTOR: 2},
    "mul4q": {MULTIPLIER: 1},
    "mul4q_base": {},
    "integ_fd": {OP_AMP: 1, CAPACITOR: 2},
    "pi_cell_fd": {OP_AMP: 1, RESISTOR: 2, CAPACITOR: 2},
    "sum_fd": {OP_AMP: 1, RESISTOR: 2},
    "mul4q_fd": {MULTIPLIER: 1},
    "ota": {OTA: 1},
    "ota_diff": {OTA: 1},
    "ota_node": {CAPACITOR: 1},
    "ota_pi": {RESISTOR: 1, CAPACITOR: 1},
    "ota_sum": {RESISTOR: 1},
    "sc_integ": {OP_AMP: 1, CAPACITOR: 1},
    "sc_branch": {SWITCH: 4, CAPACITOR: 1},
    "sc_static": {CAPACITOR: 1},
    "breakpoint": {OP_AMP: 1, RESISTOR: 2},
    "capacitor": {CAPACITOR: 1},
    "follower": {OP_AMP: 1},
    "negative": {NEGATIVE: 1},
}
"""Parts of every cell of ``circuits/cells``, without reset switches."""


def parts_of(cards: Mapping[str, int], inner: int = 0) -> dict[str, int]:
    """Return the number of parts of a netlist; absent parts are omitted.

    ``cards`` maps the cells of ``circuits/cells`` to their number in the netlist. ``inner`` is the
    number of multipliers inside function generators.
    """
    total: Counter[str] = Counter({INNER: inner})
    for kind, count in cards.items():
        for part, each in PARTS[kind].items():
            total[part] += count * each
    order = (OP_AMP, OTA, MULTIPLIER, GENERATOR, INNER, RESISTOR, NEGATIVE, CAPACITOR, SWITCH)
    return {part: total[part] for part in order if total[part]}


@dataclass(frozen=True, kw_only=True)
class Cost:
    """Cost of a circuit.

    ``parts`` are numbers of parts by kind, see `parts_of`, and ``settling`` is in seconds per
    solve. The ``power`` at rest in watts is that of op amps with their loads and of multipliers;
    nan if the level has no power data. ``loads`` is the part of it that supplies the loads.
    """

    parts: Mapping[str, int]
    power: float
    settling: float
    loads: float = 0.0

    @property
    def energy(self) -> float:
        """Energy per solve in joules."""
        return self.power * self.settling


@checked
def cost_of(
    parts: Mapping[str, int], datasheet: Datasheet, settling: FloatOrNan, loads: float = 0.0
) -> Cost:
    """Return the power and energy of a circuit at rest.

    A function generator counts as its multipliers, or as `GENERATOR_MULTIPLIERS` if the level does
    not specify them. ``settling`` is in seconds per solve. ``loads`` is the power of the op-amp
    loads in watts, see `load_power`.
    """
    inner = parts.get(INNER, GENERATOR_MULTIPLIERS * parts.get(GENERATOR, 0))
    multipliers = parts.get(MULTIPLIER, 0) + inner
    amplifiers = parts.get(OP_AMP, 0)
    power = amplifiers * datasheet.amplifier_power
    if multipliers:
        power += multipliers * datasheet.multiplier_power
    return Cost(parts=parts, power=power + loads, settling=settling, loads=loads)


GENERATOR_MULTIPLIERS = 5
"""Assumed number of multipliers of a function generator: sin and cos use 4, tan 6."""
