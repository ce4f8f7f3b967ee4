"""Non-ideal numbers: leaks, offsets, errors of weights, time constants and gains.

A strength is constant or drawn per element. `drawn_numbers` makes one batch of many samples.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.variant_numbers import Numbers
from ann_dc.hardware.parts.e_series import EXACT, Series
from ann_dc.network.cell import ONE, Connection, Function, Product, Sum
from ann_dc.network.network import Network
from ann_dc.network.rewiring import (
    amplified,
    arrival,
    conductance,
    retimed,
    reweighed,
    wire,
    with_wires,
)
from ann_dc.network.selection import (
    EVERYWHERE,
    Known,
    Selection,
    blocks_of,
    chosen,
    connections_of,
    neurons_of,
)
from ann_dc.validation import FloatOrNan, Index, NotEmpty, checked

WEIGHTS, TIME_CONSTANTS = (), (1,)
"""Random streams of one seed: the default stream, used for weights, and that of time constants."""


def errors_of(
    network: Network,
    field: str,
    size: float,
    known: Known,
    seed: int | None,
    of: tuple[int, ...] = WEIGHTS,
) -> dict:
    """Return the errors of all known names, as float or (N,) array.

    Errors cover all neurons, blocks or connections, so that draws do not depend on a selection. The
    size is the error of every element, or with a seed the standard deviation. ``of`` selects the
    random stream of the seed. Raises `NetworkError`, with ``field`` as the name, if the size is not
    finite.
    """
    require_finite(field, size)
    if seed is None:
        return dict.fromkeys(known, size)
    return dict(zip(known, size * draws(seed, (len(known), network.stages), of)))


def draws(seed: int, shape: tuple[int, int], of: tuple[int, ...] = WEIGHTS) -> np.ndarray:
    """Return normal draws of a stream of a seed."""
    stream = np.random.SeedSequence(seed, spawn_key=of)
    return np.random.default_rng(stream).standard_normal(shape)


def require_finite(field: str, value: float) -> None:
    """Raise `NetworkError`, with the name ``field``, if ``value`` is not finite."""
    if not math.isfinite(value):
        raise NetworkError(f"{field}: expected a finite number, got {value!r}")


def require_strength(field: str, value: float) -> None:
    """Raise `NetworkError`, with the name ``field``, if ``value`` is not positive.

    An infinite value disables the non-ideality.
    """
    if not value > 0:
        raise NetworkError(f"{field}: expected a positive number (inf for none), got {value!r}")


def preferred(weight: np.ndarray, series: Series) -> np.ndarray:
    """Return weights, in 1 / ohm, as made by the nearest resistors of a ``series``."""
    ohms = np.divide(1.0, np.abs(weight), out=np.full(weight.shape, np.inf), where=weight != 0)
    nearest = series.nearest(ohms)
    had = np.isclose(nearest, ohms, rtol=1e-12, atol=0.0)
    return np.where(had, weight, np.sign(weight) / nearest)


@checked
def leak(
    network: Network,
    gain: FloatOrNan,
    where: Selection = EVERYWHERE,
    *,
    unit: Mapping[str, float] | None = None,
) -> Network:
    r"""Add the leak of finite DC gain: tau x' = sum w s - (sum \|w\|) x / gain.

    If nodes have full scales S (``unit`` of a `Scaling`), \|w\| is \|w_j\| S_j / S. A PI dual is
    one op amp, whose resistors are the connections of its residual. Raises `NetworkError` or
    `UnknownNameError` if ``gain`` is not positive or ``where`` contains an unknown name.

    Parameters
    ----------
    gain : float
        DC gain of the integrators. An infinite value returns the network unchanged.
    where : Selection
        Selected neurons and stages; all by default.
    unit : mapping of str to float, optional
        Full scales S by node; equal by default.

    Examples
    --------
    >>> from ann_dc.evaluation import evaluator
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
def offset(
    network: Network, size: FloatOrNan, where: Selection = EVERYWHERE, *, seed: Index | None = None
) -> Network:
    """Add a bias o at neurons and sums: tau x' = sum w s + o.

    Raises `NetworkError` or `UnknownNameError` if ``size`` is not finite or ``where`` contains an
    unknown name.

    Parameters
    ----------
    size : float
        Bias o in units of the net input. With a seed, o is ``size`` times a normal draw for each
        node and stage.
    where : Selection
        Selected neurons or sums and stages; all by default.
    seed : int, optional
        Seed of the draws.

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
    """Multiply weights w by 1 + relative e, with a normal draw e.

    Raises `NetworkError` or `UnknownNameError` if ``relative`` is not finite or ``where`` contains
    an unknown name.

    Parameters
    ----------
    relative : float
        Standard deviation of the relative errors. Each connection and stage has one draw.
    where : Selection
        Selected connections and stages; all by default.
    seed : int
        Seed of the draws.

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
def detuned(
    network: Network, relative: FloatOrNan, where: Selection = EVERYWHERE, *, seed: Index
) -> Network:
    """Multiply time constants tau by 1 + relative e, with a normal draw e.

    The gains of coarse-level neurons do not change. Raises `NetworkError` or `UnknownNameError` if
    ``relative`` is not finite or so large that a time constant is not positive, or if ``where``
    contains an unknown name.

    Parameters
    ----------
    relative : float
        Standard deviation of the relative errors. Each neuron and stage has one draw.
    where : Selection
        Selected neurons and stages; all by default.
    seed : int
        Seed of the draws, which are independent of those of `mismatch` with an equal seed.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = detuned(synthesize(plants.double_integrator(N=2)), 0.01, seed=0)
    >>> bool(np.abs(network.neuron("u.a").tau - 1).max() < 0.1)
    True
    """
    known = neurons_of(network)
    names, there = chosen(network, where, known)
    e = errors_of(network, "relative", relative, known, seed, of=TIME_CONSTANTS)
    return retimed(network, names, there, lambda n: n.tau * (1 + e[n.name]))


