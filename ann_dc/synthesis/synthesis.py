"""Stage equations become a network: the cell is wired once, the ends of the row are data.

The forward half of the cell computes f; the backward half, which drives q and u, is its transpose,
derived from the forward half's own atoms (`adjoint.gradient`). The augmentation is wired as
PI duals: whatever reads mu reads m = mu + rho c, whatever reads beta reads b = beta + rho r.

Controls and the objective are normalised: the network's control is v = u / s with s such that
|df/dv| is about one, and its objective is scaled so that d2E/dv2 is about one. Every neuron carries
the unit that leads back.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import sympy as sp

from ann_dc.decomposition.equations import StageEquations, Stationarity
from ann_dc.network.cell import Cell, Connection, Neuron, PIDual, Role, Template
from ann_dc.network.ends import Absent, Pin
from ann_dc.network.network import Network
from ann_dc.problem.start import Start, check_start, line_start
from ann_dc.synthesis.adjoint import gradient
from ann_dc.synthesis.assembly import assemble
from ann_dc.synthesis.expressions import check_functions, signal_of
from ann_dc.synthesis.normalisation import Normalisation, normalise
from ann_dc.synthesis.signals import Signal, add, scaled
from ann_dc.synthesis.wiring import Wiring

DUALS = (("mu", "c", "m"), ("beta", "r", "b"))
"""Population, its residual, and the multiplier that everybody reads in its place."""


def synthesize(
    equations: StageEquations,
    *,
    normalisation: Normalisation | None = None,
    start: Start | None = None,
    rho: float = 1.0,
) -> Network:
    """Wire stage equations, in any form, as a network.

    Parameters
    ----------
    equations : StageEquations
    normalisation : Normalisation, optional
        Units of controls and objective; `normalise(problem)` by default.
    start : Start, optional
        Initial values in the user's units; the straight line by default.
    rho : float
        Weight of every PI dual's proportional path, zero for the plain Lagrangian. `design`
        chooses it.

    Returns
    -------
    Network
        Unit time constants, no coordinators.

    Raises
    ------
    SynthesisError
        If the problem has a function that no block computes.
    ProblemError
        If the map or the cost has no finite value or slope at the start.

    References
    ----------
    Paper equations (11)-(17); closing A (q_0 constant) by default, closing B with
    ``Form(start_is_neuron=True)``.
    """
    problem = equations.problem
    check_functions(*problem.f, problem.cost, problem.terminal_cost)
    start = start or line_start(problem)
    check_start(problem, start)
    cell = _CellWiring(equations, normalisation or normalise(problem), rho).cell()
    network = _row(cell, equations)
    return network.with_start(start_values(network, start))


def _row(cell: Cell, equations: StageEquations) -> Network:
    """N cells in a row, and what stands at its two ends."""
    problem, last = equations.problem, equations.problem.horizon - 1
    closing = equations.form.start_is_neuron
    states = [str(s) for s in problem.states]
    pins = [] if closing else [Pin(neuron=f"q.{s}", stage=0, input=f"q_0.{s}") for s in states]
    pins += [
        Pin(neuron=f"t.{s}", stage=last, input=f"q_d.{s}")
        for s, fixed in zip(states, _fixed(equations))
        if fixed
    ]
    values: dict[str, Any] = {f"q_0.{s}": value for s, value in zip(states, problem.q_0)}
    values |= {f"q_d.{s}": value for s, value in zip(states, problem.q_d or ())}
    values = {name: value for name, value in values.items() if name in cell.inputs}
    values |= {str(s): value for s, value in problem.inputs.items()}
    return Network(
        cell=cell,
        stages=problem.horizon,
        inputs=values,
        pins=tuple(pins),
        absent=tuple(Absent(neuron=name, stage=k) for name, k in _absent(equations)),
        left={f"t.{s}": f"q_0.{s}" for s in states} if closing else {},
        title=problem.name,
    )


def _fixed(equations: StageEquations) -> tuple[bool, ...]:
    """For each state component, whether its last target is held at q_d."""
    problem = equations.problem
    return (False,) * problem.n if equations.form.terminal_free else problem.fixed


def _absent(equations: StageEquations) -> list[tuple[str, int]]:
    """Neurons (name, stage) that the ends of the row do without."""
    problem, form, last = equations.problem, equations.form, equations.problem.horizon - 1
    absent = [] if form.start_is_neuron else [(f"beta.{s}", 0) for s in problem.states]
    if form.printed_ranges:  # (16), (17): u and mu from k = 1, beta up to N - 2
        absent += [(f"u.{s}", 0) for s in problem.controls]
        absent += [(f"mu.{s}", 0) for s in problem.states]
        absent += [(f"beta.{s}", last) for s in problem.states if last > 0]
    return absent


class _CellWiring:
    """The cell of stage equations: neurons, and what drives each of them."""

    def __init__(self, equations: StageEquations, units: Normalisation, rho: float) -> None:
        self.equations, self.units, self.rho = equations, units, rho
        self.problem, self.form = equations.problem, equations.form
        self.states = [str(s) for s in self.problem.states]
        self.controls = [str(s) for s in self.problem.controls]
        self.fixed = _fixed(equations)
        self.inputs = [
            *(f"q_0.{s}" for s in self.states),
            *(f"q_d.{s}" for s, fixed in zip(self.states, self.fixed) if fixed),
            *map(str, self.problem.inputs),
        ]
        self.neurons = self._neurons()
        self.wiring = Wiring([*(n.name for n in self.neurons), *self.inputs])
        self._name_residuals()
        self.symbols = self._symbols()
        self.wires: list[Connection] = []
        self.gradients: dict[sp.Expr, dict[int, Signal]] = {}

    def _neurons(self) -> tuple[Neuron, ...]:
        per_objective = 1.0 / self.units.objective
        rows = [(f"q.{s}", Role.PRIMAL, 1.0) for s in self.states]
        rows += [
            (f"u.{s}", Role.PRIMAL, unit) for s, unit in zip(self.controls, self.units.control)
        ]
        rows += [(f"t.{s}", Role.PRIMAL, 1.0) for s in self.states]
        rows += [
            (f"{p}.{s}", Role.DUAL, per_objective) for p in ("mu", "beta") for s in self.states
        ]
        return tuple(Neuron(name=name, role=role, unit=unit) for name, role, unit in rows)

    def _name_residuals(self) -> None:
        """The sums c and r, and m = mu + rho c, b = beta + rho r."""
        for p, c, m in DUALS:
            # (30) turns the residual of mu into an equation of the coordinator: no PI path there
            rho = 0.0 if p == "mu" and self.form.closed_lower_level else self.rho
            for s in self.states:
                residual = self.wiring.named_sum(f"{c}.{s}")
                self.wiring.named_sum(f"{m}.{s}")
                own = self.wiring.signal(f"{p}.{s}")
                self.wiring.fill(f"{m}.{s}", add(own, scaled(residual, rho)))

    def _symbols(self) -> dict[sp.Symbol, Signal]:
        """What carries each symbol of the equations, in the user's units."""
        signal, equations = self.wiring.signal, self.equations
        symbols = {s: signal(f"q.{s}") for s in self.problem.states}
        symbols |= {
            s: scaled(signal(f"u.{s}"), unit)
            for s, unit in zip(self.problem.controls, self.units.control)
        }
        symbols |= {s: signal(str(s)) for s in self.problem.inputs}
        for population, given in (("t", equations.t), ("m", equations.mu), ("b", equations.beta)):
            symbols |= {s: signal(f"{population}.{name}") for s, name in zip(given, self.states)}
        return symbols

    def cell(self) -> Cell:
        """The wired cell."""
        drives = self._primal_drives()
        self._terminal()
        drives |= self._dual_drives()
        blocks, connections = assemble(self.wiring, drives, self.wires)
        return Cell(
            neurons=self.neurons,
            inputs=tuple(self.inputs),
            blocks=blocks,
            connections=connections,
            duals=tuple(
                PIDual(neuron=f"{p}.{s}", residual=f"{c}.{s}", multiplier=f"{m}.{s}")
                for p, c, m in DUALS
                for s in self.states
            ),
            chains=tuple((f"q.{s}", f"t.{s}") for s in self.states),
        )

    def _primal_drives(self) -> dict[str, Signal]:
        """Of q and u: the adjoint half and what stands beside it; of t: wires alone."""
        equations, drives = self.equations, {}
        for population, names, group, units in (
            ("q", self.states, equations.grad_q, (1.0,) * self.problem.n),
            ("u", self.controls, equations.grad_u, self.units.control),
        ):
            for name, equation, unit in zip(names, group, units):
                target = f"{population}.{name}"
                slope = self._gradient(equation)[self.wiring.sources[target]]
                rest = scaled(self._local(equation.remainder, target, equation.sign), unit)
                drives[target] = scaled(add(slope, rest), equation.sign)
        for name, equation in zip(self.states, equations.grad_t):
            target = f"t.{name}"
            rest = self._local(equation.remainder, target, equation.sign)
            drives[target] = scaled(rest, equation.sign)
        return drives

    def _dual_drives(self) -> dict[str, Signal]:
        """Of mu and beta: their residuals."""
        drives, groups = {}, (self.equations.grad_mu, self.equations.grad_beta)
        for (population, residual, _), group in zip(DUALS, groups):
            for name, equation in zip(self.states, group):
                place = f"{residual}.{name}"
                self.wiring.fill(place, self._local(equation.remainder, place))
                drives[f"{population}.{name}"] = scaled(self.wiring.signal(place), equation.sign)
        return drives

    def _gradient(self, equation: Stationarity) -> dict[int, Signal]:
        """Derivatives of the equation's potential by every source, computed once a potential."""
        if equation.potential not in self.gradients:
            self.gradients[equation.potential] = gradient(
                self.wiring, self._potential(equation.potential), self.wiring.sources.values()
            )
        return self.gradients[equation.potential]

    def _potential(self, potential: sp.Expr) -> Signal:
        """Cost (scaled) plus multipliers times map: every mu in it is already in network units."""
        cost: Any = potential.xreplace({mu: sp.Integer(0) for mu in self.equations.mu})
        weighted = [(mu, sp.diff(potential, mu)) for mu in self.equations.mu]
        parts = [scaled(self._signal(cost), self.units.objective)]
        for mu, plant in weighted:
            signal = self._signal(plant)
            (atom,) = self.symbols[mu]
            parts.append({tuple(sorted((*m, *atom))): w for m, w in signal.items()})
        return add(*parts)

    def _signal(self, expression: sp.Expr) -> Signal:
        return signal_of(expression, self.symbols, self.wiring)

    def _local(self, remainder: sp.Expr, target: str, sign: int = 1) -> Signal:
        """The part of a remainder that stays in the cell; wires to neighbours are noted apart."""
        neighbours = self._neighbours()
        for symbol, source, template in neighbours:
            weight = float(remainder.coeff(symbol))  # pyright: ignore[reportArgumentType]
            if weight:
                self.wires.append(
                    Connection(
                        source=source, target=target, weight=sign * weight, template=template
                    )
                )
        here: Any = remainder.xreplace({symbol: sp.Integer(0) for symbol, _, _ in neighbours})
        signal = self._signal(here)
        if target.startswith("u."):  # S5: a cost gradient stands among the remainders
            signal = scaled(signal, self.units.objective)
        return signal

    def _neighbours(self) -> list[tuple[sp.Symbol, str, Template]]:
        """Symbols of neighbouring cells, and the nodes there that carry them."""
        equations = self.equations
        behind = Template.NEXT if self.form.coupling_reads_next else Template.PREVIOUS
        read = [(s, f"t.{name}", behind) for s, name in zip(equations.t_neighbour, self.states)]
        return read + [
            (s, f"b.{name}", Template.NEXT) for s, name in zip(equations.beta_next, self.states)
        ]

    def _terminal(self) -> None:
        """The terminal cost drives t of the last stage only: a weight that is zero elsewhere."""
        cost = self.equations.terminal_cost
        if not cost.free_symbols or all(self.fixed):
            return
        signal = scaled(self._signal(cost), self.units.objective)
        last = np.zeros(self.problem.horizon)
        last[-1] = -1.0
        slopes = gradient(self.wiring, signal, self.wiring.sources.values())
        for name, fixed in zip(self.states, self.fixed):
            slope = slopes[self.wiring.sources[f"t.{name}"]]
            if slope and not fixed:
                self.wiring.named_sum(f"terminal.{name}")
                self.wiring.fill(f"terminal.{name}", slope)
                self.wires.append(
                    Connection(source=f"terminal.{name}", target=f"t.{name}", weight=last)
                )


def start_values(network: Network, start: Start) -> np.ndarray:
    """State vector (n,) of a network from initial values in the user's units.

    Duals that the start does not give are zero.
    """
    values = np.zeros(network.live.shape)
    groups = {
        "q": start.q[:, :-1],
        "t": start.q[:, 1:],
        "u": start.u,
        "mu": start.mu,
        "beta": start.beta,
    }
    position: dict[str, int] = {}
    for row, neuron in enumerate(network.cell.neurons):
        index = position.get(neuron.population, 0)
        position[neuron.population] = index + 1
        group = groups[neuron.population]
        if group is not None:
            values[row] = group[index] / neuron.unit
    return network.pack(values)
