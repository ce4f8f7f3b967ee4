r"""Symbolic stage equations: Lagrangian (8)-(10) and stationarity (11)-(15).

With l the stage cost, f the map and t_k the copy of q_{k+1} that stage k proposes,

.. math::
    L_k = l(q_k, u_k) + \mu_k^T (f(q_k, u_k) - t_k) + \beta_k^T (q_k - t_{k-1}).

A stationarity expression is stored as the derivative of a potential plus a remainder. The adjoint
half of a cell is derived from the potential; the remainder is linear wiring. The printed form
changes potentials and remainders only.

Inequalities g <= 0 extend the Lagrangian (10) of a stage by

.. math:: L_k \mathrel{+}= \zeta_k^T g(q_k, u_k), \qquad \zeta_k \ge 0, \qquad
    \zeta_{k,i}\, g_i(q_k, u_k) = 0,

so that (11) and (12) contain one more potential. Rows of the end are added to the terminal cost, in
(14) of the last stage. The multiplier of a soft row is limited by the penalty weight, and the row
may settle at g = d zeta (`Soft`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, TypeAlias, cast

import sympy as sp

from ann_dc.decomposition.form import CORRECTED, CostWeight, Form, LowerForm
from ann_dc.errors import FormError, such_as
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.inequality import Inequality
from ann_dc.problem.soft import Soft
from ann_dc.problem.step_length import StepLength
from ann_dc.summaries import summarised
from ann_dc.timing import phase
from ann_dc.validation import NotEmpty, checked


def fresh(name: str, problem: OptimalControlProblem) -> sp.Symbol:
    """Return a symbol of that name, with a trailing '_' if the name is taken."""
    taken = {s.name for s in (*problem.states, *problem.controls, *problem.inputs)}
    while name in taken:
        name += "_"
    return sp.Symbol(name)


def rounded(expression: sp.Expr) -> Any:
    """Return the expression with its numbers rounded to six digits for display."""
    return expression.xreplace({n: sp.Float(f"{float(n):.6g}") for n in expression.atoms(sp.Float)})


def at_rest(problem: OptimalControlProblem) -> dict[Any, Any]:
    """Return a substitution that sets every control to zero."""
    return {u: sp.Integer(0) for u in problem.controls}


def drift_and_drive(problem: OptimalControlProblem) -> list[tuple[sp.Expr, sp.Expr]]:
    """Return f(q, 0) - q and f(q, u) - f(q, 0) for every state, as the paper splits the map.

    Raises `FormError` if the map has no value without controls.
    """
    parts = []
    for q, f in zip(problem.states, problem.f):
        still = f.subs(at_rest(problem))
        drift, driven = sp.expand(still - q), sp.expand(f - still)
        if drift.has(sp.nan, sp.zoo):
            raise FormError(
                "S4, S6, S17: the map has no value at u = 0, so drift and control part cannot "
                "be separated; omit these switches"
            )
        parts.append((drift, driven))
    return parts


@dataclass(frozen=True, kw_only=True, eq=False)
class InequalityRow:
    """Row g <= 0 of a stage or of the end with its multiplier zeta.

    The expression is in q and u of the stage, or in t if the row is one of q_N alone (`at_end`).
    `soft` is None for a hard constraint.
    """

    name: str
    expression: sp.Expr
    multiplier: sp.Symbol
    at_end: bool
    soft: Soft | None = None

    def __str__(self) -> str:
        where = "at the end, " if self.at_end else ""
        soft = f", {self.soft}" if self.soft else ""
        return f"{where}{self.multiplier} >= 0 presses {self.expression} <= 0{soft}"


def stage_rows(problem: OptimalControlProblem) -> tuple[InequalityRow, ...]:
    """Return the rows of every stage of a problem."""
    return tuple(_row(problem, given) for given in problem.inequalities)


def end_rows(
    problem: OptimalControlProblem, targets: Sequence[sp.Symbol]
) -> tuple[InequalityRow, ...]:
    """Return the rows of q_N, in the targets t (n symbols) of the last stage."""
    at_end = dict(zip(problem.states, targets))
    return tuple(_row(problem, given, at_end) for given in problem.end_inequalities)


def _row(
    problem: OptimalControlProblem,
    given: Inequality,
    at_end: dict[sp.Symbol, sp.Symbol] | None = None,
) -> InequalityRow:
    return InequalityRow(
        name=given.name,
        expression=cast(sp.Expr, given.expression.xreplace(at_end or {})),
        multiplier=fresh(f"zeta_{'end_' if at_end else ''}{given.name}", problem),
        at_end=at_end is not None,
        soft=given.soft,
    )


def active(rows: Sequence[InequalityRow]) -> sp.Expr:
    """Return the sum of zeta g over rows, their contribution to a Lagrangian."""
    return sp.Add(*(row.multiplier * row.expression for row in rows))


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Stationarity:
    """One equation d(potential)/d(variable) + remainder = 0, driven with a sign.

    The potential (cost and map, times multipliers) is differentiated; the remainder contains
    couplings and terms of errata. The neuron of the variable follows tau * d(variable)/ds = sign *
    expression: -1 descends, +1 ascends.
    """

    variable: sp.Symbol
    potential: sp.Expr
    remainder: sp.Expr
    sign: int

    @cached_property
    def expression(self) -> sp.Expr:
        """Left-hand side of the stationarity equation."""
        return sp.diff(self.potential, self.variable) + self.remainder


Symbols: TypeAlias = Annotated[tuple[sp.Symbol, ...], NotEmpty()]
Equations: TypeAlias = Annotated[tuple[Stationarity, ...], NotEmpty()]


@such_as("ann_dc.decompose(problem)")
@checked
@summarised(
    lambda self: {
        "problem": self.problem.name,
        "form": self.form,
        "states": ", ".join(map(str, self.problem.states)),
        "controls": ", ".join(map(str, self.problem.controls)),
        "inequalities": len(self.rows) + len(self.end_rows),
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class StageEquations:
    """Equations of stage k of a decomposed problem, in the user's symbols.

    Attributes
    ----------
    problem : OptimalControlProblem
        Decomposed problem.
    form : Form
        Form of the equations.
    t, mu, beta : tuples of n symbols
        Target, multiplier of the map and multiplier of the coupling of stage k.
    t_before, t_neighbour, beta_next : tuples of n symbols
        Values read from neighbours: t_{k-1}, the value that the coupling reads (also t_{k-1}, or
        t_{k+1} with S9), and beta_{k+1}.
    lagrangian : expression
        L_k of (10), or of (25) with S7 and S12.
    grad_q, grad_u, grad_t, grad_mu, grad_beta : tuples of Stationarity
        Equations (11), (12), (14), (13), (15).
    terminal_cost : expression
        Cost of the last t in the symbols ``t``; its gradient is added to (14) at k = N - 1.
    rows, end_rows : tuples of InequalityRow
        Inequalities of a stage, and those of the last t.

    References
    ----------
    Paper equations (8)-(15).

    Examples
    --------
    The string form is plain text; `as_latex` gives LaTeX:

    >>> from ann_dc import plants
    >>> equations = decompose(plants.double_integrator())
    >>> for equation in equations.grad_beta:
    ...     print(equation.variable, "drives", equation.expression)
    beta_x drives -t_prev_x + x
    beta_v drives -t_prev_v + v
    """

    problem: OptimalControlProblem
    form: Form
    t: Symbols
    mu: Symbols
    beta: Symbols
    t_before: Symbols
    t_neighbour: Symbols
    beta_next: Symbols
    lagrangian: sp.Expr
    grad_q: Equations
    grad_u: Equations
    grad_mu: Equations
    grad_t: Equations
    grad_beta: Equations
    terminal_cost: sp.Expr
    rows: tuple[InequalityRow, ...]
    end_rows: tuple[InequalityRow, ...]

    @property
    def all(self) -> tuple[Stationarity, ...]:
        """Equations of a stage in the order q, u, t, mu, beta."""
        return (*self.grad_q, *self.grad_u, *self.grad_t, *self.grad_mu, *self.grad_beta)

    @property
    def numbered(self) -> tuple[tuple[int, Stationarity], ...]:
        """Equations with their numbers in the paper (`Form.numbers`), in paper order."""
        groups = (self.grad_q, self.grad_u, self.grad_mu, self.grad_t, self.grad_beta)
        numbered = zip(self.form.numbers, groups)
        return tuple((number, equation) for number, group in numbered for equation in group)

    def __str__(self) -> str:
        """Return Lagrangian and equations as text.

        In the text, ``t_prev_x`` is t_{k-1} and ``beta_next_x`` is beta_{k+1}.
        """
        lines = [f"form: {self.form}", f"L_k = {rounded(self.lagrangian)}"]
        for number, equation in self.numbered:
            sign = "-" if equation.sign < 0 else "+"
            left, right = f"tau d{equation.variable}/ds", rounded(equation.expression)
            lines.append(f"({number}) {left} = {sign}( {right} )")
        return "\n".join([*lines, *map(str, (*self.rows, *self.end_rows))])


@checked
@phase("stage equations")
def decompose(problem: OptimalControlProblem, form: Form | str = CORRECTED) -> StageEquations:
    """Split a problem into stages and derive their stationarity equations.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem to decompose.
    form : Form or str
        Form or its name in `FORMS` ("printed", "S8"); `CORRECTED` by default. `PRINTED` or a
        `switch` shows the effect of the paper's errata.

    Returns
    -------
    StageEquations

    Raises
    ------
    FormError
        If a switch has no meaning for this problem.

    References
    ----------
    Paper equations (8)-(15).

    Examples
    --------
    >>> x, a = sp.symbols("x a")
    >>> problem = OptimalControlProblem(
    ...     states=(x,), controls=(a,), map=(x + a,), cost=a**2 / 2, horizon=3, q_0=(0,), q_d=(1,))
    >>> decompose(problem).grad_u[0].expression
    a + mu_x
    """
    assert isinstance(form, Form)
    _check_ends(problem, form)
    stage = _Stage(problem, form)
    terminal_cost = problem.l_N.xreplace(dict(zip(problem.states, stage.t)))
    return StageEquations(
        problem=problem,
        form=form,
        t=stage.t,
        mu=stage.mu,
        beta=stage.beta,
        t_before=stage.t_before,
        t_neighbour=stage.t_neighbour,
        beta_next=stage.beta_next,
        lagrangian=stage.lagrangian(),
        grad_q=stage.state_equations(),
        grad_u=stage.control_equations(),
        grad_mu=stage.map_equations(),
        grad_t=stage.target_equations(),
        grad_beta=stage.coupling_equations(),
        terminal_cost=cast(sp.Expr, terminal_cost),
        rows=stage.rows,
        end_rows=end_rows(problem, stage.t),
    )


def _check_ends(problem: OptimalControlProblem, form: Form) -> None:
    """Raise a `FormError` if a switch needs a fixed q_0, a fixed dt or a single cost."""
    if problem.objectives and form != CORRECTED:
        raise FormError(
            f"{form}: the printed equations have one cost, and {problem.name} has the "
            f"objectives {', '.join(problem.objective_names)}; use one cost, or omit the "
            "switches"
        )
    if not all(problem.fixed_start) and (form.printed_ranges or form.closed_lower_level):
        free = ", ".join(str(s) for s, f in zip(problem.states, problem.fixed_start) if not f)
        raise FormError(
            f"S11, S15, S17: q_0 leaves {free} free, and these switches omit its connection to "
            "the first stage; omit them, or specify every component of q_0"
        )
    dividing = form.damping_without_dt or form.control_without_dt
    if isinstance(problem.dt, StepLength) and (dividing or form.lower_level is LowerForm.LITERAL):
        raise FormError(
            "S4, S6, S17: the switches change dt, which this problem determines; set dt to a number"
        )


DAMPING = 0.99
"""Factor 1 - gamma dt of q_k in (30), the paper's example."""


