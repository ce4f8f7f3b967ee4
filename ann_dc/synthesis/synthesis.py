"""Stage equations become a network: the cell is wired once, the ends of the row are data.

The forward half of the cell computes f; the backward half, which drives q and u, is its transpose,
derived from the forward half's own atoms (`Wiring.gradient`). The augmentation is wired as
PI duals: whatever reads mu reads m = mu + rho c, whatever reads beta reads b = beta + rho r.

Controls and the objective are normalised: the network's control is v = u / s with s such that
|df/dv| is about one, and its objective is scaled so that d2E/dv2 is about one. Every neuron carries
the unit that leads back.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import sympy as sp

from ann_dc.decomposition.equations import StageEquations, Stationarity, decompose
from ann_dc.network.cell import Cell, Connection, Neuron, PIDual, Role, Template
from ann_dc.network.ends import Absent, Pin
from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.start import Start, check_start, line_start
from ann_dc.synthesis.normalisation import Normalisation, normalise
from ann_dc.synthesis.wiring import Signal, Wiring, add, check_functions, scaled


def synthesize(
    source: OptimalControlProblem | StageEquations,
    *,
    normalisation: Normalisation | None = None,
    start: Start | None = None,
    rho: float = 1.0,
) -> Network:
    """Wire a problem (or its stage equations, in any form) as a network.

    Parameters
    ----------
    source : OptimalControlProblem or StageEquations
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

    References
    ----------
    Paper equations (11)-(17); closing A (q_0 constant) by default, closing B with
    ``Form(start_is_neuron=True)``.
    """
    equations = decompose(source) if isinstance(source, OptimalControlProblem) else source
    problem = equations.problem
    check_functions(*problem.f, problem.cost, problem.terminal_cost)
    start = start or line_start(problem)
    check_start(problem, start)
    units = normalisation or normalise(problem)
    network = _Synthesis(equations, units, rho).network()
    return network.with_start(start_values(network, start))


class _Synthesis:
    def __init__(self, equations: StageEquations, units: Normalisation, rho: float) -> None:
        self.equations, self.units, self.rho = equations, units, rho
        self.problem, self.form = equations.problem, equations.form
        self.states = [str(s) for s in self.problem.states]
        self.controls = [str(s) for s in self.problem.controls]
        self.fixed = (False,) * self.problem.n if self.form.terminal_free else self.problem.fixed
        self.inputs = [
            *(f"q_0.{s}" for s in self.states),
            *(f"q_d.{s}" for s, fixed in zip(self.states, self.fixed) if fixed),
            *map(str, self.problem.inputs),
        ]
        self.neurons = self._neurons()
        self.wiring = Wiring([*(n.name for n in self.neurons), *self.inputs])
        self.connections: list[Connection] = []
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

    def network(self) -> Network:
        blocks, connections = self.wiring.finish(self._drives(), self.connections)
        problem, last = self.problem, self.problem.horizon - 1
        values: dict[str, Any] = {f"q_0.{s}": v for s, v in zip(self.states, problem.q_0)}
        values |= {f"q_d.{s}": v for s, v in zip(self.states, problem.q_d or ()) if v is not None}
        values = {k: v for k, v in values.items() if k in self.inputs}
        values |= {str(s): v for s, v in problem.inputs.items()}
        closing = self.form.start_is_neuron
        return Network(
            cell=Cell(
                neurons=self.neurons,
                inputs=tuple(self.inputs),
                blocks=blocks,
                connections=connections,
                duals=tuple(
                    PIDual(neuron=f"{p}.{s}", residual=f"{c}.{s}", multiplier=f"{m}.{s}")
                    for p, c, m in (("mu", "c", "m"), ("beta", "r", "b"))
                    for s in self.states
                ),
                chains=tuple((f"q.{s}", f"t.{s}") for s in self.states),
            ),
            stages=problem.horizon,
            inputs=values,
            pins=tuple(
                [
                    Pin(neuron=f"q.{s}", stage=0, input=f"q_0.{s}")
                    for s in self.states
                    if not closing
                ]
                + [
                    Pin(neuron=f"t.{s}", stage=last, input=f"q_d.{s}")
                    for s, fixed in zip(self.states, self.fixed)
                    if fixed
                ]
            ),
            absent=tuple(Absent(neuron=name, stage=k) for name, k in self._absent(last)),
            left={f"t.{s}": f"q_0.{s}" for s in self.states} if closing else {},
            title=problem.name,
        )

    def _absent(self, last: int) -> list[tuple[str, int]]:
        absent = [] if self.form.start_is_neuron else [(f"beta.{s}", 0) for s in self.states]
        if self.form.printed_ranges:  # (16), (17): u and mu from k = 1, beta up to N - 2
            absent += [(f"u.{s}", 0) for s in self.controls]
            absent += [(f"mu.{s}", 0) for s in self.states]
            absent += [(f"beta.{s}", last) for s in self.states if last > 0]
        return absent

    # ---- the cell ----------------------------------------------------------------------------

    def _symbols(self) -> dict[sp.Symbol, Signal]:
        wiring, equations = self.wiring, self.equations
        symbols = {s: wiring.signal(f"q.{s}") for s in self.problem.states}
        symbols |= {
            s: scaled(wiring.signal(f"u.{s}"), unit)
            for s, unit in zip(self.problem.controls, self.units.control)
        }
        symbols |= {s: wiring.signal(str(s)) for s in self.problem.inputs}
        for population, given in (("t", equations.t), ("m", equations.mu), ("b", equations.beta)):
            symbols |= {
                s: wiring.signal(f"{population}.{name}") for s, name in zip(given, self.states)
            }
        return symbols

    def _drives(self) -> dict[str, Signal]:
        wiring = self.wiring
        for p, c, m in (("mu", "c", "m"), ("beta", "r", "b")):
            # (30) turns the residual of mu into an equation of the coordinator: no PI path there
            rho = 0.0 if p == "mu" and self.form.closed_lower_level else self.rho
            for s in self.states:
                residual = wiring.named_sum(f"{c}.{s}")
                wiring.named_sum(f"{m}.{s}")
                wiring.fill(f"{m}.{s}", add(wiring.signal(f"{p}.{s}"), scaled(residual, rho)))
        symbols = self._symbols()
        drives = self._primal_drives(symbols)
        for residual, population, group in (
            ("c", "mu", self.equations.grad_mu),
            ("r", "beta", self.equations.grad_beta),
        ):
            for name, equation in zip(self.states, group):
                signal = self._local(equation.remainder, symbols, f"{residual}.{name}")
                wiring.fill(f"{residual}.{name}", signal)
                drives[f"{population}.{name}"] = scaled(
                    wiring.signal(f"{residual}.{name}"), equation.sign
                )
        return drives

    def _primal_drives(self, symbols: dict[sp.Symbol, Signal]) -> dict[str, Signal]:
        equations, drives = self.equations, {}
        for population, names, group, units in (
            ("q", self.states, equations.grad_q, (1.0,) * self.problem.n),
            ("u", self.controls, equations.grad_u, self.units.control),
        ):
            for name, equation, unit in zip(names, group, units):
                target = f"{population}.{name}"
                gradient = self._gradient(equation, symbols)[self.wiring.sources[target]]
                rest = scaled(self._local(equation.remainder, symbols, target, equation.sign), unit)
                drives[target] = scaled(add(gradient, rest), equation.sign)
        for name, equation in zip(self.states, equations.grad_t):
            target = f"t.{name}"
            drives[target] = scaled(
                self._local(equation.remainder, symbols, target, equation.sign), equation.sign
            )
        self._terminal(symbols)
        return drives

    def _gradient(self, equation: Stationarity, symbols) -> dict[int, Signal]:
        """Derivatives of the equation's potential by every source, computed once a potential."""
        if equation.potential not in self.gradients:
            self.gradients[equation.potential] = self.wiring.gradient(
                self._potential(equation.potential, symbols), self.wiring.sources.values()
            )
        return self.gradients[equation.potential]

    def _potential(self, potential: sp.Expr, symbols) -> Signal:
        """Cost (scaled) plus multipliers times map: every mu in it is already in network units."""
        cost: Any = potential.xreplace({mu: sp.Integer(0) for mu in self.equations.mu})
        weighted = [(mu, sp.diff(potential, mu)) for mu in self.equations.mu]
        parts = [scaled(self.wiring.compile(cost, symbols), self.units.objective)]
        for mu, plant in weighted:
            signal = self.wiring.compile(plant, symbols)
            (atom,) = symbols[mu]
            parts.append({tuple(sorted((*m, *atom))): w for m, w in signal.items()})
        return add(*parts)

    def _local(self, remainder: sp.Expr, symbols, target: str, sign: int = 1) -> Signal:
        """The part of a remainder that stays in the cell; wires to neighbours are noted apart."""
        equations, form = self.equations, self.form
        behind = Template.NEXT if form.coupling_reads_next else Template.PREVIOUS
        neighbours = [(s, f"t.{n}", behind) for s, n in zip(equations.t_neighbour, self.states)]
        neighbours += [
            (s, f"b.{n}", Template.NEXT) for s, n in zip(equations.beta_next, self.states)
        ]
        for symbol, source, template in neighbours:
            weight = float(remainder.coeff(symbol))  # pyright: ignore[reportArgumentType]
            if weight:
                self.connections.append(
                    Connection(
                        source=source, target=target, weight=sign * weight, template=template
                    )
                )
        here: Any = remainder.xreplace({symbol: sp.Integer(0) for symbol, _, _ in neighbours})
        signal = self.wiring.compile(here, symbols)
        if target.startswith("u."):  # S5: a cost gradient stands among the remainders
            signal = scaled(signal, self.units.objective)
        return signal

    def _terminal(self, symbols) -> None:
        """The terminal cost drives t of the last stage only: a weight that is zero elsewhere."""
        cost = self.equations.terminal_cost
        if not cost.free_symbols or all(self.fixed):
            return
        signal = scaled(self.wiring.compile(cost, symbols), self.units.objective)
        last = np.zeros(self.problem.horizon)
        last[-1] = -1.0
        gradient = self.wiring.gradient(signal, self.wiring.sources.values())
        for name, fixed in zip(self.states, self.fixed):
            slope = gradient[self.wiring.sources[f"t.{name}"]]
            if slope and not fixed:
                self.wiring.named_sum(f"terminal.{name}")
                self.wiring.fill(f"terminal.{name}", slope)
                self.connections.append(
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
