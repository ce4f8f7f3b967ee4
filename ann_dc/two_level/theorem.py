r"""Theorem IV.2: is its hypothesis on the stages true? Checked at the solution, for any problem.

The theorem promises that the two-level iteration converges when the matrices

.. math::
    \frac{\partial G_k}{\partial v_k}, \qquad
    G_k = \nabla_{v_k} L, \quad v_k = (q_k, u_k),

are positive semi-definite at the solution, one of them positive definite. They are the Hessians of
the stages' own Lagrangians,

.. math::
    \frac{\partial G_k}{\partial v_k} = \nabla^2_{vv}\,(E_k + \mu_k^T f(q_k, u_k)) ,

not diag(0.99, 0.1) as (31), (32) have it: for a plant in which controls multiply functions of the
state they are indefinite as a rule.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.evaluation.generated.choice import fast_evaluator
from ann_dc.evaluation.reference import evaluator, tape_with_penalty
from ann_dc.hints.checked import checked
from ann_dc.hints.values import NotEmpty, Shape, State
from ann_dc.network.network import Network

STAGE_POPULATIONS = ("q", "u")
"""What v_k is made of."""

ROUNDING = 1e-9
"""An eigenvalue below this share of the largest one counts as zero."""


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Hypothesis:
    """Whether the matrices of Theorem IV.2 are as it asks; its lambda, (33), is another matter.

    Attributes
    ----------
    eigenvalues : tuple of arrays
        Of dG_k/dv_k for every stage k, ascending, in the user's units.

    Examples
    --------
    >>> print(Hypothesis(eigenvalues=(np.array([0.0, 1.0]), np.array([-2.0, 1.0]))))
    the hypothesis of Theorem IV.2 fails at 1 of 2 stages; worst at k = 1, where dG_k/dv_k has \
eigenvalues -2 .. 1

    References
    ----------
    Paper, Theorem IV.2.
    """

    eigenvalues: Annotated[tuple[Annotated[np.ndarray, Shape("m")], ...], NotEmpty()]

    @property
    def _zero(self) -> float:
        return ROUNDING * max(float(np.abs(e).max(initial=0.0)) for e in self.eigenvalues)

    @property
    def failing(self) -> tuple[int, ...]:
        """Stages whose matrix has a negative eigenvalue."""
        return tuple(k for k, e in enumerate(self.eigenvalues) if e.size and e[0] < -self._zero)

    @property
    def definite(self) -> tuple[int, ...]:
        """Stages whose matrix is positive definite."""
        return tuple(k for k, e in enumerate(self.eigenvalues) if e.size and e[0] > self._zero)

    @property
    def holds(self) -> bool:
        """All matrices positive semi-definite, at least one positive definite."""
        return not self.failing and bool(self.definite)

    def __str__(self) -> str:
        if self.holds:
            return (
                "the hypothesis of Theorem IV.2 holds: every dG_k/dv_k is positive semi-definite, "
                f"{len(self.definite)} of {len(self.eigenvalues)} are positive definite"
            )
        if not self.failing:
            return (
                "the hypothesis of Theorem IV.2 fails: every dG_k/dv_k is positive semi-definite, "
                "but none is positive definite"
            )
        worst = min(self.failing, key=lambda k: self.eigenvalues[k][0])
        values = self.eigenvalues[worst]
        return (
            f"the hypothesis of Theorem IV.2 fails at {len(self.failing)} of "
            f"{len(self.eigenvalues)} stages; worst at k = {worst}, where dG_k/dv_k has "
            f"eigenvalues {values[0]:.4g} .. {values[-1]:.4g}"
        )


@checked
def theorem_IV_2(network: Network, x: State) -> Hypothesis:
    """Check the hypothesis of Theorem IV.2 at a settled state.

    Parameters
    ----------
    network : Network
        Of the corrected equations, in which q and u follow minus the gradient.
    x : (n,) array
        State vector of the solution, in network units.

    Returns
    -------
    Hypothesis
        Its text says where it fails, and by how much.

    Raises
    ------
    NetworkError
        If this is no network of a problem, or no state of it.

    Examples
    --------
    >>> from ann_dc import design, plants
    >>> designed = design(plants.car())
    >>> theorem_IV_2(designed.network, designed.state).holds
    False

    References
    ----------
    Paper, Theorem IV.2 and equations (31), (32).
    """
    compiled = fast_evaluator(network, tape_with_penalty(network, 0.0))
    hessian = -compiled.drive_jacobian(_with_multipliers(network, x))
    factors = np.array([neuron.scale.factor for neuron in network.cell.neurons])
    factors, cost = factors[network.places[:, 0]], _cost_factor(network)
    inside = network.of_population(*STAGE_POPULATIONS)
    if not inside.any() or len(x) != network.size:
        raise NetworkError(
            "theorem_IV_2: expected the network of a problem, with neurons q and u, and a state of "
            f"{network.size} numbers; got {network.title} and {len(x)}"
        )
    eigenvalues = []
    for stage in range(network.stages):
        rows = np.flatnonzero(inside & (network.places[:, 1] == stage))
        block = hessian[rows][:, rows].toarray() * cost / np.outer(factors[rows], factors[rows])
        eigenvalues.append(np.linalg.eigvalsh(0.5 * (block + block.T)))
    return Hypothesis(eigenvalues=tuple(eigenvalues))


def _cost_factor(network: Network) -> float:
    """The user's objective over the network's: what a multiplier and its state stand for."""
    for dual, (q, _) in zip(network.cell.duals, network.cell.chains):
        return network.neuron(dual.neuron).scale.factor * network.neuron(q).scale.factor
    return 1.0


def _with_multipliers(network: Network, x: State) -> np.ndarray:
    """The state with m = mu + rho c in place of mu: what the network works with."""
    values, nodes = evaluator(network).values(x), network.node_index
    state = network.unpack(x)
    for dual in network.cell.duals:
        state[network.neuron_index[dual.neuron]] = values[nodes[dual.multiplier], 1:-1]
    return network.pack(state)