@checked
def quantised(
    network: Network,
    where: Selection = EVERYWHERE,
    *,
    bits: FloatOrNan = math.inf,
    series: Series = EXACT,
) -> Network:
    """Round weights to conductances of series resistors or to significant bits.

    A weight is 1 / R in units of one resistor. R is rounded to the nearest value of the series,
    then the weight to the given number of significant bits. Equal weights stay equal, so the errors
    of stages do not average out. Raises `NetworkError` or `UnknownNameError` if ``bits`` is below 1
    or ``where`` contains an unknown name.

    Parameters
    ----------
    where : Selection
        Selected connections and stages; all by default.
    bits : float
        Significant bits, at least 1; unlimited by default.
    series : Series
        Available resistors; every value by default.

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
    """Scale products to (1 + e) a b and functions to (1 + e) g(x).

    Connections that read a block are scaled. Blocks that read a block do so through a sum
    ``gain.<block>``. Raises `NetworkError` or `UnknownNameError` if ``relative`` is not finite or
    ``where`` contains an unknown name.

    Parameters
    ----------
    relative : float
        Relative gain error e. With a seed, e is ``relative`` times a normal draw for each block and
        stage.
    where : Selection
        Selected blocks and stages; all by default.
    seed : int, optional
        Seed of the draws.

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
def drawn_numbers(
    network: Network,
    seeds: Annotated[Sequence[Index], NotEmpty()],
    *,
    weights: FloatOrNan = 0.0,
    time_constants: FloatOrNan = 0.0,
) -> Numbers:
    """Draw the weights and time constants of many samples of a network.

    The numbers of seed s are those of ``mismatch(detuned(network, time_constants, seed=s), weights,
    seed=s)``, bit for bit. No network is built per sample, which takes a hundredth of the time.
    Raises `NetworkError` if a standard deviation is not finite, or so large that a time constant is
    not positive.

    Parameters
    ----------
    network : Network
        Nominal network.
    seeds : sequence of int
        Seeds, one per sample.
    weights, time_constants : float
        Standard deviations of the relative errors; 0 by default.

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> numbers = ann_dc.nonidealities.drawn_numbers(network, range(100), weights=0.01)
    >>> int(ann_dc.OdeBackend().run_batch(network, {}, numbers=numbers).settled.sum())
    100
    """
    require_finite("weights", weights)
    require_finite("time_constants", time_constants)
    tape, edges = evaluator(network).tape, evaluator(network).edges
    order = [edges[connection.name] for connection in network.cell.connections]
    tau = np.array([np.broadcast_to(n.tau, network.stages) for n in network.cell.neurons], float)
    own = np.empty((len(seeds), *tape.weights.shape))
    rates = np.empty((len(seeds), *tau.shape))
    for sample, seed in enumerate(seeds):
        own[sample, order] = weights * draws(seed, tape.weights.shape)
        rates[sample] = time_constants * draws(seed, tau.shape, TIME_CONSTANTS)
    own += 1
    own *= tape.weights
    rates += 1
    rates *= tau
    if not (rates > 0).all():
        raise NetworkError(
            f"time_constants: errors of {time_constants:g} leave time constants that are not "
            "positive"
        )
    rates = np.where(network.live, 1 / rates, 0.0)
    return Numbers(weights=own, rates=rates)
