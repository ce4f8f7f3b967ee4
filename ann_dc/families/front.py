r"""Pareto front of several objectives, from one network with weights as inputs.

Every objective is normalised by its *ideal* J_i^- and its *nadir* J_i^+. Points of the front are

.. math::
    \min\; \max_i\; w_i \frac{J_i - J_i^-}{J_i^+ - J_i^-}, \qquad w_i > 0, \quad \sum_i w_i = 1,

one for each direction. The weights are inputs, so one network with fixed gains finds all points, in
one batch of weights. Ideal and nadir are the best and the worst value of every objective at the
points that are optimal for one objective. There, each objective is regularised by a small fraction
of all objectives, since one objective alone may leave controls undetermined.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np

from ann_dc.backends.batch import BatchRun
from ann_dc.backends.ode import OdeBackend
from ann_dc.decomposition.equations import decompose
from ann_dc.errors import ProblemError
from ann_dc.evaluation.populations import kkt_point
from ann_dc.gain_design import procedure
from ann_dc.gain_design.procedure import Design
from ann_dc.network.preconditioners.base import Kinds, PreconditionerKind
from ann_dc.optimality.certificate import Certificate
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.initial_guess import interpolated_guess
from ann_dc.problem.minimax import normalised, weighed, weights_of
from ann_dc.progress import Progress, silent
from ann_dc.solution.solution import certificate_of
from ann_dc.summaries import summarised
from ann_dc.synthesis.synthesis import synthesize
from ann_dc.validation import NotEmpty, Own, checked

REGULAR = 0.02
"""Regularisation weight of all objectives in the search for the ideal point, relative to the size
of each objective on the straight line.
"""
KINDS = (
    PreconditionerKind.COUPLED_MULTILEVEL,
    PreconditionerKind.MULTILEVEL,
    PreconditionerKind.DIAGONAL,
)
"""Preconditioner kinds supported by a network with objectives."""


@checked
@summarised(
    lambda self: {
        "problem": self.problem.name,
        "objectives": ", ".join(self.names),
        "points": len(self.values),
        "certified": f"{np.count_nonzero(self.certified)} of {len(self.values)}",
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Front:
    """Points of the Pareto front of several objectives.

    The problem has objectives normalised between ideal, 0, and nadir, 1, and weights as inputs; the
    design is at equal weights. In the user's units are `ideal` and `nadir` (p,) and the objectives
    `values` (B, p) of every point. `shares` (B, p) is the contribution of every objective: its
    fraction of the cost times its weight.
    """

    problem: OptimalControlProblem
    ideal: np.ndarray
    nadir: np.ndarray
    design: Design
    weights: np.ndarray
    values: np.ndarray
    shares: np.ndarray
    batch: BatchRun
    certificates: tuple[Certificate, ...]

    def __len__(self) -> int:
        return len(self.weights)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the objectives."""
        return self.problem.objective_names

    @property
    def certified(self) -> np.ndarray:
        """Boolean array (B,), True for points that settled and are certified."""
        return self.batch.settled & [found.certified for found in self.certificates]

    def states(self, point: int) -> np.ndarray:
        """Return the states (n, N+1) of a point, in the user's units."""
        q, _, t, *_ = kkt_point(self.batch.network, self.batch.states[point])
        return np.column_stack([q, t[:, -1]])

    def controls(self, point: int) -> np.ndarray:
        """Return the controls (m, N) of a point, in the user's units."""
        return kkt_point(self.batch.network, self.batch.states[point])[1]

    def __str__(self) -> str:
        good = self.certified
        lines = [
            f"{self.problem.name} (N = {self.problem.horizon}): {int(good.sum())} of {len(self)} "
            "points of the front certified",
            "  ideal  " + "".join(f"{v:14.6g}" for v in self.ideal),
            "  nadir  " + "".join(f"{v:14.6g}" for v in self.nadir),
            "  weights" + "".join(f"{name:>14}" for name in self.names),
        ]
        for weight, value, is_good in zip(self.weights, self.values, good):
            name = " ".join(f"{w:.2f}" for w in weight)
            end = "" if is_good else "  not certified"
            lines.append(f"  {name:7}" + "".join(f"{v:14.6g}" for v in value) + end)
        return "\n".join(lines)


