r"""Loop gain and phase margin of every op amp at the settled point, all other loops closed.

An op amp of gain a(s) = Omega / (s + Omega / A0) drives x = -a e, with e what comes back to its
virtual ground through the whole circuit; a second pole lies behind x, in the circuit. Broken at its
input, its loop gain is L = a e / x. With A the Jacobian of the emulation's flow, and i the
component that x is, Schur's complement is

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
from ann_dc.validation.checked import checked
from ann_dc.validation.values import State

LARGEST = 1500
"""Neurons of an emulation up to which all of its modes are computed."""

POINTS = 40
"""Frequencies a decade at which crossovers are looked for, beside those of the modes."""


@dataclass(frozen=True, kw_only=True)
class LoopGain:
    """The loop of one op amp.

    Attributes
    ----------
    node : str
        Part of the op amp; ``not.<part>`` of its inverter, ``open.<part>`` of a diode neuron.
    stage : int
        Its cell, from 0.
    crossover : float
        Hz at which the loop gain is 1; nan where it is below 1 everywhere.
    phase_margin : float
        Degrees that the loop gain is from -1 there; where there are several crossovers, at that
        with the smallest margin. Infinite where there is none, negative where it has gone past.

    Examples
    --------
    >>> print(LoopGain(node="q.x", stage=2, crossover=1.2e6, phase_margin=48.3))
    q.x of cell 2: 48 degrees at 1.2e+06 Hz
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
    """Crossover and phase margin of every op amp, the smallest margin first.

    Loops are broken one at a time. That all margins are positive does not prove that the circuit is
    stable: eigenvalues do, and margins tell which op amp is short of bandwidth.

    Parameters
    ----------
    emulation : Emulation
        Of the circuit.
    level : Level
        What it was emulated as.
    x : (n,) array
        Where it settles, a state of the emulation; op amps at their rails have no loop.

    Returns
    -------
    tuple of LoopGain

    Raises
    ------
    NetworkError
        If the level has no op amps, or the circuit has more than 1500 neurons.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity import Specimen
    >>> from ann_dc.fidelity import loop_gains
    >>> from ann_dc.hardware.parts import macro
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, kinds=[ann_dc.Kind.TIME_CONSTANTS]).network
    >>> level = macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> made = Specimen(circuit=circuit, level=level, probe=probe)
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
    """Why the loop gains of a circuit of op amps would take too long; empty where they do not.

    Parameters
    ----------
    emulation : Emulation
        Of the circuit.

    Returns
    -------
    str
        A clause.
    """
    size = emulation.network.size
    if size <= LARGEST:
        return ""
    return (
        f"the emulation has {size} neurons, and loop gains are computed up to {LARGEST}; take a "
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
    """Of every op amp that is free: (row of the flow, neuron, stage); and the flow itself."""
    network = emulation.network
    compiled = fast_evaluator(network)
    free = compiled.free(x)
    flow = dense_flow(network.metric, network.row, compiled.drive_jacobian(x), free)
    places = network.places[free]
    rows = [
        (i, row, stage)
        for i, (row, stage) in enumerate(places)
        if network.cell.neurons[row].name in names
    ]
    return np.array(rows).reshape(-1, 3), flow


def _names(emulation: Emulation) -> dict[str, str]:
    """Node of every op amp, by the neuron of its first pole."""
    known = emulation.network.neuron_index
    return {
        nodes.first if nodes.first in known else nodes.output: nodes.output
        for nodes in _amplifiers(emulation.circuit.schematic)
    }


def _amplifiers(schematic: Schematic) -> Iterator[AmplifierNodes]:
    """The op amps of all parts, and of their inverters."""
    for part in schematic.parts:
        if part.name in schematic.inverted:
            yield AmplifierNodes(part.name, inverter=True)
        if not isinstance(part, (Multiplier, Generator)):
            rectified = isinstance(part, PICell) and part.rectified
            yield AmplifierNodes(part.name, rectified=rectified)


def _frequencies(modes: np.ndarray, omega: float) -> np.ndarray:
    """Radians per unit of network time at which crossovers are looked for."""
    sizes = np.abs(modes)
    low, high = np.log10(0.1 * sizes.min()), np.log10(10 * max(sizes.max(), omega))
    grid = np.logspace(low, high, math.ceil(POINTS * (high - low)))
    return np.unique(np.concatenate([grid, sizes, 0.99 * sizes, 1.01 * sizes]))


def _loop(share: np.ndarray, modes: np.ndarray, leak: float) -> Callable[[np.ndarray], np.ndarray]:
    """L (F,) at frequencies (F,), from the shares (n,) of the modes in an op amp's response."""

    def gain(w: np.ndarray) -> np.ndarray:
        s = 1j * np.asarray(w)[:, None]
        return 1 / ((s[:, 0] + leak) * (share / (s - modes)).sum(axis=1)) - 1

    return gain


def _margins(
    loop: Callable[[np.ndarray], np.ndarray], grid: np.ndarray
) -> Iterator[tuple[float, float]]:
    """Frequency and phase margin in degrees of every crossover."""
    above = np.log(np.abs(loop(grid)))
    for i in np.flatnonzero(np.sign(above[1:]) != np.sign(above[:-1])):
        bracket = grid[i], grid[i + 1]
        w = root_scalar(lambda w: math.log(abs(loop(np.array([w]))[0])), bracket=bracket).root
        yield float(w), float(np.degrees(np.angle(-loop(np.array([w]))[0])))
