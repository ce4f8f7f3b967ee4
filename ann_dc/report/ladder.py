"""The ladder report of ``ann-dc circuit``: one problem at every level of fidelity."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ann_dc.cli.terminal import table
from ann_dc.report.json_file import write_json

if TYPE_CHECKING:
    from rich.table import Table

    from ann_dc.fidelity.ladder import Measured
    from ann_dc.network.network import Network
    from ann_dc.problem.declaration import OptimalControlProblem


def climb(
    problem: OptimalControlProblem,
    network: Network,
    margin: float,
    seed: int | None,
    slow: bool,
    figure: Path | None,
    json_file: Path | None,
    progress: Callable[[str], None],
) -> tuple[Table, list[Path]]:
    """Climb every rung; the table, and the files that were written."""
    from ann_dc.fidelity.ladder import Ladder, ode_rung, recurrent_rung, rungs

    first, probe = ode_rung(network)
    progress("recurrent layer")
    second = recurrent_rung(network, probe)
    steps = rungs(network, probe, seed=1 if seed is None else seed)
    ladder = Ladder(margin=margin, progress=progress)
    climbed = ladder.climb(network, tuple(r for r in steps if slow or not r.slow))
    done = [first, second, *climbed, *_cpu(problem)]
    written = []
    if figure is not None:
        from ann_dc import plotting

        written.append(plotting.save(plotting.ladder(done, problem.name), figure))
    if json_file is not None:
        write_json(json_file, {"problem": problem.name, "rungs": [as_dict(m) for m in done]})
        written.append(json_file)
    return ladder_table(done, str(problem)), written


def _cpu(problem: OptimalControlProblem) -> list[Measured]:
    """What solvers on this CPU take, where CasADi is installed."""
    from ann_dc.fidelity.ladder import Measured, Rung
    from ann_dc.hardware.parts.levels import BEHAVIOURAL
    from ann_dc.optimality.reference_solvers import solve_times

    return [
        Measured(rung=Rung(name=f"{t.name} on this CPU", level=BEHAVIOURAL), settling=t.seconds)
        for t in solve_times(problem)
    ]


def ladder_table(done: list[Measured], title: str) -> Table:
    """Prediction beside measurement, rung by rung."""
    shown = table(dense=True)
    shown.title = title
    shown.add_column("level", overflow="fold")
    for name in ("error", "predicted", "0.1% us", "predicted", "W", "uJ"):
        shown.add_column(name, justify="right", no_wrap=True)
    for m in done:
        shown.add_row(
            m.rung.name + (f": {m.why}" if m.why else ""),
            _figure(m.error, ".1e"),
            _figure(m.predicted_error, ".1e"),
            _figure(m.settling * 1e6, ".4g"),
            _figure(m.predicted_settling * 1e6, ".4g"),
            _figure(m.power, ".3g"),
            _figure(m.energy * 1e6, ".3g"),
        )
    return shown


def as_dict(m: Measured) -> dict:
    """One rung for the JSON file."""
    return {
        "rung": m.rung.name.strip(),
        "error": m.error,
        "predicted_error": m.predicted_error,
        "settling_time": m.settling,
        "predicted_settling_time": m.predicted_settling,
        "power": m.power,
        "energy": m.energy,
        "ngspice_seconds": m.wall,
        "parts": {} if m.run is None else m.run.deck.parts,
        "why": m.why,
    }


def _figure(value: float, form: str) -> str:
    return f"{value:{form}}" if value == value else "-"
