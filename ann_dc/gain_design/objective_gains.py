r"""Gains of the neurons that all cells share, where the largest of several objectives is minimised.

With M the metric and G the slopes of the objectives over all primal neurons, every row weighs

.. math:: r = \frac{1}{\lambda_{max}(G M G^T)},

so that no combination of rows is stiffer than one. Here the full metric
is right: such a row touches every neuron, and there is one an objective. The level is as stiff as
all rows together, 1 / tau = 1 / (p r); shares move like multipliers, and an objective is measured
about as fast as the fastest neuron moves. At a temperature T the logarithm of a share leaks, and
r is 1 / T at most; shares that add up to one are together as stiff as one row.
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
    """Gains with those of the shared neurons among them.

    Parameters
    ----------
    linear : Linearisation
        At a state where it was evaluated.
    gains : Gains
        Of all other neurons, with their metric.
    share : float
        1 / tau of the shares.
    away : float
        How far from the present state, in scales, slopes are to fit too: where they are small,
        they soon are larger.

    Returns
    -------
    Gains
    """
    network, objectives = linear.network, linear.network.cell.objectives
    if not objectives:
        return gains
    row, index = row_with(network, gains), network.neuron_index
    felt = 0.0
    for member in linear.members:
        slopes = member.objective_slopes()
        moves = gains.metric.apply(row, slopes)
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
