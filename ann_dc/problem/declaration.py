r"""Declaration of a discrete-time optimal-control problem with SymPy symbols.

.. math::
    \min \sum_{k=0}^{N-1} l(q_k, u_k) + l_N(q_N) + \max_i w_i \sum_{k=0}^{N-1} l_i(q_k, u_k)
    \quad\text{s.t.}\quad q_{k+1} = f(q_k, u_k),\; q_{0,i} \text{ given and }
    q_{N,i} = q_{d,i} \text{ where they are fixed,}\; g(q_k, u_k) \le 0,\; g_N(q_N) \le 0.

These are equations (5) to (7) and (23) of the paper, extended by general boundary conditions and
inequalities.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp

from ann_dc.dataclass_pickling import Record
from ann_dc.errors import ProblemError, UnknownNameError, such_as
from ann_dc.problem.bounds import (
    bounds_assumed,
    bounds_of,
    check_ends,
    check_inputs,
    limits_of,
    rows_of,
)
from ann_dc.problem.fields import (
    both_ends,
    check_names,
    inputs_by_name,
    measures,
    scales_by_hand,
    smooth_expression,
    symbols,
    text,
    units_by_name,
    values_a_stage,
    whole_stages,
)
from ann_dc.problem.functions import ProblemFunctions
from ann_dc.problem.inequality import Inequality, Relations, relations_of
from ann_dc.problem.minimax import (
    Objectives,
    Weights,
    objectives_of,
    share_symbol,
    temperature_of,
    weight_inputs,
    weight_symbol,
    weights_among,
    weights_of,
)
from ann_dc.problem.soft import Softness, soft_of
from ann_dc.problem.step_length import HandedOn, StepLength, step_length
from ann_dc.scale import Scale
from ann_dc.si_prefixes import counted
from ann_dc.summaries import summarised
from ann_dc.validation import checked

HOLD = "hold_{}"
"""Input that weights the holding of a control at stages at which it has no effect
(`decomposition.held`).
"""


@such_as("ann_dc.plants.car()")
@summarised(
    lambda self: {
        "name": self.name,
        "states": ", ".join(map(str, self.states)),
        "controls": ", ".join(map(str, self.controls)),
        "stages": self.horizon,
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class OptimalControlProblem(Record):
    """Discrete-time optimal-control problem in the user's symbols.

    Parameters
    ----------
    states, controls : sequence of sympy.Symbol
        The n components of q and the m components of u; each needs a unique identifier.
    dynamics : sequence of n expressions, optional
        Right-hand side F of the continuous dynamics; the forward Euler rule (4) gives the map q +
        dt F(q, u).
    map : sequence of n expressions, optional
        Discrete dynamics f(q, u) = q_{k+1}. Give either ``dynamics`` or ``map``.
    dt : float or StepLength
        Sampling interval in the unit of ``"time"`` (seconds by default). With ``map``, it only
        labels the time axis and defines the factor that the printed errata S4 and S6 omit; it may
        then remain 1. A `StepLength` makes the interval an optimisation variable: formulas may name
        it, and a state that is free at both ends is appended to the user's states.
    cost : expression
        Stage cost l(q, u), summed over k = 0..N-1; omit it if there are objectives only.
    terminal_cost : expression
        Cost of the last state q_N, in the state symbols.
    horizon : int
        Number of stages N >= 1.
    q_0 : sequence of n floats or None
        Initial state; a component that is None is free and optimised.
    q_d : sequence of n floats or None, or None
        Terminal state; a component that is None is free, None frees all of them.
    inputs : mapping of sympy.Symbol to float or sequence of N floats
        Further symbols of cost and dynamics, such as a reference, a weight or a measured
        disturbance. One value for all stages, or one per stage; the values may change without
        rewiring the network.
    name : str
        Name of the problem in tables and files.
    units : mapping of str or sympy.Symbol to str
        Units of measure, such as "m/s^2" ("1" for a dimensionless number), of states, controls,
        inputs, "cost" and "time" ("s" by default). They appear in figures and reports and change no
        number.
    scales : mapping of str or sympy.Symbol to float or Scale
        Value that a network value of 1 represents, by state, control or "cost"; a `Scale` also sets
        the value of a network's zero. The others are derived from the problem (`scales_of`).
    constraints, terminal_constraints : sequence of relations, or mapping of str to relation
        Smooth inequalities such as ``x**2 + y**2 >= 1``. ``constraints`` are in states, controls
        and inputs and apply at the stages 0..N-1; ``terminal_constraints`` are in states and inputs
        and apply at q_N. Unnamed relations are called g1, g2, ... and end1, end2, ...
    bounds : mapping of str or sympy.Symbol to (low, high)
        Bounds of states (at every stage, and at the end if it is free) and of controls; None for no
        bound.
    soft : Soft or float, or mapping of str to Soft or float, optional
        Rows that may be violated: one penalty weight for all, or by name (bounds: ``x_low``,
        ``x_high``).
    objectives : mapping of str to expression, or sequence of expressions
        Stage costs l_i(q, u) of at least two objectives; the largest sum is minimised together with
        the cost. Unnamed objectives are called J1, J2, ...
    weights : mapping of str to float, or sequence of floats
        Weights w_i >= 0 with sum one; 1 for all if omitted. They are inputs, called weight_J1, ...
    temperature : float
        T > 0 softens the maximum: T log sum_i exp(w_i J_i / T) is minimised instead, which exceeds
        the maximum by at most T log p. Zero, the default, minimises the maximum itself.

    Raises
    ------
    ProblemError
        If a field is invalid. The message gives the field, the value and a remedy.

    References
    ----------
    Paper equations (4) to (7), (23).

    Examples
    --------
    >>> x, v, a = sp.symbols("x v a")
    >>> problem = OptimalControlProblem(
    ...     states=(x, v), controls=(a,), dynamics=(v, a), dt=0.1,
    ...     cost=a**2 / 2, horizon=20, q_0=(0, 0), q_d=(1, 0))
    >>> problem.f
    (0.1*v + x, 0.1*a + v)
    """

    states: Sequence[sp.Symbol]
    controls: Sequence[sp.Symbol]
    horizon: int
    q_0: Sequence[float | None]
    cost: sp.Expr = None  # type: ignore[assignment]
    q_d: Sequence[float | None] | None = None
    dynamics: Sequence[sp.Expr] | None = None
    map: Sequence[sp.Expr] | None = None
    dt: float | StepLength = 1.0
    terminal_cost: sp.Expr = sp.S.Zero
    inputs: Mapping[sp.Symbol, float | Sequence[float]] = field(default_factory=dict)
    name: str = "problem"
    units: Mapping[str, str] = field(default_factory=dict)
    scales: Mapping[str, float | Scale] = field(default_factory=dict)
    constraints: Relations = ()
    terminal_constraints: Relations = ()
    bounds: Mapping[str, Sequence[float | None]] = field(default_factory=dict)
    soft: Softness = field(default_factory=dict)
    objectives: Objectives = ()
    weights: Weights = None
    temperature: float = 0.0

    def __post_init__(self) -> None:
        put = lambda key, value: object.__setattr__(self, key, value)  # noqa: E731
        put("dt", step_length(self.dt))
        handed = HandedOn.of(symbols("states", self.states), self.dt)
        put("states", handed.states)
        put("controls", symbols("controls", self.controls))
        put("name", text("name", self.name))
        put("horizon", whole_stages(self.horizon))
        put("weights", weights_of(self.weights, self.objectives))
        put("temperature", temperature_of(self.temperature, self.objectives))
        inputs = values_a_stage(self.inputs, self.horizon)
        put("inputs", inputs | values_a_stage(weight_inputs(self.weights), self.horizon))
        check_names([*self.states, *self.controls], [*self.inputs])
        handed.check_symbol([*self.states, *self.controls, *self.inputs])
        known = {*self.states, *self.controls, *self.inputs, *handed.symbols}
        at_end = known - {*self.controls}
        put(*handed.stage_map(self.dynamics, self.map, known))
        put("objectives", objectives_of(self.objectives, known, {*self.states, *self.controls}))
        if self.cost is None and not self.objectives:
            raise ProblemError("cost: missing; add a stage cost, or objectives")
        given = sp.S.Zero if self.cost is None else self.cost
        put("cost", smooth_expression("cost", given, known))
        put("terminal_cost", smooth_expression("terminal_cost", self.terminal_cost, at_end))
        for end, given in (("q_0", self.q_0), ("q_d", self.q_d)):
            put(end, handed.end(end, given))
        named = [*map(str, (*self.states, *self.controls))]
        put("units", {**handed.units, **measures(self.units, [*named, *map(str, self.inputs)])})
        put("scales", scales_by_hand(self.scales, named))
        bounds = bounds_of(self.bounds, (*handed.own, *self.controls))
        put("bounds", bounds_assumed(bounds, (*handed.own, *self.controls)))
        check_inputs(self.inputs)
        for place, own in (("constraints", known), ("terminal_constraints", at_end)):
            put(place, relations_of(place, getattr(self, place), own, {*self.inputs}, self.bounds))
        names = [*self.constraints, *self.terminal_constraints]
        names += [row.name for row in rows_of({}, self.bounds, self.states)]
        put("soft", soft_of(self.soft, names, [*map(str, self.controls)]))
        ends, rows = (self.q_0, self.q_d or ()), (self.inequalities, self.end_inequalities)
        check_ends(self.states, rows, ends, self.inputs, self.bounds)

    @cached_property
    def f(self) -> tuple[sp.Expr, ...]:
        """Discrete dynamics q_{k+1} = f(q_k, u_k), n components: ``map``, or Euler (4)."""
        if self.dynamics is None:
            return tuple(self._in_states(e) for e in self.map or ())
        step = getattr(self.dt, "expression", self.dt)
        return tuple(s + step * self._in_states(e) for s, e in zip(self.states, self.dynamics))

    @cached_property
    def l(self) -> sp.Expr:  # noqa: E743
        """Stage cost l(q_k, u_k) in states, controls and inputs, with weighted objectives."""
        weighed = self.stage_objectives.values()
        return self._in_states(self.cost) + sp.Add(*(z * e for z, e in zip(self.shares, weighed)))

    @cached_property
    def l_N(self) -> sp.Expr:
        """Terminal cost l_N(q_N) in states and inputs only."""
        return self._in_states(self.terminal_cost)

    @cached_property
    def inequalities(self) -> tuple[Inequality, ...]:
        """Rows g(q_k, u_k) <= 0 of a stage (r of them): `constraints`, then state bounds."""
        given = self._in_states, self.soft, self.inputs
        return rows_of(self.constraints, self.bounds, self.states, *given)

    @cached_property
    def end_inequalities(self) -> tuple[Inequality, ...]:
        """Rows g(q_N) <= 0 of the end: `terminal_constraints`, then bounds of free states."""
        free = [s for s, fixed in zip(self.states, self.fixed) if not fixed]
        return rows_of(self.terminal_constraints, self.bounds, free, self._in_states, self.soft)

    @cached_property
    def control_limits(self) -> np.ndarray:
        """Bounds (m, 2) of the controls, infinite if there is none."""
        return limits_of(self.bounds, self.controls)

    def _in_states(self, formula: sp.Expr) -> Any:
        """Return a formula with an optimised step length replaced by its state expression."""
        dt: Any = self.dt
        return formula if isinstance(dt, float) else formula.xreplace({dt.symbol: dt.expression})

    @property
    def held(self) -> tuple[sp.Symbol, ...]:
        """Controls that are held at stages without effect (`decomposition.held`)."""
        return tuple(c for c in self.controls if sp.Symbol(HOLD.format(c)) in self.inputs)

    @property
    def n(self) -> int:
        """Number of state components."""
        return len(self.states)

    @property
    def m(self) -> int:
        """Number of control components."""
        return len(self.controls)

    @property
    def fixed_start(self) -> tuple[bool, ...]:
        """Booleans (n,): True for each state component that q_0 fixes."""
        return tuple(value is not None for value in self.q_0)

    @property
    def fixed(self) -> tuple[bool, ...]:
        """Booleans (n,): True for each state component that q_d fixes."""
        return tuple(value is not None for value in self.q_d)  # type: ignore[union-attr]

    @property
    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """Boundary values (q_0, q_d) as arrays (n,).

        A free component has the value of its other end, or else zero or the offset of its `Scale`.
        """
        return both_ends(self.q_0, self.q_d or (), [self.scales.get(str(s)) for s in self.states])

    @property
    def handed_on(self) -> tuple[sp.Symbol, ...]:
        """State of an optimised step length, carried from stage to stage; otherwise empty."""
        return (self.dt.coordinate,) if isinstance(self.dt, StepLength) else ()

    @cached_property
    def functions(self) -> ProblemFunctions:
        """Problem as NumPy functions with exact derivatives."""
        return ProblemFunctions(
            states=self.states,
            controls=self.controls,
            inputs={s: np.asarray(v) for s, v in {**self.inputs, **self.shares}.items()},
            f=self.f,
            cost=self.l,
            terminal_cost=self.l_N,
            rows=[row.expression for row in self.inequalities],
            end_rows=[row.expression for row in self.end_inequalities],
        )

    @property
    def time_unit(self) -> str:
        """Unit of measure of dt, "s" by default."""
        return self.units.get("time", "s")

    @property
    def interval(self) -> str:
        """Sampling interval with its unit: "0.1 s", or "0.02 to 0.5 s" if optimised."""
        return self.timed(str(self.dt) if isinstance(self.dt, StepLength) else f"{self.dt:g}")

    def timed(self, number: str) -> str:
        """Return a number with the unit of dt."""
        return number + (f" {self.time_unit}" if self.time_unit != "1" else "")

    @property
    def cost_unit(self) -> str:
        """Unit of measure of the objective; empty if undeclared."""
        return self.units.get("cost", "")

    @checked
    def unit(self, name: str) -> str:
        """Return the unit of measure of a state, control, input or neuron.

        The unit is empty if undeclared. A multiplier has the unit of the cost divided by the unit
        of its state; a multiplier of an inequality has no unit.

        The name is, for example, "x", or the network's neuron name "q.x", "u.a" or "mu.x". Raises
        `UnknownNameError` with the list of names if the name is unknown.

        Examples
        --------
        >>> x, a = sp.symbols("x a")
        >>> problem = OptimalControlProblem(
        ...     states=(x,), controls=(a,), dynamics=(a,), cost=a**2, horizon=9, q_0=(0,),
        ...     units={x: "m", "a": "m/s"})
        >>> problem.unit("a"), problem.unit("q.x"), problem.unit("mu.x"), problem.time_unit
        ('m/s', 'm', 'cost/m', 's')
        """
        q, u, w = ([str(s) for s in group] for group in (self.states, self.controls, self.inputs))
        rows = [f"z.{row.name}" for row in self.inequalities]
        rows += [f"z_end.{row.name}" for row in self.end_inequalities]
        known = units_by_name(self.units, q, u, w, [*rows, *(f"z_J.{n}" for n in self.objectives)])
        known |= {f"J.{name}": self.cost_unit for name in self.objectives}
        known |= {"E.max": self.cost_unit} if self.objectives else {}
        if isinstance(self.dt, StepLength):
            known[str(self.dt.symbol)] = self.time_unit
        if name not in known:
            raise UnknownNameError.of("name", name, known)
        return known[name]

    @property
    def objective_names(self) -> tuple[str, ...]:
        """Names of all objectives."""
        return tuple(self.objectives)

    @property
    def stage_objectives(self) -> dict[str, sp.Expr]:
        """Terms w_i l_i by name, in states, controls and inputs; w_i is 1 without weights."""
        weigh = weight_symbol if self.weights else lambda _: sp.S.One
        return {n: weigh(n) * self._in_states(e) for n, e in self.objectives.items()}

    @property
    def shares(self) -> dict[sp.Symbol, np.ndarray]:
        """Equal coefficients zeta of all objectives, (N,) each, by symbol."""
        return self.shared_by(np.full(len(self.objectives), 1.0 / max(len(self.objectives), 1)))

    def shared_by(self, shares: np.ndarray) -> dict[sp.Symbol, np.ndarray]:
        """Return given coefficients (p,) by symbol, constant over the stages."""
        return {share_symbol(n): np.full(self.horizon, z) for n, z in zip(self.objectives, shares)}

    def functions_with(self, shares: np.ndarray | None) -> ProblemFunctions:
        """Return the problem functions with coefficients (p,), equal ones if None."""
        if shares is None:
            return self.functions
        given: Any = {**self.inputs, **self.shared_by(shares)}
        return self.functions.with_inputs(given)

    def objective_values(self, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return w_i J_i (p,) of a path ``q`` (n, N+1) with q_N, ``u`` (m, N).

        Examples
        --------
        >>> x, a = sp.symbols("x a")
        >>> problem = OptimalControlProblem(
        ...     states=(x,), controls=(a,), dynamics=(a,), horizon=2, q_0=(1,),
        ...     objectives={"effort": a**2, "error": x**2})
        >>> problem.objective_values(np.ones((1, 3)), np.full((1, 2), 3.0)).tolist()
        [18.0, 2.0]
        """
        return self.objective_stages(q, u).sum(axis=1)

    def objective_stages(self, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return the contribution of every stage to the objectives, (p, N)."""
        count = len(self.objectives)
        if not count:
            return np.zeros((0, self.horizon))
        alone = (np.zeros(count), *np.eye(count))
        common, *each = [self.functions_with(shares).cost(q[:, :-1], u) for shares in alone]
        return np.array(each) - common

    def with_inputs(self, /, *, q_0=None, q_d=None, **inputs) -> OptimalControlProblem:
        """Return the problem with other boundary conditions or input values.

        The wiring of the network is the same.

        Parameters
        ----------
        q_0, q_d : sequence of n floats or None, optional
            New initial and terminal state; None leaves the state unchanged.
        **inputs : float or sequence of N floats
            Values of declared inputs, by the name of their symbol.

        Returns
        -------
        OptimalControlProblem

        Raises
        ------
        ProblemError
            If an input is not declared, or a value would be invalid in a declaration.
        """
        given = {**self.inputs, **inputs_by_name(inputs, [*self.inputs])}
        other = replace(
            self,
            q_0=self.q_0 if q_0 is None else q_0,
            q_d=self.q_d if q_d is None else q_d,
            inputs=given,
            weights=weights_among(self.weights, given),
        )
        given: Any = {**other.inputs, **other.shares}
        if other.end_inequalities == self.end_inequalities:  # bounds of other free ends are others
            object.__setattr__(other, "functions", self.functions.with_inputs(given))
        return other

    @checked
    def with_horizon(self, horizon: int) -> OptimalControlProblem:
        """Return the problem with another number N of stages and the same dt.

        An input that varies from stage to stage must fit the new horizon.
        """
        # an input that was given once fits any horizon
        constant = {s: v if np.ptp(v) else np.min(v) for s, v in self.inputs.items()}
        return replace(self, horizon=horizon, inputs=constant)

    def __str__(self) -> str:
        own = self.states[: self.n - len(self.handed_on)]
        reported = {
            "free at the start": [s for s, f in zip(own, self.fixed_start) if not f],
            "free at the end": [s for s, f in zip(own, self.fixed) if not f],
            "constraints": self.constraints,
            "at the end": self.terminal_constraints,
            "bounds": self.bounds,
            "soft": self.soft,
            "constant where it has no effect": self.held,
        }
        return (
            f"{self.name}: {counted(self.n, 'states')} ({', '.join(map(str, self.states))}), "
            f"{counted(self.m, 'controls')} ({', '.join(map(str, self.controls))}), "
            f"{counted(self.horizon, 'stages')} of {self.interval}"
            + "".join(f", {words}: {', '.join(map(str, s))}" for words, s in reported.items() if s)
        )