class _Stage:
    """Symbols, cost, map and equations of stage k in the chosen form."""

    def __init__(self, problem: OptimalControlProblem, form: Form) -> None:
        self.problem, self.form = problem, form
        self.t, self.mu, self.beta, self.t_before, t_next, self.beta_next = (
            tuple(fresh(f"{population}_{state}", problem) for state in problem.states)
            for population in ("t", "mu", "beta", "t_prev", "t_next", "beta_next")
        )
        self.t_neighbour = t_next if form.coupling_reads_next else self.t_before
        weight = {
            CostWeight.TOTAL: sp.Integer(1),
            CostWeight.COPIES: sp.Integer(problem.horizon),
            CostWeight.MEAN: sp.Rational(1, problem.horizon),
        }[form.cost_weight]
        self.cost = weight * problem.l
        self.plant = self._plant()
        self.rows = stage_rows(problem)
        self.active = active(self.rows)
        self.coupling = self._coupling()
        self.primal_sign = 1 if form.primal_ascends else -1

    def _plant(self) -> tuple[sp.Expr, ...]:
        """Return the map, with dt omitted from its drift (S4) or its control part (S6)."""
        form, problem = self.form, self.problem
        if not (form.damping_without_dt or form.control_without_dt):
            return tuple(problem.f)
        return tuple(
            q
            + drift / (problem.dt if form.damping_without_dt else 1)
            + driven / (problem.dt if form.control_without_dt else 1)
            for q, (drift, driven) in zip(problem.states, drift_and_drive(problem))
        )

    def _coupling(self) -> tuple[sp.Expr, ...]:
        """Return q_k - t_{k-1}, modified by S7, S8 and S9."""
        form = self.form
        return tuple(
            _times(form.coupling_coefficient, q) - (-1 if form.coupling_adds else 1) * neighbour
            for q, neighbour in zip(self.problem.states, self.t_neighbour)
        )

    def lagrangian(self) -> sp.Expr:
        """Return L_k of (10), or of (25), without the errata of the subsequent conditions."""
        held = self.form.coupling_coefficient
        chain = zip(self.beta, self.problem.states, self.t_before)
        return (
            self.cost
            + sum(m * (f - target) for m, f, target in zip(self.mu, self.problem.f, self.t))
            + sum(b * (_times(held, q) - t) for b, q, t in chain)
            + self.active
        )

    def _weighted(self, plant) -> sp.Expr:
        return sp.Add(*(m * f for m, f in zip(self.mu, plant)))

    def state_equations(self) -> tuple[Stationarity, ...]:
        """Return the equations (11)."""
        if self.form.closed_lower_level:  # (30): q_k = t_{k-1}
            held = DAMPING if self.form.lower_level is LowerForm.LITERAL else 1.0
            chain = zip(self.problem.states, self.t_before)
            return tuple(_wired(q, _times(held, q) - t, sign=-1) for q, t in chain)
        plant = self.plant
        if self.form.without_control_jacobian:
            plant = tuple(f.subs(at_rest(self.problem)) for f in plant)
        potential = self.cost + self._weighted(plant) + self.active
        return tuple(
            Stationarity(variable=q, potential=potential, remainder=b, sign=self.primal_sign)
            for q, b in zip(self.problem.states, self.beta)
        )

    def control_equations(self) -> tuple[Stationarity, ...]:
        """Return the equations (12)."""
        potential = self.cost + self._weighted(self.plant) + self.active
        if self.form.lower_level is LowerForm.LITERAL:  # (30): u = B^T mu / dt
            dt = self.problem.dt
            driven = tuple(part / dt for _, part in drift_and_drive(self.problem))
            potential = dt * self.cost - self._weighted(driven) + self.active
        slips = [sp.Integer(0)] * self.problem.m
        if self.form.control_reads_state_cost:
            # (12) puts dE/dq, which has n components, where m belong: take the first m.
            potential, n = self._weighted(self.plant) + self.active, self.problem.n
            slips = [
                self.cost.diff(self.problem.states[i]) if i < n else sp.Integer(0)
                for i in range(self.problem.m)
            ]
        return tuple(
            Stationarity(variable=u, potential=potential, remainder=slip, sign=self.primal_sign)
            for u, slip in zip(self.problem.controls, slips)
        )

    def map_equations(self) -> tuple[Stationarity, ...]:
        """Return the equations (13)."""
        if self.form.closed_lower_level:  # (30): mu_k = -beta_{k+1}
            sign = -1 if self.form.lower_level is LowerForm.LITERAL else 1
            return tuple(_wired(m, m + sign * b, sign=-1) for m, b in zip(self.mu, self.beta_next))
        return tuple(
            _wired(m, f - target, sign=1) for m, f, target in zip(self.mu, self.plant, self.t)
        )

    def target_equations(self) -> tuple[Stationarity, ...]:
        """Return the equations (14)."""
        plus = 1 if self.form.target_adds else -1
        return tuple(
            _wired(t, -m + plus * b, sign=-1) for t, m, b in zip(self.t, self.mu, self.beta_next)
        )

    def coupling_equations(self) -> tuple[Stationarity, ...]:
        """Return the equations (15)."""
        sign = -1 if self.form.dual_descends else 1
        return tuple(_wired(b, c, sign=sign) for b, c in zip(self.beta, self.coupling))


def _wired(variable: sp.Symbol, remainder: sp.Expr, *, sign: int) -> Stationarity:
    """Return an equation without a potential, which is wiring only."""
    return Stationarity(variable=variable, potential=sp.Integer(0), remainder=remainder, sign=sign)


def _times(factor: float, symbol: sp.Symbol) -> sp.Expr:
    return symbol if factor == 1 else factor * symbol
