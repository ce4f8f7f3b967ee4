"""Board models of parts: model files and their parameters.

A file of ``circuits/models/board`` replaces the file of equal name if a parasitic requires it. The
netlist of a circuit without parasitics does not change.
"""

from __future__ import annotations

import math
from pathlib import PurePosixPath

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts.datasheet import Datasheet
from ann_dc.hardware.parts.parasitics import NONE, Parasitics
from ann_dc.hardware.parts.technologies import Technology

MACRO_PARAMETERS = {
    "opamp_a0": ("a0", 1.0, 1e8),
    "opamp_gbw": ("gbw", 1.0, 1e12),
    "opamp_sr": ("slew", 1.0, 1e11),
    "opamp_vsat": ("output_swing", 1e-3, 1e3),
    "opamp_rout": ("rout", 1e-3, 1e6),
    "mul_bw": ("multiplier_bandwidth", 1.0, 1e11),
    "mul_vsat": ("multiplier_output_swing", 1e-3, 1e3),
    "func_bw": ("function_bandwidth", 1.0, 1e11),
}
"""Parameters of the macro models: attribute of `Datasheet` and supported range."""

IDEAL = {"opamp_a0": 1e8, "opamp_sr": 1e9, "opamp_rout": 1e-3, "mul_bw": 1e9, "func_bw": 1e9}
"""Values that represent infinity, or none, without visible effect; limits are 15 full scales."""

OP_AMPS = {
    "opamp_cin": ("ground", 1e-18),
    "opamp_ib": ("bias_current", 0.0),
    "opamp_pole2": ("second_pole", 1e12),
    "opamp_imax": ("output_current", 1e3),
}
"""Parameters of op amps on a board: attribute of `Parasitics`, value that denotes none."""

PASSIVES = {
    "cap_leakage": ("capacitor_leakage", 1e9),
    "switch_leakage": ("switch_leakage", 1e12),
    "switch_capacitance": ("switch_capacitance", 0.0),
    "switch_charge": ("switch_charge", 0.0),
}
"""Parameters of cells with a capacitor: attribute of `Parasitics`, value that denotes none."""

MULTIPLIERS = {
    "mul_nonlinearity": ("multiplier_nonlinearity", 0.0),
    "mul_feedthrough": ("multiplier_feedthrough", 0.0),
    "mul_capacitance": ("multiplier_capacitance", 0.0),
}
"""Parameters of macro-model multipliers: attribute of `Parasitics`, value that denotes none."""

BUILT = (
    *("input_capacitance", "stray_capacitance", "second_pole", "bias_current", "output_current"),
    *(attribute for attribute, _ in MULTIPLIERS.values()),
)
"""Parasitics that only netlists of macro models support."""

HOLDING = "integ.cir", "pi_cell.cir", "pi_diode.cir", "integ_fd.cir", "pi_cell_fd.cir"
"""Cells with a capacitor."""

FILES = {
    **dict.fromkeys(("opamp.lib", "opamp_fd.lib"), tuple(OP_AMPS)),
    **dict.fromkeys(("switch.lib", *HOLDING), tuple(PASSIVES)),
    **dict.fromkeys(("mul4q.lib", "mul4q_fd.cir"), tuple(MULTIPLIERS)),
}
"""Files of ``circuits/models/board`` and the parameters that require them."""


def model_parameters(parasitics: Parasitics, models: str) -> dict[str, float]:
    """Return the global parameters of all files that parasitics require.

    ``models`` is the folder of op amps and multipliers; only those of ``macro`` have board files.

    Examples
    --------
    >>> model_parameters(Parasitics(switch_charge=5e-12), "macro")["switch_leakage"]
    1000000000000.0
    >>> model_parameters(Parasitics(), "macro")
    {}
    """
    found = {}
    for table in (OP_AMPS, PASSIVES, MULTIPLIERS) if models == "macro" else (PASSIVES,):
        if any(getattr(parasitics, name) != getattr(NONE, name) for name, _ in table.values()):
            for parameter, (name, none) in table.items():
                value = float(getattr(parasitics, name))
                found[parameter] = none if value == getattr(NONE, name) else value
    return found


def macro_parameters(datasheet: Datasheet, full_scale: float) -> dict[str, float]:
    """Return the global parameters of macro models; ``full_scale`` is in volts."""
    ideal = IDEAL | dict.fromkeys(("opamp_vsat", "mul_vsat"), 15.0 * full_scale)
    given = {n: float(getattr(datasheet, a)) for n, (a, *_) in MACRO_PARAMETERS.items()}
    return {n: ideal[n] if v in (0.0, math.inf) else v for n, v in given.items()}


def op_amp_output_swing(datasheet: Datasheet, full_scale: float) -> float:
    """Return the (finite) output swing of macro-model op amps in volts."""
    return macro_parameters(datasheet, full_scale)["opamp_vsat"]


def check_parasitics(
    parasitics: Parasitics, own: Parasitics, models: str, technology: Technology, name: str
) -> None:
    """Raise `NetworkError` for a parasitic that a netlist cannot contain.

    Cells may lack the part, or the models may not support the parasitic. The message names the
    parasitic. ``own`` contains the parasitics of models that are not macro models. ``models`` is
    the folder of op amps and multipliers, and ``name`` identifies the circuits in the message.
    """
    for attribute, _ in PASSIVES.values():
        if not technology.has_resistors and getattr(parasitics, attribute) != getattr(
            NONE, attribute
        ):
            raise NetworkError(
                f"parasitics, {attribute}: cells of {name} circuits have no such part; omit it"
            )
    for attribute in () if models == "macro" else BUILT:
        known = {getattr(each, attribute) for each in (NONE, own)}
        if getattr(parasitics, attribute) not in known:
            raise NetworkError(
                f"parasitics, {attribute}: parts of {name} circuits have only the parasitics of "
                "their models; omit it, or use macro models"
            )


def on_board(file: str, parameters: dict[str, float]) -> str:
    """Return the board file that replaces a file below ``circuits``, or that file.

    ``parameters`` are those of `model_parameters`.

    Examples
    --------
    >>> on_board("cells/integ.cir", {"cap_leakage": 1e4})
    'models/board/integ.cir'
    """
    name = PurePosixPath(file).name
    asked = any(parameter in parameters for parameter in FILES.get(name, ()))
    return f"models/board/{name}" if asked else file
