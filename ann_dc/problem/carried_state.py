"""Carried state: the extra state of a declaration with an optimised step length.

The declaration contains the user's components and one more. The extra component is free at both
ends and its map is the identity. A completed declaration is not changed, so `dataclasses.replace`
works.
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
    """Completion of a declaration with the carried state, if the step length is free.

    Attributes
    ----------
    own : tuple of Symbol
        The user's states.

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
        """Return the completion of a declaration, with or without the carried state.

        Raises `ProblemError` if a carried state exists but the step length is now given.
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
        """States of the completed declaration, n in total."""
        return self.own if self.step is None else (*self.own, self.step.coordinate)

    @property
    def symbols(self) -> tuple[sp.Symbol, ...]:
        """Symbols that formulas may name in addition to states, controls and inputs."""
        return () if self.step is None else (self.step.symbol,)  # type: ignore[return-value]

    @property
    def units(self) -> dict[str, str]:
        """Unit of the carried state, which is dimensionless."""
        return {} if self.step is None else {str(self.step.coordinate): "1"}

    def check_symbol(self, given: Sequence[sp.Symbol]) -> None:
        """Raise a `ProblemError` if the step length's symbol is among the given ones."""
        for symbol in self.symbols:
            if symbol.name.lower() in [s.name.lower() for s in given]:
                raise ProblemError(
                    f"dt.symbol: {symbol} is one of the problem's own symbols; call the step "
                    'length something else, for instance StepLength(..., symbol="step")'
                )

    def stage_map(
        self, dynamics: Any, map: Any, known: set[sp.Symbol]
    ) -> tuple[str, tuple[sp.Expr, ...]]:
        """Return "dynamics" or "map" and its n checked components.

        Raises `ProblemError` if neither or both are given, or if the number of components is wrong.
        """
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
        """Return the values of q_0 or q_d per state, None if free.

        A missing q_d is free in all components. Raises `ProblemError` for invalid values.
        """
        if given is None and name == "q_d":
            given = (None,) * len(self.own)
        return self.after(one_a_state(name, self.of_own(given, None), self.own), None)

    def of_own(self, given: Any, last: Any) -> Any:
        """Return the values of the user's states, without the value of a carried state.

        The carried state is recognised by its value ``last``.
        """
        completed = self.step is not None and is_vector(given, len(self.own) + 1)
        return given[: len(self.own)] if completed and _is(given[len(self.own)], last) else given

    def after(self, checked: Sequence[Any], last: Any) -> tuple[Any, ...]:
        """Return the checked values of the user's states, plus ``last`` if completed."""
        return tuple(checked) if self.step is None else (*checked, last)


def _is(value: Any, last: Any) -> bool:
    return value is None if last is None else bool(value == last)
