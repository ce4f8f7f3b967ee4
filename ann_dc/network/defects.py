r"""What analog parts do to a network, before any part is chosen: network in, network out.

Each function spoils one thing, and every backend runs what comes out. Of a neuron they make

.. math:: \tau\,\dot x = r\tau\; \mathrm{clip}\Big(\tfrac{1}{r\tau}\Big(
    \textstyle\sum_j (1 + \epsilon_j) w_j s_j + o - \frac{x}{A_0} \sum_j |w_j|\Big)\Big),
    \qquad |x| \le limit ,

with another pole behind every s_j. All numbers are the network's own: its units, its time, one full
scale for all nodes. `ann_dc.network.emulation` is the exact version, for a circuit whose resistors
and op amps are chosen. Roles, duals, chains and coordinators stay (what coordinators add is ideal),
so a residual says how far a network is from rest; its certificate says what defects cost.

No defect (strength zero, or infinite gain) gives back the network itself. They compose; what one
has added is to the next a node like any other. So begin with what changes numbers (`quantised`,
`mismatch`, `gain_error`, `offset`, `leak`), and end with what adds parts (`extra_pole`, `slew`,
`rails`, `noise`). Design a network before: a design would choose the time constants of poles too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.network.cell import ONE, Block, Connection, Function, Limiter, Neuron, Product, Sum
from ann_dc.network.network import Absent, Network

E24 = (1.0, 1.1, 1.2, 1.3, 1.5, 1.6, 1.8, 2.0, 2.2, 2.4, 2.7, 3.0)
E24 += (3.3, 3.6, 3.9, 4.3, 4.7, 5.1, 5.6, 6.2, 6.8, 7.5, 8.2, 9.1)
E96 = tuple(round(10 ** (k / 96), 2) for k in range(96))
SERIES = {"E12": E24[::2], "E24": E24, "E96": E96}
"""Preferred values of a decade (IEC 60063)."""


@dataclass(frozen=True, kw_only=True)
class Where:
    """A choice of neurons, blocks or connections, which are where their target is.

    Attributes
    ----------
    populations : tuple of str, optional
        What stands before the dot in the name of a neuron or a sum (``mu``, ``c``), ``product``,
        ``function``.
    stages : tuple of int, optional
    names : tuple of str, optional
        Of neurons, blocks and connections; a target's name stands for all its connections.
    """

    populations: tuple[str, ...] | None = None
    stages: tuple[int, ...] | None = None
    names: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        for field, given in vars(self).items():
            if not isinstance(given, tuple | None):
                raise NetworkError(f"where, {field}: expected a tuple, got {given!r}")


EVERYWHERE = Where()

DRIVE = "drive"
"""Prefix of the sum at which the wires of a neuron arrive that has a slew rate."""


def leak(
    network: Network,
    gain: float,
    where: Where = EVERYWHERE,
    *,
    unit: Mapping[str, float] | None = None,
) -> Network:
    r"""Finite DC gain of integrators: tau x' = sum w s - (sum \|w\|) x / gain.

    Where nodes have full scales S (``unit`` of a `Scaling`; all the same by default), \|w\| is
    \|w_j\| S_j / S. A PI dual is one op amp: its resistors are the wires of its residual.

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
    scale, sums, wires = unit or {}, _blocks(network, Sum), []
    duals = {d.neuron: d for d in network.cell.duals if d.residual in sums}
    for name in names if gain < math.inf else ():
        dual, target = duals.get(name), _arrival(network, name)
        fused, output = ("", name) if dual is None else (dual.residual, dual.multiplier)
        conductance = _conductance(network, target, fused, scale) / scale.get(output, 1.0)
        wires.append(_wire(name, target, -conductance * there / gain))
    return _with_wires(network, wires)


def extra_pole(network: Network, bandwidth: float, where: Where = EVERYWHERE) -> Network:
    """One more pole at the output s of a neuron or a block: y' = bandwidth (s - y).

    Readers of s read a new neuron y, ``slow.<node>`` (where stages are chosen, through a sum
    ``seen.<node>``), which is pinned, absent and started as s is. ``bandwidth`` is in radians per
    unit of network time.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``bandwidth`` is not positive, or ``where`` names what is not there.
    """
    names, there = _chosen(network, where, _neurons(network) | _blocks(network))
    _positive("bandwidth", bandwidth)
    if bandwidth == math.inf:
        return network
    start = network.program.values(network.start_state)[:, 1:-1]
    rows = network.program.nodes
    for name in names:
        network = _slowed(network, name, 1 / bandwidth, there, start[rows[name]])
    return network


