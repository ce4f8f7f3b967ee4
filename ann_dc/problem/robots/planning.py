"""What a robot plans, as a problem whose every number of the moment is an input.

The map is linear about a reference path, q' = c + A q + B u: what varies of A, B and c is an input
of every cell. Obstacles are half-planes, b - a'p <= 0: a, b are inputs too, in so many slots. So
one network with one wiring plans in any world: what changes from period to period is its inputs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import sympy as sp

from ann_dc.problem.constraints.soft import Soft
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.functions import ProblemFunctions
from ann_dc.problem.robots.robot import Robot

FAR = 100.0
"""Of an empty slot: its half-plane lies so far away, in the world's unit of length."""
NOWHERE = (1.0, 0.0, -FAR)
"""a_x, a_y and b of an empty slot."""


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Planning:
    """A planning problem and where its inputs come from; see `planning_problem`.

    Attributes
    ----------
    problem : OptimalControlProblem
    robot : Robot
    steps : ProblemFunctions
        Its map, which is linearised.
    entries : tuple of Entry
        Of A and B.
    shifts : tuple of (str, int)
        Inputs c, and the states whose map they are in.
    dt : float
        Seconds a stage.
    slots : int
        Half-planes a cell.
    soft : Soft
        What it costs to break a row.
    """

    problem: OptimalControlProblem
    robot: Robot
    steps: ProblemFunctions
    entries: tuple[Entry, ...]
    shifts: tuple[tuple[str, int], ...]
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
        values = {e.name: jacobian[e.row, e.column].reshape(shape) for e in self.entries}
        return values | {name: shift[row].reshape(shape) for name, row in self.shifts}

    def slot_inputs(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Values (..., N) of the inputs of the slots.

        Parameters
        ----------
        rows : (..., N, slots, 3) array
            a_x, a_y and b of the half-planes b - a'p <= 0.
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


def planning_problem(
    robot: Robot, *, horizon: int, dt: float, slots: int, pull: float, reach: float, soft: Soft
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
        Half-planes a cell.
    pull : float
        Weight of the squared distance to the goal, a stage.
    reach : float
        How far a plan may lead: the scale of x and y.
    soft : Soft
        What it costs to break a row, in units of the cost by length (or by unit of a state).
    """
    symbols = (*robot.states, *robot.controls)
    jacobian = sp.Matrix(robot.stepped(dt)).jacobian(symbols)
    values: dict[sp.Symbol, float] = {}
    entries, shifts, step = [], [], []
    for i, state in enumerate(robot.states):
        terms = []
        for j, symbol in enumerate(symbols):
            entry = sp.simplify(jacobian[i, j])
            if not entry.is_number:
                entries.append(Entry(f"{state}_by_{symbol}", i, j))
                entry = sp.Symbol(entries[-1].name)
                values[entry] = 0.0
            terms.append(entry * symbol)
        if any(entry.row == i for entry in entries):
            shifts.append((f"{state}_shift", i))
            terms.append(sp.Symbol(shifts[-1][0]))
            values[terms[-1]] = 0.0
        step.append(sp.Add(*terms))
    goal = sp.symbols("goal_x goal_y")
    values |= dict.fromkeys(goal, 0.0)
    rows = {}
    for slot in range(slots):
        a_x, a_y, b = parts = sp.symbols(_slot_names(slot))
        values |= dict(zip(parts, NOWHERE))
        rows[f"slot{slot}"] = b - a_x * robot.states[0] - a_y * robot.states[1] <= 0
    far = [pull * (p - g) ** 2 for p, g in zip(robot.states, goal)]
    problem = OptimalControlProblem(
        states=robot.states,
        controls=robot.controls,
        map=step,
        dt=dt,
        cost=sp.Add(*far, *_effort(robot)),
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
        steps=robot.steps(dt),
        entries=tuple(entries),
        shifts=tuple(shifts),
        dt=dt,
        slots=slots,
        soft=soft,
    )


def _slot_names(slot: int) -> tuple[str, str, str]:
    return f"a{slot}_x", f"a{slot}_y", f"b{slot}"


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
    h = sp.Symbol("h", positive=True)
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
