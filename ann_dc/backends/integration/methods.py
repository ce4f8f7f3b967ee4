"""Integration methods with tolerances: a compiled method and SciPy's solvers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from ann_dc.backends.integration.tableaus import DOP853_TABLEAU, TSIT5_TABLEAU, Rows, Tableau
from ann_dc.conversion import declare_words
from ann_dc.errors import ArgumentTypeError, given_words, such_as
from ann_dc.validation import PositiveFinite, checked

SciPys: TypeAlias = Literal["RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA"]
"""Names of the `scipy.integrate` solvers; SciPy is imported only when one of them runs."""
Known: TypeAlias = tuple[np.ndarray, np.ndarray]
"""Times (T,) and states (T, n)."""
Between: TypeAlias = Callable[[Known, np.ndarray], np.ndarray]
"""Continuous extension of a run: states (K, n) at rising times (K,), between the known ones."""


@such_as("ann_dc.ode.RK45")
@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Method:
    """Integration method with its tolerances.

    Attributes
    ----------
    solver : Tableau, str or type
        Tableau for compiled code, name of a SciPy solver, or subclass of
        `scipy.integrate.OdeSolver`.
    rtol, atol : float
        Relative and absolute tolerance per step, the latter in network units. Those of an explicit
        method shrink as the residual falls.
    implicit : bool
        True if the solver uses the exact Jacobian.

    Examples
    --------
    >>> from ann_dc.backends import DOP853
    >>> DOP853.name, DOP853.tighter(100.0).rtol
    ('DOP853', 1e-08)
    """

    solver: Tableau | SciPys | type
    rtol: PositiveFinite = 1e-6
    atol: PositiveFinite = 1e-10
    implicit: bool = False

    def __post_init__(self) -> None:
        if isinstance(self.solver, type):
            from scipy import integrate  # loads slowly, and few runs need it

            if not issubclass(self.solver, integrate.OdeSolver):
                raise ArgumentTypeError(
                    "solver: expected a Tableau, SciPy's name of a solver or a subclass of "
                    f"OdeSolver, got {given_words(self.solver)}"
                )

    @property
    def name(self) -> str:
        """SciPy's name of the method, or "compiled"."""
        if isinstance(self.solver, Tableau):
            return "compiled"
        return self.solver if isinstance(self.solver, str) else self.solver.__name__

    @property
    def rows(self) -> Rows | None:
        """Tableau in the form read by loops; None for a SciPy solver."""
        return self.solver.rows if isinstance(self.solver, Tableau) else None

    @property
    def scipys(self) -> Any:
        """Subclass of `scipy.integrate.OdeSolver` for a method without a tableau."""
        if not isinstance(self.solver, str):
            return self.solver
        from scipy import integrate

        return getattr(integrate, self.solver)

    @checked
    def tighter(self, factor: PositiveFinite = 100.0) -> Method:
        """Return the method with both tolerances divided by a factor.

        The relative tolerance is at least 3e-14.
        """
        return replace(self, rtol=max(self.rtol / factor, 3e-14), atol=self.atol / factor)


COMPILED = Method(solver=DOP853_TABLEAU)
BATCHES = Method(solver=TSIT5_TABLEAU, rtol=1e-5, atol=1e-9)
RK23 = Method(solver="RK23")
RK45 = Method(solver="RK45")
DOP853 = Method(solver="DOP853")
RADAU = Method(solver="Radau", implicit=True)
BDF = Method(solver="BDF", implicit=True)
LSODA = Method(solver="LSODA", implicit=True)

METHODS = {m.name: m for m in (COMPILED, RK23, RK45, DOP853, RADAU, BDF, LSODA)}
"""Methods by name for Python and the command line: the compiled method and SciPy's."""
declare_words(Method, METHODS)
