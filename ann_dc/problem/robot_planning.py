"""Planning problem of a robot, with all momentary values as network inputs.

In the `LINEAR` form, the map is linearised about a reference path, q' = c + A q + B u. The varying
entries of A, B and c are inputs of every cell. Obstacles are half-planes, b - a'p <= 0, in a fixed
number of slots; a and b are also inputs. One network with one wiring therefore plans in any world;
only its inputs change from period to period.

For comparison, the `NONLINEAR` form uses the robot's nonlinear map and discs as obstacles, (R^2 -
|p - o|^2) / 2R <= 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import sympy as sp

from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.functions import ProblemFunctions
from ann_dc.problem.robot import Robot
from ann_dc.problem.soft import Soft

FAR = 100.0
"""Distance of the obstacle in an empty slot, in the world's unit of length."""


class Entry(NamedTuple):
    """Entry of the map's Jacobian (n, n+m) that varies along a path, and the name of its input."""

    name: str
    row: int
    column: int


class Step(NamedTuple):
    """Symbolic map q' of a stage, its inputs in A and B, and its inputs c with their states."""

    map: tuple[sp.Expr, ...]
    entries: tuple[Entry, ...] = ()
    shifts: tuple[tuple[str, int], ...] = ()


class Form(NamedTuple):
    """Form of the cells of a planning network; see `LINEAR` and `NONLINEAR`.

    A row of an obstacle is zero or less if a position (x, y) is clear of it; `nowhere` are the
    three inputs of an empty slot.
    """

    step: Callable[[Robot, float], Step]
    row: Callable[..., sp.Expr]
    nowhere: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class Planning:
    """Planning problem and the sources of its inputs; see `planning_problem`.

    `steps` is the map of the robot, which is linearised, and `step` that of the cells.
    """

    problem: OptimalControlProblem
    robot: Robot
    form: Form
    steps: ProblemFunctions
    step: Step
    dt: float
    slots: int
    soft: Soft

    def model_inputs(self, q: np.ndarray, u: np.ndarray) -> dict[str, np.ndarray]:
        """Return the inputs A, B and c (..., N) at references clipped to the limits.

        The references q and u have shapes (n, ..., N) and (m, ..., N).
        """
        shape, n = q.shape[1:], len(q)
        q, u = (
            np.clip(z.T, *limits.T).T
            for z, limits in ((q, self.robot.state_limits), (u, self.robot.limits))
        )
        for row, control in enumerate(map(str, self.robot.controls)):
            if control in self.robot.rolling:
                least = self.robot.rolling[control]
                backwards = u[row] < -least / 2
                u[row] = np.where(backwards, np.minimum(u[row], -least), np.maximum(u[row], least))
        flat_q, flat_u = q.reshape(n, -1), u.reshape(len(u), -1)
        found = self.steps.derivatives(flat_q, flat_u, np.zeros_like(flat_q))
        jacobian = found.jacobian
        shift = found.map - np.einsum("ijk,jk->ik", jacobian, np.vstack([flat_q, flat_u]))
        values = {e.name: jacobian[e.row, e.column].reshape(shape) for e in self.step.entries}
        return values | {name: shift[row].reshape(shape) for name, row in self.step.shifts}

    def slot_inputs(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Return the slot inputs (..., N) for rows (..., N, slots, 3).

        The last axis contains a_x, a_y and b of half-planes, or o_x, o_y and R of discs.
        """
        return {
            name: rows[..., slot, part]
            for slot in range(self.slots)
            for part, name in enumerate(_slot_names(slot))
        }

    @staticmethod
    def goal_inputs(goal: np.ndarray) -> dict[str, np.ndarray]:
        """Return the goal inputs (...) for goals (..., 2)."""
        return {"goal_x": goal[..., 0], "goal_y": goal[..., 1]}


def _linear_step(robot: Robot, dt: float) -> Step:
    """Return q' = c + A q + B u; constant entries of A and B are not inputs."""
    symbols = (*robot.states, *robot.controls)
    jacobian = sp.Matrix(robot.stepped(dt)).jacobian(symbols)
    entries, shifts, step = [], [], []
    for i, state in enumerate(robot.states):
        terms = []
        for j, symbol in enumerate(symbols):
            entry = sp.simplify(jacobian[i, j])
            if not entry.is_number:
                entries.append(Entry(f"{state}_by_{symbol}", i, j))
                entry = sp.Symbol(entries[-1].name)
            terms.append(entry * symbol)
        if any(entry.row == i for entry in entries):
            shifts.append((f"{state}_shift", i))
            terms.append(sp.Symbol(shifts[-1][0]))
        step.append(sp.Add(*terms))
    return Step(tuple(step), tuple(entries), tuple(shifts))


def _own_step(robot: Robot, dt: float) -> Step:
    return Step(robot.stepped(dt))


def _half_plane(x, y, a_x, a_y, b) -> sp.Expr:
    return b - a_x * x - a_y * y


def _disc(x, y, o_x, o_y, R) -> sp.Expr:
    return (R**2 - (x - o_x) ** 2 - (y - o_y) ** 2) / (2 * R)


LINEAR = Form(_linear_step, _half_plane, (1.0, 0.0, -FAR))
"""Map linear about a reference path, obstacles as half-planes; in contact the optimum is stable."""
NONLINEAR = Form(_own_step, _disc, (2 * FAR, 0.0, FAR))
"""Nonlinear map of the robot, obstacles as discs: fewer inputs, but in contact the optimum may be
unstable.
"""


def planning_problem(
    robot: Robot,
    *,
    horizon: int,
    dt: float,
    slots: int,
    pull: float,
    reach: float,
    soft: Soft,
    form: Form = LINEAR,
) -> Planning:
    """Return the problem that a robot solves in every control period.

    ``dt`` is the duration of a stage in seconds and ``slots`` the number of obstacles per cell.
    ``pull`` weights the squared distance to the goal, per stage. ``reach`` is the largest distance
    of a plan, the scale of x and y. ``soft`` is the cost of a row violation per length (or per unit
    of a state).
    """
    step, place = form.step(robot, dt), robot.states[:2]
    goal = sp.symbols("goal_x goal_y")
    names = (*(entry.name for entry in step.entries), *(name for name, _ in step.shifts))
    values = dict.fromkeys((*map(sp.Symbol, names), *goal), 0.0)
    rows = {}
    for slot in range(slots):
        parts = sp.symbols(_slot_names(slot))
        values |= dict(zip(parts, form.nowhere))
        rows[f"slot{slot}"] = form.row(*place, *parts) <= 0
    problem = OptimalControlProblem(
        states=robot.states,
        controls=robot.controls,
        map=step.map,
        dt=dt,
        cost=sp.Add(*(pull * (p - g) ** 2 for p, g in zip(place, goal)), *_effort(robot)),
        horizon=horizon,
        q_0=(0.0,) * len(robot.states),
        inputs=values,
        constraints=rows,
        bounds=robot.bounds,
        soft=soft,
        scales=_scales(robot, reach),
        name="planning",
    )
    return Planning(
        problem=problem,
        robot=robot,
        form=form,
        steps=robot.steps(dt),
        step=step,
        dt=dt,
        slots=slots,
        soft=soft,
    )


def _slot_names(slot: int) -> tuple[str, str, str]:
    return f"slot{slot}_x", f"slot{slot}_y", f"slot{slot}_reach"


def _effort(robot: Robot) -> list[sp.Expr]:
    symbols = (*robot.states, *robot.controls)
    return [sp.Float(robot.effort.get(z.name, 0.0)) / 2 * z**2 for z in symbols]


def _scales(robot: Robot, reach: float) -> dict[str, float]:
    """Return the scales: reach for the position, bounds if finite, otherwise one."""
    symbols = (*robot.states, *robot.controls)
    limits = np.abs(np.vstack([robot.state_limits, robot.limits])).max(axis=1)
    sizes = np.where(np.isfinite(limits), limits, 1.0)
    sizes[:2] = reach
    return dict(zip(map(str, symbols), sizes.tolist()))


def segment_problem(robot: Robot, *, stages: int, reach: float) -> OptimalControlProblem:
    """Return the minimum-effort problem of a segment: from a state to a position.

    The input ``h`` is the duration of a stage in seconds; ``reach`` is the length of the segment.
    """
    h = sp.Symbol("h")
    aside = len(robot.states) - 2
    return OptimalControlProblem(
        states=robot.states,
        controls=robot.controls,
        map=robot.stepped(h),
        cost=sp.Add(*_effort(robot)),
        horizon=stages,
        q_0=(0.0,) * len(robot.states),
        q_d=(reach, 0.0, *(None,) * aside),
        inputs={h: 1.5 * reach / (robot.limits[0, 1] * stages)},
        bounds=robot.bounds,
        scales=_scales(robot, reach),
        name="leg",
    )
