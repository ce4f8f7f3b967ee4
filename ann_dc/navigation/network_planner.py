"""Receding-horizon planner: a network shifted by one stage every control period.

Every period the neurons take the values of their right neighbours. The inputs contain the robot's
state, the model linearised about the previous path, and the free half-planes. The network then runs
for the time that its hardware has, and the first control is applied.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ann_dc.backends.batch import BatchRun
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.settling import Settling
from ann_dc.backends.status import Outcome
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.hardware.circuit.scaling import time_unit
from ann_dc.navigation.half_planes import Ahead, Margin, discs, half_planes
from ann_dc.navigation.planner import Plan, Situation
from ann_dc.network.cell import Function, Product
from ann_dc.network.network import Network
from ann_dc.problem.robot_planning import LINEAR, NONLINEAR, Planning
from ann_dc.si_prefixes import counted

FIRST_ROUNDS = 6
"""Rounds of settling and linearisation before a robot starts."""
FIRST = 1000.0
"""Fastest time constants of each initial round, at least."""
CRUISE = 0.8
"""Fraction of the distance at maximum speed that a first plan covers."""
STILL = 0.25
"""Fraction of the distance to the goal, or of the longest plan, below which a plan leads nowhere.
"""
BANDWIDTH = 10e6
"""Bandwidth in Hz of the op amps for which hardware times are reported."""
SHARE = 0.5
"""Fraction of a control period that settling may take."""
ROWS = {LINEAR: half_planes, NONLINEAR: discs}
"""Functions that compute the obstacle inputs, by constraint form."""
LOST = 10.0
"""Residual above which a network has failed and restarts."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NetworkPlanner:
    """Model-predictive control by one network with fixed gains; see `design_planner`.

    Attributes
    ----------
    radius : float
        Spectral radius in contact: fastest rate, per unit of network time.
    budget : float
        Fastest time constants that the network may run in each period.
    tolerance : float
        Residual at which the run of a period ends early.
    """

    planning: Planning
    network: Network
    radius: float
    budget: float = 1000.0
    tolerance: float = 3e-4
    margin: Margin = field(default_factory=Margin)

    @property
    def dt(self) -> float:
        """Control period in seconds, one stage of the plan."""
        return self.planning.dt

    def begin(self) -> NetworkDriver:
        """Return a driver without previous plans."""
        return NetworkDriver(self)

    def run(self, inputs: Mapping[str, np.ndarray], x: np.ndarray, budget: float) -> BatchRun:
        """Run the network until it has settled or its budget of fastest time constants is used.

        Inputs have shape (B, N) or (B,), and the initial states x (B, n) are in network units.
        """
        backend = OdeBackend(
            limit=budget * self._start_rate / self.radius,
            settling=Settling(tolerance=self.tolerance, confirm=1.0),
            verify=False,
        )
        return backend.run_batch(self.network, inputs, x)

    @cached_property
    def _start_rate(self) -> float:
        """Reciprocal of the time constant in which the limit of a run is counted."""
        return float(fast_evaluator(self.network).fastest_rate(self.network.start_state))

    def hardware_time(self, bandwidth: float) -> float:
        """Return the seconds of a period's budget for op amps of a GBW in Hz.

        Circuits are scaled so that a fastest time constant is k / (2 pi GBW) with a bandwidth
        margin k of 10, which is 0.159 us at 10 MHz.
        """
        return self.budget * time_unit(1.0, bandwidth)

    def __str__(self) -> str:
        cell, stages = self.network.cell, self.network.stages
        counts = [
            f"{stages * sum(isinstance(block, kind) for block in cell.blocks)} {name}"
            for kind, name in ((Product, "multipliers"), (Function, "rectifiers"))
        ]
        taken, megahertz = self.hardware_time(BANDWIDTH), BANDWIDTH / 1e6
        needed = BANDWIDTH * taken / (SHARE * 1e-3)
        return (
            f"{self.network.size} neurons in {counted(stages, 'cells')}, {', '.join(counts)}; "
            f"{self.budget:g} tau_min per period: {1e6 * taken:.3g} us with op amps of "
            f"{megahertz:g} MHz, {taken / self.dt:.2%} of the control period; a period of 1 ms "
            f"needs {needed / 1e6:.3g} MHz"
        )


