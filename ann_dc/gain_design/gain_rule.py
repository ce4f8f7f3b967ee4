r"""Closed-form gains: rho, time constants and multilevel gains from the Jacobian.

With A the Jacobian of all constraints, H the Hessian of the cost alone (not of the Lagrangian), and
w_i the penalty of constraint i,

.. math::
    \rho_0 = \max_j \frac{\max_k H_{jj}}{\max_k \sum_i A_{ij}^2}, \quad
    w_i = r\,\rho_0 \times \text{boost} \times \text{row}_i, \quad
    1/\tau_j = \frac{f}{\max_k H_{jj} + \max_k \sum_i w_i A_{ij}^2}, \quad
    1/\tau_i = \eta\, w_i ,

first for equalities, then (`diode_weights`) with the active inequalities included; max_k is over
the stages of one neuron of the cell. All fast rates are then near one. With kappa an eigenvalue of
T A'WA, a mode with negligible H satisfies s^2 + kappa s + eta kappa = 0.

A gain rule (`GainRule`) consists of the factors r, eta, f, the preconditioner kind and the
constraint weights. Two are predefined.

Weights of the constraints: by equilibration or by reachability.

Constraints that act on their neurons through small numbers are slow, and no common penalty corrects
this. The weights w make all constraints equally stiff once the primal neurons have their time
constants. The iteration is

.. math::
    T_j = \frac{1}{h_j + \max_k \sum_i w_i A_{ij}^2}, \qquad
    s_i = \max_k w_i \sum_j A_{ij}^2 T_j, \qquad
    w_i \leftarrow w_i \sqrt{\bar s / s_i},

with h_j the curvature of the cost in units of the base penalty, maxima over the stages, and a
geometric mean of w of one. The curvature ensures finite weights; without it they diverge.

With reachability weights, a constraint weighs less the further the controls move its state at unit
cost, :math:`1 / w_i = \sum_k (\Phi_k B R^{-1} B^T \Phi_k^T)_{ii}` over a quarter of the horizon.

Gains of the shared neurons of a minimax objective.

With M the preconditioner and G the gradients of the objectives over all primal neurons, every
objective has the weight

.. math:: r = \frac{1}{\lambda_{max}(G M G^T)},

so that no combination of these constraints is stiffer than one. The full preconditioner is correct
here: such a constraint acts on every neuron, and there is one per objective. The level is as stiff
as all of them together, 1 / tau = 1 / (p r). The weight neurons move like multipliers, and an
objective is measured about as fast as the fastest neuron moves. At a temperature T the logarithm of
a weight leaks, and r is at most 1 / T; weights that sum to one are together as stiff as one
constraint.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from ann_dc.analysis.linearisation import Linearisation, MeanLinearisation
from ann_dc.conversion import OrWord, default
from ann_dc.errors import DesignError, UnknownNameError, require_positive, such_as
from ann_dc.gain_design.coarse_gains import active_weights, diode_weights, pyramid
from ann_dc.gain_design.gains import Gains, row_with
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.network.preconditioners.diagonal import Diagonal
from ann_dc.validation import Own, checked

_MEASURING = 2.0
"""1 / tau of the neurons that measure objectives."""


def _with_objectives(
    linear: Linearisation | MeanLinearisation, gains: Gains, share: float, away: float
) -> Gains:
    """Return gains that include those of the shared neurons.

    `linear` must be evaluated at a state; `gains` are those of all other neurons, with their
    preconditioner. `share` is 1 / tau of the objective weights. `away` is the distance from the
    present state, in scales, at which the weights must still be suitable: small gradients soon
    become larger.
    """
    network, objectives = linear.network, linear.network.cell.objectives
    if not objectives:
        return gains
    row, index = row_with(network, gains), network.neuron_index
    felt = 0.0
    for member in linear.members:
        slopes = member.objective_slopes()
        moves = gains.preconditioner.apply(row, slopes)
        answers = np.tensordot(slopes, moves, axes=((1, 2), (1, 2)))
        bent = (away * member.cost_curvature()) ** 2 * row.rates
        if np.isfinite(answers).all():
            felt = max(felt, float(np.linalg.eigvalsh(answers)[-1] + bent[linear.primal].sum()))
    weight, together = 1.0 / felt if felt > 0 else 1.0, len(objectives)
    if objectives[0].is_softened:
        weight, together = min(weight, 1.0 / linear.members[0].temperature), 1
    rho, rate = gains.rho.copy(), gains.rate.copy()
    shares = [index[objective.neuron] for objective in objectives]
    rho[shares], rate[network.shared] = weight, _MEASURING
    rate[shares] = share
    rate[index[objectives[0].level]] = 1.0 / (together * weight)
    return replace(gains, rho=rho, rate=rate)


WINDOWS = 4
"""Number of windows of the horizon over which reachability is evaluated."""


def equilibrated(
    linear: Linearisation | MeanLinearisation,
    penalty: float,
    equilibration_sweeps: int,
    weights: np.ndarray | None = None,
) -> np.ndarray:
    """Return the equilibrated weights (P,) of the dual neurons [1]_, zero for others.

    ``penalty`` is the base penalty rho_0, the unit of the cost's curvature. Fewer sweeps stay
    nearer to the initial ``weights`` (P,), equal by default.

    References
    ----------
    .. [1] D. Ruiz, A scaling algorithm to equilibrate both rows and columns norms in matrices,
       Rutherford Appleton Laboratory, RAL-TR-2001-034, 2001.
    """
    dual = linear.dual
    start = dual.astype(float) if weights is None else weights
    weights = np.array(start)
    curvature = np.maximum(linear.cost_curvature().max(axis=1), 0.0) / penalty
    for _ in range(equilibration_sweeps):
        stiffness = curvature + linear.row_sums(weights).max(axis=1)
        rate = np.where(
            linear.primal & (stiffness > 0), 1 / np.where(stiffness > 0, stiffness, 1), 0
        )
        row = weights[dual] * linear.column_sums(rate).max(axis=1)[dual]
        if not (np.isfinite(row).all() and (row > 0).all()):
            return start
        weights[dual] *= np.sqrt(row.mean() / row)
        weights[dual] /= np.exp(np.log(weights[dual]).mean())
    return weights


def by_reachability(linear: Linearisation | MeanLinearisation) -> np.ndarray:
    """Return the reachability weights (P,) of the dual neurons, zero for others.

    Both constraints of a chain have the same weight, a chain that no control moves has the mean
    weight, and the geometric mean is one. `linear` must be evaluated at a state.
    """
    F, _, _ = linear.stage_matrices()
    B, R = linear.control_matrices()
    stages, chains, _ = B.shape
    cheap = R > 0
    effort = B / np.sqrt(np.where(cheap, R, R[cheap].mean() if cheap.any() else 1.0))
    length, reached = max(stages // WINDOWS, 1), np.zeros(chains)
    for first in range(0, stages - length + 1, length):
        gramian = np.zeros((chains, chains))
        for k in range(first, first + length):
            gramian = F[k] @ gramian @ F[k].T + effort[k] @ effort[k].T
        reached += gramian.diagonal()
    weights = linear.dual.astype(float)
    known = np.isfinite(reached) & (reached > 0)
    if known.any():
        size = np.exp(np.log(reached[known]).mean())
        of_chain = np.where(known, size / np.where(known, reached, 1.0), 1.0)
        rows = [linear.network.neuron_index[dual.neuron] for dual in linear.network.cell.duals]
        weights[rows] = np.resize(of_chain, len(rows))
    return weights


@such_as("ann_dc.GainRule()")
@checked
@dataclass(frozen=True, kw_only=True)
class GainRule:
    """Gain rule: factors of the closed form.

    Attributes
    ----------
    penalty : float
        r: w = r rho_0.
    dual, dual_coupling : float
        eta of mu and of beta.
    state, control, target : float
        f of q, u and t.
    coarse : float
        gamma of a multilevel preconditioner.
    kind : PreconditionerKind or str
        Preconditioner kind: diagonal or multilevel here, resistive grid or cyclic reduction in
        `grid_gains`.
    equilibration_sweeps : int
        Equilibration sweeps of the constraint weights; zero leaves the weights unchanged.
    by_reachability : bool
        True if the constraint weights before any sweep are reachability weights; otherwise they are
        equal.
    path_weight : float
        theta of a grid: weight of the change of A between initial guess and settled point.
    linearisation_radius : float
        Linearisation radius in scales: distance from the state of evaluation at which the weights
        of objectives must still be suitable.
    inequality : float
        Factor on the weights of inequalities.
    row_factors : mapping of dual neuron name to float
        Further factors on the penalties of single constraints; default 1.

    Raises
    ------
    DesignError
        If a factor is not positive, or a number of sweeps or a path term is negative.

    Examples
    --------
    >>> from ann_dc import design, plants
    >>> problem = plants.double_integrator(N=5)
    >>> rule = GainRule(penalty=2.0, kind=PreconditionerKind.DIAGONAL)
    >>> designed = design(problem, gain_rule=rule)
    >>> designed.settled, designed.gains.preconditioner.kind.name
    (True, 'DIAGONAL')
    """

    penalty: float = 1.0
    dual: float = 1.5
    dual_coupling: float = 1.5
    state: float = 1.0
    control: float = 1.2
    target: float = 1.2
    coarse: float = 0.5
    kind: OrWord[PreconditionerKind] = default(PreconditionerKind.MULTILEVEL)
    equilibration_sweeps: Annotated[int, Own()] = 0
    by_reachability: bool = False
    path_weight: float = 0.3
    linearisation_radius: float = 0.0
    inequality: float = 1.0
    row_factors: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        names = "penalty", "dual", "dual_coupling", "state", "control", "target", "coarse"
        factors = {name: getattr(self, name) for name in (*names, "inequality")}
        factors |= {f"row_factors[{name}]": weight for name, weight in self.row_factors.items()}
        require_positive(DesignError, **factors)
        if not (isinstance(self.equilibration_sweeps, int) and self.equilibration_sweeps >= 0):
            raise DesignError(
                "equilibration_sweeps: expected a whole number of at least 0, got "
                f"{self.equilibration_sweeps!r}"
            )
        for name in ("path_weight", "linearisation_radius"):
            if not 0 <= getattr(self, name) < np.inf:
                raise DesignError(
                    f"{name}: expected a number of at least 0, got {getattr(self, name)!r}"
                )


MULTILEVEL_RULE = GainRule()
"""Gain rule of the multilevel preconditioner."""


DIAGONAL_RULE = GainRule(
    penalty=0.4,
    dual=0.8,
    dual_coupling=1.3,
    control=1.0,
    target=1.2,
    kind=PreconditionerKind.DIAGONAL,
)
"""Gain rule of the diagonal preconditioner (neighbour wiring only)."""


GAIN_RULES = {
    PreconditionerKind.RESISTIVE_GRID: replace(
        MULTILEVEL_RULE, kind=PreconditionerKind.RESISTIVE_GRID, dual=1.0, dual_coupling=1.0
    ),
    PreconditionerKind.CYCLIC_REDUCTION: replace(
        MULTILEVEL_RULE, kind=PreconditionerKind.CYCLIC_REDUCTION, dual=1.0, dual_coupling=1.0
    ),
    PreconditionerKind.COUPLED_MULTILEVEL: replace(
        MULTILEVEL_RULE, kind=PreconditionerKind.COUPLED_MULTILEVEL
    ),
    PreconditionerKind.MULTILEVEL: MULTILEVEL_RULE,
    PreconditionerKind.DIAGONAL: DIAGONAL_RULE,
}
"""Initial gain rules of the preconditioner kinds, fastest kind first."""

SWEEPS = (0, 16, 60)
"""Equilibration sweeps that are compared."""

STEADIER = ((1.0, 0.3, 1.0), (2.0, 0.3, 1.0), (2.0, 0.3, 1.5), (4.0, 0.3, 1.5))
"""Factors on the penalty and on the rates of states and of multipliers.

