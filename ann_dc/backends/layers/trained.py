"""Conversion of a cell layer to a network, with all trained numbers, and its step limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from ann_dc.backends.layers.named_rows import NamedRows
from ann_dc.backends.layers.preconditioners import Constants
from ann_dc.backends.step_rules import StepLimits
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Preconditioner
from ann_dc.network.preconditioners.multilevel import Multilevel


def trained_network(
    network: Network, constants: Constants, *, tau: NamedRows, start: NamedRows, inputs: NamedRows
) -> Network:
    """Return the network with other weights, gains, initial values and inputs."""
    return replace(
        _with_constants(network, constants, tau.rows),
        inputs={name: _plain(inputs[name]) for name in inputs.names},
        start={name: _plain(start[name]) for name in start.names},
    )


def _with_constants(network: Network, constants: Constants, tau: torch.Tensor) -> Network:
    """Return the network with other weights, rates and coordinator gains.

    A number that is equal at all stages becomes one number. ``tau`` (P, N) contains the time
    constants of fixed and omitted neurons, whose rate is zero.
    """
    weights, rates, grids = (tensor.detach().cpu().double() for tensor in constants)
    edges = evaluator(network).edges
    taus = torch.where(rates[:, :, 0] > 0, 1 / rates[:, :, 0], tau.detach().cpu())
    neurons = tuple(
        replace(neuron, tau=_plain(row)) for neuron, row in zip(network.cell.neurons, taus)
    )
    connections = tuple(
        replace(c, weight=_plain(weights[edges[c.name], :, 0])) for c in network.cell.connections
    )
    return replace(
        network,
        cell=replace(network.cell, neurons=neurons, connections=connections),
        preconditioner=_with_gains(network.preconditioner, grids),
    )


def _with_gains(preconditioner: Preconditioner, grids: torch.Tensor) -> Preconditioner:
    if not isinstance(preconditioner, Multilevel):
        return preconditioner
    levels = grids.split([len(gain) for gain in preconditioner.gains])
    return replace(preconditioner, gains=tuple(gain.numpy().copy() for gain in levels))


def _plain(row: torch.Tensor) -> float | np.ndarray:
    """Return one number if it is equal at all stages, else one per stage."""
    values = row.detach().cpu().double().numpy()
    return float(values[0]) if (values == values[0]).all() else values.copy()


class CurrentLimits:
    """Step limits of a network with trained or loaded gains, recomputed when these change."""

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
        self._last = now, StepLimits(_with_constants(self._network, now, any_tau))
        return self._last[1]


def _held(constants: Constants) -> Constants:
    """Return an independent copy on the CPU in double precision."""
    return Constants(*(part.detach().to("cpu", torch.float64, copy=True) for part in constants))
