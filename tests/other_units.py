"""The same problem written in other units: what a network must not notice."""

from dataclasses import dataclass, replace

import numpy as np
import sympy as sp

from ann_dc.problem.declaration import OptimalControlProblem


@dataclass(frozen=True)
class Units:
    """q = shift + state * q', u = push + control * u', time = seconds * t', E = cost * E'."""

    state: np.ndarray
    control: np.ndarray
    cost: float = 1.0
    time: float = 1.0
    shift: np.ndarray | float = 0.0
    push: np.ndarray | float = 0.0

    @classmethod
    def random(cls, problem: OptimalControlProblem, seed: int, decades: float = 6.0) -> "Units":
        """Factors 10^U(-decades, decades) on everything that has a unit."""
        rng = np.random.default_rng(seed)
        factors = lambda size=None: 10 ** rng.uniform(-decades, decades, size)  # noqa: E731
        return cls(factors(problem.n), factors(problem.m), float(factors()), float(factors()))


def written_in(problem: OptimalControlProblem, units: Units) -> OptimalControlProblem:
    """The problem for somebody who measures in these units."""
    shift = np.broadcast_to(units.shift, problem.n).astype(float)
    push = np.broadcast_to(units.push, problem.m).astype(float)
    states = [*zip(problem.states, shift, units.state, strict=True)]
    controls = [*zip(problem.controls, push, units.control, strict=True)]
    by_name = {s: zero + factor * s for s, zero, factor in (*states, *controls)}
    changed = {
        "cost": problem.cost.xreplace(by_name) / units.cost,
        "terminal_cost": sp.sympify(problem.terminal_cost).xreplace(by_name) / units.cost,
        "dt": problem.dt / units.time,
        "q_0": (np.array(problem.q_0) - shift) / units.state,
        "q_d": tuple(
            None if value is None else (value - zero) / factor
            for value, zero, factor in zip(problem.q_d, shift, units.state, strict=True)
        ),
        "constraints": {n: r.xreplace(by_name) for n, r in problem.constraints.items()},
        "terminal_constraints": {
            n: r.xreplace(by_name) for n, r in problem.terminal_constraints.items()
        },
        "bounds": {
            str(s): tuple((end - zero) / factor for end in problem.bounds[str(s)])
            for s, zero, factor in (*states, *controls)
            if str(s) in problem.bounds
        },
    }
    if problem.dynamics is not None:
        changed["dynamics"] = tuple(
            f.xreplace(by_name) * units.time / factor
            for f, factor in zip(problem.dynamics, units.state, strict=True)
        )
    else:
        changed["map"] = tuple(
            (f.xreplace(by_name) - zero) / factor
            for f, zero, factor in zip(problem.f, shift, units.state, strict=True)
        )
    return replace(problem, **changed)
