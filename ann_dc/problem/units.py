"""Units of measure of a problem: labels of numbers without effect on values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ann_dc.errors import UnknownNameError
from ann_dc.problem.step_length import StepLength
from ann_dc.validation import checked


class Measured:
    """Units of measure of a problem."""

    if TYPE_CHECKING:
        states: Any
        controls: Any
        inputs: Any
        units: Any
        dt: Any
        inequalities: Any
        end_inequalities: Any
        objectives: Any

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
        >>> import sympy as sp
        >>> from ann_dc import OptimalControlProblem
        >>> x, a = sp.symbols("x a")
        >>> problem = OptimalControlProblem(
        ...     states=(x,), controls=(a,), dynamics=(a,), cost=a**2, horizon=9, q_0=(0,),
        ...     units={x: "m", "a": "m/s"})
        >>> problem.unit("a"), problem.unit("q.x"), problem.unit("mu.x"), problem.time_unit
        ('m/s', 'm', 'cost/m', 's')
        """
        q, u, w = ([str(s) for s in group] for group in (self.states, self.controls, self.inputs))
        known = units_by_name(self.units, q, u, w, self.inequalities, self.end_inequalities)
        known |= {f"z_J.{name}": "" for name in self.objectives}
        known |= {f"J.{name}": self.cost_unit for name in self.objectives}
        known |= {"E.max": self.cost_unit} if self.objectives else {}
        if isinstance(self.dt, StepLength):
            known[str(self.dt.symbol)] = self.time_unit
        if name not in known:
            raise UnknownNameError.of("name", name, known)
        return known[name]


def units_by_name(
    units: Mapping[str, str],
    states: Sequence[str],
    controls: Sequence[str],
    inputs: Sequence[str],
    rows: Sequence[Any],
    end_rows: Sequence[Any],
) -> dict[str, str]:
    """Return the unit of every state, control, input and neuron; empty if unknown."""
    known = {name: units.get(name, "") for name in (*states, *controls, *inputs)}
    known |= {f"{p}.{s}": known[s] for p in ("q", "t") for s in states}
    cost = units.get("cost", "cost")
    duals = {f"{p}.{s}": known[s] and per(cost, known[s]) for p in ("mu", "beta") for s in states}
    pressed = [*(f"z.{row.name}" for row in rows), *(f"z_end.{row.name}" for row in end_rows)]
    return known | duals | {f"u.{s}": known[s] for s in controls} | dict.fromkeys(pressed, "")


def per(above: str, below: str) -> str:
    """Return the unit of a quotient.

    >>> per("cost", "m"), per("cost", "m/s"), per("J", "1"), per("J/s", "m")
    ('cost/m', 'cost/(m/s)', 'J', '(J/s)/m')
    """
    if below == "1":
        return above
    above, below = (f"({u})" if set(u) & set("/*· ") else u for u in (above, below))
    return f"{above}/{below}"
