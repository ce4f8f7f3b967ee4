r"""Estimate of the chip area: transistors, polysilicon resistors, metal capacitors.

.. math:: A = f \sum_{MOS} m W L + n_{npn} A_{npn} + \sum_R \frac{R}{R_s} w (w + s)
    + \sum_C \frac{C}{C_a} ,

where f accounts for sources and drains, wells, contacts and wires of MOS transistors. The area of a
bipolar transistor includes all of these. No layout is drawn.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ann_dc.backends.spice.ngspice.expressions import value_of
from ann_dc.backends.spice.pdk.devices import Device, device_cards
from ann_dc.errors import FileFormatError
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.cost import INNER, MULTIPLIER, OP_AMP
from ann_dc.hardware.schematic.elements import Adder, Integrator, PICell
from ann_dc.hardware.schematic.schematic import Schematic
from ann_dc.validation import checked

SHEET = 2000.0
"""Sheet resistance of the poly resistors in ohms per square, ``rsheet`` of the PDK's
``res_xhigh_po``.
"""

WIDTH, SPACE = 2.0, 0.5
"""Width of a resistor, so that 100 kohm match to 0.25 %, and space to the next one, in micrometres.
"""

DENSITY = 2e-15
"""Metal-on-metal capacitance in farads per square micrometre, ``camimc`` of the PDK's typical
corner.
"""

BIPOLAR = 49.0
"""Area of the smallest bipolar transistor with its wells in square micrometres, about 7 um a side.
"""

ROUTING = 3.0
"""Area of a MOS transistor on the chip relative to that of its gate."""

SUBCIRCUIT = re.compile(r"^\.subckt (\w+)(.*?)\n(.*?)^\.ends", re.MULTILINE | re.DOTALL)
DEFAULT = re.compile(r"(\w+)=(\S+)")
PASSIVE = re.compile(r"^([RC])\S* +\S+ +\S+ +(\{.*\}|\S+) *$", re.MULTILINE | re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class Area:
    """Areas of a chip by component type, in square micrometres."""

    transistors: float
    resistors: float
    capacitors: float

    @property
    def total(self) -> float:
        """Total area."""
        return self.transistors + self.resistors + self.capacitors


@checked
def area_of(circuit: Circuit, parts: Mapping[str, int], library: Mapping[str, str]) -> Area:
    """Estimate the area of a circuit whose transistors are those of the PDK.

    ``parts`` is ``Deck.parts`` of the netlist, and ``library`` is ``Deck.library``, the files of
    its cells. The estimate excludes pads and the bias and references common to all parts. Raises
    `FileFormatError` if a value in a cell is not a number.
    """
    bodies = {found[1]: found for text in library.values() for found in SUBCIRCUIT.finditer(text)}
    cells = Counter({"opamp": parts[OP_AMP]})
    cells["mul4q"] = parts.get(MULTIPLIER, 0) + parts.get(INNER, 0)
    cells["mul_opamp"] = cells["mul4q"]
    cells["reset_gate"] = sum(int((c > 0).sum()) for c in circuit.capacitors.values())
    cells["pi_diode"] = _diode_neurons(circuit.schematic)
    total = sum(
        (n * _inside(*bodies[name].groups()) for name, n in cells.items() if n), np.zeros(3)
    )
    return Area(
        transistors=float(total[0]),
        resistors=float((total[1] + _resistance(circuit)) / SHEET * WIDTH * (WIDTH + SPACE)),
        capacitors=float((total[2] + sum(c.sum() for c in circuit.capacitors.values())) / DENSITY),
    )


def _inside(name: str, declared: str, body: str) -> np.ndarray:
    """Return transistor area (square micrometres), ohms and farads of a subcircuit."""
    defaults = {key: value_of(value, {}) for key, value in DEFAULT.findall(declared.lower())}
    values = {"r": 0.0, "c": 0.0}
    for kind, value in PASSIVE.findall(body):
        try:
            values[kind.lower()] += value_of(value.lower(), defaults)
        except FileFormatError as error:
            raise FileFormatError(f"subcircuit {name}: {error}") from error
    transistors = sum(count * _square(device) for device, count in device_cards(body))
    return np.array([transistors, values["r"], values["c"]])


def _square(device: Device) -> float:
    return ROUTING * device.width * device.length if device.binned else BIPOLAR


def _diode_neurons(schematic: Schematic) -> int:
    return sum(int(schematic.alive_at(name).sum()) for name in schematic.diode_neurons)


def _resistance(circuit: Circuit) -> float:
    """Return the sum of all resistances of a circuit in ohms, including inverters."""
    schematic = circuit.schematic
    total = sum(float(r[np.isfinite(r)].sum()) for r in circuit.resistors.values())
    for part in schematic.parts:
        alive = int(schematic.alive_at(part.name).sum())
        if isinstance(part, (Adder, PICell, Integrator)):
            total += alive * circuit.feedback.get(part.name, 0.0)
        if part.name in schematic.inverted:
            total += 2 * alive * circuit.inverter
    return total
