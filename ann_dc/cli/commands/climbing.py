"""The climb of ``ann-dc ladder``: every rung, then the table and the files."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table

from ann_dc.fidelity.ladder import Measured
from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.progress import Progress
from ann_dc.report.json_file import write_json
from ann_dc.report.ladder import as_dict, ladder_table


def climb(
    problem: OptimalControlProblem,
    network: Network,
    margin: float,
    seed: int | None,
    slow: bool,
    figure: Path | None,
    json_file: Path | None,
    progress: Progress,
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
    from ann_dc.optimality.reference_solvers import time_solvers

    return [
        Measured(rung=Rung(name=f"{t.name} on this CPU", level=BEHAVIOURAL), settling=t.seconds)
        for t in time_solvers(problem)
    ]
