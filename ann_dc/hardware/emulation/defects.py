r"""What analog parts do to a network, before any part is chosen: network in, network out.

Each function spoils one thing, and every backend runs what comes out. Of a neuron they make

.. math:: \tau\,\dot x = r\tau\; \mathrm{clip}\Big(\tfrac{1}{r\tau}\Big(
    \textstyle\sum_j (1 + \epsilon_j) w_j s_j + o - \frac{x}{A_0} \sum_j |w_j|\Big)\Big),
    \qquad |x| \le limit ,

with another pole behind every s_j. All numbers are the network's own: its units, its time, one full
scale for all nodes. `ann_dc.hardware.emulation.emulation` is the exact version, for a circuit whose
resistors and op amps are chosen. Roles, duals, chains and coordinators stay (what coordinators add
is ideal), so a residual says how far a network is from rest; its certificate says what they cost.

No defect (strength zero, or infinite gain) gives back the network itself. They compose; what one
has added is to the next a node like any other. So begin with what changes numbers (`quantised`,
`mismatch`, `gain_error`, `offset`, `leak`), and end with what adds parts (`extra_pole`, `slew`,
`rails`, `noise`). Design a network before: a design would choose the time constants of poles too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.emulation.strengths import errors_of, preferred, require_strength
from ann_dc.hardware.parts.e_series import EXACT, Series
from ann_dc.hints.checked import checked
from ann_dc.hints.values import FloatOrNan, Index
from ann_dc.network.cell import ONE, Connection, Function, Product, Sum
from ann_dc.network.network import Network
from ann_dc.network.rewiring import (
    amplified,
    arrival,
    conductance,
    fresh,
    reweighed,
    slewing,
    slowed,
    stopped,
    wire,
    with_wires,
)
from ann_dc.network.selection import (
    EVERYWHERE,
    Selection,
    blocks_of,
    chosen,
    connections_of,
    neurons_of,
)


@checked
def leak(
    network: Network,
    gain: FloatOrNan,
    where: Selection = EVERYWHERE,
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
    >>> from ann_dc.network import Cell, Neuron
    >>> wires = (Connection(source="x", target="x", weight=-1.0),)
    >>> row = Network(cell=Cell(neurons=(Neuron(name="x"),), connections=wires), stages=1)
    >>> evaluator(leak(row, 100.0)).rhs([1.0]).tolist()
    [-1.01]
    """
    names, there = chosen(network, where, neurons_of(network))
    require_strength("gain", gain)
    scale, sums, wires = unit or {}, blocks_of(network, Sum), []
    duals = {d.neuron: d for d in network.cell.duals if d.residual in sums}
    for name in names if gain < math.inf else ():
        dual, target = duals.get(name), arrival(network, name)
        fused, output = ("", name) if dual is None else (dual.residual, dual.multiplier)
        total = conductance(network, target, fused, scale) / scale.get(output, 1.0)
        wires.append(wire(name, target, -total * there / gain))
    return with_wires(network, wires)


