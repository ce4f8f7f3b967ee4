"""Input samples of a fixed-point network and floating-point trajectories for each.

Word ranges are those of one sample: the nominal inputs, the corners of the ranges, and a Sobol
sequence. The accuracy of the integers is measured on another sample.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ann_dc.errors import ExportError, UnknownNameError
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.rules import RoleRows, residuals
from ann_dc.export.reference.vector import LIMIT, LOST, ReferenceVector
from ann_dc.lowering.program import Program
from ann_dc.lowering.walk import Ranges, Walks
from ann_dc.lowering.writing import program_of
from ann_dc.network.inputs import drawn_values, ranges_of
from ann_dc.network.network import Network

InputRanges = Mapping[str, tuple[float, float]]
"""Lowest and highest value of inputs, in the user's units."""
LEARNT, HELD_OUT = 96, 256
"""Number of inputs for the choice of words, without corners; number of inputs for the measurement.
"""
LEARNT_SEED, HELD_OUT_SEED = 1, 2
MOST_CORNERS = 5
"""Maximum number of inputs with ranges for which all corners are simulated."""
HALVINGS = 3
"""Maximum number of step halvings, used if more inputs settle with shorter steps."""
SLOWEST = 20
"""Maximum steps of a run relative to those of the test vector; longer runs count as not settled."""
CHECKS = 8
"""Number of residual checks within the steps of the test vector."""


def covered(network: Network, over: str) -> dict[str, tuple[float, float]]:
    """Return the input ranges for which words are chosen: those in ``over``, or of the design.

    Raises `ExportError` if a range in ``over`` is empty or not finite, and `UnknownNameError` if
    the network does not have such an input.
    """
    if not over:
        return {name: _closed(network, name, ends) for name, ends in network.ranges.items()}
    found = ranges_of(over.split(","), "over")
    for name, (low, high) in found.items():
        if name not in network.cell.inputs:
            raise UnknownNameError.of("over: input", name, network.cell.inputs)
        if not (np.isfinite([low, high]).all() and low < high):
            raise ExportError(f"over: expected {name}=LOW:HIGH with LOW < HIGH, got {low}:{high}")
    return found


def _closed(network: Network, name: str, ends: tuple[float, float]) -> tuple[float, float]:
    """Return a range whose open ends are replaced by the network's input value."""
    own = network.input_scale(name).user(network.input_values[name])
    low, high = ends
    return (
        float(low if np.isfinite(low) else min(own.min(), high)),
        float(high if np.isfinite(high) else max(own.max(), low)),
    )


@dataclass(frozen=True, eq=False)
class Sample:
    """Trajectories of a network from its initial state, one set of inputs per lane.

    Inputs with ranges are ``loaded`` (N, B), in network units like the final states ``ends``
    (n, B). A lane settles within ``steps`` (B,) steps h of network time, or never if they are -1.
    """

    program: Program
    step: float
    loaded: Mapping[str, np.ndarray]
    walks: Walks
    steps: np.ndarray
    ends: np.ndarray

    @property
    def settled(self) -> np.ndarray:
        """True for runs that settled: (B,) bool."""
        return self.steps >= 0

    @property
    def ranges(self) -> Ranges:
        """Ranges of all words in the runs that settled."""
        return self.walks.ranges(np.flatnonzero(self.settled))


def learnt(network: Network, vector: ReferenceVector, ranges: InputRanges) -> Sample:
    """Simulate the nominal inputs, the corners of the ranges, and inputs between them.

    The step of the test vector is halved as long as more runs settle with shorter steps.
    """
    loaded: dict[str, np.ndarray] = {}
    if ranges:
        values = drawn_values(ranges, LEARNT, LEARNT_SEED).T
        if len(ranges) <= MOST_CORNERS:
            values = np.column_stack([np.transpose(list(product(*ranges.values()))), values])
        loaded = _loaded(network, ranges, values)
        loaded = {
            name: np.column_stack([network.input_values[name], values])
            for name, values in loaded.items()
        }
    best = _walked(network, vector, loaded, vector.step)
    for halving in range(1, HALVINGS + 1):
        if best.settled.all():
            break
        found = _walked(network, vector, loaded, vector.step / 2**halving)
        if found.settled.sum() <= best.settled.sum():
            break
        best = found
    return best


