"""Limits on the step length: rates of a network at its start, with current gains."""

from __future__ import annotations

from functools import cached_property

import torch

from ann_dc.analysis.spectra import stability_limit
from ann_dc.backends.recurrent.cell.preconditioners import Constants
from ann_dc.backends.recurrent.cell.trained import with_constants
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.network.network import Network


class StepLimits:
    """Step limits of one network at its start."""

    def __init__(self, network: Network) -> None:
        self._network = network

    @cached_property
    def stable(self) -> float:
        """Stability limit of the simultaneous order, in units of network time."""
        return stability_limit(self._network, self._network.start_state)

    @cached_property
    def fastest_rate(self) -> float:
        """Estimate of the fastest rate by power iterations, in units of 1 / network time."""
        return fast_evaluator(self._network).fastest_rate(self._network.start_state)


class CurrentLimits:
    """Step limits of a network with trained or loaded gains.

    The limits are recomputed when the gains change. ``constants`` are those of the network.
    """

    def __init__(self, network: Network, constants: Constants) -> None:
        self._network = network
        self._own = _held(constants), StepLimits(network)
        self._last = self._own

    def of(self, constants: Constants) -> StepLimits:
        """Return the limits for constants of all stages."""
        now = _held(constants)
        for known, limits in (self._own, self._last):
            if all(map(torch.equal, known, now)):
                return limits
        any_tau = torch.ones_like(now.rates[:, :, 0])  # of neurons that do not move
        self._last = now, StepLimits(with_constants(self._network, now, any_tau))
        return self._last[1]


def _held(constants: Constants) -> Constants:
    """Return an independent copy on the CPU in double precision."""
    return Constants(*(part.detach().to("cpu", torch.float64, copy=True) for part in constants))
