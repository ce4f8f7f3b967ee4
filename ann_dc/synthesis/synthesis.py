"""Synthesis of a network from stage equations: one cell with boundary data.

The forward half of the cell computes f. The backward half, which drives q and u, is its transpose,
derived from the atoms of the forward half (`adjoint.gradient`). The augmentation is realised by PI
multiplier neurons: every reader of mu reads m = mu + rho c, and every reader of beta reads b = beta
+ rho r.

The network computes in the problem's `Scales`: q = c + S q', t = c + S t', u = u_0 + U u', E = E_0
E'. Its multipliers are therefore mu = (E_0 / S) mu'. Every neuron stores the scale for the
conversion back, and every stationarity equation is multiplied by the scale of its variable.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import sympy as sp

from ann_dc.decomposition.equations import StageEquations, Stationarity, active
from ann_dc.network.cell import Cell, Connection, Template
from ann_dc.network.duals import PIDual
from ann_dc.network.network import Network
from ann_dc.problem.initial_guess import Guess, check_start, guess_of
from ann_dc.problem.scales import Scales, scales_of
from ann_dc.scale import Scale
from ann_dc.synthesis.adjoint import gradient
from ann_dc.synthesis.assembly import assemble
from ann_dc.synthesis.expressions import check_functions, signal_of
from ann_dc.synthesis.inequalities import (
    diode_drive,
    fill_residual,
    inequality_duals,
    name_diode,
    name_objective,
    objective_duals,
    objective_neurons,
    objective_wires,
    row_scales,
)
from ann_dc.synthesis.neurons import neurons_of
from ann_dc.synthesis.row import fixed_targets, input_scale, row_of, start_values
from ann_dc.synthesis.signals import Signal, add, divided, scaled
from ann_dc.synthesis.wiring import Wiring
from ann_dc.timing import phase
from ann_dc.validation import checked

_DUALS = (("mu", "c", "m"), ("beta", "r", "b"))
"""Population, its residual, and the multiplier that replaces the population for all readers."""


@checked
@phase("network")
def synthesize(
    equations: StageEquations,
    *,
    scales: Scales | None = None,
    initial_guess: Guess | None = None,
    rho: float = 1.0,
) -> Network:
    """Return the network that realises stage equations of any form.

    Time constants are one, without coarse-level neurons. Raises `SynthesisError` if the problem has
    a function that no block computes, and `ProblemError` if the map or the cost has no finite value
    or slope at the initial guess.

    Parameters
    ----------
    scales : Scales, optional
        Scales of states, controls and cost; `scales_of(problem)` by default.
    initial_guess : InitialGuess, callable or str, optional
        Initial guess in the user's units, a function of the problem, or a word of `GUESSES`;
        the straight line by default.
    rho : float
        Weight of the proportional path of every PI multiplier neuron, zero for the plain
        Lagrangian; chosen by `design`.

    References
    ----------
    Paper equations (11)-(17); closing A (q_0 constant) by default, closing B with
    ``Form(start_is_neuron=True)``.

    Examples
    --------
    >>> from ann_dc import decompose, plants
    >>> network = synthesize(decompose(plants.double_integrator(N=5)))
    >>> [neuron.name for neuron in network.cell.neurons][:3]
    ['q.x', 'q.v', 'u.a']
    """
    problem = equations.problem
    rows = (*equations.rows, *equations.end_rows)
    check_functions(*problem.f, problem.l, problem.l_N, *(row.expression for row in rows))
    guess = guess_of(problem, initial_guess)
    check_start(problem, guess)
    scales = scales or scales_of(problem)
    cell = _CellWiring(equations, scales, row_scales(equations, scales, guess), rho).cell()
    network = row_of(cell, equations, scales)
    measured = problem.objective_values(guess.q, guess.u).tolist()
    return network.with_start(start_values(network, guess, measured))


def _in_user_units(signal: Signal, scale: Scale) -> Signal:
    constant = {(): scale.offset} if scale.offset else {}
    return add(scaled(signal, scale.factor), constant)


class _CellWiring:
    """Cell of stage equations: neurons and their net inputs."""

    def __init__(
        self,
        equations: StageEquations,
        scales: Scales,
        of_rows: dict[str, Scale],
        rho: float,
    ) -> None:
        self.equations, self.scales, self.of_rows, self.rho = equations, scales, of_rows, rho
        self.rows = (*equations.rows, *equations.end_rows)
        self.diodes = inequality_duals(self.rows)
        self.problem, self.form = equations.problem, equations.form
        self.objectives = objective_duals(self.problem)
        self.states = [str(s) for s in self.problem.states]
        self.controls = [str(s) for s in self.problem.controls]
        self.fixed = fixed_targets(equations)
        self.inputs = [
            *(f"q_0.{s}" for s, fixed in zip(self.states, self.problem.fixed_start) if fixed),
            *(f"q_d.{s}" for s, fixed in zip(self.states, self.fixed) if fixed),
            *map(str, self.problem.inputs),
        ]
        self.untied = [s for s, f in zip(self.states, self.problem.fixed_start) if not f]
        self.multipliers = {n: Scale(scales.cost / row.factor) for n, row in of_rows.items()}
        of_row = objective_neurons(self.objectives, scales.cost)
        self.neurons = (*neurons_of(self.problem, scales, self.multipliers), *of_row)
        self.wiring = Wiring([*(n.name for n in self.neurons), *self.inputs])
        self._name_residuals(scales)
        self.symbols = self._symbols()
        self.wires = objective_wires(self.objectives, self.problem.horizon)
        self.gradients: dict[sp.Expr, dict[int, Signal]] = {}

    def _name_residuals(self, scales: Scales) -> None:
        """Add the sums c and r, and m = mu + rho c, b = beta + rho r."""
        for p, c, m in _DUALS:
            # (30) turns the residual of mu into an equation of the coordinator: no PI path there
            rho = 0.0 if p == "mu" and self.form.closed_lower_level else self.rho
            for s in self.states:
                residual = self.wiring.named_sum(f"{c}.{s}")
                self.wiring.named_sum(f"{m}.{s}")
                own = self.wiring.signal(f"{p}.{s}")
                self.wiring.fill(f"{m}.{s}", add(own, scaled(residual, rho)))
        for row, diode in zip(self.rows, self.diodes):
            name_diode(self.wiring, diode, self.rho, row.soft, self.multipliers[diode.neuron])
        for objective in self.objectives:
            name_objective(self.wiring, objective, self.rho, self.problem.temperature / scales.cost)

    def _symbols(self) -> dict[sp.Symbol, Signal]:
        """Return the signal of each symbol of the equations, in the user's units.

        In remainders, multipliers occur only next to those of their component, in units of cost.
        They are represented as S m, which `_local` divides by S, so that a plain wire has weight 1
        to the bit.
        """
        signal, equations, problem = self.wiring.signal, self.equations, self.problem
        states = list(zip(self.states, self.scales.states))
        symbols = {
            s: _in_user_units(signal(f"q.{name}"), scale)
            for s, (name, scale) in zip(problem.states, states)
        }
        symbols |= {
            s: _in_user_units(signal(f"u.{s}"), scale)
            for s, scale in zip(problem.controls, self.scales.controls)
        }
        symbols |= {
            s: _in_user_units(signal(str(s)), input_scale(values))
            for s, values in problem.inputs.items()
        }
        symbols |= {
            s: _in_user_units(signal(f"t.{name}"), scale)
            for s, (name, scale) in zip(equations.t, states)
        }
        for population, given in (("m", equations.mu), ("b", equations.beta)):
            symbols |= {
                s: scaled(signal(f"{population}.{name}"), scale.factor)
                for s, (name, scale) in zip(given, states)
            }
        for row, diode in zip(self.rows, self.diodes):
            of_multiplier = self.multipliers[diode.neuron].factor
            symbols[row.multiplier] = scaled(signal(diode.multiplier), of_multiplier)
        shares = zip(problem.shares, self.objectives)
        symbols |= {share: signal(objective.multiplier) for share, objective in shares}
        for symbol in (*problem.states, *problem.controls, *problem.inputs):
            self.wiring.name_value(symbols[symbol], str(symbol))
        return symbols

    def cell(self) -> Cell:
        drives = self._primal_drives()
        self._terminal()
        drives |= self._dual_drives() | self._diode_drives() | self._measured()
        blocks, connections = assemble(self.wiring, drives, self.wires)
        return Cell(
            neurons=self.neurons,
            inputs=tuple(self.inputs),
            blocks=blocks,
            connections=connections,
            duals=tuple(
                PIDual(neuron=f"{p}.{s}", residual=f"{c}.{s}", multiplier=f"{m}.{s}")
                for p, c, m in _DUALS
                for s in self.states
            ),
            inequality_duals=self.diodes,
            objectives=self.objectives,
            chains=tuple((f"q.{s}", f"t.{s}") for s in self.states),
        )

    def _primal_drives(self) -> dict[str, Signal]:
        """Return the net inputs of q and u (adjoint half, remainders) and of t (wires)."""
        equations, drives = self.equations, {}
        for population, names, group in (
            ("q", self.states, equations.grad_q),
            ("u", self.controls, equations.grad_u),
        ):
            for name, equation in zip(names, group):
                target = f"{population}.{name}"
                slope = self._gradient(equation)[self.wiring.sources[target]]
                rest = self._local(equation.remainder, target, equation.sign)
                if name in self.untied:
                    rest = self._from_second_stage(rest, target, equation.sign)
                drives[target] = scaled(add(slope, rest), equation.sign)
        for name, equation in zip(self.states, equations.grad_t):
            target = f"t.{name}"
            rest = self._local(equation.remainder, target, equation.sign)
            drives[target] = scaled(rest, equation.sign)
        return drives

    def _from_second_stage(self, rest: Signal, target: str, sign: int) -> Signal:
        """Add wires of weight zero at stage 0, where b ties a free q_0 to no neighbour."""
        names = self.wiring.names
        for atoms, weight in rest.items():
            later = np.full(self.problem.horizon, sign * weight)
            later[0] = 0.0
            (source,) = (names[atom] for atom in atoms)
            self.wires.append(Connection(source=source, target=target, weight=later))
        return {}

    def _dual_drives(self) -> dict[str, Signal]:
        """Return the net inputs of mu and beta, which are their residuals."""
        drives, groups = {}, (self.equations.grad_mu, self.equations.grad_beta)
        for (population, residual, _), group in zip(_DUALS, groups):
            for name, equation in zip(self.states, group):
                place = f"{residual}.{name}"
                self.wiring.fill(place, self._local(equation.remainder, place))
                drives[f"{population}.{name}"] = scaled(self.wiring.signal(place), equation.sign)
        return drives

    def _diode_drives(self) -> dict[str, Signal]:
        """Return the net inputs of z and fill the residuals of the rows."""
        for row, diode in zip(self.rows, self.diodes):
            units = self.of_rows[diode.neuron], self.multipliers[diode.neuron]
            fill_residual(self.wiring, diode, self._signal(row.expression), row.soft, units)
        return {diode.neuron: diode_drive(self.wiring, diode, self.rho) for diode in self.diodes}

    def _measured(self) -> dict[str, Signal]:
        """Return the net inputs of J, the contributions of the cell to its objectives."""
        given = zip(self.objectives, self.problem.stage_objectives.values())
        return {o.measure: divided(self._signal(e), self.scales.cost) for o, e in given}

    def _gradient(self, equation: Stationarity) -> dict[int, Signal]:
        """Return the potential's derivatives by every source, computed once per potential."""
        if equation.potential not in self.gradients:
            self.gradients[equation.potential] = gradient(
                self.wiring, self._potential(equation.potential), self.wiring.sources.values()
            )
        return self.gradients[equation.potential]

    def _potential(self, potential: sp.Expr) -> Signal:
        """Return cost plus multipliers times map, in the scale of the cost."""
        cost: Any = potential.xreplace({mu: sp.Integer(0) for mu in self.equations.mu})
        weighted = [(mu, sp.diff(potential, mu)) for mu in self.equations.mu]
        parts = [divided(self._signal(cost), self.scales.cost)]
        for (mu, plant), scale in zip(weighted, self.scales.states):
            signal = divided(self._signal(plant), scale.factor)
            (atom,) = self.symbols[mu]
            parts.append({tuple(sorted((*m, *atom))): w for m, w in signal.items()})
        return add(*parts)

    def _signal(self, expression: sp.Expr) -> Signal:
        return signal_of(expression, self.symbols, self.wiring)

    def _local(self, remainder: sp.Expr, target: str, sign: int = 1) -> Signal:
        """Return the in-cell part of a remainder; record the wires to neighbours."""
        neighbours = self._neighbours()
        for symbol, source, template, _ in neighbours:
            weight = float(remainder.coeff(symbol))  # pyright: ignore[reportArgumentType]
            if weight:
                self.wires.append(
                    Connection(
                        source=source, target=target, weight=sign * weight, template=template
                    )
                )
        here: Any = remainder.xreplace({symbol: zero for symbol, _, _, zero in neighbours})
        return self._of_component(self._signal(here), target)

    def _of_component(self, remainder: Signal, target: str) -> Signal:
        """Return a remainder in the scale of the component that it drives."""
        population, _, name = target.partition(".")
        if population == "u":  # S5: a cost gradient stands among the remainders
            factor = self.scales.controls[self.controls.index(name)].factor
            return scaled(divided(remainder, self.scales.cost), factor)
        return divided(remainder, self.scales.states[self.states.index(name)].factor)

    def _neighbours(self) -> list[tuple[sp.Symbol, str, Template, sp.Expr]]:
        """Return symbols of neighbouring cells, their nodes, templates and zero values."""
        equations = self.equations
        sides = {equations.t_before: Template.PREVIOUS}
        if self.form.coupling_reads_next:
            sides[equations.t_neighbour] = Template.NEXT
        read: list[tuple[sp.Symbol, str, Template, sp.Expr]] = [
            (s, f"t.{name}", side, sp.Float(scale.offset))
            for symbols, side in sides.items()
            for s, name, scale in zip(symbols, self.states, self.scales.states)
        ]
        return read + [
            (s, f"b.{name}", Template.NEXT, sp.Integer(0))
            for s, name in zip(equations.beta_next, self.states)
        ]

    def _terminal(self) -> None:
        """Wire end cost and rows to the last t only, with a weight that is zero elsewhere."""
        cost = self.equations.terminal_cost + active(self.equations.end_rows)
        if not cost.free_symbols or all(self.fixed):
            return
        signal = divided(self._signal(cost), self.scales.cost)
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
