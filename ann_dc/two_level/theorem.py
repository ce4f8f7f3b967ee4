r"""Theorems of the paper at a solution: rate of Theorem IV.1, hypothesis of IV.2.

**Theorem IV.1** states that the errors (18) of the stages, e_v and e_mu, vanish with the errors of
the coordination variables, e_t and e_beta. The paper gives no rate. The implicit function theorem
gives one if the Jacobian J_ll of the stages is regular:

.. math::
    e_l = -J_{ll}^{-1} J_{lc}\, e_c + O(|e_c|^2), \qquad
    |e_v| \le K_v |e_c|, \quad |e_\mu| \le K_\mu |e_c|

to first order, where K_v and K_mu are the spectral norms of the rows of v and of mu. The theorem
makes no statement if J_ll is singular, as in cell 0 with constant q_0.

**Theorem IV.2** states that the two-level iteration converges if the matrices

.. math::
    \frac{\partial G_k}{\partial v_k}, \qquad
    G_k = \nabla_{v_k} L, \quad v_k = (q_k, u_k),

are positive semi-definite at the solution and one of them is positive definite. They are the
Hessians of the stage Lagrangians,

.. math::
    \frac{\partial G_k}{\partial v_k} = \nabla^2_{vv}\,(E_k + \mu_k^T f(q_k, u_k)) ,

and not diag(0.99, 0.1) as in (31), (32). For a plant in which controls multiply functions of the
state they are generally indefinite. `StageHessians` computes the correct matrices.
`PrintedMatrices` is the same at every state of every plant.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from ann_dc.errors import DesignError, NetworkError, such_as
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.evaluation.reference import evaluator, tape_with_penalty
from ann_dc.network.network import COORDINATION, Network
from ann_dc.two_level.upper_gains import UpperMap
from ann_dc.validation import State, checked

STAGE_POPULATIONS = ("q", "u")
"""Populations of v_k."""

ROUNDING = 1e-9
"""Fraction of the largest eigenvalue below which an eigenvalue counts as zero."""


@dataclass(frozen=True, kw_only=True)
class Following:
    """First-order bounds K_v and K_mu on the stage errors per unit error of t and beta.

    The bounds are in network units, and infinite if the lower level is singular.
    """

    v: float
    mu: float

    def __str__(self) -> str:
        if not np.isfinite(self.v):
            return "Theorem IV.1 does not apply: the lower level is singular at the solution"
        change = "|e_t, e_beta|"
        bounds = f"|e_v| <= {self.v:.3g} {change} and |e_mu| <= {self.mu:.3g} {change}"
        return f"{bounds} near the solution"


@checked
def theorem_IV_1(network: Network, settled: State) -> Following:
    """Return the bounds K_v and K_mu of Theorem IV.1 at a solution (n,) in network units.

    Every stage must be separately solvable (closing B); otherwise the bounds are infinite.
    """
    try:
        follow = UpperMap(network=network, settled=settled).follow
    except DesignError:
        return Following(v=float("inf"), mu=float("inf"))
    lower = ~network.of_population(*COORDINATION)
    of_v = network.of_population("q", "u")[lower]
    norm = np.linalg.norm
    return Following(v=float(norm(follow[of_v], 2)), mu=float(norm(follow[~of_v], 2)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Hypothesis:
    """Eigenvalues of dG_k/dv_k for every stage k, ascending, in the user's units.

    The text of the object is the result of the check of Theorem IV.2, without its lambda (33).
    """

    eigenvalues: tuple[np.ndarray, ...]

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
        """True if all matrices are positive semi-definite and one is positive definite."""
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


@such_as("ann_dc.two_level.StageHessians()")
class StageMatrices(ABC):
    """Base class of the matrices that are used for dG_k/dv_k."""

    @abstractmethod
    def of(self, network: Network, x: np.ndarray) -> list[np.ndarray]:
        """Return one symmetric matrix (q, u) for every stage at a state (n,)."""


@checked
@dataclass(frozen=True, kw_only=True)
class StageHessians(StageMatrices):
    """Correct matrices: Hessians of the stage Lagrangians, in the user's units."""

    def of(self, network: Network, x: np.ndarray) -> list[np.ndarray]:
        """Return the Hessians from the drive Jacobian, with m = mu + rho c for mu."""
        compiled = fast_evaluator(network, tape_with_penalty(network, 0.0))
        hessian = -compiled.drive_jacobian(_with_multipliers(network, x))
        factors = np.array([neuron.scale.factor for neuron in network.cell.neurons])
        factors, cost = factors[network.places[:, 0]], _cost_factor(network)
        blocks = []
        for rows in _rows_of_stages(network):
            block = hessian[rows][:, rows].toarray() * cost / np.outer(factors[rows], factors[rows])
            blocks.append(0.5 * (block + block.T))
        return blocks


