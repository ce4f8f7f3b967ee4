"""Conversion of a cell layer to a network, with all trained numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from ann_dc.backends.recurrent.cell.named_rows import NamedRows
from ann_dc.backends.recurrent.cell.preconditioners import Constants
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Preconditioner
from ann_dc.network.preconditioners.multilevel import Multilevel


def trained_network(
    network: Network, constants: Constants, *, tau: NamedRows, start: NamedRows, inputs: NamedRows
) -> Network:
    """Return the network with other numbers and the same structure.

    A number that is equal at all stages becomes one number. ``constants`` contains weights, rates
    and coordinator gains. ``tau`` contains the time constants of fixed and omitted neurons, whose
    rate is zero. ``start`` and ``inputs`` contain initial values and input values, each with one
    number per stage.
    """
    return replace(
        with_constants(network, constants, tau.rows),
        inputs={name: _plain(inputs[name]) for name in inputs.names},
        start={name: _plain(start[name]) for name in start.names},
    )


def with_constants(network: Network, constants: Constants, tau: torch.Tensor) -> Network:
    """Return the network with other weights, rates and coordinator gains.

    The structure is unchanged, and a number that is equal at all stages becomes one number. ``tau``
    (P, N) contains the time constants of fixed and omitted neurons, whose rate is zero.
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
