"""Report of a level comparison: a problem at every model level, as table and JSON."""

from __future__ import annotations

import math
from pathlib import Path

from rich.table import Table

from ann_dc import plotting
from ann_dc.fidelity.level_comparison import Group, Measured
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.report.json_file import write_json
from ann_dc.report.tables import measured, table


def level_table(done: list[Measured], title: str) -> Table:
    """Return a table of predictions and measurements by level.

    Levels with a single non-ideality are indented.
    """
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
    """Return the content of one level for the JSON file."""
    return {
        "level": m.name,
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


def write_level_comparison(
    done: list[Measured],
    problem: OptimalControlProblem,
    *,
    figures: Path | None,
    json_file: Path | None,
) -> list[Path]:
    """Write the requested files and return their paths."""
    written = []
    if figures is not None:
        figure = plotting.comparison(done, problem)
        written.append(plotting.save(figure, figures / "levels.png"))
    if json_file is not None:
        write_json(json_file, {"problem": problem.name, "levels": [as_dict(m) for m in done]})
        written.append(json_file)
    return written


def _settling_error(m: Measured) -> float:
    """Return the settling-time error in seconds; nan without a simulation."""
    return float("nan") if m.run is None else m.run.settling_error


def _settling(m: Measured) -> str:
    """Return the settling time in microseconds, with the digits the steps resolve."""
    if m.run is None or not math.isfinite(m.settling):
        return _figure(m.settling * 1e6, ".4g")
    return measured(1e6 * m.settling, 1e6 * m.run.settling_error)


def _figure(value: float, form: str) -> str:
    return f"{value:{form}}" if value == value else "-"
