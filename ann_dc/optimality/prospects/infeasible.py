"""What cannot be met, and by how much: the miss that is left where the map is weighed heavily.

At a path of least violation the map is weighed more and more, until what is left is the miss at the
end alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.optimality.prospects.search import Path, Search
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import natural_scales

OUT_OF_REACH = 1e-4
"""Miss of a component at the end, in its scale, from which on it is called out of reach."""
WEIGHTS = (10.0, 100.0, 1000.0)
"""Of the map over the target, in turn, when the nearest end is looked for."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Infeasible:
    """A target that no controls reach, as far as searches from several starts can tell.

    Attributes
    ----------
    reached : mapping of str to float
        Fixed components of q_d that cannot be met, the worst first, and where the path that comes
        nearest ends instead, in the user's units.
    path : Path
        The one that comes nearest.
    message : str
        The same in a sentence.
    """

    reached: dict[str, float]
    path: Path
    message: str


def out_of_reach(problem: OptimalControlProblem, path: Path) -> Infeasible | None:
    """Which components of the target cannot be met, seen from a path at rest.

    Parameters
    ----------
    problem : OptimalControlProblem
    path : Path
        Of least violation.

    Returns
    -------
    Infeasible or None
        None where the path is not at rest, or misses nothing by more than `OUT_OF_REACH`.

    Examples
    --------
    A step of a tenth at most, ten times, and a target that is three away:

    >>> import sympy as sp
    >>> from ann_dc.optimality import feasible_path
    >>> from ann_dc.problem import straight_line
    >>> x, a = sp.symbols("x a")
    >>> problem = OptimalControlProblem(
    ...     states=(x,), controls=(a,), map=(x + sp.tanh(a) / 10,), cost=a**2, horizon=10,
    ...     q_0=(0,), q_d=(3,))
    >>> line = straight_line(problem)
    >>> found = out_of_reach(problem, feasible_path(problem, line.q, line.u))
    >>> round(found.reached["q_d.x"], 2)
    1.0
    """
    if path.met or not path.at_rest:
        return None
    with np.errstate(all="ignore"):
        for weight in WEIGHTS:
            path = Search(problem, weight).least_violation(path.q, path.u)
    miss, fixed = path.gap[:, -1], np.array(problem.fixed)
    worst = [i for i in np.argsort(-np.abs(miss)) if fixed[i] and abs(miss[i]) > OUT_OF_REACH]
    if not worst:
        return None
    factors = natural_scales(problem).state_factors
    reached, told = {}, []
    for i in worst:
        name, aim = str(problem.states[i]), float(path.q[i, -1])
        unit = f" {problem.unit(name)}" if problem.unit(name) not in ("", "1") else ""
        reached[f"q_d.{name}"] = float(aim + miss[i] * factors[i])
        told.append(f"q_d.{name} = {aim:g}{unit} (nearest {reached[f'q_d.{name}']:.4g}{unit})")
    message = (
        f"no controls reach {', '.join(told)}; change the target, free the component, or check "
        "that the controls act on it"
    )
    return Infeasible(reached=reached, path=path, message=message)
