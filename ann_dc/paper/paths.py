"""Data of Figures 4 and 5: paths in the plane and their controls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ann_dc.solution.solution import Solution
from ann_dc.validation import OrNan, Shape, checked

REACH = 1.6
"""Limit of x and y, relative to the largest target component, up to which a diverging run is drawn.
"""


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Path:
    """Path in the plane with its controls.

    Attributes
    ----------
    name : str
        Legend entry.
    x, y : (N + 1,) array
        Positions in the problem's units.
    controls : (m, N) array
        Piecewise constant controls by stage.

    Examples
    --------
    >>> Path(name="T_0", x=np.arange(3.0), y=np.zeros(3), controls=np.ones((2, 2))).x.size
    3
    """

    name: str
    x: Annotated[np.ndarray, Shape("N+1"), OrNan()]
    y: Annotated[np.ndarray, Shape("N+1"), OrNan()]
    controls: Annotated[np.ndarray, Shape("m", "N"), OrNan()]


@checked
def path_of(solution: Solution, name: str, sample: int = -1) -> Path:
    """Return the path of the q neurons at a sample of the run, followed by t_{N-1}.

    The default is the last sample.
    """
    run, controls = solution.trajectory, map(str, solution.problem.controls)
    x, y = (np.append(run[f"q.{s}"][sample], run[f"t.{s}"][sample, -1]) for s in ("x", "y"))
    u = np.stack([run[f"u.{s}"][sample] for s in controls])
    return Path(name=name, x=x, y=y, controls=u)


@checked
def rolled_out(solution: Solution, name: str) -> Path:
    """Return the simulated path of the final controls."""
    states = [str(s) for s in solution.problem.states]
    x, y = (solution.certificate.rollout[states.index(s)] for s in ("x", "y"))
    return Path(name=name, x=x, y=y, controls=solution.populations["u"].T)


@checked
def run_away(solution: Solution, count: int = 3) -> list[Path]:
    """Return moments of a diverging run within the figure, named by network time."""
    run, ends = solution.trajectory, [v or 0.0 for v in solution.problem.q_d or ()]
    largest = REACH * max(map(abs, ends))
    size = np.maximum(*(np.abs(run[f"q.{s}"]).max(axis=1) for s in ("x", "y")))
    inside = int(np.argmax(~(size < largest))) or len(size)
    moments = np.linspace(0, inside - 1, count + 1).astype(int)[1:]
    return [path_of(solution, f"after {run.time[k]:.2g} time constants", int(k)) for k in moments]
