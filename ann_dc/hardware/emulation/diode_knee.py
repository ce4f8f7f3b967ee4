r"""Diode knee: rounded corners of multipliers, and their effect on the solution.

A diode outside the loop of an op amp rounds the corner of m = max(0, y), y = z + w g. The corner
becomes exponential, with a width of s:

.. math:: m = s \ln(1 + e^{y / s}) = \max(0, y) + s \ln(1 + e^{-|y| / s}) .

The integrator before the diode rests at m = z, so a constraint misses its boundary by

.. math:: g = \frac{s}{w} \ln(1 - e^{-z / s}) ,

which is exponentially small except for weakly active constraints. Every active or nearly active
multiplier at the optimum has an excess :math:`b = s \ln(1 + e^{-|y|/s})`. To first order the
excesses move the solution of the KKT system, in which a constraint conducts by the fraction
:math:`p = 1 / (1 + e^{-y/s})`:

.. math:: L\, \delta x + G' \delta z = 0, \qquad p\, w\, G\, \delta x - (1 - p)\, \delta z = -b .

In the loop of an op amp a knee has an effect of s / A0, which is negligible.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from scipy.sparse.linalg import splu

from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.network.cell import ONE, Block, Connection, Function, Sum
from ann_dc.network.network import Network
from ann_dc.validation import FloatOrNan, State, checked

FARTHEST = 30.0
"""Widths from a corner beyond which a diode is straight; its tail is below 1e-13 widths."""


@checked
def with_diode_knee(network: Network, width: FloatOrNan | Mapping[str, FloatOrNan]) -> Network:
    """Add a knee to rectifying neurons: m = width ln(1 + exp((z + w g) / width)).

    The added blocks are ``tail.<m>``, the addition to the corner, and its inputs. ``width`` is in
    network units of the multiplier, one for all or by neuron name. For 10 mV in a circuit it is
    ``circuit.scaling.value(diode.multiplier, 0.01)``. A network without widths is returned
    unchanged. Raises `NetworkError` if a width is negative or not finite, and `UnknownNameError` if
    no rectifying neuron has a given name.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.hardware.emulation import with_diode_knee
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> held = ann_dc.synthesize(ann_dc.OptimalControlProblem(
    ...     states=problem.states, controls=problem.controls, dynamics=problem.dynamics, dt=0.1,
    ...     cost=problem.cost, horizon=5, q_0=(0, 0), q_d=(1, 0), bounds={"v": (None, 0.5)}))
    >>> [block.name for block in with_diode_knee(held, 0.01).cell.blocks if "tail" in block.name]
    ['tail.zeta.v_high']
    """
    widths = _widths(network, width)
    for sum_name, size in widths.items():
        network = _bent(network, sum_name, size)
    return network


@checked
def knee_shift(
    network: Network, x: State, width: FloatOrNan | Mapping[str, FloatOrNan]
) -> np.ndarray:
    """Return the first-order shift (n,) of a settled state by a knee.

    It is one step of Newton's method. The network has no knee and settles at ``x`` (n,), to which
    the result is added. Saturated neurons stay at their limits. ``width`` has the form of
    `with_diode_knee`. Raises `NetworkError` if a width is negative or not finite or the
    equilibrium is not isolated, and `UnknownNameError` if no rectifying neuron has a given name.

    Examples
    --------
    x' = 1 - x - m with x <= 1/2: the knee lets x - 1/2 be s ln(1 - exp(-m / s)), with m = 1/2:

    >>> from ann_dc.hardware.emulation import knee_shift
    >>> from ann_dc.network import Cell, InequalityDual, Neuron
    >>> dual = InequalityDual(neuron="z", residual="g", sum="y", multiplier="m")
    >>> ends = [("one", "x", 1.0), ("x", "x", -1.0), ("m", "x", -1.0), ("x", "g", 1.0),
    ...         ("one", "g", -0.5), ("z", "y", 1.0), ("g", "y", 1.0), ("m", "z", 1.0),
    ...         ("z", "z", -1.0)]
    >>> cell = Cell(
    ...     neurons=(Neuron(name="x"), Neuron(name="z")), inequality_duals=(dual,),
    ...     blocks=(Sum(name="g"), Sum(name="y"), Function(name="m", function="rectify", x="y")),
    ...     connections=tuple(Connection(source=s, target=t, weight=w) for s, t, w in ends))
    >>> found = knee_shift(Network(cell=cell, stages=1), np.array([0.5, 0.5]), 0.1)
    >>> found.round(5).tolist(), round(float(0.1 * np.log(1 - np.exp(-0.5 / 0.1))), 5)
    ([-0.00067, 0.00067], -0.00068)
    """
    bent = fast_evaluator(with_diode_knee(network, width))
    drives = bent.drives(x)
    free = np.flatnonzero(~bent.saturated(x, drives))
    moved = np.zeros(network.size)
    try:
        factors = splu(bent.drive_jacobian(x).tocsc()[free][:, free])
    except RuntimeError as error:
        raise NetworkError(
            "knee: the Jacobian is singular; the equilibrium is not isolated"
        ) from error
    moved[free] = -factors.solve(network.pack(drives)[free])
    return moved


def _widths(network: Network, width: float | Mapping[str, float]) -> dict[str, float]:
    """Return the width of every rounded rectifier, by the sum that it reads."""
    cell = network.cell
    sums = {dual.neuron: (dual.sum,) for dual in cell.objectives if not dual.is_softened}
    sums |= {d.neuron: (d.sum, d.excess) if d.excess else (d.sum,) for d in cell.inequality_duals}
    given = width if isinstance(width, Mapping) else dict.fromkeys(sums, width)
    found = {}
    for neuron, size in given.items():
        if neuron not in sums:
            raise UnknownNameError.of("inequality dual neuron", neuron, sums)
        if not 0 <= size < math.inf:
            raise NetworkError(f"width of {neuron}: expected 0 or a positive number, got {size!r}")
        found |= dict.fromkeys(sums[neuron] if size else (), float(size))
    return found


def _bent(network: Network, sum_name: str, s: float) -> Network:
    """Return the network with m = corner + s ln(1 + exp(-|y| / s)) for a sum y."""
    blocks: list[Block] = []
    wires = list(network.cell.connections)
    for block in network.cell.blocks:
        if isinstance(block, Function) and block.function == "rectify" and block.x == sum_name:
            more, added = bent_rectifier(block, s)
            blocks += more
            wires += added
        else:
            blocks.append(block)
    return replace(
        network, cell=replace(network.cell, blocks=tuple(blocks), connections=tuple(wires))
    )


def bent_rectifier(block: Function, s: float) -> tuple[Iterable[Block], Iterable[Connection]]:
    """Return blocks and wires that replace a rectifier of y by s ln(1 + e^(y / s)).

    The argument y is at least -30 s. The knee width s is in units of y. The final sum has the name
    of the rectifier.
    """
    m, y = block.name, block.x
    corner, near, kept, exponent = f"corner.{m}", f"near.{m}", f"kept.{m}", f"exponent.{m}"
    tail, grown = f"tail.{m}", f"grown.{m}"
    blocks = (
        Function(name=corner, function="rectify", x=y),
        Sum(name=near),
        Function(name=kept, function="rectify", x=near),
        Sum(name=exponent),
        Function(name=tail, function="exp", x=exponent),
        Sum(name=grown),
        Function(name=f"log.{m}", function="log", x=grown),
        Sum(name=m),
    )
    ends = (
        (y, near, 1.0 / s), (corner, near, -2.0 / s), (ONE, near, FARTHEST),  # -|y| / s
        (kept, exponent, 1.0), (ONE, exponent, -FARTHEST),
        (tail, grown, 1.0), (ONE, grown, 1.0), (corner, m, 1.0), (f"log.{m}", m, s),
    )  # fmt: skip
    return blocks, [Connection(source=a, target=b, weight=weight) for a, b, weight in ends]
