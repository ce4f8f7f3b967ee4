r"""Fixed-point network: golden model, externally accessible words, and accuracy.

Errors are control errors relative to the largest control, in the user's units,

.. math:: e = \max |u - u_{ref}| / \max |u_{ref}| ,

and to 1 % of the largest control on the way if all controls end below that.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ann_dc.errors import ExportError
from ann_dc.evaluation.rules import RESTING
from ann_dc.export.fixed_point.machine import WORD, Integers, Machine, Settled
from ann_dc.export.fixed_point.sampling import Sample
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.scale import Scale

FEWEST, MOST = 4, 32
"""Minimum and maximum number of bits of a number."""
WRONG = 10.0
"""Error, relative to the wanted accuracy, from which a settled answer counts as wrong: 1 % by
default.
"""
LEAST = 0.05
"""Least reference control of an error, relative to the largest control of all inputs: a number with
few bits has no relative accuracy near zero.
"""
MISSING = 0.02
"""Permitted fraction of inputs that settle correctly only in float64."""
PREFIX = "ann_dc"
"""Prefix of all file, C and module names."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Port:
    """Words of an input, one per stage, or of a control at its stage.

    The scale converts the number in a word, with its fraction bits, to the user's units.
    """

    name: str
    words: np.ndarray
    scale: Scale


class Measured(NamedTuple):
    """Counts of held-out inputs in the ranges, each settled by the golden model."""

    inputs: int = 0
    """Tested inputs; zero if no input has a range."""
    floats: int = 0
    """Inputs that settle in float64."""
    settled: int = 0
    right: int = 0
    """Settled inputs whose controls match float64 within `WRONG` times the accuracy."""
    wrong: int = 0
    """Settled inputs whose controls deviate further from float64."""
    unconfirmed: int = 0
    """Settled inputs that float64 does not settle, even with half the step for twice the time, from
    the start or from the integer answer.
    """
    saturated: int = 0
    """Inputs with a clipped number."""

    @property
    def failed(self) -> str:
        """Conditions of an acceptable width that the counts violate; empty if none."""
        conditions = (
            (self.wrong > 0, "none wrong"),
            (self.unconfirmed > 0, "none unconfirmed"),
            (
                self.floats - self.right > MISSING * self.inputs,
                f"as many correct as in float64 less {MISSING:.0%}",
            ),
        )
        return ", ".join(condition for fails, condition in conditions if fails)

    def __str__(self) -> str:
        if not self.inputs:
            return "no held-out inputs"
        return (
            f"{self.right} of {self.inputs} inputs settle at the optimum "
            f"({self.right / self.inputs:.1%}; float64 {self.floats}), {self.wrong} wrong, "
            f"{self.unconfirmed} unconfirmed, {self.saturated} saturated"
        )


