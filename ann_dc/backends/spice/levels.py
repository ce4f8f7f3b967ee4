"""The ladder: the same netlist, other models. A level says which files, with which numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ann_dc.errors import NetworkError
from ann_dc.resources import circuits_path


@dataclass(frozen=True, kw_only=True, eq=False)
class Level:
    """A rung of the ladder.

    Attributes
    ----------
    name : str
    models : str
        Folder of ``circuits/models`` that holds `opamp`, `mul4q` and the function generators.
    parameters : mapping of str to float
        Values of the models' global parameters.
    gbw : float
        Gain-bandwidth of the op amps in Hz: what network time is scaled by.
    """

    name: str
    models: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    gbw: float = 10e6

    def text(self) -> str:
        """Parameters, models and cells as SPICE text: decks need no other file."""
        folder = circuits_path()
        lines = [f".param {name}={value:.9g}" for name, value in sorted(self.parameters.items())]
        files = [
            *sorted((folder / "models" / self.models).glob("*.lib")),
            folder / "models" / "switch.lib",
            *(folder / "cells" / f"{cell}.cir" for cell in CELLS),
        ]
        return "\n".join([*lines, *(file.read_text(encoding="utf-8").rstrip() for file in files)])


CELLS = ("integ", "pi_cell", "sum", "inv")
"""Cells that a generated netlist is made of."""

BEHAVIOURAL = Level(name="behavioural", models="ideal")
"""Ideal op amps, multipliers and function generators."""


def macro(
    *,
    a0: float = 1e6,
    gbw: float = 10e6,
    slew: float = 1e9,
    rails: float = 15.0,
    rout: float = 1e-3,
    multiplier_bandwidth: float = 1e9,
    function_bandwidth: float = 1e9,
) -> Level:
    """Op-amp macro models.

    Parameters
    ----------
    a0 : float
        Open-loop gain.
    gbw : float
        Gain-bandwidth product in Hz.
    slew : float
        Slew rate in V/s.
    rails : float
        Output saturation in volts.
    rout : float
        Output resistance in ohms.
    multiplier_bandwidth, function_bandwidth : float
        In Hz.
    """
    given = {
        "opamp_a0": a0,
        "opamp_gbw": gbw,
        "opamp_sr": slew,
        "opamp_vsat": rails,
        "opamp_rout": rout,
        "mul_bw": multiplier_bandwidth,
        "mul_vsat": rails,
        "func_bw": function_bandwidth,
    }
    for name, value in given.items():
        if not 0 < value < float("inf"):
            raise NetworkError(f"{name}: expected a positive number, got {value!r}")
    return Level(name="macro", models="macro", parameters=given, gbw=gbw)
