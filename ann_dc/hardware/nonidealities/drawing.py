"""Monte Carlo samples of a network: weights and time constants in one batch.

Each sample has a seed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.variant_numbers import Numbers
from ann_dc.hardware.nonidealities.strengths import TIME_CONSTANTS, draws, require_finite
from ann_dc.network.network import Network
from ann_dc.validation import FloatOrNan, Index, NotEmpty, checked


@checked
def drawn_numbers(
    network: Network,
    seeds: Annotated[Sequence[Index], NotEmpty()],
    *,
    weights: FloatOrNan = 0.0,
    time_constants: FloatOrNan = 0.0,
) -> Numbers:
    """Draw the weights and time constants of many samples of a network.

    The numbers of seed s are those of ``mismatch(detuned(network, time_constants, seed=s), weights,
    seed=s)``, bit for bit. No network is built per sample, which takes a hundredth of the time.
    Raises `NetworkError` if a standard deviation is not finite, or so large that a time constant is
    not positive.

    Parameters
    ----------
    network : Network
        Nominal network.
    seeds : sequence of int
        Seeds, one per sample.
    weights, time_constants : float
        Standard deviations of the relative errors; 0 by default.

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> numbers = ann_dc.nonidealities.drawn_numbers(network, range(100), weights=0.01)
    >>> int(ann_dc.OdeBackend().run_batch(network, {}, numbers=numbers).settled.sum())
    100
    """
    require_finite("weights", weights)
    require_finite("time_constants", time_constants)
    tape, edges = evaluator(network).tape, evaluator(network).edges
    order = [edges[connection.name] for connection in network.cell.connections]
    tau = np.array([np.broadcast_to(n.tau, network.stages) for n in network.cell.neurons], float)
    own = np.empty((len(seeds), *tape.weights.shape))
    rates = np.empty((len(seeds), *tau.shape))
    for sample, seed in enumerate(seeds):
        own[sample, order] = weights * draws(seed, tape.weights.shape)
        rates[sample] = time_constants * draws(seed, tau.shape, TIME_CONSTANTS)
    own += 1
    own *= tape.weights
    rates += 1
    rates *= tau
    if not (rates > 0).all():
        raise NetworkError(
            f"time_constants: errors of {time_constants:g} leave time constants that are not "
            "positive"
        )
    rates = np.where(network.live, 1 / rates, 0.0)
    return Numbers(weights=own, rates=rates)
