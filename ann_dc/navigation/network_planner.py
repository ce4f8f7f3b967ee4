"""The planner that is a network: shifted by a stage, run for a while, its first control applied.

Every period the neurons take over what their right neighbours have found, the inputs say where the
robot is, what its map is about the path planned before and which half-planes are free, and the
network runs for as long as its hardware has.
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
"""Rounds of settling and linearising before a robot starts."""
FIRST = 1000.0
"""Fastest time constants of each of them, at least."""
CRUISE = 0.8
"""Share of the way that the highest speed allows which a first plan takes."""
STILL = 0.25
"""Share of the way to the goal, or of the longest plan, below which a plan leads nowhere."""
BANDWIDTH = 10e6
"""Of the op amps that hardware times are told for, in Hz."""
SHARE = 0.5
"""Of a control period that settling may take."""
ROWS = {LINEAR: half_planes, NONLINEAR: discs}
"""What cells are told of obstacles, by their form."""
LOST = 10.0
"""Residual of a network that is on no way to a plan: it begins anew."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NetworkPlanner:
    """Model-predictive control by one network with frozen gains; see `design_planner`.

    Attributes
    ----------
    planning : Planning
    network : Network
        Frozen.
    radius : float
        Of its spectrum in contact: fastest rate, per unit of network time.
    budget : float
        Fastest time constants that it may run each period.
    tolerance : float
        Residual at which a period's run ends earlier.
    margin : Margin
    """

    planning: Planning
    network: Network
    radius: float
    budget: float = 1000.0
    tolerance: float = 3e-4
    margin: Margin = field(default_factory=Margin)

    @property
    def dt(self) -> float:
        """The control period, in seconds: a stage of the plan."""
        return self.planning.dt

    def begin(self) -> NetworkDriver:
        """A driver that starts cold."""
        return NetworkDriver(self)

    def run(self, inputs: Mapping[str, np.ndarray], x: np.ndarray, budget: float) -> BatchRun:
        """Its network with some inputs, until it has settled or its budget is spent.

        Parameters
        ----------
        inputs : mapping of input name to (B, N) or (B,) array
        x : (B, n) array
            Where to start, in network units.
        budget : float
            In fastest time constants.
        """
        backend = OdeBackend(
            limit=budget * self._start_rate / self.radius,
            settling=Settling(tolerance=self.tolerance, confirm=1.0),
            verify=False,
        )
        return backend.run_batch(self.network, inputs, x)

    @cached_property
    def _start_rate(self) -> float:
        """One over the time constant that limits of a run are counted in."""
        return float(fast_evaluator(self.network).fastest_rate(self.network.start_state))

    def hardware_time(self, bandwidth: float) -> float:
        """Seconds that a period's budget takes with op amps of a bandwidth (GBW, in Hz).

        A circuit is scaled so that a fastest time constant is k / (2 pi GBW), with a margin k of
        10: 0.159 us at 10 MHz.
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
            f"{self.budget:g} fastest time constants a period: {1e6 * taken:.3g} us with op amps "
            f"of {megahertz:g} MHz, {taken / self.dt:.2%} of the control period; a period of "
            f"1 ms needs {needed / 1e6:.3g} MHz"
        )


class NetworkDriver:
    """One network on some journeys at once, a sample of a batch each.

    Attributes
    ----------
    planner : NetworkPlanner
    network : Network
        The planner's.
    batch : BatchRun
        The last run.
    begun : (B, n) array
        Where it began, in network units.
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
        """A plan for each situation; where a robot starts, after a few rounds of settling."""
        new = [s for s in situations if s.number not in self._plans]
        for situation in new:
            self._plans[situation.number] = self._cold(situation)
            self._sides[situation.number] = {}
        first: list[Plan] = []
        for _ in range(FIRST_ROUNDS if new else 0):
            first = self._run(new, max(self.planner.budget, FIRST))
        for situation in situations:
            if situation not in new:
                self._plans[situation.number] = self._shifted(self._plans[situation.number])
        rest = [s for s in situations if s not in new]
        told = dict(zip((s.number for s in new), first))
        if rest:
            told |= dict(zip((s.number for s in rest), self._run(rest, self.planner.budget)))
        return [told[s.number] for s in situations]

    def _cold(self, situation: Situation) -> np.ndarray:
        """Neurons' values (P, N) on the line to the goal, in the user's units."""
        stages = self.network.stages
        values = np.zeros(self.network.live.shape)
        line = np.repeat(situation.q[:, None], stages + 1, axis=1)
        line[:2] = self._line(situation).T
        values[self._q], values[self._t] = line[:, :-1], line[:, 1:]
        values[self._u[0]] = np.linalg.norm(line[:2, -1] - line[:2, 0]) / (stages * self.planner.dt)
        return values

    def _line(self, situation: Situation) -> np.ndarray:
        """Places (N+1, 2) on the line to the goal, or as far as a plan comes."""
        planner, stages = self.planner, self.network.stages
        way = situation.world.goal - situation.q[:2]
        longest = CRUISE * planner.planning.robot.limits[0, 1] * stages * planner.dt
        taken = way * min(1.0, longest / max(float(np.linalg.norm(way)), 1e-12))
        return situation.q[:2] + np.outer(np.linspace(0, 1, stages + 1), taken)

    def _way(self, path: np.ndarray, situation: Situation) -> np.ndarray:
        """Places (N, 2) that obstacles are to be kept off: of the plan, or of the line to the goal.

        A plan that leads nowhere does not show on which side an obstacle could be passed.
        """
        planned, line = path[self._q[:2]].T, self._line(situation)[:-1]
        lengths = (np.linalg.norm(places[-1] - places[0]) for places in (planned, line))
        return planned if next(lengths) >= STILL * next(lengths) else line

    def _shifted(self, values: np.ndarray) -> np.ndarray:
        """Every cell takes over what its right neighbour holds; the last one looks a stage on."""
        ahead = np.concatenate([values[:, 1:], values[:, -1:]], axis=1)
        ahead[self._q, -1] = values[self._t, -1]
        ahead[self._t, -1] = self.planner.planning.steps.map(
            ahead[self._q, -1:], ahead[self._u, -1:]
        )[:, 0]
        return ahead

    def _run(self, situations: Sequence[Situation], budget: float) -> list[Plan]:
        inputs = self._inputs(situations)
        values = np.array([self._plans[s.number] for s in situations])
        self.begun = self.network.pack((values - self._offset) / self._factor)
        self.batch = batch = self.planner.run(inputs, self.begun, budget)
        settled = self._offset + self._factor * self.network.unpack(batch.states)
        return [
            self._told(situation, batch, sample, settled[sample], budget)
            for sample, situation in enumerate(situations)
        ]

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

    def _told(
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
            pressed=float(values[self._rows].max()) / planning.soft.price,
        )