def control_errors(
    found: np.ndarray, wanted: np.ndarray, settled: np.ndarray | None = None, least: float = 0.0
) -> np.ndarray:
    """Return the largest error (B,) of the controls of every lane.

    Errors are relative to the largest wanted control of the lane, but at least to `LEAST` times the
    largest control of all lanes, and to ``least``. Controls are (B, k) arrays in the user's units.
    Lanes with wanted controls are those in ``settled``, by default the finite lanes.
    """
    with np.errstate(all="ignore"):
        largest = np.abs(wanted).max(1, initial=0.0)
        off = np.abs(found - wanted).max(1, initial=0.0)
        known = np.isfinite(largest) if settled is None else settled
        whole = largest[known].max(initial=0.0)
        least = max(LEAST * whole, least)
        return off / (np.maximum(largest, least) if least > 0 else 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class FixedPoint:
    """Fixed-point network with the results of its golden model.

    Attributes
    ----------
    wiring, content, vector : str
        Hashes of the network, and of its test vector as JSON.
    step : float
        Step h in network time: that of the test vector divided by a power of two.
    fraction : (W,) array of int
        Fraction bits of the number of ``bits`` bits in every word.
    places : (n, 2) array of int
        Neuron and stage of each state, in the arrays of a test vector.
    ranges : mapping of str to (float, float)
        Ranges of the inputs for which words were chosen, in the user's units.
    accuracy, error : float
        Wanted error, and largest error of a control with the network's nominal inputs, at settling
        and long afterwards.
    reach : float
        Largest magnitude of a control on the sampled runs, counted from its scale's offset, in the
        user's units.
    limit : int
        Number of steps after which an unsettled run is not expected to settle.
    vectors : mapping of int to (n,) array of int
        Words of the neurons by number of steps; the last entry is the settled state.
    """

    title: str
    wiring: str
    content: str
    vector: str
    step: float
    machine: Machine
    fraction: np.ndarray
    labels: tuple[str, ...]
    places: np.ndarray
    inputs: tuple[Port, ...]
    controls: tuple[Port, ...]
    ranges: Mapping[str, tuple[float, float]]
    measured: Measured
    accuracy: float
    error: float
    reach: float
    limit: int
    vectors: Mapping[int, np.ndarray]
    prefix: str = PREFIX

    @property
    def bits(self) -> int:
        """Bits of an input and of a control."""
        return self.machine.bits

    @property
    def steps(self) -> int:
        """Number of steps to settling."""
        return max(self.vectors)

    @property
    def covers(self) -> str:
        """Description of the inputs for which words were chosen."""
        if not self.ranges:
            return "the inputs of the network only"
        ends = (f"{name} from {low:g} to {high:g}" for name, (low, high) in self.ranges.items())
        return ", ".join(ends)

    @property
    def worth(self) -> str:
        """Description of these inputs and of the fraction of correct held-out inputs."""
        if not self.ranges:
            return f"words chosen for {self.covers}; others may saturate (reported by the status)"
        return f"words chosen for {self.covers}; held out, {self.measured}"

    def named(self, prefix: str) -> FixedPoint:
        """Return the network with a prefix of names; raises `ExportError` if it is none in C."""
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,31}", prefix):
            raise ExportError(
                "prefix: expected a letter, then up to 31 letters, digits or '_', "
                f"got {prefix!r:.50}"
            )
        return replace(self, prefix=prefix)

    def states_after(self, steps: int) -> np.ndarray:
        """Return the words (n,) of the neurons after a number of golden-model steps."""
        model = Integers(self.machine)
        model.run(steps)
        return model.states

    def model(self, loaded: Mapping[str, np.ndarray]) -> Integers:
        """Return the golden model at its start, with inputs (N, B) in network units."""
        lanes = next((values.shape[1] for values in loaded.values()), 1)
        model = Integers(self.machine, lanes)
        for port in self.inputs:
            if port.name in loaded:
                numbers = np.rint(np.ldexp(loaded[port.name], self.fraction[port.words][:, None]))
                model.load(port.words, numbers.astype(np.int64))
        return model

    def held(self, port: Port) -> tuple[float, float]:
        """Return the lowest and highest value of an input, in the user's units."""
        top = 2.0 ** (self.bits - 1)
        numbers = np.ldexp([-top, top - 1], -self.fraction[port.words[0]])
        low, high = np.sort(port.scale.user(numbers)).tolist()
        return low, high

    def values(self, states: np.ndarray) -> np.ndarray:
        """Return integer states (n, B) in network units."""
        bits = self.fraction[self.machine.neurons[:, WORD]] + self.machine.guard
        return np.ldexp(states.astype(float), -bits[:, None])

    def errors(
        self, states: np.ndarray, ends: np.ndarray, settled: np.ndarray | None = None
    ) -> np.ndarray:
        """Return `control_errors` of integer states (n, B) against ends in network units."""
        words = self.machine.neurons[:, WORD].tolist()
        at = {word: place for place, word in enumerate(words)}
        read = [at[int(port.words[0])] for port in self.controls]
        factor, offset = np.array([port.scale for port in self.controls]).reshape(-1, 2).T
        with np.errstate(all="ignore"):
            found = offset + factor * self.values(states)[read].T
            wanted = offset + factor * ends[read].T
            return control_errors(found, wanted, settled, RESTING * self.reach)

    def control_error(self, states: np.ndarray, vector: ReferenceVector) -> float:
        """Return the control error of integer states (n,) against a vector's end."""
        ends = vector.end[tuple(self.places.T)]
        return float(self.errors(states[:, None], ends[:, None])[0])

    def judged(self, run: Settled, sample: Sample, allowed: float) -> Measured:
        """Count the results of a run; the largest error of a correct answer is ``allowed``."""
        right = self.errors(run.states, sample.ends, sample.settled) <= allowed
        both = run.settled & sample.settled
        return Measured(
            inputs=len(right),
            floats=int(sample.settled.sum()),
            settled=int(run.settled.sum()),
            right=int((both & right).sum()),
            wrong=int((both & ~right).sum()),
            unconfirmed=int((run.settled & ~sample.settled).sum()),
            saturated=int(run.saturated.sum()),
        )