def offset(
    network: Network, size: float, where: Where = EVERYWHERE, *, seed: int | None = None
) -> Network:
    """A bias o at neurons and sums, in units of what arrives there: tau x' = sum w s + o.

    o is ``size``, or with a seed ``size`` times a normal draw for each node and stage.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``size`` is not finite, or ``where`` names what is not there.
    """
    known = _neurons(network) | _blocks(network, Sum)
    names, there = _chosen(network, where, known)
    o = _errors(network, "size", size, known, seed)
    wires = [_wire(ONE, _arrival(network, name), o[name] * there) for name in names]
    return _with_wires(network, wires)


def mismatch(network: Network, relative: float, where: Where = EVERYWHERE, *, seed: int) -> Network:
    """Weights w (1 + relative e), with a normal draw e for each connection and stage.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``relative`` is not finite, or ``where`` names what is not there.
    """
    known = _connections(network)
    names, there = _chosen(network, where, known)
    e = _errors(network, "relative", relative, known, seed)
    return _reweighed(network, names, there, lambda c: c.weight * (1 + e[c.name]))


def quantised(
    network: Network,
    where: Where = EVERYWHERE,
    *,
    bits: float = math.inf,
    series: str | None = None,
) -> Network:
    """Weights that can be had: values (or their reciprocals) of a series, or of a few bits.

    A weight becomes the nearest v or 1 / v, for v a preferred value of the `SERIES` times a power
    of ten, and is then rounded to so many significant bits. Equal weights stay equal, so that the
    errors of stages do not average out.

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

    def rounded(connection: Connection) -> np.ndarray:
        weight = np.asarray(connection.weight, float)
        if series is not None:
            weight = _preferred(weight, np.array(SERIES[series]))
        mantissa, exponent = np.frexp(weight)
        return np.ldexp(np.round(mantissa * 2**bits) / 2**bits, exponent) if bits < 53 else weight

    return _reweighed(network, names, there, rounded)


def gain_error(
    network: Network, relative: float, where: Where = EVERYWHERE, *, seed: int | None = None
) -> Network:
    """Products (1 + e) a b and functions (1 + e) g(x).

    e is ``relative``, or with a seed ``relative`` times a normal draw for each block and stage.
    Connections that read a block are scaled; blocks that do read it through a sum ``gain.<block>``.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``relative`` is not finite, or ``where`` names what is not there.
    """
    known = _blocks(network, Product, Function)
    names, there = _chosen(network, where, known)
    e = _errors(network, "relative", relative, known, seed)
    for name in names if relative else ():
        network = _amplified(network, name, 1 + e[name] * there)
    return network


def rails(
    network: Network, limit: float | Mapping[str, float], where: Where = EVERYWHERE
) -> Network:
    """Neurons that stop at |x| = limit, one number or one by name, if nothing stops them before.

    A start beyond is moved there. Of a PI dual mu stops, not its output m.

    Raises
    ------
    NetworkError, UnknownNameError
        If a limit is not positive, or ``where`` names what is not there or chooses stages.
    """
    known = _neurons(network)
    names, there = _chosen(network, where, known)
    if not there.all():
        raise NetworkError(f"rails are the same at all stages, got {where}; leave stages out")
    given = dict(limit) if isinstance(limit, Mapping) else dict.fromkeys(names, limit)
    for name, value in given.items():
        if name not in known:
            raise UnknownNameError.of("limit: neuron", name, known)
        _positive(f"limit of {name}", value)
    limits = {name: given[name] for name in names if given.get(name, math.inf) < math.inf}
    if not limits:
        return network
    neurons = tuple(_stopped(n, limits.get(n.name, math.inf)) for n in network.cell.neurons)
    start = {name: np.clip(network.start.get(name, 0.0), -v, v) for name, v in limits.items()}
    cell = replace(network.cell, neurons=neurons)
    return replace(network, cell=cell, start={**network.start, **start})


def slew(network: Network, rate: float, where: Where = EVERYWHERE) -> Network:
    """No neuron faster than rate: tau x' = rate tau clip(d), d = sum w s / (rate tau).

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
    """An input ``noise.<neuron>``, zero until someone feeds xi: tau x' = sum w s + density xi.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``density`` is not finite, or ``where`` names what is not there.
    """
    known = _neurons(network)
    names, there = _chosen(network, where, known)
    weight = _errors(network, "density", density, known, None)
    for name in names if density else ():
        source = _fresh(network, "noise", name)
        cell = replace(network.cell, inputs=(*network.cell.inputs, source))
        network = replace(network, cell=cell, inputs={**network.inputs, source: 0.0})
        wire = _wire(source, _arrival(network, name), weight[name] * there)
        network = _with_wires(network, [wire])
    return network


# ---- what is chosen ------------------------------------------------------------------------------

