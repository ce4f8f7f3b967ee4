"""Models of parts as they are on a board: in which files, and what their parameters are.

A file of ``circuits/models/board`` stands in for the one of its name where a parasitic asks for it;
a circuit without parasitics has the same netlist as ever.
"""

from __future__ import annotations

from pathlib import PurePosixPath

from ann_dc.hardware.parts.parasitics import NONE, Parasitics

PASSIVES = {
    "cap_leakage": ("capacitor_leakage", 1e9),
    "switch_leakage": ("switch_leakage", 1e12),
    "switch_capacitance": ("switch_capacitance", 0.0),
    "switch_charge": ("switch_charge", 0.0),
}
"""Parameters of cells that hold something: the attribute of `Parasitics`, what stands for none."""

MULTIPLIERS = {
    "mul_nonlinearity": ("multiplier_nonlinearity", 0.0),
    "mul_feedthrough": ("multiplier_feedthrough", 0.0),
    "mul_capacitance": ("multiplier_capacitance", 0.0),
}
"""The same of multipliers as macro models."""

HOLDING = "integ.cir", "pi_cell.cir", "pi_diode.cir", "integ_fd.cir", "pi_cell_fd.cir"
"""Cells that hold something."""

FILES = {
    **dict.fromkeys(("switch.lib", *HOLDING), tuple(PASSIVES)),
    **dict.fromkeys(("mul4q.lib", "mul4q_fd.cir"), tuple(MULTIPLIERS)),
}
"""Files of ``circuits/models/board``, and the parameters that ask for them."""


def board_parameters(parasitics: Parasitics, models: str) -> dict[str, float]:
    """Values of the global parameters of all files that parasitics ask for.

    Parameters
    ----------
    parasitics : Parasitics
    models : str
        Folder of the op amps and multipliers: only those of ``macro`` have a file for a board.

    Examples
    --------
    >>> board_parameters(Parasitics(switch_charge=5e-12), "macro")["switch_leakage"]
    1000000000000.0
    >>> board_parameters(Parasitics(), "macro")
    {}
    """
    found: dict[str, float] = {}
    for table in (PASSIVES, MULTIPLIERS) if models == "macro" else (PASSIVES,):
        if any(getattr(parasitics, name) != getattr(NONE, name) for name, _ in table.values()):
            for parameter, (name, none) in table.items():
                value = float(getattr(parasitics, name))
                found[parameter] = none if value == getattr(NONE, name) else value
    return found


def on_board(file: str, parameters: dict[str, float]) -> str:
    """The file that stands in for one of ``circuits``, or that one.

    Parameters
    ----------
    file : str
        Below ``circuits``.
    parameters : dict of str to float
        Of `board_parameters`.

    Examples
    --------
    >>> on_board("cells/integ.cir", {"cap_leakage": 1e4})
    'models/board/integ.cir'
    """
    name = PurePosixPath(file).name
    asked = any(parameter in parameters for parameter in FILES.get(name, ()))
    return f"models/board/{name}" if asked else file
