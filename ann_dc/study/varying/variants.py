"""A designed network as a point of a study has it: other gains, inputs, start and defects.

Every draw has a stream of its own, made of the seed of the point and the name of the defect, so
that one kind of error stays as it is while the size of another changes.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ann_dc.errors import StudyError
from ann_dc.hardware import defects
from ann_dc.network.inputs import input_batch, moved_starts
from ann_dc.network.metrics.pyramid import Pyramid
from ann_dc.network.network import Network
from ann_dc.study.varying.settings import behind

TOGETHER = ("mismatch", "time_constants")
"""Defects of numbers alone, which can be drawn for many points at once."""
SPREAD = 0.1
"""Of ``start.kind = "random"``: share of a neuron's scale by which it is disturbed."""


def stream(seed: int, name: str) -> int:
    """The seed of what is drawn under a name.

    Parameters
    ----------
    seed : int
        Of the point.
    name : str

    Examples
    --------
    >>> stream(1, "mismatch") != stream(1, "offset")
    True
    """
    entropy = np.random.SeedSequence([seed, zlib.crc32(name.encode())])
    return int(entropy.generate_state(1, np.uint64)[0] >> 1)


BRINGERS: dict[str, Callable[[Network, float, int], Network]] = {
    "bits": lambda network, value, seed: defects.quantised(network, bits=value),
    "mismatch": lambda network, value, seed: defects.mismatch(network, value, seed=seed),
    "time_constants": lambda network, value, seed: defects.detuned(network, value, seed=seed),
    "gain_error": lambda network, value, seed: defects.gain_error(network, value, seed=seed),
    "offset": lambda network, value, seed: defects.offset(network, value, seed=seed),
    "leak": lambda network, value, seed: defects.leak(network, value),
    "extra_pole": lambda network, value, seed: defects.extra_pole(network, value),
    "slew": lambda network, value, seed: defects.slew(network, value),
    "rails": lambda network, value, seed: defects.rails(network, value),
}
"""By the name of the defect, in the order in which they can follow each other."""


def with_gains(network: Network, factors: Mapping[str, float]) -> Network:
    """The network with some of its gains multiplied.

    Parameters
    ----------
    network : Network
    factors : mapping of str to float
        ``rho`` or ``rho.<dual neuron>``, ``tau`` or ``tau.<population or neuron>``, ``coarse``.

    Returns
    -------
    Network

    Raises
    ------
    StudyError
        If a factor is not positive, or there are no coordinators to multiply.
    """
    if not factors:
        return network
    for name, factor in factors.items():
        if not 0 < float(factor) < float("inf"):
            raise StudyError(f"gains.{name}: a factor is a positive number, got {factor!r}")
    if "coarse" in factors:
        if not isinstance(network.metric, Pyramid):
            raise StudyError(
                "gains.coarse: the metric has no coarse coordinators; set design.kind to pyramid"
            )
        gains = tuple(factors["coarse"] * grid for grid in network.metric.gains)
        network = replace(network, metric=replace(network.metric, gains=gains))
    cell, factor_of = network.cell, dict(factors)
    paths = {
        dual.path: factor_of.get("rho", 1.0) * factor_of.get(f"rho.{dual.neuron}", 1.0)
        for dual in cell.duals
    }
    connections = tuple(
        replace(c, weight=paths[c.name] * np.asarray(c.weight))
        if paths.get(c.name, 1.0) != 1.0
        else c
        for c in cell.connections
    )
    neurons = []
    for neuron in cell.neurons:
        factor = factor_of.get("tau", 1.0)
        for name in dict.fromkeys((neuron.population, neuron.name)):
            factor *= factor_of.get(f"tau.{name}", 1.0)
        neurons.append(replace(neuron, tau=factor * neuron.tau) if factor != 1.0 else neuron)
    return replace(network, cell=replace(cell, neurons=tuple(neurons), connections=connections))


def with_inputs(network: Network, inputs: Mapping[str, Any]) -> Network:
    """The network with other inputs, its start moved with its ends.

    Parameters
    ----------
    network : Network
    inputs : mapping of str to float
    """
    if not inputs:
        return network
    start = moved_starts(network, input_batch(network, inputs))[0]
    return network.with_inputs(dict(inputs)).with_start(start)


def started(start: np.ndarray, given: Mapping[str, Any], seed: int) -> np.ndarray:
    """The state (n,) at which a point begins.

    Parameters
    ----------
    start : (n,) array
        On the straight line.
    given : mapping of str to Value
        ``kind``: line, zero or random; ``spread`` of the random one, in network units, where a
        neuron is near one: `SPREAD` by default.
    seed : int
        Of the point.
    """
    kind = given.get("kind", "random" if "spread" in given else "line")
    if kind == "zero":
        return np.zeros_like(start)
    if kind == "line":
        return start
    rng = np.random.default_rng(stream(seed, "start"))
    return start + given.get("spread", SPREAD) * rng.standard_normal(start.size)


def with_defects(network: Network, sizes: Mapping[str, float], seed: int) -> Network:
    """The network with the defects of a point.

    Parameters
    ----------
    network : Network
    sizes : mapping of str to float
        By the name of the defect.
    seed : int
        Of the point.
    """
    for name, bring in BRINGERS.items():
        if name in sizes:
            network = bring(network, float(sizes[name]), defect_stream(seed, name))
    return network


def defect_stream(seed: int, name: str) -> int:
    """The seed of a defect's draws; weights and time constants have streams of their own in one.

    Parameters
    ----------
    seed : int
        Of the point.
    name : str
        Of the defect.
    """
    return stream(seed, "defect" if name in TOGETHER else f"defect.{name}")


def network_at(designed: Network, setting: Mapping[str, Any], seed: int) -> Network:
    """The network of a point.

    Parameters
    ----------
    designed : Network
        As it was designed.
    setting : mapping of str to Value
    seed : int

    Returns
    -------
    Network

    Raises
    ------
    StudyError, NetworkError
        If a value is out of its range.
    """
    network = with_inputs(with_gains(designed, behind(setting, "gains")), behind(setting, "input"))
    if given := behind(setting, "start"):
        network = network.with_start(started(network.start_state, given, seed))
    return with_defects(network, behind(setting, "defect"), seed)