Known = dict[str, tuple[str, ...]]
"""What can be chosen: the population of each, and the names that it answers to."""


def _neurons(network: Network) -> Known:
    return {neuron.name: (neuron.population, neuron.name) for neuron in network.cell.neurons}


def _blocks(network: Network, *kinds: type) -> Known:
    return {
        b.name: (
            b.name.partition(".")[0] if isinstance(b, Sum) else type(b).__name__.lower(),
            b.name,
        )
        for b in network.cell.blocks
        if not kinds or isinstance(b, kinds)
    }


def _connections(network: Network) -> Known:
    nodes = _neurons(network) | _blocks(network)
    return {c.name: (nodes[c.target][0], c.name, c.target) for c in network.cell.connections}


def _chosen(network: Network, where: Where, known: Known) -> tuple[list[str], np.ndarray]:
    """Names of what is chosen, and at which stages (N,)."""
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
    stages = np.arange(network.stages)
    there = np.isin(stages, stages if where.stages is None else where.stages)
    return names if there.any() else [], there


def _errors(network: Network, field: str, size: float, known: Known, seed: int | None):
    """Errors of all that is known, so that draws do not depend on what is chosen of it."""
    if not math.isfinite(size):
        raise NetworkError(f"{field}: expected a finite number, got {size!r}")
    if seed is None:
        return dict.fromkeys(known, size)
    draws = np.random.default_rng(seed).standard_normal((len(known), network.stages))
    return dict(zip(known, size * draws))


def _positive(field: str, value: float) -> None:
    if not value > 0:
        raise NetworkError(f"{field}: expected a positive number, inf for no defect, got {value!r}")


# ---- wires ---------------------------------------------------------------------------------------


def _tidy(weight) -> float | np.ndarray:
    """One number where all stages have the same."""
    weight = np.asarray(weight, float)
    return float(weight.flat[0]) if (weight == weight.flat[0]).all() else weight


def _wire(source: str, target: str, weight: float | np.ndarray = 1.0) -> Connection:
    return Connection(source=source, target=target, weight=_tidy(weight))


def _with_wires(network: Network, wires: list[Connection]) -> Network:
    """More wires; one that is there already takes the weight of its double."""
    together = {c.name: c for c in network.cell.connections}
    wires = [wire for wire in wires if np.any(wire.weight)]
    for wire in wires:
        there = together.get(wire.name)
        weight = wire.weight if there is None else np.add(there.weight, wire.weight)
        together[wire.name] = replace(wire, weight=_tidy(weight))
    cell = replace(network.cell, connections=tuple(together.values()))
    return replace(network, cell=cell) if wires else network


def _reweighed(network: Network, names: list[str], there: np.ndarray, weight_of) -> Network:
    """Other weights of some connections at some stages; the same network if they are the same."""
    before, chosen = network.cell.connections, set(names)
    after = tuple(
        replace(c, weight=_tidy(np.where(there, weight_of(c), c.weight))) if c.name in chosen else c
        for c in before
    )
    if all((np.asarray(a.weight) == b.weight).all() for a, b in zip(after, before)):
        return network
    return replace(network, cell=replace(network.cell, connections=after))


def _preferred(weight: np.ndarray, series: np.ndarray) -> np.ndarray:
    levels = np.concatenate([series, 10 / series, [10.0]])
    size = np.where(weight == 0, 1.0, np.abs(weight))
    decade = 10.0 ** np.floor(np.log10(size))
    nearest = levels[np.abs(levels - (size / decade)[..., None]).argmin(axis=-1)] * decade
    had = np.isclose(nearest, size, rtol=1e-12, atol=0.0)
    return np.where(had, weight, np.sign(weight) * nearest)


def _arrival(network: Network, node: str) -> str:
    """Where the wires of a node arrive: at itself, or at the sum that `slew` has put before it."""
    drive = f"{DRIVE}.{node}"
    return drive if any(block.name == drive for block in network.cell.blocks) else node


def _conductance(network: Network, target: str, fused: str, scale: Mapping[str, float]):
    """sum |w| S of a node's wires; in place of the one from a fused sum, those of that sum."""
    total: float | np.ndarray = 0.0
    for c in network.cell.connections:
        if c.target == target:
            own = c.source != fused
            behind = scale.get(c.source, 1.0) if own else _conductance(network, fused, "", scale)
            total = total + np.abs(c.weight) * behind
    return total


# ---- parts ---------------------------------------------------------------------------------------


def _fresh(network: Network, prefix: str, node: str) -> str:
    """The name ``prefix.node`` for a new node, numbered where it is taken."""
    cell = network.cell
    taken = {n.name.lower() for n in (*cell.neurons, *cell.blocks)} | set(
        map(str.lower, cell.inputs)
    )
    name, number = f"{prefix}.{node}", 2
    while name.lower() in taken:
        name, number = f"{prefix}.{node}.{number}", number + 1
    return name


