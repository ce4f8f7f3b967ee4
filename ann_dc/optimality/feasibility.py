"""Feasibility check: a path that satisfies all constraints, or the smallest violation.

With linear dynamics and constraints, one search that converges to a nonzero violation proves
infeasibility. Otherwise several searches must agree. With inequalities or limits, a search may
converge on the wrong side of an obstacle or swing in the wrong direction. Searches then start from
simulated paths of the plant, which differ more, and some must converge to the same violation.

At a path of least violation, the weight of the dynamics is increased until only the error at the
end remains. With inequalities, the target is first tested without them. If some controls reach it,
the result is the violation of the inequalities that such a path requires.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ann_dc.optimality.feasibility_search import Path, Search
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.inequality import Inequality
from ann_dc.problem.scales import natural_scales, straight_line
from ann_dc.progress import Progress, silent

STARTS = (1.0, 1.0, 5.0)
"""Amplitudes of the random controls of further initial guesses, in control scales."""
WAVES = (1.0, 3.0, 10.0, 30.0, 1.0, 3.0)
"""Amplitudes of slow waves of controls, which N stages sum to one scale of the states."""
HARMONICS = 3
"""Number of sine waves in a wave."""
AGREE = 3
"""Searches that must converge to the same violation if there are inequalities."""
SAME = 0.01
"""Relative difference up to which violations count as equal."""


def feasible_path(
    problem: OptimalControlProblem, q: np.ndarray, u: np.ndarray, progress: Progress = silent
) -> Path:
    """Return the path of least violation found by searches from several guesses.

    The first guess is q (n, N+1) and u (m, N) in the user's units. The nearest path is returned if
    no search finds a feasible one. With inequalities or limits, `at_rest` is True only if `AGREE`
    searches found its violation.

    Examples
    --------
    >>> from ann_dc.problem import plants, straight_line
    >>> problem = plants.double_integrator(N=5)
    >>> line = straight_line(problem)
    >>> feasible_path(problem, line.q, line.u).met
    True
    """
    search, found = Search(problem, progress=progress), []
    with np.errstate(all="ignore"):
        for start in _starts(problem, q, u) if not search.is_held else _wide_starts(problem, q, u):
            found.append(search.least_violation(*start))
            if found[-1].met:
                return found[-1]
    nearest = min(found, key=lambda path: path.violation)
    if not search.is_held:
        return nearest
    same = [path for path in found if path.violation <= (1 + SAME) * nearest.violation]
    return replace(nearest, at_rest=sum(path.at_rest for path in same) >= AGREE)


def _starts(problem, q, u) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the given path, the straight line, and seeded random controls."""
    yield q, u
    line, scales = straight_line(problem), natural_scales(problem)
    yield line.q, line.u
    rng = np.random.default_rng(0)
    for size in STARTS:
        drawn = rng.standard_normal(u.shape) * scales.control_factors[:, None]
        yield line.q, line.u + size * drawn


def _wide_starts(problem, q, u) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the given path, the straight line, and simulations of slow control waves."""
    yield q, u
    line, rng = straight_line(problem), np.random.default_rng(0)
    yield line.q, line.u
    middle, (low, high) = line.u.mean(axis=1, keepdims=True), problem.control_limits.T[:, :, None]
    factor = line.scales.control_factors[:, None] / problem.horizon
    turns = np.pi * np.linspace(0.0, 1.0, problem.horizon, endpoint=False)
    for size in WAVES:
        wave = np.zeros_like(u)
        for number in range(1, HARMONICS + 1):
            height, phase = rng.standard_normal((problem.m, 1)), rng.random((problem.m, 1))
            wave += height * np.sin(number * turns + 2 * np.pi * phase)
        swung = np.clip(middle + size * factor * wave, low, high)
        yield problem.functions.rollout(problem.ends[0], swung), swung


OUT_OF_REACH = 1e-4
"""Terminal error or distance to a constraint, in scales, above which it is reported."""
WEIGHTS = (10.0, 100.0, 1000.0)
"""Successive weights of the dynamics relative to the violations that remain."""
LONGEST = 60
"""Characters up to which a constraint is written out in a message; longer ones are named."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Infeasible:
    """Infeasible target or inequalities, as found by several searches.

    `reached` maps the components of q_d that cannot be met, the worst first, to the terminal value
    of the nearest `path` in the user's units. If it is empty, the target alone is feasible, and
    `exceeded` maps the violated inequalities to the largest g on that path.
    """

    reached: dict[str, float]
    exceeded: dict[str, float]
    path: Path
    message: str