def held_out(network: Network, vector: ReferenceVector, ranges: InputRanges, step: float) -> Sample:
    """Simulate held-out inputs of the ranges, which influence no choice."""
    values = drawn_values(ranges, HELD_OUT, HELD_OUT_SEED).T
    return _walked(network, vector, _loaded(network, ranges, values), step)


def confirmed(
    network: Network,
    vector: ReferenceVector,
    sample: Sample,
    lanes: np.ndarray,
    answers: np.ndarray,
) -> Sample:
    """Repeat unsettled runs of ``lanes`` (B,), with half the step and for twice the time.

    Runs start at the initial state, and then at the integer answers (n, B) in network units if they
    do not settle from the initial state either. At a correct answer, float64 converges.
    """
    longer = 4 * _most_steps(vector, sample.step)
    for start in (None, answers):
        again = lanes & ~sample.settled
        if not again.any():
            break
        loaded = {name: values[:, again] for name, values in sample.loaded.items()}
        begun = None if start is None else start[:, again]
        found = _walked(network, vector, loaded, sample.step / 2, longer, begun)
        ends, steps = sample.ends.copy(), sample.steps.copy()
        ends[:, again], steps[again] = found.ends, found.steps
        sample = replace(sample, ends=ends, steps=steps)
    return sample


def _loaded(network: Network, ranges: InputRanges, values: np.ndarray) -> dict[str, np.ndarray]:
    """Return the values (N, B) of every input in network units."""
    ones = np.ones((network.stages, 1))
    return {
        name: ones * network.input_scale(name).network(row) for name, row in zip(ranges, values)
    }


def _steps_of(vector: ReferenceVector, step: float) -> int:
    """Return the number of steps of a given length in the duration of a vector's run."""
    return max(round(vector.steps * vector.step / step), 1)


def _most_steps(vector: ReferenceVector, step: float) -> int:
    """Return the number of steps after which a run counts as not settled."""
    count = _steps_of(vector, step)
    return max(2 * count, min(SLOWEST * count, LIMIT))


def _walked(
    network: Network,
    vector: ReferenceVector,
    loaded: Mapping[str, np.ndarray],
    step: float,
    most: int = 0,
    start: np.ndarray | None = None,
) -> Sample:
    """Simulate until every lane has converged, diverged, or reached the step limit."""
    program = program_of(network, step)
    walks = Walks(program, loaded)
    if start is not None:
        walks.words[program.states] = start
    every = max(_steps_of(vector, step) // CHECKS, 1)
    limit = most or _most_steps(vector, step)
    steps = np.full(walks.words.shape[1], -1)
    moving = np.arange(len(steps))
    for taken in range(every, limit + 1, every):
        walks.run(every, moving)
        residual = _residuals(network, walks, moving)
        steps[moving[residual < vector.tolerance]] = taken
        moving = moving[(residual >= vector.tolerance) & (residual < LOST)]
        if not len(moving):
            break
    return Sample(program, step, loaded, walks, steps, walks.words[program.states])


def _residuals(network: Network, walks: Walks, lanes: np.ndarray) -> np.ndarray:
    """Compute relative residuals of lanes, see `ann_dc.evaluation.rules.residuals`."""
    rows = RoleRows.of(evaluator(network).tape.roles)
    drives, states = np.zeros((2, *network.live.shape, len(lanes)))
    rows_of, stages = network.places.T
    drives[rows_of, stages] = walks.words[walks.program.drives][:, lanes]
    states[rows_of, stages] = walks.words[walks.program.states][:, lanes]
    with np.errstate(all="ignore"):
        return residuals(np, rows, drives, states).max(0)