@checked
def extra_pole(network: Network, bandwidth: FloatOrNan, where: Selection = EVERYWHERE) -> Network:
    """One more pole at the output s of a neuron or a block: y' = bandwidth (s - y).

    Readers of s read a new neuron y, ``slow.<node>`` (where stages are chosen, through a sum
    ``seen.<node>``), which is pinned, absent and started as s is. ``bandwidth`` is in radians per
    unit of network time.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``bandwidth`` is not positive, or ``where`` names what is not there.

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
def offset(
    network: Network, size: FloatOrNan, where: Selection = EVERYWHERE, *, seed: Index | None = None
) -> Network:
    """A bias o at neurons and sums, in units of what arrives there: tau x' = sum w s + o.

    o is ``size``, or with a seed ``size`` times a normal draw for each node and stage.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``size`` is not finite, or ``where`` names what is not there.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = offset(synthesize(plants.double_integrator(N=2)), 1e-3)
    >>> [wire.weight for wire in network.cell.connections if wire.name == "u.a<-one"]
    [0.001]
    """
    known = neurons_of(network) | blocks_of(network, Sum)
    names, there = chosen(network, where, known)
    o = errors_of(network, "size", size, known, seed)
    wires = [wire(ONE, arrival(network, name), o[name] * there) for name in names]
    return with_wires(network, wires)


@checked
def mismatch(
    network: Network, relative: FloatOrNan, where: Selection = EVERYWHERE, *, seed: Index
) -> Network:
    """Weights w (1 + relative e), with a normal draw e for each connection and stage.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``relative`` is not finite, or ``where`` names what is not there.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=2))
    >>> pair = zip(network.cell.connections, mismatch(network, 0.01, seed=0).cell.connections)
    >>> bool(0 < max(np.max(np.abs(b.weight / a.weight - 1)) for a, b in pair) < 0.05)
    True
    """
    known = connections_of(network)
    names, there = chosen(network, where, known)
    e = errors_of(network, "relative", relative, known, seed)
    return reweighed(network, names, there, lambda c: c.weight * (1 + e[c.name]))


@checked
def quantised(
    network: Network,
    where: Selection = EVERYWHERE,
    *,
    bits: FloatOrNan = math.inf,
    series: Series = EXACT,
) -> Network:
    """Weights that can be had: conductances of resistors from a series, or of a few bits.

    A weight is 1 / R in units of one resistor; R becomes the nearest of the series, and the weight
    is then rounded to so many significant bits. Equal weights stay equal, so that the errors of
    stages do not average out.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``bits`` is below 1, or ``where`` names what is not there.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> from ann_dc.problem import Scales
    >>> problem = plants.double_integrator(N=2, dt=0.7)
    >>> network = quantised(synthesize(problem, scales=Scales.none(problem)), bits=2)
    >>> sorted({abs(float(wire.weight)) for wire in network.cell.connections})
    [0.75, 1.0]
    """
    names, there = chosen(network, where, connections_of(network))
    if not bits >= 1:
        raise NetworkError(f"bits: expected 1 or more significant bits, got {bits!r}")

    def rounded(connection: Connection) -> np.ndarray:
        weight = np.asarray(connection.weight, float)
        if series.mantissas:
            weight = preferred(weight, series)
        mantissa, exponent = np.frexp(weight)
        return np.ldexp(np.round(mantissa * 2**bits) / 2**bits, exponent) if bits < 53 else weight

    return reweighed(network, names, there, rounded)


@checked
def gain_error(
    network: Network,
    relative: FloatOrNan,
    where: Selection = EVERYWHERE,
    *,
    seed: Index | None = None,
) -> Network:
    """Products (1 + e) a b and functions (1 + e) g(x).

    e is ``relative``, or with a seed ``relative`` times a normal draw for each block and stage.
    Connections that read a block are scaled; blocks that do read it through a sum ``gain.<block>``.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``relative`` is not finite, or ``where`` names what is not there.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = synthesize(plants.pendulum(N=2))
    >>> pair = zip(network.cell.connections, gain_error(network, 0.01).cell.connections)
    >>> sorted({round(float(b.weight / a.weight), 9) for a, b in pair})
    [1.0, 1.01]
    """
    known = blocks_of(network, Product, Function)
    names, there = chosen(network, where, known)
    e = errors_of(network, "relative", relative, known, seed)
    for name in names if relative else ():
        network = amplified(network, name, 1 + e[name] * there)
    return network


@checked
def rails(
    network: Network, limit: FloatOrNan | Mapping[str, FloatOrNan], where: Selection = EVERYWHERE
) -> Network:
    """Neurons that stop at |x| = limit, one number or one by name, if nothing stops them before.

    A start beyond is moved there. Of a PI dual mu stops, not its output m.

    Raises
    ------
    NetworkError, UnknownNameError
        If a limit is not positive, or ``where`` names what is not there or chooses stages.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = rails(synthesize(plants.double_integrator(N=2)), {"u.a": 2.0})
    >>> network.neuron("u.a").limiter
    Limiter(low=-2.0, high=2.0)
    """
    known = neurons_of(network)
    names, there = chosen(network, where, known)
    if not there.all():
        raise NetworkError(f"rails are the same at all stages, got {where}; leave stages out")
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
    """No neuron faster than rate: tau x' = rate tau clip(d), d = sum w s / (rate tau).

    clip(d) = rectify(d + 1) - rectify(d - 1) - 1. The wires arrive at a sum ``drive.<neuron>``.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``rate`` is not positive, or ``where`` names what is not there.

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
    """An input ``noise.<neuron>``, zero until someone feeds xi: tau x' = sum w s + density xi.

    Raises
    ------
    NetworkError, UnknownNameError
        If ``density`` is not finite, or ``where`` names what is not there.

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
