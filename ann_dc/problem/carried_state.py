"""What a step length that is chosen adds to a declaration: a state that every stage hands on.

A declaration keeps what the user wrote, in his own symbols, and one component more: it is free at
both ends and its map is itself. A declaration that has been completed is left as it is, so that
`dataclasses.replace` works.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp

from ann_dc.errors import ProblemError
from ann_dc.problem.fields import is_vector, one_a_state, smooth_expression
from ann_dc.problem.step_length import Coordinate, StepLength


@dataclass(frozen=True, kw_only=True, eq=False)
class HandedOn:
    """What stands after the user's own components: nothing where the step length is given.

    Attributes
    ----------
    own : tuple of Symbol
        The user's states.
    step : StepLength or None

    Examples
    --------
    >>> x = sp.Symbol("x")
    >>> completed = HandedOn.of((x,), StepLength(low=0.1))
    >>> completed.states, completed.after((0.0,), None)
    ((x, h_free), (0.0, None))
    """

    own: tuple[sp.Symbol, ...]
    step: StepLength | None

    @classmethod
    def of(cls, states: tuple[sp.Symbol, ...], dt: float | StepLength) -> HandedOn:
        """Of a declaration's states, with the handed-on one or without.

        Raises
        ------
        ProblemError
            If a state was handed on for a step length that is now given.
        """
        if isinstance(dt, StepLength):
            own = states[:-1] if states[-1] == dt.coordinate else states
            return cls(own=own, step=dt)
        if isinstance(states[-1], Coordinate):
            raise ProblemError(
                f"dt: {dt:g} is given, but this problem chooses its step length (state "
                f"{states[-1]}); declare it anew with formulas in which the step is a number"
            )
        return cls(own=states, step=None)

    @property
    def states(self) -> tuple[sp.Symbol, ...]:
        """All n states."""
        return self.own if self.step is None else (*self.own, self.step.coordinate)

    @property
    def symbols(self) -> tuple[sp.Symbol, ...]:
        """What formulas may name besides states, controls and inputs."""
        return () if self.step is None else (self.step.symbol,)  # type: ignore[return-value]

    @property
    def units(self) -> dict[str, str]:
        """The unit of the state that is handed on: it is a plain number."""
        return {} if self.step is None else {str(self.step.coordinate): "1"}

    def check_symbol(self, given: Sequence[sp.Symbol]) -> None:
        """A ProblemError where the step length's symbol is also one of these."""
        for symbol in self.symbols:
            if symbol.name.lower() in [s.name.lower() for s in given]:
                raise ProblemError(
                    f"dt.symbol: {symbol} is one of the problem's own symbols; call the step "
                    'length something else, for instance StepLength(..., symbol="step")'
                )

    def stage_map(
        self, dynamics: Any, map: Any, known: set[sp.Symbol]
    ) -> tuple[str, tuple[sp.Expr, ...]]:
        """Which of the two is given, and its n components, checked; or a ProblemError."""
        if (dynamics is None) == (map is None):
            raise ProblemError(
                f"dynamics, map: {'neither' if map is None else 'both'} given; give the continuous "
                "right-hand side as dynamics= or the map q_{k+1} = f(q, u) as map=, one of the two"
            )
        name, given = ("map", map) if dynamics is None else ("dynamics", dynamics)
        last = self.states[-1] if dynamics is None else sp.S.Zero
        given = self.of_own(given, last)
        if not is_vector(given, len(self.own)):
            raise ProblemError(
                f"{name}: {len(self.own)} expressions expected, one for each state "
                f"({', '.join(str(s) for s in self.own)}), but got {given!r}"
            )
        checked = [smooth_expression(f"{name}[{s}]", e, known) for s, e in zip(self.own, given)]
        return name, self.after(checked, last)

    def end(self, name: str, given: Any) -> tuple[Any, ...]:
        """An end by its name, q_0 or q_d, which may be None: a value a state, or None where free.

        Raises
        ------
        ProblemError
        """
        if given is None and name == "q_d":
            given = (None,) * len(self.own)
        return self.after(one_a_state(name, self.of_own(given, None), self.own), None)

    def of_own(self, given: Any, last: Any) -> Any:
        """What is given for the user's states; ``last`` is what a completed one has at its end."""
        completed = self.step is not None and is_vector(given, len(self.own) + 1)
        return given[: len(self.own)] if completed and _is(given[len(self.own)], last) else given

    def after(self, checked: Sequence[Any], last: Any) -> tuple[Any, ...]:
        """What was checked for the user's states, and ``last`` for the one handed on."""
        return tuple(checked) if self.step is None else (*checked, last)


def _is(value: Any, last: Any) -> bool:
    return value is None if last is None else bool(value == last)
