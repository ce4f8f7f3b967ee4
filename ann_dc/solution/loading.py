"""Loading of a saved solution, with a check that its parts belong together."""

from __future__ import annotations

import os

from ann_dc.backends.run import Run
from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import Form
from ann_dc.errors import FileFormatError
from ann_dc.gain_design.procedure import Design
from ann_dc.optimality.certificate import Certificate
from ann_dc.problem.serialisation import WrittenProblem, declared
from ann_dc.solution.saved_result import opened_result
from ann_dc.solution.solution import Solution
from ann_dc.validation import checked


@checked
def load_solution(folder: str | os.PathLike[str]) -> Solution:
    """Load a solution that `Solution.save` wrote; its network runs identically.

    Parameters
    ----------
    folder : path-like
        Folder of the saved solution.

    Returns
    -------
    Solution
        Solution with all its records.

    Raises
    ------
    FileFormatError
        If the folder was not written by `Solution.save`, was written by a version with another
        format, or is incomplete. The message names the folder and the place in it.

    Examples
    --------
    >>> import tempfile
    >>> from ann_dc import OdeBackend, plants, solve
    >>> with tempfile.TemporaryDirectory() as place:
    ...     solve(plants.double_integrator(N=3)).save(f"{place}/result")
    ...     again = load_solution(f"{place}/result")
    >>> run = OdeBackend().run(again.network)
    >>> bool((run.trajectory.states == again.trajectory.states).all())
    True
    """
    with opened_result(folder) as saved:
        network = saved.network("network")
        problem = declared(saved.record("problem", WrittenProblem))
        solution = Solution(
            problem=problem,
            equations=decompose(problem, saved.record("form", Form)),
            network=network,
            run=saved.record("run", Run, network),
            certificate=saved.record("certificate", Certificate, network),
            design=saved.record("design", Design, saved.network("design"))
            if "design" in saved.networks
            else None,
        )
        _check_agreement(solution)
    return solution


def _check_agreement(solution: Solution) -> None:
    """Raise `FileFormatError` if parts belong to different solutions."""
    problem, network = solution.problem, solution.network
    names = {f"q.{s}" for s in problem.states} | {f"u.{s}" for s in problem.controls}
    missing = sorted(names - set(network.neuron_index))
    expected = (problem.n, problem.horizon + 1)
    if missing or network.stages != problem.horizon:
        raise FileFormatError(
            f"the network has {network.stages} stages of {', '.join(network.neuron_index)}, "
            f"which does not belong to the problem ({problem}); save the solution again"
        )
    if solution.certificate.rollout.shape != expected:
        raise FileFormatError(
            f"certificate/rollout: expected shape {expected}, got "
            f"{solution.certificate.rollout.shape}; save the solution again"
        )
