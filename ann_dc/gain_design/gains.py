"""Gains of a network: rho, rates and preconditioner.

Gains are rho (the weight of every PI path), 1 / tau of every neuron at every stage, and the
preconditioner. `apply_gains` makes them the constants of a network; for many trials, only the tape
of a network is changed (`tape_with`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from ann_dc.errors import DesignError, UnknownNameError, such_as
from ann_dc.evaluation.preconditioner_arrays import preconditioner_arrays
from ann_dc.evaluation.reference import tape_with_penalty
from ann_dc.evaluation.tape import Tape
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import ArrayLayout, Preconditioner
from ann_dc.network.preconditioners.diagonal import Diagonal
from ann_dc.summaries import extent, summarised
from ann_dc.validation import FloatOrNan, OrNan, Shape, checked


@such_as("ann_dc.manual_gains(network)")
@checked
@summarised(
    lambda self: {
        "preconditioner": self.preconditioner.kind.value,
        "rho": extent(self.rho),
        "rate": extent(self.rate),
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Gains:
    """Designed or manual constants of a network.

    Attributes
    ----------
    rho : (P,) array
        Path weight of every PI dual and rectifying multiplier neuron, zero for other neurons; P
        neurons per cell.
    rate : (P, N) array
        1 / tau of every neuron at every stage, in units of 1 / network time.
    preconditioner : Preconditioner
        Preconditioner; diagonal by default.

    Examples
    --------
    Manual gains, then every neuron twice as fast:

    >>> from ann_dc import plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=5))
    >>> gains = manual_gains(network, rho=1.0)
    >>> faster = Gains(rho=gains.rho, rate=2 * gains.rate)
    >>> faster.rho.shape, faster.rate.shape
    ((9,), (9, 5))
    """

    rho: Annotated[np.ndarray, Shape("P"), OrNan()]
    rate: Annotated[np.ndarray, Shape("P", "N"), OrNan()]
    preconditioner: Preconditioner = field(default_factory=Diagonal)


@checked
def manual_gains(
    network: Network,
    *,
    rho: FloatOrNan | Mapping[str, FloatOrNan] = 0.0,
    tau: FloatOrNan | Mapping[str, FloatOrNan] = 1.0,
) -> Gains:
    """Return manual gains; by default those of the paper's network (rho = 0, tau = 1).

    Parameters
    ----------
    network : Network
        Network for which the gains are made.
    rho, tau : float or mapping
        One number for all, or numbers by neuron (``mu.phi``) or population (``mu``). Other neurons
        have the default, rho = 0 or tau = 1. tau is in units of network time.

    Returns
    -------
    Gains
        Gains with a diagonal preconditioner.

    Raises
    ------
    DesignError
        If a time constant is not positive or a penalty is negative.
    UnknownNameError
        If a neuron or population does not exist.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=3))
    >>> gains = manual_gains(network, rho={"mu": 2.0}, tau=0.5)
    >>> float(gains.rho.sum()), float(gains.rate[0, 0])
    (4.0, 2.0)
    """
    neurons = network.cell.neurons
    known = {name for neuron in neurons for name in (neuron.name, neuron.population)}

    def expand(given: float | Mapping[str, float], default: float) -> np.ndarray:
        if not isinstance(given, Mapping):
            return np.full(len(neurons), float(given))
        for name in given:
            if name not in known:
                raise UnknownNameError.of("neuron or population", name, sorted(known))
        return np.array(
            [given.get(n.name, given.get(n.population, default)) for n in neurons], float
        )

    time = expand(tau, 1.0)
    if not (np.isfinite(time).all() and (time > 0).all()):
        raise DesignError(f"tau: time constants must be positive, got {tau!r}")
    weight = expand(rho, 0.0)
    if not (np.isfinite(weight).all() and (weight >= 0).all()):
        raise DesignError(f"rho: penalties must be zero or positive, got {rho!r}")
    duals = [d.neuron for d in (*network.cell.duals, *network.cell.inequality_duals)]
    is_dual = np.isin([n.name for n in neurons], duals)
    return Gains(
        rho=np.where(is_dual, weight, 0.0),
        rate=np.repeat(1.0 / time[:, None], network.stages, axis=1),
    )


def tape_with(network: Network, gains: Gains) -> Tape:
    """Return a tape of the network with these gains."""
    tape, row = tape_with_penalty(network, gains.rho), row_with(network, gains)
    return tape._replace(rates=row.rates, **preconditioner_arrays(gains.preconditioner, row))


def row_with(network: Network, gains: Gains) -> ArrayLayout:
    """Return the cell array layout of a preconditioner for these gains."""
    tau = 1.0 / gains.rate  # rounded as the network itself will be
    return replace(network.layout, rates=np.where(network.live, 1.0 / tau, 0.0))


def check_gains(network: Network, gains: Gains) -> None:
    """Raise `DesignError` if gains are not finite, not positive, or of the wrong size."""
    if gains.rate.shape != network.live.shape or gains.rho.shape != network.live.shape[:1]:
        raise DesignError(
            f"gains: expected rho of shape {network.live.shape[:1]} and rate of shape "
            f"{network.live.shape}, got {gains.rho.shape} and {gains.rate.shape}; design them for "
            "this network"
        )
    if not (np.isfinite(gains.rho).all() and np.isfinite(gains.rate).all()):
        raise DesignError("gains: rho or rate holds a value that is not finite")
    if not (gains.rate > 0).all():
        raise DesignError("gains: expected positive rates, got one that is not")


@checked
def apply_gains(network: Network, gains: Gains) -> Network:
    """Return the network with these gains as its constants.

    Parameters
    ----------
    network : Network
        Network to change.
    gains : Gains
        Gains of a network of the same size.

    Returns
    -------
    Network
        Network with these penalties, time constants and preconditioner; its initial guess is
        unchanged.

    Raises
    ------
    DesignError
        If the gains are those of a network of another size, not finite, or not positive.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=3))
    >>> frozen = apply_gains(network, manual_gains(network, rho=2.0, tau={"mu": 0.5}))
    >>> [frozen.neuron(name).tau for name in ("q.x", "mu.x")]
    [1.0, 0.5]
    """
    check_gains(network, gains)
    paths = network.cell.penalty_weights(dict(zip(network.neuron_index, gains.rho)))
    neurons = tuple(
        replace(neuron, tau=_one_if_equal(1.0 / gains.rate[row]))
        for row, neuron in enumerate(network.cell.neurons)
    )
    connections = tuple(
        replace(c, weight=paths[c.name]) if c.name in paths else c for c in network.cell.connections
    )
    return replace(
        network,
        cell=replace(network.cell, neurons=neurons, connections=connections),
        preconditioner=gains.preconditioner,
    )


def _one_if_equal(values: np.ndarray) -> float | np.ndarray:
    return float(values[0]) if (values == values[0]).all() else values
