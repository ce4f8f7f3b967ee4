"""Non-idealities that add parts: poles, limits, slew limits and noise inputs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.nonidealities.numbers import errors_of, require_strength
from ann_dc.network.network import Network
from ann_dc.network.rewiring import arrival, fresh, slewing, slowed, stopped, wire, with_wires
from ann_dc.network.selection import EVERYWHERE, Selection, blocks_of, chosen, neurons_of
from ann_dc.validation import FloatOrNan, checked


@checked
def extra_pole(network: Network, bandwidth: FloatOrNan, where: Selection = EVERYWHERE) -> Network:
    """Add a pole at the output s of a neuron or a block: y' = bandwidth (s - y).

    Readers of s read a new neuron y, named ``slow.<node>``. If ``where`` selects stages, they read
    it through a sum ``seen.<node>``. The neuron y is fixed or omitted in the cells in which s is,
    and starts at the initial value of s. Raises `NetworkError` or `UnknownNameError` if
    ``bandwidth`` is not positive or ``where`` contains an unknown name.

    Parameters
    ----------
    bandwidth : float
        Bandwidth in radians per unit of network time. An infinite value returns the network
        unchanged.
    where : Selection
        Selected neurons or blocks and stages; all by default.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = extra_pole(synthesize(plants.double_integrator(N=2)), 10.0)
    >>> network.neuron("slow.u.a").tau
    0.1
    """
    names, there = chosen(network, where, neurons_of(network) | blocks_of(network))
    require_strength("bandwidth", bandwidth)
    if bandwidth == math.inf:
        return network
    start = evaluator(network).values(network.start_state)[:, 1:-1]
    rows = network.node_index
    for name in names:
        network = slowed(network, name, 1 / bandwidth, there, start[rows[name]])
    return network


@checked
def saturation(
    network: Network, limit: FloatOrNan | Mapping[str, FloatOrNan], where: Selection = EVERYWHERE
) -> Network:
    """Limit neurons to ``|x| <= limit`` unless a tighter limit exists.

    An initial value beyond the limit is moved to the limit. For a PI dual, mu is limited and the
    output m is not. Raises `NetworkError` or `UnknownNameError` if a limit is not positive, or if
    ``where`` contains an unknown name or selects stages.

    Parameters
    ----------
    limit : float or mapping of str to float
        Limit in network units, one for all or one by name. An infinite value adds no limit.
    where : Selection
        Selected neurons; all by default. Stages cannot be selected.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = saturation(synthesize(plants.double_integrator(N=2)), {"u.a": 2.0})
    >>> network.neuron("u.a").limiter
    Limiter(low=-2.0, high=2.0)
    """
    known = neurons_of(network)
    names, there = chosen(network, where, known)
    if not there.all():
        raise NetworkError(
            f"saturation: limits are the same at all stages, got {where}; omit stages"
        )
    given = dict(limit) if isinstance(limit, Mapping) else dict.fromkeys(names, limit)
    for name, value in given.items():
        if name not in known:
            raise UnknownNameError.of("limit: neuron", name, known)
        require_strength(f"limit of {name}", value)
    limits = {name: given[name] for name in names if given.get(name, math.inf) < math.inf}
    if not limits:
        return network
    neurons = tuple(stopped(n, limits.get(n.name, math.inf)) for n in network.cell.neurons)
    start = {name: np.clip(network.start.get(name, 0.0), -v, v) for name, v in limits.items()}
    cell = replace(network.cell, neurons=neurons)
    return replace(network, cell=cell, start={**network.start, **start})


@checked
def slew(network: Network, rate: FloatOrNan, where: Selection = EVERYWHERE) -> Network:
    """Limit the slope of neurons: tau x' = rate tau clip(d), d = sum w s / (rate tau).

    The clip is clip(d) = rectify(d + 1) - rectify(d - 1) - 1. The connections arrive at a sum
    ``drive.<neuron>``. Raises `NetworkError` or `UnknownNameError` if ``rate`` is not positive or
    ``where`` contains an unknown name.

    Parameters
    ----------
    rate : float
        Largest slope in network units per unit of network time. An infinite value returns the
        network unchanged.
    where : Selection
        Selected neurons and stages; all by default.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = slew(synthesize(plants.double_integrator(N=2)), 0.5)
    >>> bool(np.abs(evaluator(network).rhs(100 + network.start_state)).max() < 0.5001)
    True
    """
    names, there = chosen(network, where, neurons_of(network))
    require_strength("rate", rate)
    for name in names if rate < math.inf else ():
        network = slewing(network, name, rate * np.asarray(network.neuron(name).tau), there)
    return network


@checked
def noise(network: Network, density: FloatOrNan, where: Selection = EVERYWHERE) -> Network:
    """Add noise inputs ``noise.<neuron>``: tau x' = sum w s + density xi.

    The inputs xi are zero until the caller sets them. Raises `NetworkError` or `UnknownNameError`
    if ``density`` is not finite or ``where`` contains an unknown name.

    Parameters
    ----------
    density : float
        Factor on xi.
    where : Selection
        Selected neurons and stages; all by default.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = noise(synthesize(plants.double_integrator(N=2)), 0.5)
    >>> "noise.u.a" in network.cell.inputs, network.inputs["noise.u.a"].tolist()
    (True, [0.0, 0.0])
    """
    known = neurons_of(network)
    names, there = chosen(network, where, known)
    weight = errors_of(network, "density", density, known, None)
    for name in names if density else ():
        source = fresh(network, "noise", name)
        cell = replace(network.cell, inputs=(*network.cell.inputs, source))
        network = replace(network, cell=cell, inputs={**network.inputs, source: 0.0})
        connection = wire(source, arrival(network, name), weight[name] * there)
        network = with_wires(network, [connection])
    return network
