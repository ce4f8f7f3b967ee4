r"""What analog parts do to a network, before any part is chosen: network in, network out.

Each function spoils one thing, and any backend runs what comes out. With Gamma the conductance of
a neuron's wires, o an offset and e(d) = clip(d, -1, 1), together they make of a neuron

.. math:: \tau\,\dot x = r\tau\; e\Big(\tfrac{1}{r\tau}\big(
    \textstyle\sum_j (1 + \epsilon_j) w_j s_j + o - \Gamma x / A_0\big)\Big), \qquad |x| \le limit ,

with every s_j behind one more pole. Numbers are those of the network: values count in its own
units, as if every node had the same full scale, and time is network time. The version for one
circuit, with its resistors, full scales and op amps, is `ann_dc.network.emulation`.

Roles, duals, chains and coordinators stay: the residual of a run is then the distance from rest,
and what the defects have done to the solution is for its certificate to say. What coordinators add
is ideal. A strength of nothing gives back the network itself.

Defects compose. What one has added is a node like any other to the next, so begin with those that
change numbers (`quantised`, `mismatch`, `gain_error`, `offset`, `leak`) and end with those that add
parts (`extra_pole`, `slew`, `rails`, `noise`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.network.cell import (
    ONE,
    Block,
    Connection,
    Function,
    Limiter,
    Neuron,
    Product,
    Sum,
)
from ann_dc.network.network import Absent, Network

E24 = (1.0, 1.1, 1.2, 1.3, 1.5, 1.6, 1.8, 2.0, 2.2, 2.4, 2.7, 3.0) + (
    *(3.3, 3.6, 3.9, 4.3, 4.7, 5.1, 5.6, 6.2, 6.8, 7.5, 8.2, 9.1),
)
SERIES = {
    "E12": E24[::2],
    "E24": E24,
    "E96": tuple(round(10 ** (k / 96), 2) for k in range(96)),
}
"""Preferred values of a decade, from IEC 60063."""

Strength = float | np.ndarray
Known = Mapping[str, tuple[str, ...]]
"""What a defect can act on: the population of each, and the names that it answers to."""


@dataclass(frozen=True, kw_only=True)
class Where:
    """A choice of neurons, blocks or connections; what is None does not restrict it.

    Attributes
    ----------
    populations : tuple of str, optional
        Of a neuron or sum the part of its name before the dot (``mu``, ``c``); products are
        ``product``, functions ``function``; a connection has the population of its target.
    stages : tuple of int, optional
        Of the node, or of a connection's target; 0 .. N - 1.
    names : tuple of str, optional
        Of neurons, blocks, or connections; a target's name stands for all its connections.

    Examples
    --------
    >>> Where(populations=("mu", "beta"), stages=(0, 1))
    Where(populations=('mu', 'beta'), stages=(0, 1), names=None)
    """

    populations: tuple[str, ...] | None = None
    stages: tuple[int, ...] | None = None
    names: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        for field in ("populations", "stages", "names"):
            if not isinstance(getattr(self, field), tuple | None):
                raise NetworkError(f"{field}: expected a tuple, got {getattr(self, field)!r}")


EVERYWHERE = Where()


def leak(network: Network, gain: float, where: Where = EVERYWHERE) -> Network:
    r"""Finite DC gain A0 of integrators: tau x' = sum w s - Gamma x / A0, Gamma = sum \|w\|.

    A wire that nothing feeds, from beyond an end or from an absent neuron, does not count. A PI
    dual is one op amp, which takes the wires of its residual: Gamma is the sum of theirs.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``gain`` is not positive, or ``where`` names what is not there.

    Examples
    --------
    >>> from ann_dc.network.cell import Cell
    >>> wires = (Connection(source="x", target="x", weight=-1.0),)
    >>> row = Network(cell=Cell(neurons=(Neuron(name="x"),), connections=wires), stages=1)
    >>> leak(row, 100.0).rhs([1.0]).tolist()
    [-1.01]
    """
    names, there = _chosen(network, where, _neurons(network))
    _positive("gain", gain)
    sums = {block.name for block in network.cell.blocks if isinstance(block, Sum)}
    fused = {dual.neuron: sums & {dual.residual} for dual in network.cell.duals}
    wires = []
    for name in names if gain < math.inf else ():
        target = _arrival(network, name)
        conductance = _conductance(network, target, fused.get(name, set()))
        wires.append(_wire(name, target, -conductance * there / gain))
    return _with_wires(network, wires)


def extra_pole(network: Network, bandwidth: float, where: Where = EVERYWHERE) -> Network:
    """One more pole at the outputs of neurons and blocks: y' = bandwidth (s - y).

    Readers of a node s read a new neuron y, ``slow.<node>`` (where stages are chosen, through a
    sum ``seen.<node>``), which is pinned, absent and started as s is. ``bandwidth`` is in radians
    per unit of network time.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``bandwidth`` is not positive, or ``where`` names what is not there.
    """
    names, there = _chosen(network, where, _neurons(network) | _blocks(network))
    _positive("bandwidth", bandwidth)
    if bandwidth == math.inf:
        return network
    program = network.program
    start = program.values(network.start_state)[:, 1:-1]
    for name in names:
        network = _slowed(network, name, 1 / bandwidth, there, start[program.nodes[name]])
    return network


def offset(
    network: Network, size: float, where: Where = EVERYWHERE, *, seed: int | None = None
) -> Network:
    """A bias at neurons and sums: tau x' = sum w s + o, in units of what arrives there.

    o is ``size``; with a seed, ``size`` times a normal draw for each node and stage.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``size`` is not finite, or ``where`` names what is not there.
    """
    known = _neurons(network) | _blocks(network, Sum)
    names, there = _chosen(network, where, known)
    errors = _errors(network, "size", size, known, seed)
    return _with_wires(
        network, [_wire(ONE, _arrival(network, name), errors[name] * there) for name in names]
    )


def mismatch(
    network: Network, relative: float, where: Where = EVERYWHERE, *, seed: int
) -> Network:
    """Weights that are off: w (1 + relative * a normal draw for each connection and stage).

    Raises
    ------
    NetworkError, UnknownNameError
        If ``relative`` is not finite, or ``where`` names what is not there.
    """
    known = _connections(network)
    names, there = _chosen(network, where, known)
    errors = _errors(network, "relative", relative, known, seed)
    return _reweighed(network, names, there, lambda c: c.weight * (1 + errors[c.name]))


def quantised(
    network: Network,
    where: Where = EVERYWHERE,
    *,
    bits: float = math.inf,
    series: str | None = None,
) -> Network:
    """Weights as they can be had: of so many significant bits, or from a series of resistors.

    A weight becomes a value of the `SERIES` or the reciprocal of one, times a power of ten,
    whichever is nearer. Equal weights stay equal: the errors of stages do not average out.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``bits`` is below 1, there is no such series, or ``where`` names what is not there.
    """
    names, there = _chosen(network, where, _connections(network))
    if not bits >= 1:
        raise NetworkError(f"bits: expected 1 or more significant bits, got {bits!r}")
    if series is not None and series not in SERIES:
        raise UnknownNameError.of("series", series, SERIES)
    levels = np.unique([*SERIES[series], *(10 / np.array(SERIES[series])), 10.0]) if series else ()

    def rounded(connection: Connection):
        weight = np.asarray(connection.weight, float)
        if len(levels):
            weight = _nearest(weight, np.asarray(levels))
        mantissa, exponent = np.frexp(weight)
        return np.ldexp(np.round(mantissa * 2**bits) / 2**bits, exponent) if bits < 53 else weight

    return _reweighed(network, names, there, rounded)


def gain_error(
    network: Network, relative: float, where: Where = EVERYWHERE, *, seed: int | None = None
) -> Network:
    """Products and functions off by a factor: (1 + e) a b, (1 + e) g(x).

    e is ``relative``; with a seed, ``relative`` times a normal draw for each block and stage.
    Connections that read a block are scaled; blocks that do read it through a sum ``gain.<block>``.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``relative`` is not finite, or ``where`` names what is not there.
    """
    known = _blocks(network, Product, Function)
    names, there = _chosen(network, where, known)
    errors = _errors(network, "relative", relative, known, seed)
    for name in names if relative else ():
        network = _amplified(network, name, 1 + errors[name] * there)
    return network


def rails(
    network: Network, limit: float | Mapping[str, float], where: Where = EVERYWHERE
) -> Network:
    """Neurons that stop at |x| = limit (one number, or one by name) if they do not before.

    A start beyond is moved there. Of a PI dual the integrator stops, not its proportional path.

    Raises
    ------
    NetworkError, UnknownNameError
        If a limit is not positive, or ``where`` names what is not there or chooses stages, of
        which all have the same rails.
    """
    known = _neurons(network)
    names, there = _chosen(network, where, known)
    if not there.all():
        raise NetworkError(f"rails are those of all stages, got {where}; leave its stages out")
    given = dict(limit) if isinstance(limit, Mapping) else dict.fromkeys(names, limit)
    for name, value in given.items():
        if name not in known:
            raise UnknownNameError.of("limit: neuron", name, known)
        _positive(f"limit of {name}", value)
    limits = {name: given[name] for name in names if given.get(name, math.inf) < math.inf}
    if not limits:
        return network
    neurons = tuple(_stopped(n, limits.get(n.name, math.inf)) for n in network.cell.neurons)
    beyond = {name: np.clip(network.start.get(name, 0.0), -v, v) for name, v in limits.items()}
    cell = replace(network.cell, neurons=neurons)
    return replace(network, cell=cell, start={**network.start, **beyond})


def slew(network: Network, rate: float, where: Where = EVERYWHERE) -> Network:
    r"""Largest speed of neurons: tau x' = rate tau clip(d), d = sum w s / (rate tau).

    clip(d) = rectify(d + 1) - rectify(d - 1) - 1. The wires arrive at a sum ``drive.<neuron>``.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``rate`` is not positive, or ``where`` names what is not there.
    """
    names, there = _chosen(network, where, _neurons(network))
    _positive("rate", rate)
    for name in names if rate < math.inf else ():
        network = _slewing(network, name, rate * np.asarray(network.neuron(name).tau), there)
    return network


def noise(network: Network, density: float, where: Where = EVERYWHERE) -> Network:
    """An input ``noise.<neuron>``, zero until samples xi are fed: tau x' = sum w s + density xi.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``density`` is not zero or more, or ``where`` names what is not there.
    """
    names, there = _chosen(network, where, _neurons(network))
    if not 0 <= density < math.inf:
        raise NetworkError(f"density: expected a number not below 0, got {density!r}")
    if density == 0 or not names:
        return network
    sources = {name: _fresh(network, "noise", name) for name in names}
    cell = replace(network.cell, inputs=(*network.cell.inputs, *sources.values()))
    silent = dict.fromkeys(sources.values(), 0.0)
    return _with_wires(
        replace(network, cell=cell, inputs={**network.inputs, **silent}),
        [_wire(sources[name], _arrival(network, name), density * there) for name in names],
    )


# ---- what is chosen ------------------------------------------------------------------------------


def _neurons(network: Network) -> Known:
    return {neuron.name: (neuron.population, neuron.name) for neuron in network.cell.neurons}


def _population(block: Block) -> str:
    return block.name.partition(".")[0] if isinstance(block, Sum) else type(block).__name__.lower()


def _blocks(network: Network, *kinds: type) -> Known:
    chosen = [b for b in network.cell.blocks if isinstance(b, kinds or (Sum, Product, Function))]
    return {block.name: (_population(block), block.name) for block in chosen}


def _connections(network: Network) -> Known:
    nodes = _neurons(network) | _blocks(network)
    return {c.name: (nodes[c.target][0], c.name, c.target) for c in network.cell.connections}


def _chosen(network: Network, where: Where, known: Known) -> tuple[list[str], np.ndarray]:
    """Names of what is chosen, and (N,) booleans of the stages."""
    for kind, given, available in (
        ("population", where.populations, {population for population, *_ in known.values()}),
        ("name", where.names, {name for _, *names in known.values() for name in names}),
        ("stage", where.stages, range(network.stages)),
    ):
        for name in given or ():
            if name not in available:
                raise UnknownNameError.of(f"where: {kind}", name, map(str, sorted(available)))
    names = [
        name
        for name, (population, *answers) in known.items()
        if (where.populations is None or population in where.populations)
        and (where.names is None or not set(where.names).isdisjoint(answers))
    ]
    stages = range(network.stages) if where.stages is None else where.stages
    return names, np.isin(np.arange(network.stages), list(stages))


def _errors(network: Network, field: str, size: float, known: Known, seed: int | None):
    """Errors of all that is known: draws do not depend on what is chosen of it."""
    if not math.isfinite(size):
        raise NetworkError(f"{field}: expected a finite number, got {size!r}")
    if seed is None:
        return dict.fromkeys(known, size)
    draws = np.random.default_rng(seed).standard_normal((len(known), network.stages))
    return dict(zip(known, size * draws))


def _positive(field: str, value: float) -> None:
    if not value > 0:
        raise NetworkError(f"{field}: expected a positive number, inf for none, got {value!r}")
