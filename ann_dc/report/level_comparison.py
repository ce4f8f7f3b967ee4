"""The ladder report in words: one problem at every level of fidelity, as a table and as JSON."""

from __future__ import annotations

import math
from pathlib import Path

from rich.table import Table

from ann_dc import plotting
from ann_dc.fidelity.level_comparison import Measured
from ann_dc.fidelity.model_level import Group
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.report.json_file import write_json
from ann_dc.report.tables import measured, table


def ladder_table(done: list[Measured], title: str) -> Table:
    """Prediction beside measurement, rung by rung; single defects are indented."""
    shown = table(dense=True)
    shown.title = title
    shown.add_column("level", overflow="fold")
    for name in ("error", "predicted", "0.1% us", "predicted", "W", "uJ"):
        shown.add_column(name, justify="right", no_wrap=True)
    for m in done:
        indent = "  " if m.group is Group.ALONE else ""
        shown.add_row(
            indent + m.name + (f": {m.why}" if m.why else ""),
            _figure(m.error, ".1e"),
            _figure(m.predicted_error, ".1e"),
            _settling(m),
            _figure(m.predicted_settling * 1e6, ".4g"),
            _figure(m.power, ".3g"),
            _figure(m.energy * 1e6, ".3g"),
        )
    return shown


def as_dict(m: Measured) -> dict:
    """One rung for the JSON file."""
    return {
        "rung": m.name,
        "error": m.error,
        "predicted_error": m.predicted_error,
        "settling_time": m.settling,
        "settling_error": _settling_error(m),
        "predicted_settling_time": m.predicted_settling,
        "power": m.power,
        "energy": m.energy,
        "ngspice_seconds": m.wall,
        "parts": {} if m.run is None else m.run.deck.parts,
        "why": m.why,
    }


def write_ladder(
    done: list[Measured],
    problem: OptimalControlProblem,
    *,
    figure: Path | None,
    json_file: Path | None,
) -> list[Path]:
    """Write what was asked for; the files that were written.

    Parameters
    ----------
    done : list of Measured
    problem : OptimalControlProblem
    figure, json_file : Path or None
    """
    if figure is not None:
        plotting.save(plotting.ladder(done, problem), figure)
    if json_file is not None:
        write_json(json_file, {"problem": problem.name, "rungs": [as_dict(m) for m in done]})
    return [file for file in (figure, json_file) if file is not None]


def _settling_error(m: Measured) -> float:
    """Seconds; nan where nothing was simulated."""
    return float("nan") if m.run is None else m.run.settling_error


def _settling(m: Measured) -> str:
    """Microseconds: of a circuit, the digits that its steps were fine enough for."""
    if m.run is None or not math.isfinite(m.settling):
        return _figure(m.settling * 1e6, ".4g")
    return measured(1e6 * m.settling, 1e6 * m.run.settling_error)


def _figure(value: float, form: str) -> str:
    return f"{value:{form}}" if value == value else "-"
