"""What a robot plans, as a problem whose every number of the moment is an input.

The map is linear about a reference path, q' = c + A q + B u: what varies of A, B and c is an input
of every cell. Obstacles are half-planes, b - a'p <= 0: a, b are inputs too, in so many slots. So
one network with one wiring plans in any world: what changes from period to period is its inputs.

Or, to compare, the map is the robot's own and obstacles are discs, (R^2 - |p - o|^2) / 2R <= 0.
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
"""Of an empty slot: what it holds lies so far away, in the world's unit of length."""


class Entry(NamedTuple):
    """An entry of the map's Jacobian that varies along a path.

    Attributes
    ----------
    name : str
        Of its input.
    row, column : int
        Of the Jacobian (n, n+m).
    """

    name: str
    row: int
    column: int


class Step(NamedTuple):
    """A map q' of a stage in symbols, and what of it are inputs.

    Attributes
    ----------
    map : tuple of sympy expressions
    entries : tuple of Entry
        Of A and B.
    shifts : tuple of (str, int)
        Inputs c, and the states whose map they are in.
    """

    map: tuple[sp.Expr, ...]
    entries: tuple[Entry, ...] = ()
    shifts: tuple[tuple[str, int], ...] = ()


class Form(NamedTuple):
    """What the cells of a planning network hold; see `LINEAR` and `NONLINEAR`.

    Attributes
    ----------
    step : callable (Robot, dt) to Step
    row : callable (x, y, and three inputs) to sympy expression
        Of an obstacle: zero or less where a place (x, y) is clear of it.
    nowhere : (float, float, float)
        The three inputs of an empty slot.
    """

    step: Callable[[Robot, float], Step]
    row: Callable[..., sp.Expr]
    nowhere: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class Planning:
    """A planning problem and where its inputs come from; see `planning_problem`.

    Attributes
    ----------
    problem : OptimalControlProblem
    robot : Robot
    form : Form
        Of its cells.
    steps : ProblemFunctions
        The robot's map, which is linearised.
    step : Step
        That of the cells.
    dt : float
        Seconds a stage.
    slots : int
        Obstacles a cell.
    soft : Soft
        What it costs to break a row.
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
        """Values (..., N) of the inputs A, B and c about references, put within the limits.

        Parameters
        ----------
        q, u : (n, ..., N) and (m, ..., N) arrays
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
        """Values (..., N) of the inputs of the slots.

        Parameters
        ----------
        rows : (..., N, slots, 3) array
            Of the form: a_x, a_y and b, or o_x, o_y and R.
        """
        return {
            name: rows[..., slot, part]
            for slot in range(self.slots)
            for part, name in enumerate(_slot_names(slot))
        }

    @staticmethod
    def goal_inputs(goal: np.ndarray) -> dict[str, np.ndarray]:
        """Values (...) of the inputs of the goal (..., 2)."""
        return {"goal_x": goal[..., 0], "goal_y": goal[..., 1]}


def _linear_step(robot: Robot, dt: float) -> Step:
    """q' = c + A q + B u; what of A and B does not vary is no input."""
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
"""The map linear about a reference path, obstacles as half-planes: in contact the optimum attracts.
"""
NONLINEAR = Form(_own_step, _disc, (2 * FAR, 0.0, FAR))
"""The robot's own map, obstacles as discs: fewer inputs, but in contact the optimum may repel."""


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
    """The problem that a robot solves every period.

    Parameters
    ----------
    robot : Robot
    horizon : int
        Stages N.
    dt : float
        Seconds a stage.
    slots : int
        Obstacles a cell.
    pull : float
        Weight of the squared distance to the goal, a stage.
    reach : float
        How far a plan may lead: the scale of x and y.
    soft : Soft
        What it costs to break a row, in units of the cost by length (or by unit of a state).
    form : Form
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
    """What a stage pays for its states and controls."""
    symbols = (*robot.states, *robot.controls)
    return [sp.Float(robot.effort.get(z.name, 0.0)) / 2 * z**2 for z in symbols]


def _scales(robot: Robot, reach: float) -> dict[str, float]:
    """Place by the reach, what is bounded by its bounds, the rest by one."""
    symbols = (*robot.states, *robot.controls)
    limits = np.abs(np.vstack([robot.state_limits, robot.limits])).max(axis=1)
    sizes = np.where(np.isfinite(limits), limits, 1.0)
    sizes[:2] = reach
    return dict(zip(map(str, symbols), sizes.tolist()))


def leg_problem(robot: Robot, *, stages: int, reach: float) -> OptimalControlProblem:
    """The problem of a leg: from a state to a place, with the least effort, in a time of its own.

    Parameters
    ----------
    robot : Robot
    stages : int
    reach : float
        The scale of x and y, and how far this leg leads.

    Returns
    -------
    OptimalControlProblem
        With an input ``h``, the seconds of a stage.
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
