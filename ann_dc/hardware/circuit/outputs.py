"""What loads do at outputs: to the gain and the pole of op amps, to what multipliers give."""

from __future__ import annotations

import math

import numpy as np

from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.loads import drawn_of, loads_of, moving_load
from ann_dc.hardware.parts.levels import Level


class Outputs:
    """The outputs of a circuit's parts, with what they drive.

    Parameters
    ----------
    circuit : Circuit
    level : Level
        What its parts are like.

    Attributes
    ----------
    omega : float
        Gain-bandwidth of its op amps, in radians per unit of network time.
    """

    def __init__(self, circuit: Circuit, level: Level) -> None:
        sheet = level.datasheet
        self.circuit, self.datasheet, self.law = circuit, sheet, sheet.multiplier_law
        self.omega = 2 * math.pi * sheet.gbw * circuit.scaling.time
        loaded = sheet.rout or sheet.stage_resistance or self.law.output_resistance
        self._loads = loads_of(circuit) if loaded else {}
        self._drawn = drawn_of(circuit, level.functions) if self.law.input_current else {}
        self._none = np.zeros(circuit.schematic.network.stages)

    def gain(self, part: str, inverter: bool = False) -> np.ndarray:
        """Open-loop gain (N,) of an op amp into what it drives at rest.

        Parameters
        ----------
        part : str
        inverter : bool
            Whether the inverter behind it is meant.
        """
        return self.datasheet.a0 / (1 + self._ohms * self._load(part, inverter))

    def lag(self, part: str, inverter: bool = False) -> np.ndarray:
        """1 / Omega (N,), Omega being smaller by what an op amp drives while it moves.

        Parameters
        ----------
        part : str
        inverter : bool
            Whether the inverter behind it is meant.
        """
        more = 0.0 if inverter else moving_load(self.circuit, part)
        return (1 + self.datasheet.rout * (self._load(part, inverter) + more)) / self.omega

    def offset(self, part: str, inverter: bool = False) -> np.ndarray:
        """Volts (N,) at an op amp's input: its own, and what multipliers draw from its output.

        Parameters
        ----------
        part : str
        inverter : bool
            Whether the inverter behind it is meant: multipliers read the part itself.
        """
        drawn = self._none if inverter else self._amperes(part)
        return self.datasheet.systematic_offset - self._ohms * drawn / self.datasheet.a0

    def passed(self, part: str) -> tuple[np.ndarray, np.ndarray]:
        """Share (N,) of a multiplier's output that its load leaves, and volts (N,) added to it.

        Parameters
        ----------
        part : str
        """
        ohms = self.law.output_resistance
        return 1 / (1 + ohms * self._load(part, False)), -ohms * self._amperes(part)

    @property
    def _ohms(self) -> float:
        return self.datasheet.rout + self.datasheet.stage_resistance

    def _load(self, part: str, inverter: bool) -> np.ndarray:
        return self._loads.get((part, inverter), self._none)

    def _amperes(self, part: str) -> np.ndarray:
        return self.law.input_current * self._drawn.get(part, self._none)
