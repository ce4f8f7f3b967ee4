"""Gains: what a design chooses or a hand sets, and how a network gets them.

Gains are rho (the weight of every PI path), 1 / tau of every neuron at every stage, and the
metric. A network that is to be kept takes them as its constants (`apply_gains`); where many
are tried, only the tape of a network does (`tape_with`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from ann_dc.errors import DesignError, UnknownNameError
from ann_dc.evaluation.metric_arrays import metric_arrays
from ann_dc.evaluation.reference import tape_with_penalty
from ann_dc.evaluation.tape import Tape
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Metric, Row
from ann_dc.network.preconditioners.diagonal import TimeConstants
from ann_dc.validation.checked import checked
from ann_dc.validation.values import FloatOrNan, OrNan, Shape, such_as


@such_as("ann_dc.hand_gains(network)")
@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Gains:
    """Everything that design chooses: constants of the frozen network.

    Attributes
    ----------
    rho : (P,) array
        Weight of the path of every PI dual and diode neuron, zero for other neurons; P a cell.
    rate : (P, N) array
        1 / tau of every neuron at every stage, in units of 1 / network time.
    metric : Metric
        How drives become moves; time constants alone by default.

    Examples
    --------
    By hand, then every neuron twice as fast:

    >>> from ann_dc import plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=5))
    >>> gains = hand_gains(network, rho=1.0)
    >>> faster = Gains(rho=gains.rho, rate=2 * gains.rate)
    >>> faster.rho.shape, faster.rate.shape
    ((9,), (9, 5))
    """

    rho: Annotated[np.ndarray, Shape("P"), OrNan()]
    rate: Annotated[np.ndarray, Shape("P", "N"), OrNan()]
    metric: Metric = field(default_factory=TimeConstants)


@checked
def hand_gains(
    network: Network,
    *,
    rho: FloatOrNan | Mapping[str, FloatOrNan] = 0.0,
    tau: FloatOrNan | Mapping[str, FloatOrNan] = 1.0,
) -> Gains:
    """Gains set by hand; without arguments the paper's plain network (rho = 0, tau = 1).

    Parameters
    ----------
    network : Network
    rho, tau : float or mapping
        One number for all, or numbers by neuron (``mu.phi``) or population (``mu``); what is not
        named keeps the default.

    Returns
    -------
    Gains
        With time constants alone for a metric.

    Raises
    ------
    DesignError
        If a time constant is not positive or a penalty negative.
    UnknownNameError
        If there is no such neuron or population.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=3))
    >>> gains = hand_gains(network, rho={"mu": 2.0}, tau=0.5)
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
    duals = [d.neuron for d in (*network.cell.duals, *network.cell.diodes)]
    is_dual = np.isin([n.name for n in neurons], duals)
    return Gains(
        rho=np.where(is_dual, weight, 0.0),
        rate=np.repeat(1.0 / time[:, None], network.stages, axis=1),
    )


def tape_with(network: Network, gains: Gains) -> Tape:
    """A tape of the network with these gains.

    Parameters
    ----------
    network : Network
    gains : Gains

    Returns
    -------
    Tape
    """
    tape, row = tape_with_penalty(network, gains.rho), row_with(network, gains)
    return tape._replace(rates=row.rates, **metric_arrays(gains.metric, row))


def row_with(network: Network, gains: Gains) -> Row:
    """What a metric has to know of the network with these gains.

    Parameters
    ----------
    network : Network
    gains : Gains
    """
    tau = 1.0 / gains.rate  # rounded as the network itself will be
    return replace(network.row, rates=np.where(network.live, 1.0 / tau, 0.0))


def check_gains(network: Network, gains: Gains) -> None:
    """Refuse gains that are not finite or not positive, or those of a network of another size.

    Parameters
    ----------
    network : Network
    gains : Gains

    Raises
    ------
    DesignError
    """
    if gains.rate.shape != network.live.shape or gains.rho.shape != network.live.shape[:1]:
        raise DesignError(
            f"gains: expected rho of shape {network.live.shape[:1]} and rate of shape "
            f"{network.live.shape}, got {gains.rho.shape} and {gains.rate.shape}; design them for "
            "this network"
        )
    if not (np.isfinite(gains.rho).all() and np.isfinite(gains.rate).all()):
        raise DesignError("gains: rho or rate holds a value that is not finite")
    if not (gains.rate > 0).all():
        raise DesignError("gains: a rate is not positive, so that it is no time constant")


@checked
def apply_gains(network: Network, gains: Gains) -> Network:
    """The network with these gains as its constants.

    Parameters
    ----------
    network : Network
    gains : Gains

    Returns
    -------
    Network
        With these penalties, time constants and metric; it starts where it started.

    Raises
    ------
    DesignError
        If they are those of a network of another size, not finite, or not positive.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=3))
    >>> frozen = apply_gains(network, hand_gains(network, rho=2.0, tau={"mu": 0.5}))
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
        metric=gains.metric,
    )


def _one_if_equal(values: np.ndarray) -> float | np.ndarray:
    return float(values[0]) if (values == values[0]).all() else values
