r"""Gains of the shared neurons of a minimax objective.

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

from dataclasses import replace

import numpy as np

from ann_dc.analysis.linearisation import Linearisation, MeanLinearisation
from ann_dc.gain_design.gains import Gains, row_with

MEASURING = 2.0
"""1 / tau of the neurons that measure objectives."""


def with_objectives(
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
    rho[shares], rate[network.shared] = weight, MEASURING
    rate[shares] = share
    rate[index[objectives[0].level]] = 1.0 / (together * weight)
    return replace(gains, rho=rho, rate=rate)
