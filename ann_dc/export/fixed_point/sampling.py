"""Samples of inputs for a network in integers, and its floating-point walks with each input.

Word ranges are read from the walks of one sample: the network's own inputs, the corners of the
ranges, and a Sobol sequence. The accuracy of the integers is measured on another one.
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
"""Inputs that words are chosen by, corners aside, and inputs that they are measured on."""
LEARNT_SEED, HELD_OUT_SEED = 1, 2
MOST_CORNERS = 5
"""Inputs with ranges up to which all corners are walked from."""
HALVINGS = 3
"""How often the step is halved where more inputs settle with shorter steps."""
SLOWEST = 20
"""Steps of a walk over those of the reference vector, before it counts as not settled."""
LOOKS = 8
"""Looks at the residual in the steps of the reference vector."""


def covered(network: Network, over: str) -> dict[str, tuple[float, float]]:
    """Return the ranges of inputs that words are chosen for.

    Parameters
    ----------
    network : Network
        Its ranges are those that it was designed for.
    over : str
        Other ranges, ``q_d.x=3:7,q_d.y=3:7``; empty for the network's.

    Raises
    ------
    ExportError
        If a range is empty or not finite.
    UnknownNameError
        If the network has no such input.
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
    """Return a range with the network's own value for an end that is open."""
    own = network.input_scale(name).user(network.input_values[name])
    low, high = ends
    return (
        float(low if np.isfinite(low) else min(own.min(), high)),
        float(high if np.isfinite(high) else max(own.max(), low)),
    )


@dataclass(frozen=True, eq=False)
class Sample:
    """Walks of a network from its start with some inputs, one a lane.

    Attributes
    ----------
    program : Program
    step : float
        h, in units of network time.
    loaded : mapping of str to (N, B) array
        Values of the inputs that have ranges, in network units.
    walks : Walks
    steps : (B,) array of int
        Steps until the walk was seen at rest; -1 where it did not settle.
    ends : (n, B) array
        States at the end, in network units.
    """

    program: Program
    step: float
    loaded: Mapping[str, np.ndarray]
    walks: Walks
    steps: np.ndarray
    ends: np.ndarray

    @property
    def settled(self) -> np.ndarray:
        """True for walks that settled: (B,) bool."""
        return self.steps >= 0

    @property
    def ranges(self) -> Ranges:
        """Ranges of all words on the walks that settled."""
        return self.walks.ranges(np.flatnonzero(self.settled))


def learnt(network: Network, vector: ReferenceVector, ranges: InputRanges) -> Sample:
    """Walk with the network's own inputs, the corners of the ranges and inputs between them.

    The step is that of the reference vector, or half of it, or less, if more walks settle then.

    Parameters
    ----------
    network : Network
    vector : ReferenceVector
        Of the network; it settles.
    ranges : mapping of str to (float, float)
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
    """Walk with inputs of the ranges that no choice has seen.

    Parameters
    ----------
    network : Network
    vector : ReferenceVector
    ranges : mapping of str to (float, float)
        One at least.
    step : float
    """
    values = drawn_values(ranges, HELD_OUT, HELD_OUT_SEED).T
    return _walked(network, vector, _loaded(network, ranges, values), step)


def confirmed(
    network: Network,
    vector: ReferenceVector,
    sample: Sample,
    lanes: np.ndarray,
    answers: np.ndarray,
) -> Sample:
    """Walk again where walks did not settle, with half the step and for twice as long.

    Walks begin at the start, and at the answers of the integers if they do not settle from there
    either: at an answer that is right, float64 comes to rest.

    Parameters
    ----------
    network : Network
    vector : ReferenceVector
    sample : Sample
    lanes : (B,) array of bool
        Lanes that are walked again, if they did not settle.
    answers : (n, B) array
        States at which the integers settled, in network units.

    Returns
    -------
    Sample
        Ends and steps are those of the last walks.
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
    """Return values of every input, in network units: (N, B) each."""
    ones = np.ones((network.stages, 1))
    return {
        name: ones * network.input_scale(name).network(row) for name, row in zip(ranges, values)
    }


def _steps_of(vector: ReferenceVector, step: float) -> int:
    """Return the steps of a length that the walk of a vector takes."""
    return max(round(vector.steps * vector.step / step), 1)


def _most_steps(vector: ReferenceVector, step: float) -> int:
    """Return the steps after which a walk counts as not settled."""
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
    """Walk until every lane rests, is lost, or has taken too long."""
    program = program_of(network, step)
    walks = Walks(program, loaded)
    if start is not None:
        walks.words[program.states] = start
    every = max(_steps_of(vector, step) // LOOKS, 1)
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
    """Compute relative residuals of lanes, those of `ann_dc.evaluation.rules.residuals`."""
    rows = RoleRows.of(evaluator(network).tape.roles)
    drives, states = np.zeros((2, *network.live.shape, len(lanes)))
    rows_of, stages = network.places.T
    drives[rows_of, stages] = walks.words[walks.program.drives][:, lanes]
    states[rows_of, stages] = walks.words[walks.program.states][:, lanes]
    with np.errstate(all="ignore"):
        return residuals(np, rows, drives, states).max(0)