class NetworkDriver:
    """Network planner on several journeys at once, one sample each of its last ``batch``.

    ``begun`` (B, n) has the initial states of the last run, in network units.
    """

    batch: BatchRun
    begun: np.ndarray

    def __init__(self, planner: NetworkPlanner) -> None:
        self.planner, self.network = planner, planner.network
        self._plans: dict[int, np.ndarray] = {}
        self._sides: dict[int, dict[int, float]] = {}
        neurons = self.network.cell.neurons
        index, robot = self.network.neuron_index, planner.planning.robot
        self._q = [index[f"q.{q}"] for q in robot.states]
        self._t = [index[f"t.{q}"] for q in robot.states]
        self._u = [index[f"u.{u}"] for u in robot.controls]
        self._rows = [index[f"z.slot{i}"] for i in range(planner.planning.slots)]
        self._factor, self._offset = np.array([n.scale for n in neurons]).T[..., None]

    def plan(self, situations: Sequence[Situation]) -> list[Plan]:
        """Return a plan for each situation.

        A new journey first runs several rounds of settling.
        """
        new = [s for s in situations if s.number not in self._plans]
        rest = [s for s in situations if s.number in self._plans]
        for situation in new:
            self._plans[situation.number] = self._cold(situation)
            self._sides[situation.number] = {}
        for situation in rest:
            self._plans[situation.number] = self._shifted(self._plans[situation.number])
        plans: dict[int, Plan] = {}
        for _ in range(FIRST_ROUNDS if new else 0):
            plans |= self._run(new, max(self.planner.budget, FIRST))
        if rest:
            plans |= self._run(rest, self.planner.budget)
        return [plans[s.number] for s in situations]

    def _cold(self, situation: Situation) -> np.ndarray:
        """Return neuron values (P, N) on the line to the goal, in the user's units."""
        stages = self.network.stages
        values = np.zeros(self.network.live.shape)
        line = np.repeat(situation.q[:, None], stages + 1, axis=1)
        line[:2] = self._line(situation).T
        values[self._q], values[self._t] = line[:, :-1], line[:, 1:]
        values[self._u[0]] = np.linalg.norm(line[:2, -1] - line[:2, 0]) / (stages * self.planner.dt)
        return values

    def _line(self, situation: Situation) -> np.ndarray:
        """Return places (N+1, 2) on the line to the goal, up to the length of a plan."""
        planner, stages = self.planner, self.network.stages
        way = situation.world.goal - situation.q[:2]
        longest = CRUISE * planner.planning.robot.limits[0, 1] * stages * planner.dt
        taken = way * min(1.0, longest / max(float(np.linalg.norm(way)), 1e-12))
        return situation.q[:2] + np.outer(np.linspace(0, 1, stages + 1), taken)

    def _way(self, path: np.ndarray, situation: Situation) -> np.ndarray:
        """Return the places (N, 2) from which obstacles are kept away.

        A plan that leads nowhere does not show on which side to pass an obstacle; the line to the
        goal replaces such a plan.
        """
        planned, line = path[self._q[:2]].T, self._line(situation)[:-1]
        lengths = (np.linalg.norm(places[-1] - places[0]) for places in (planned, line))
        return planned if next(lengths) >= STILL * next(lengths) else line

    def _shifted(self, values: np.ndarray) -> np.ndarray:
        """Shift all values by one cell from the right and extrapolate the last cell."""
        ahead = np.concatenate([values[:, 1:], values[:, -1:]], axis=1)
        ahead[self._q, -1] = values[self._t, -1]
        ahead[self._t, -1] = self.planner.planning.steps.map(
            ahead[self._q, -1:], ahead[self._u, -1:]
        )[:, 0]
        return ahead

    def _run(self, situations: Sequence[Situation], budget: float) -> dict[int, Plan]:
        """Return the plans by the numbers of their journeys."""
        inputs = self._inputs(situations)
        values = np.array([self._plans[s.number] for s in situations])
        self.begun = self.network.pack((values - self._offset) / self._factor)
        self.batch = batch = self.planner.run(inputs, self.begun, budget)
        settled = self._offset + self._factor * self.network.unpack(batch.states)
        return {
            situation.number: self._reported(situation, batch, sample, settled[sample], budget)
            for sample, situation in enumerate(situations)
        }

    def _inputs(self, situations: Sequence[Situation]) -> dict[str, np.ndarray]:
        planning, stages = self.planner.planning, self.network.stages
        margin, room = self.planner.margin, self.planner.margin.at(stages) + planning.robot.radius
        paths = np.array([self._plans[s.number] for s in situations])
        for path, situation in zip(paths, situations):
            path[self._q, 0] = situation.q
        rows = []
        for path, situation in zip(paths, situations):
            time = situation.time + self.planner.dt * np.arange(stages)
            seen = situation.world.sensed(situation.q[:2], situation.time)
            obstacles = [(i, situation.world.obstacles[i]) for i in seen]
            ahead = Ahead(
                path=self._way(path, situation),
                goal=situation.world.goal,
                time=time,
                room=room,
                between=margin.between,
            )
            sides = self._sides[situation.number]
            rows.append(ROWS[planning.form](obstacles, ahead, planning.slots, sides))
        q, u = paths[:, self._q].swapaxes(0, 1), paths[:, self._u].swapaxes(0, 1)
        inputs = planning.model_inputs(q, u) | planning.slot_inputs(np.array(rows))
        inputs |= planning.goal_inputs(np.array([s.world.goal for s in situations]))
        starts = np.array([s.q for s in situations]).T
        return inputs | {f"q_0.{q}": v for q, v in zip(planning.robot.states, starts)}

    def _reported(
        self,
        situation: Situation,
        batch: BatchRun,
        sample: int,
        values: np.ndarray,
        budget: float,
    ) -> Plan:
        planning = self.planner.planning
        residual = float(batch.residuals[sample].max())
        lost = batch.outcomes[sample] is Outcome.DIVERGED or not residual < LOST
        values[self._q, 0] = situation.q
        self._plans[situation.number] = self._cold(situation) if lost else values
        time = batch.settling_times[sample] * self.planner.radius
        return Plan(
            q=np.column_stack([values[self._q], values[self._t, -1]]),
            u=np.zeros((len(self._u), values.shape[1])) if lost else values[self._u],
            residual=np.inf if lost else residual,
            spent=budget if np.isnan(time) else float(time),
            relative_multiplier=float(values[self._rows].max()) / planning.soft.weight,
        )
