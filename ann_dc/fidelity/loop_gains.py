r"""Loop gain and phase margin of every op amp, with all other loops closed.

The loops are evaluated at the settled point. An op amp of gain a(s) = Omega / (s + Omega / A0)
drives x = -a e. Here e is the feedback at its virtual ground, through the whole circuit. A second
pole follows x, in the circuit. The loop is broken at the input, and its gain is L = a e / x. With A
the Jacobian of the emulation's flow, and i the component of x, the Schur complement is

.. math:: 1 + L(s) = \frac{1}{(s + \Omega / A_0) \, [(s I - A)^{-1}]_{ii}} ,

so that one eigendecomposition of A gives the loop gains of all op amps at all frequencies [1]_.

References
----------
.. [1] H. W. Bode, Network Analysis and Feedback Amplifier Design, 1945: return difference.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import root_scalar

from ann_dc.analysis.spectra import dense_flow
from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.emulation.nodes import AmplifierNodes
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.technologies import OtaC
from ann_dc.hardware.schematic.elements import Generator, Multiplier, PICell
from ann_dc.hardware.schematic.schematic import Schematic
from ann_dc.validation import State, checked

LARGEST = 1500
"""Largest number of emulation neurons for which all modes are computed."""

POINTS = 40
"""Frequencies per decade in the search for crossovers, in addition to those of the modes."""


@dataclass(frozen=True, kw_only=True)
class LoopGain:
    """Loop gain of one op amp.

    Attributes
    ----------
    node : str
        Part of the op amp; ``not.<part>`` for its inverter, ``open.<part>`` for a rectifying
        multiplier neuron.
    stage : int
        Index of the cell, from 0.
    crossover : float
        Frequency in Hz at which the loop gain is 1; nan if it is below 1 everywhere.
    phase_margin : float
        Phase distance in degrees of the loop gain from -1 at the crossover with the smallest
        margin. Infinite without a crossover, negative beyond -1.
    """

    node: str
    stage: int
    crossover: float
    phase_margin: float

    def __str__(self) -> str:
        return (
            f"{self.node} of cell {self.stage}: {self.phase_margin:.0f} degrees at "
            f"{self.crossover:.3g} Hz"
        )


@checked
def loop_gains(emulation: Emulation, level: Level, x: State) -> tuple[LoopGain, ...]:
    """Return crossover and phase margin of every op amp, smallest margin first.

    Loops are broken one at a time. Positive margins do not prove that the circuit is stable:
    eigenvalues do, and margins show which op amp lacks bandwidth.

    Parameters
    ----------
    x : (n,) array
        Settled state of the emulation; saturated op amps have no loop.

    Raises
    ------
    NetworkError
        If the level has no op amps, or the circuit has more than 1500 neurons.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity import CircuitInstance, loop_gains
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> level = ann_dc.levels.macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> made = CircuitInstance(circuit=circuit, level=level, probe=probe)
    >>> worst = loop_gains(made.emulation, level, made.settled)[0]
    >>> 20 < worst.phase_margin < 90, 1e5 < worst.crossover < 1e7
    (True, True)
    """
    _check(emulation, level)
    names = _names(emulation)
    rows, flow = _op_amps(emulation, x, names)
    omega = 2 * math.pi * level.datasheet.gbw * emulation.circuit.scaling.time
    modes, vectors = np.linalg.eig(flow)
    shares = vectors[rows[:, 0]] * np.linalg.inv(vectors).T[rows[:, 0]]
    grid = _frequencies(modes, omega)
    hertz = 1 / (2 * math.pi * emulation.circuit.scaling.time)
    found = []
    for (_, row, stage), share in zip(rows, shares):
        loop = _loop(share, modes, omega / level.datasheet.a0)
        w, margin = min(_margins(loop, grid), key=lambda pair: abs(pair[1]), default=NONE)
        node = names[emulation.network.cell.neurons[row].name]
        found.append(
            LoopGain(node=node, stage=int(stage), crossover=w * hertz, phase_margin=margin)
        )
    return tuple(sorted(found, key=lambda loop: abs(loop.phase_margin)))


def why_no_loops(emulation: Emulation) -> str:
    """Return the reason, as a clause, for which loop gains would take too long, or ""."""
    size = emulation.network.size
    if size <= LARGEST:
        return ""
    return (
        f"the emulation has {size} neurons, but loop gains are computed up to {LARGEST}; use a "
        "shorter horizon"
    )


NONE = (math.nan, math.inf)
"""Crossover and margin of a loop gain that is below 1 everywhere."""


def _check(emulation: Emulation, level: Level) -> None:
    if not level.emulated:
        raise NetworkError(f"loop gains: {level.name} circuits are not emulated")
    if isinstance(level.technology, OtaC):
        raise NetworkError(f"loop gains: {level.name} circuits have no op amps")
    if why := why_no_loops(emulation):
        raise NetworkError(f"loop gains: {why}")


def _op_amps(
    emulation: Emulation, x: np.ndarray, names: Mapping[str, str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return (row of the flow, neuron, stage) per unsaturated op amp, and the flow."""
    network = emulation.network
    compiled = fast_evaluator(network)
    free = compiled.free(x)
    flow = dense_flow(network.preconditioner, network.layout, compiled.drive_jacobian(x), free)
    places = network.places[free]
    rows = [
        (i, row, stage)
        for i, (row, stage) in enumerate(places)
        if network.cell.neurons[row].name in names
    ]
    return np.array(rows).reshape(-1, 3), flow


