r"""Linearised upper-level map: choice of lambda_t and lambda_beta and their rate.

Let J be the Jacobian of all net inputs at the solution, split into the lower level l = (q, u, mu)
and the upper level c = (t, beta). The lower level follows its coordinator, and the Schur complement
drives the upper level:

.. math::
    S = J_{cc} - J_{cl} J_{ll}^{-1} J_{lc}, \qquad
    e^{(j+1)} = (I + \Lambda S)\, e^{(j)}, \qquad \Lambda = diag(\lambda_t, \lambda_\beta) .

The iteration (17) converges near the solution if and only if the spectral radius of I + Lambda S is
below one. The error then decreases by a factor of that radius per iteration.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import minimize

from ann_dc.errors import DesignError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.network.network import COORDINATION, Network
from ann_dc.validation import State, checked

SINGULAR = 1e13
"""Condition number above which the lower level counts as singular."""

DECADES = np.log(10.0) * np.arange(-3.0, 1.5)
"""Logarithms of the initial gains, relative to the reciprocal of the largest eigenvalue of S."""
REFINED = 3
"""Number of grid gains to refine; the radius has kinks at which a simplex search stops."""


@dataclass(frozen=True, kw_only=True)
class UpperGains:
    """Gains of the upper level in network units, with the radius of its linearised map."""

    lambda_t: float
    lambda_beta: float
    radius: float

    @checked
    def predicted(self, tolerance: float = 1e-6) -> float:
        """Return the outer iterations in which the slowest mode decreases to ``tolerance``.

        ``tolerance`` is a fraction of the initial size. The number is infinite if the map is
        unstable.
        """
        return float(np.log(tolerance) / np.log(self.radius)) if self.radius < 1 else float("inf")


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class UpperMap:
    """Upper-level map of a network, linearised at its solution.

    Attributes
    ----------
    network : Network
        Network in which the lower level of every cell can be solved: q_0 is a neuron (closing B).
    settled : (n,) array
        State vector of the solution, in network units.

    Examples
    --------
    >>> import ann_dc
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> equations = ann_dc.decompose(problem, ann_dc.Form(start_is_neuron=True))
    >>> network = ann_dc.synthesize(equations)
    >>> designed = ann_dc.design(network, preconditioner=ann_dc.PreconditionerKind.MULTILEVEL)
    >>> upper = ann_dc.UpperMap(network=designed.network, settled=designed.state)
    >>> best = upper.best()
    >>> best.radius < upper.radius(0.01, 0.1) < 1  # both converge, one of them faster
    True

    References
    ----------
    Paper equation (17), corrected, linearised at its solution.
    """

    network: Network
    settled: State

    @cached_property
    def follow(self) -> np.ndarray:
        """Sensitivity d(q, u, mu) / d(t, beta) (lower, upper), in network units.

        Raises `DesignError` if the lower level is singular.
        """
        J, upper = self._jacobian, self._upper
        lower = ~upper
        if np.linalg.cond(J[np.ix_(lower, lower)]) > SINGULAR:
            raise DesignError(
                f"{self.network.title}: the lower level is singular at the solution. With q_0 "
                "constant, cell 0 has more equations than unknowns: close the chain with "
                "Form(start_is_neuron=True); otherwise the solution of a stage is not isolated"
            )
        return -np.linalg.solve(J[np.ix_(lower, lower)], J[np.ix_(lower, upper)])

    @cached_property
    def schur(self) -> np.ndarray:
        """Dense Schur complement S over all t and beta, in network units."""
        J, upper = self._jacobian, self._upper
        return J[np.ix_(upper, upper)] + J[np.ix_(upper, ~upper)] @ self.follow

    @cached_property
    def _jacobian(self) -> np.ndarray:
        return fast_evaluator(self.network).drive_jacobian(self.settled).toarray()

    @cached_property
    def _upper(self) -> np.ndarray:
        return self.network.of_population(*COORDINATION)

    @cached_property
    def _is_t(self) -> np.ndarray:
        return self.network.of_population("t")[self.network.of_population(*COORDINATION)]

    @checked
    def radius(self, lambda_t: float, lambda_beta: float) -> float:
        """Return the spectral radius of I + Lambda S for gains in network units."""
        gains = np.where(self._is_t, lambda_t, lambda_beta)
        eigenvalues = np.linalg.eigvals(np.eye(len(gains)) + gains[:, None] * self.schur)
        return float(np.abs(eigenvalues).max())

    def best(self) -> UpperGains:
        """Return the two gains with the smallest spectral radius.

        The best gains of a grid of decades are refined by a simplex search. A singular lower level
        raises `DesignError`.
        """
        scale = -np.log(np.abs(np.linalg.eigvals(self.schur)).max())
        grid = [scale + np.array(z) for z in itertools.product(DECADES, DECADES)]
        grid = sorted(grid, key=lambda z: self.radius(*np.exp(z)))
        found = min((self._refined(z) for z in grid[:REFINED]), key=lambda found: found.fun)
        lambda_t, lambda_beta = np.exp(found.x)
        return UpperGains(
            lambda_t=float(lambda_t), lambda_beta=float(lambda_beta), radius=float(found.fun)
        )

    def _refined(self, start: np.ndarray) -> Any:
        return minimize(
            lambda z: self.radius(*np.exp(z)),
            start,
            method="Nelder-Mead",
            options={"initial_simplex": start + np.array([[0, 0], [0.5, 0], [0, 0.5]])},
        )
