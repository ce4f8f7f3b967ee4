"""Integration methods with their tolerances: our own in compiled code, SciPy's beside them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

from scipy import integrate

from ann_dc.backends.integration.tableaus import DOP853_TABLEAU, TSIT5_TABLEAU, Rows, Tableau
from ann_dc.hints.checked import checked
from ann_dc.hints.values import PositiveFinite
from ann_dc.hints.words import such_as


@such_as("ann_dc.ode.RK45")
@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Method:
    """An integration method with its tolerances.

    Attributes
    ----------
    solver : Tableau or type
        A tableau for compiled code, or a subclass of `scipy.integrate.OdeSolver`.
    rtol, atol : float
        Relative and absolute tolerance a step, the latter in network units; those of an explicit
        method get smaller as the residual falls.
    implicit : bool
        Whether the solver takes the exact Jacobian.

    Examples
    --------
    >>> from ann_dc.backends import DOP853
    >>> DOP853.name, DOP853.tighter(100.0).rtol
    ('DOP853', 1e-08)
    """

    solver: Tableau | type[integrate.OdeSolver]
    rtol: PositiveFinite = 1e-6
    atol: PositiveFinite = 1e-10
    implicit: bool = False

    @property
    def name(self) -> str:
        """SciPy's name of the method, or "compiled"."""
        return "compiled" if isinstance(self.solver, Tableau) else self.solver.__name__

    @cached_property
    def rows(self) -> Rows | None:
        """The tableau as loops read it; None of a solver of SciPy's."""
        return Rows.of(self.solver) if isinstance(self.solver, Tableau) else None

    @checked
    def tighter(self, factor: PositiveFinite = 100.0) -> Method:
        """The same method with both tolerances smaller by a factor; rtol is at least 3e-14."""
        return replace(self, rtol=max(self.rtol / factor, 3e-14), atol=self.atol / factor)


COMPILED = Method(solver=DOP853_TABLEAU)
BATCHES = Method(solver=TSIT5_TABLEAU, rtol=1e-5, atol=1e-9)
RK23 = Method(solver=integrate.RK23)
RK45 = Method(solver=integrate.RK45)
DOP853 = Method(solver=integrate.DOP853)
RADAU = Method(solver=integrate.Radau, implicit=True)
BDF = Method(solver=integrate.BDF, implicit=True)
LSODA = Method(solver=integrate.LSODA, implicit=True)

METHODS = {m.name: m for m in (COMPILED, RK23, RK45, DOP853, RADAU, BDF, LSODA)}
"""By name, for the command line: that in compiled code, and SciPy's."""