def _names(emulation: Emulation) -> dict[str, str]:
    """Return the node of every op amp, by the neuron of its first pole."""
    known = emulation.network.neuron_index
    return {
        nodes.first if nodes.first in known else nodes.output: nodes.output
        for nodes in _amplifiers(emulation.circuit.schematic)
    }


def _amplifiers(schematic: Schematic) -> Iterator[AmplifierNodes]:
    """Yield the op amps of all parts and of their inverters."""
    for part in schematic.parts:
        if part.name in schematic.inverted:
            yield AmplifierNodes(part.name, inverter=True)
        if not isinstance(part, (Multiplier, Generator)):
            rectified = isinstance(part, PICell) and part.rectified
            yield AmplifierNodes(part.name, rectified=rectified)


def _frequencies(modes: np.ndarray, omega: float) -> np.ndarray:
    """Return the frequencies (radians per unit of network time) of the search."""
    sizes = np.abs(modes)
    low, high = np.log10(0.1 * sizes.min()), np.log10(10 * max(sizes.max(), omega))
    grid = np.logspace(low, high, math.ceil(POINTS * (high - low)))
    return np.unique(np.concatenate([grid, sizes, 0.99 * sizes, 1.01 * sizes]))


def _loop(share: np.ndarray, modes: np.ndarray, leak: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return L (F,) as a function of frequencies (F,), from the mode weights (n,)."""

    def gain(w: np.ndarray) -> np.ndarray:
        s = 1j * np.asarray(w)[:, None]
        return 1 / ((s[:, 0] + leak) * (share / (s - modes)).sum(axis=1)) - 1

    return gain


def _margins(
    loop: Callable[[np.ndarray], np.ndarray], grid: np.ndarray
) -> Iterator[tuple[float, float]]:
    """Yield frequency and phase margin in degrees of every crossover."""
    above = np.log(np.abs(loop(grid)))
    for i in np.flatnonzero(np.sign(above[1:]) != np.sign(above[:-1])):
        bracket = grid[i], grid[i + 1]
        w = root_scalar(lambda w: math.log(abs(loop(np.array([w]))[0])), bracket=bracket).root
        yield float(w), float(np.degrees(np.angle(-loop(np.array([w]))[0])))