@checked
def pareto(
    problem: OptimalControlProblem,
    points: Annotated[int | Sequence | np.ndarray, Own()] = 21,
    *,
    preconditioner: Annotated[Kinds, NotEmpty()] = KINDS,
    progress: Progress = silent,
) -> Front:
    """Compute the Pareto front with one network and a batch of weights.

    The network has fixed gains, and the weights are its inputs.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem with objectives and no other cost; its weights are ignored.
    points : int or (B, p) array
        Number of evenly distributed directions, or the positive weights, one row per point. Default
        21.
    preconditioner : PreconditionerKind, str, or iterable of these
        Preconditioner kinds from which designs choose. Default: `KINDS`.
    progress : Progress
        Receives one line per step. Default: silent.

    Returns
    -------
    Front
        Returned for every outcome of the points.

    Raises
    ------
    ProblemError
        If the problem has no objectives, or a cost in addition to them; if weights are not positive
        or do not add up to one; or if objectives do not compete because one point is best for all
        of them.
    DesignError
        If numbers of a design overflow.

    References
    ----------
    Paper equation (6).

    Examples
    --------
    >>> import sympy as sp
    >>> x, v, a = sp.symbols("x v a")
    >>> problem = OptimalControlProblem(
    ...     states=(x, v), controls=(a,), dynamics=(v, a), dt=0.1, horizon=5, q_0=(0, 0),
    ...     q_d=(1, 0), objectives={"effort": a**2 / 800, "error": (x - 1) ** 2 + a**2 / 8000})
    >>> front = pareto(problem, points=3)
    >>> front.certified.tolist(), front.values[:, 0].round(3).tolist()
    ([True, True, True], [...])
    """
    _check(problem)
    weights = _weights_of(problem, points)
    payoff = _payoff(problem, preconditioner, progress)
    ideal, nadir = payoff.min(axis=0), payoff.max(axis=0)
    if not (nadir > ideal).all():
        raise ProblemError(
            f"objectives: {problem.name} has a point that minimises all objectives, so the "
            "front is a point"
        )
    related = normalised(problem, ideal, nadir)
    network = synthesize(decompose(related))
    designed = procedure.design(network, preconditioner=preconditioner, progress=progress)
    inputs = {f"weight_{name}": w for name, w in zip(related.objective_names, weights.T)}
    progress(f"front: {len(weights)} points")
    batch = OdeBackend(progress=progress).run_batch(designed.network, inputs)
    found = [_judged(related, batch, point, w) for point, w in enumerate(weights)]
    values, shares, certificates = zip(*found)
    return Front(
        problem=related,
        ideal=ideal,
        nadir=nadir,
        design=designed,
        weights=weights,
        values=ideal + np.array(values) * (nadir - ideal),
        shares=np.array(shares),
        batch=batch,
        certificates=certificates,
    )


def _check(problem: OptimalControlProblem) -> None:
    if not problem.objectives:
        raise ProblemError(f"objectives: {problem.name} has none; a front needs two or more")
    if problem.cost != 0 or problem.terminal_cost != 0:
        raise ProblemError(
            "cost: a front has objectives only; make the cost an objective, or part of one"
        )


def _weights_of(problem: OptimalControlProblem, points: Any) -> np.ndarray:
    """Return weights (B, p): as given, or from a regular division of the simplex."""
    names = problem.objective_names
    count = len(names)
    if isinstance(points, (int, np.integer)) and not isinstance(points, bool):
        if points < 1:
            raise ProblemError(f"points: expected a number of points of at least 1, got {points}")
        return _division(int(points), count)
    try:
        weights = np.array(points, float)
    except (TypeError, ValueError) as error:
        raise ProblemError(f"points: expected a number, or rows of weights: {points!r}") from error
    if weights.ndim != 2 or weights.shape[1] != count or not len(weights):
        raise ProblemError(
            f"points: expected a number of points, or an array of weights with a column for each "
            f"of {', '.join(names)}, got one of shape {weights.shape}"
        )
    for row in weights:
        weights_of(row.tolist(), problem.objectives)
    if not (weights > 0).all():
        raise ProblemError("points: weights of a front are positive; omit that objective")
    return weights


def _division(points: int, count: int) -> np.ndarray:
    """Return at least `points` weights, evenly inside the simplex and off its edges."""
    degree = 0
    while True:
        rows = [
            row for row in itertools.product(range(degree + 1), repeat=count) if sum(row) == degree
        ]
        if len(rows) >= points:
            return (np.array(rows, float) + 1.0 / count) / (degree + 1)
        degree += 1


def _payoff(problem: OptimalControlProblem, kinds, progress: Progress) -> np.ndarray:
    """Return (p, p) objectives (columns) at the regularised minima (rows)."""
    plain = replace(problem, weights=None)
    line = interpolated_guess(plain)
    sizes = np.abs(plain.objective_stages(line.q, line.u)).sum(axis=1)
    sizes = np.where(sizes > 0, sizes, 1.0)
    rows = []
    for own, name in enumerate(plain.objective_names):
        progress(f"front: the least {name}")
        alone = weighed(plain, (np.eye(len(sizes))[own] + REGULAR) / sizes)
        designed = procedure.design(
            synthesize(decompose(alone)), preconditioner=kinds, progress=progress
        )
        if not designed.settled:
            raise ProblemError(
                f"objectives[{name}]: the network does not settle at its least value, so the "
                "ideal point is unknown"
            )
        q, u, t, *_ = kkt_point(designed.network, designed.state)
        rows.append(plain.objective_values(np.column_stack([q, t[:, -1]]), u))
    return np.array(rows)


def _judged(
    problem: OptimalControlProblem, batch: BatchRun, point: int, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray, Certificate]:
    """Return unweighted objectives, contributions and the certificate of a point."""
    names = [f"weight_{name}" for name in problem.objective_names]
    weighed = problem.with_inputs(**dict(zip(names, weights.tolist())))
    found = certificate_of(weighed, batch.network_of(point), batch.states[point])
    assert found.largest is not None  # the problem has objectives
    counted = found.largest.shares * weights
    total = counted.sum()
    return found.largest.values / weights, counted / (total if total > 0 else 1.0), found