def _with_block(network: Network, block: Block, after: str) -> Network:
    """One more block, behind the one that it reads; before all of them if that is a neuron."""
    names = [b.name for b in network.cell.blocks]
    place = names.index(after) + 1 if after in names else 0
    blocks = (*network.cell.blocks[:place], block, *network.cell.blocks[place:])
    return replace(network, cell=replace(network.cell, blocks=blocks))


def _blocks_reading(network: Network, new: str, old: str) -> Network:
    """Products and functions that read another node in place of the old one."""
    blocks = tuple(
        replace(b, **{field: new for field in ("a", "b", "x") if getattr(b, field, "") == old})
        for b in network.cell.blocks
    )
    return replace(network, cell=replace(network.cell, blocks=blocks))


def _all_reading(network: Network, new: str, old: str) -> Network:
    """Everything that reads another node in place of the old one, at the left end too."""
    cell = _blocks_reading(network, new, old).cell
    wires = tuple(replace(c, source=new) if c.source == old else c for c in cell.connections)
    duals = tuple(replace(d, residual=new) if d.residual == old else d for d in cell.duals)
    left = {new: network.left[old]} if old in network.left else {}
    cell = replace(cell, connections=wires, duals=duals)
    return replace(network, cell=cell, left={**network.left, **left})


def _slowed(network: Network, name: str, tau: float, there: np.ndarray, start) -> Network:
    slow = _fresh(network, "slow", name)
    seen = slow if there.all() else _fresh(network, "seen", name)
    unit = network.neuron(name).unit if name in network.neuron_index else 1.0
    neurons = (*network.cell.neurons, Neuron(name=slow, tau=tau, unit=unit))
    absent = {a.stage for a in network.absent if a.neuron == name} | set(np.flatnonzero(~there))
    pins = [pin for pin in network.pins if pin.neuron == name and there[pin.stage]]
    network = replace(
        network,
        cell=replace(network.cell, neurons=neurons),
        pins=(*network.pins, *(replace(pin, neuron=slow) for pin in pins)),
        absent=(*network.absent, *(Absent(neuron=slow, stage=int(k)) for k in sorted(absent))),
        start={**network.start, slow: start},
    )
    wires = [_wire(name, slow), _wire(slow, slow, -1.0)]
    if seen != slow:
        network = _with_block(network, Sum(name=seen), after=name)
        wires += [_wire(slow, seen), _wire(name, seen, ~there)]
    return _with_wires(_all_reading(network, seen, name), wires)


def _amplified(network: Network, name: str, gain: np.ndarray) -> Network:
    around = np.concatenate([[1.0], gain, [1.0]])  # what lies beyond the ends is no block
    connections = tuple(
        replace(c, weight=_tidy(c.weight * around[1 + c.template : len(gain) + 1 + c.template]))
        if c.source == name
        else c
        for c in network.cell.connections
    )
    network = replace(network, cell=replace(network.cell, connections=connections))
    if not any(
        name in (getattr(b, field, "") for field in ("a", "b", "x")) for b in network.cell.blocks
    ):
        return network
    amplified = _fresh(network, "gain", name)
    network = _with_block(network, Sum(name=amplified), after=name)
    return _with_wires(_blocks_reading(network, amplified, name), [_wire(name, amplified, gain)])


def _stopped(neuron: Neuron, limit: float) -> Neuron:
    low, high = max(neuron.limiter.low, -limit), min(neuron.limiter.high, limit)
    return replace(neuron, limiter=Limiter(low=low, high=high))


def _slewing(network: Network, name: str, largest: np.ndarray, there: np.ndarray) -> Network:
    drive, cell = _fresh(network, DRIVE, name), network.cell
    arriving = tuple(replace(c, target=drive) if c.target == name else c for c in cell.connections)
    blocks: list[Block] = [*cell.blocks, Sum(name=drive)]
    wires = [_wire(ONE, name, -largest * there), _wire(drive, name, ~there)]
    for sign in (1.0, -1.0):
        shifted, beyond = (
            _fresh(network, f"{part}{sign:+.0f}", name) for part in ("slew", "rectify")
        )
        blocks += [Sum(name=shifted), Function(name=beyond, function="rectify", x=shifted)]
        wires += [_wire(drive, shifted, 1 / largest), _wire(ONE, shifted, sign)]
        wires.append(_wire(beyond, name, sign * largest * there))
    cell = replace(cell, connections=arriving, blocks=tuple(blocks))
    return _with_wires(replace(network, cell=cell), wires)
