"""``ann-dc circuit --level ladder``: the ladder report, printed and written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rich.table import Table

from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.report.json_file import write_json


def ladder_report(
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
    from ann_dc.fidelity.ladder import Ladder, climb, quick
    from ann_dc.optimality.reference_solvers import time_solvers
    from ann_dc.report.ladder import as_dict, ladder_table

    ladder = Ladder(margin=margin, progress=progress)
    wanted = (lambda rung: True) if slow else quick
    seed = 1 if seed is None else seed
    done = list(climb(network, ladder, seed=seed, wanted=wanted, timings=time_solvers(problem)))
    written = []
    if figure is not None:
        from ann_dc import plotting

        written.append(plotting.save(plotting.ladder(done, problem.name), figure))
    if json_file is not None:
        write_json(json_file, {"problem": problem.name, "rungs": [as_dict(m) for m in done]})
        written.append(json_file)
    return ladder_table(done, str(problem)), written