def out_of_reach(
    problem: OptimalControlProblem, path: Path, progress: Progress = silent
) -> Infeasible | None:
    """Return the infeasible target components or inequalities of a path of least violation.

    Returns None if the path is not at rest, or no violation exceeds `OUT_OF_REACH`.

    Examples
    --------
    Ten steps of at most 0.1 and a target at distance 3:

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
    if problem.inequalities or problem.end_inequalities:
        bare = _without_rows(problem)
        alone = feasible_path(bare, path.q, path.u, progress)
        if alone.met:
            return _exceeded(problem, _weighed(problem, path, progress))
        return out_of_reach(bare, alone, progress)
    path = _weighed(problem, path, progress)
    miss, fixed = path.gap[:, -1], np.array(problem.fixed)
    worst = [i for i in np.argsort(-np.abs(miss)) if fixed[i] and abs(miss[i]) > OUT_OF_REACH]
    if not worst:
        return None
    factors = natural_scales(problem).state_factors
    reached, reported = {}, []
    for i in worst:
        name, aim = str(problem.states[i]), float(path.q[i, -1])
        unit = _unit(problem, name)
        reached[f"q_d.{name}"] = float(aim + miss[i] * factors[i])
        reported.append(f"q_d.{name} = {aim:g}{unit} (nearest {reached[f'q_d.{name}']:.4g}{unit})")
    limits = _limits(problem, path)
    message = (
        f"no controls{limits} reach {', '.join(reported)}; {'widen the limits, ' if limits else ''}"
        "change the target, free the component, or check that the controls act on it"
    )
    return Infeasible(reached=reached, exceeded={}, path=path, message=message)


def _without_rows(problem: OptimalControlProblem) -> OptimalControlProblem:
    """Return the problem with the control limits as its only inequalities."""
    controls = {str(u) for u in problem.controls}
    limits = {name: pair for name, pair in problem.bounds.items() if name in controls}
    bare: dict[str, Any] = {"constraints": (), "terminal_constraints": (), "soft": {}}
    return replace(problem, bounds=limits, **bare)


def _weighed(problem: OptimalControlProblem, path: Path, progress: Progress) -> Path:
    """Return the least-violation path for increasing weights of the dynamics."""
    with np.errstate(all="ignore"):
        for weight in WEIGHTS:
            path = Search(problem, weight, progress).least_violation(path.q, path.u)
    return path


def _exceeded(problem: OptimalControlProblem, path: Path) -> Infeasible | None:
    """Return the inequalities that a weighted path to the target violates."""
    rows = Search(problem).rows.worst(path.distance)
    rows = [row for row in rows if row.distance > OUT_OF_REACH]
    if not rows:
        return None
    reported = []
    for row in rows:
        where = f"at stage {row.stage}" if row.stage < problem.horizon else "at the end"
        amount = f"{row.excess:.3g}{_unit_of(problem, row.inequality)}"
        reported.append(f"{_words(row.inequality)} is exceeded by {amount} {where}")
    message = (
        f"no controls{_limits(problem, path)} satisfy all inequalities: {', '.join(reported)}; "
        "relax the violated constraint or make it soft, change the boundary conditions, or add "
        "stages"
    )
    exceeded = {row.inequality.name: row.excess for row in rows}
    return Infeasible(reached={}, exceeded=exceeded, path=path, message=message)


def _limits(problem: OptimalControlProblem, path: Path) -> str:
    """Return the active control limits of a path, as text."""
    reported = []
    for control, (low, high), values in zip(problem.controls, problem.control_limits, path.u):
        if np.isin(values, (low, high)).any():
            sides = [
                f"from {low:g}" if low > -np.inf else "",
                f"to {high:g}" if high < np.inf else "",
            ]
            reported.append(
                f"{control} {' '.join(filter(None, sides))}{_unit(problem, str(control))}"
            )
    return f" within {', '.join(reported)}" if reported else ""


def _words(row: Inequality) -> str:
    return str(row) if len(str(row)) <= LONGEST else row.name


def _unit_of(problem: OptimalControlProblem, row: Inequality) -> str:
    """Return the unit of a constraint that is a state or control plus a number."""
    symbols = [*row.expression.free_symbols]
    is_plain = len(symbols) == 1 and abs(row.expression.diff(symbols[0])) == 1
    return _unit(problem, str(symbols[0])) if is_plain else ""


def _unit(problem: OptimalControlProblem, name: str) -> str:
    unit = problem.unit(name)
    return f" {unit}" if unit not in ("", "1") else ""