@checked
@dataclass(frozen=True, kw_only=True)
class PrintedMatrices(StageMatrices):
    """Matrices diag(0.99, 0.1) of (31) and (32) as printed, for every plant and state.

    ``of_q`` and ``of_u`` are the entries for every q and every u. Equation (31) treats mu and beta
    as constants.
    """

    of_q: float = 0.99
    of_u: float = 0.1

    def of(self, network: Network, x: np.ndarray) -> list[np.ndarray]:
        """Return the same diagonal matrices at every state."""
        is_q = network.of_population("q")
        return [
            np.diag(np.where(is_q[rows], self.of_q, self.of_u)) for rows in _rows_of_stages(network)
        ]


@checked
def theorem_IV_2(
    network: Network, x: State, *, matrices: StageMatrices | None = None
) -> Hypothesis:
    """Check the hypothesis of Theorem IV.2 at a settled state.

    Parameters
    ----------
    network : Network
        Network of the corrected equations, in which q and u follow the negative gradient.
    x : (n,) array
        State vector of the solution, in network units.
    matrices : StageMatrices, optional
        `StageHessians` by default; `PrintedMatrices` are those of (32).

    Returns
    -------
    Hypothesis
        Eigenvalues of all stages; the text of the result names the worst failing stage.

    Raises
    ------
    NetworkError
        If the network does not represent a problem, or the state has another size.

    Examples
    --------
    >>> from ann_dc import design, plants
    >>> designed = design(plants.car())
    >>> theorem_IV_2(designed.network, designed.state).holds
    False
    >>> theorem_IV_2(designed.network, designed.state, matrices=PrintedMatrices()).holds
    True

    References
    ----------
    Paper, Theorem IV.2 and equations (31), (32).
    """
    if not network.of_population(*STAGE_POPULATIONS).any() or len(x) != network.size:
        raise NetworkError(
            "theorem_IV_2: expected the network of a problem, with neurons q and u, and a state of "
            f"{network.size} numbers; got {network.title} and {len(x)}"
        )
    found = (matrices or StageHessians()).of(network, x)
    return Hypothesis(eigenvalues=tuple(map(np.linalg.eigvalsh, found)))


def _rows_of_stages(network: Network) -> list[np.ndarray]:
    """Return the places of q and u in the state vector for every stage."""
    inside, stage = network.of_population(*STAGE_POPULATIONS), network.places[:, 1]
    return [np.flatnonzero(inside & (stage == k)) for k in range(network.stages)]


def _cost_factor(network: Network) -> float:
    """Return the ratio of the user's objective to the network's objective.

    The ratio is the product of the scale factors of a multiplier and its state.
    """
    for dual, (q, _) in zip(network.cell.duals, network.cell.chains):
        return network.neuron(dual.neuron).scale.factor * network.neuron(q).scale.factor
    return 1.0


def _with_multipliers(network: Network, x: State) -> np.ndarray:
    """Return the state with m = mu + rho c in place of mu, as the network uses it."""
    values, nodes = evaluator(network).values(x), network.node_index
    state = network.unpack(x)
    for dual in network.cell.duals:
        state[network.neuron_index[dual.neuron]] = values[nodes[dual.multiplier], 1:-1]
    return network.pack(state)