The resulting rules are slower at the end and oscillate less on the way.
"""


def recipe_of_first_run(gain_rule: GainRule | None) -> GainRule:
    """Return the gain rule of a first run, never a grid: no settled point is known.

    `gain_rule` is the rule fixed by the caller, or None.
    """
    if gain_rule is None or gain_rule.kind.is_stiffness:
        return MULTILEVEL_RULE
    return gain_rule


def _base_penalty(linear: Linearisation | MeanLinearisation) -> float:
    """Return rho_0, the largest ratio of cost curvature to squared constraint gain.

    The maximum is over the neurons, in network units. The result is 1 if nothing has curvature.
    """
    curvature = linear.cost_curvature().max(axis=1)
    coupling = linear.row_sums(linear.dual.astype(float)).max(axis=1)
    usable = linear.primal & (coupling > 0)
    ratios = curvature[usable] / coupling[usable]
    largest = ratios.max(initial=0.0)
    return float(largest) if largest > 0 else 1.0


def weights_of_rows(linear: Linearisation | MeanLinearisation, gain_rule: GainRule) -> np.ndarray:
    """Return the constraint weights (P,) of the dual neurons, zero for others.

    `linear` must be evaluated at a state. Raises `UnknownNameError` if the rule names an unknown
    constraint; the message lists the known ones.
    """
    start = by_reachability(linear) if gain_rule.by_reachability else None
    weights = equilibrated(linear, _base_penalty(linear), gain_rule.equilibration_sweeps, start)
    network = linear.network
    duals = [dual.neuron for dual in network.cell.duals]
    for name, factor in gain_rule.row_factors.items():
        if name not in duals:
            raise UnknownNameError.of("row: dual neuron", name, duals)
        weights[network.neuron_index[name]] *= factor
    return weights


def _factors(linear: Linearisation | MeanLinearisation, gain_rule: GainRule) -> np.ndarray:
    """Return f of primal neurons and eta of duals, (P,)."""
    named = {"q": gain_rule.state, "t": gain_rule.target, "beta": gain_rule.dual_coupling}
    others = [gain_rule.control if primal else gain_rule.dual for primal in linear.primal]
    neurons = linear.network.cell.neurons
    return np.array([named.get(n.population, other) for n, other in zip(neurons, others)])


def closed_form(
    linear: Linearisation | MeanLinearisation, gain_rule: GainRule, penalty_factor: float = 1.0
) -> Gains:
    """Compute the gains of a rule at the state of a linearisation.

    Parameters
    ----------
    linear : Linearisation
        Linearisation evaluated at a state by `Linearisation.at`.
    gain_rule : GainRule
        Gain rule.
    penalty_factor : float
        Factor on every penalty (the watchdog's rho neuron). Default 1.

    Returns
    -------
    Gains

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> from ann_dc.analysis import Linearisation, MeanLinearisation
    >>> network = synthesize(plants.double_integrator(N=5))
    >>> linear = Linearisation(network).at(network.start_state)
    >>> gains = closed_form(linear, DIAGONAL_RULE)
    >>> bool((gains.rate > 0).all()), gains.preconditioner.kind.name
    (True, 'DIAGONAL')
    """
    network = linear.network
    rho = (
        gain_rule.penalty
        * _base_penalty(linear)
        * penalty_factor
        * weights_of_rows(linear, gain_rule)
    )
    curvature = np.maximum(linear.cost_curvature().max(axis=1), 0.0)
    stiffness, factor = curvature + linear.row_sums(rho).max(axis=1), _factors(linear, gain_rule)
    if linear.diode.any():
        diodes = diode_weights(linear, factor / np.where(stiffness != 0, stiffness, 1.0))
        rho = rho + gain_rule.inequality * diodes
        active = [member.row_sums(active_weights(member, rho)) for member in linear.members]
        stiffness = curvature + np.max(active, axis=(0, 2))
    felt = np.where(stiffness != 0, stiffness, 1.0)
    rate = np.where(linear.primal, factor / felt, factor * rho)
    rate[network.shared] = 1.0
    coarse = None
    if gain_rule.kind in (PreconditionerKind.MULTILEVEL, PreconditionerKind.COUPLED_MULTILEVEL):
        coupled = gain_rule.kind is PreconditionerKind.COUPLED_MULTILEVEL
        coarse = pyramid(linear, rho, gain_rule.coarse, coupled=coupled)
    gains = Gains(
        rho=rho,
        rate=np.repeat(rate[:, None], network.stages, axis=1),
        preconditioner=coarse or Diagonal(),
    )
    return _with_objectives(linear, gains, gain_rule.dual, gain_rule.linearisation_radius)


def steadier(kind: PreconditionerKind) -> tuple[GainRule, ...]:
    """Return gain rules that settle from more initial guesses, but later.

    `kind` must have a closed form: diagonal or multilevel.
    """
    own = GAIN_RULES[kind]
    return tuple(
        replace(
            own,
            equilibration_sweeps=equilibration_sweeps,
            penalty=penalty * own.penalty,
            state=state * own.state,
            target=state * own.target,
            dual=dual * own.dual,
            dual_coupling=dual * own.dual_coupling,
        )
        for equilibration_sweeps in SWEEPS[:2]
        for penalty, state, dual in STEADIER
    )
