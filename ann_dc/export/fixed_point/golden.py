r"""A network in fixed point: the word width that a wanted accuracy takes, and the golden model.

What a width reaches is not predicted but measured: the integers walk until the network rests, and
their controls are compared with those of the reference vector,

.. math:: e = \max |u - u_{ref}| / \max |u_{ref}| ,

in the user's units. Where they rest, words go on by some last bits; the settle test allows
`QUIET` times as much.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, TypeAlias

import numpy as np

from ann_dc.errors import ExportError
from ann_dc.export.fixed_point.arithmetic.formats import quantised
from ann_dc.export.fixed_point.arithmetic.machine import Integers, Machine
from ann_dc.export.fixed_point.arithmetic.program import Program
from ann_dc.export.fixed_point.arithmetic.walk import Ranges, walked
from ann_dc.export.fixed_point.arithmetic.writing import program_of
from ann_dc.export.reference.vector import EARLY, ReferenceVector
from ann_dc.hints.checked import checked
from ann_dc.hints.values import PositiveFinite, Range
from ann_dc.network.network import Network
from ann_dc.scale import Scale

FEWEST, MOST = 4, 32
"""Bits of a word."""
WIDTHS = (8, 12, 16, 20, 24, 28, 32)
"""Those that are tried where none is given."""
QUIET = (4, 2, 1)
"""Thresholds of the settle test over what words still move at rest; the first that is near enough
counts."""
LONGER = 2
"""Steps of the integers over those of the reference vector, until they rest."""
PERIODS = 16
"""Of the settle test, in the steps of the reference vector."""
SHORTEST, LONGEST = 8, 1024
"""Steps of a period."""
WATCHED = 4
"""Periods for which words at rest are watched."""
CONTROLS = "u"
"""The population of the controls."""

Bits: TypeAlias = Annotated[int, Range(words=f"0 or {FEWEST} to {MOST} bits", low=0, high=MOST)]


@dataclass(frozen=True, kw_only=True, eq=False)
class Port:
    """Words that the world outside reads or writes.

    Attributes
    ----------
    name : str
        Of an input, or of a control at its stage.
    words : (k,) array of int
        Of an input one a stage, of a control one.
    scale : Scale
        How the number in a word, with its fraction bits, stands for a value of the user's.
    """

    name: str
    words: np.ndarray
    scale: Scale


@dataclass(frozen=True, kw_only=True, eq=False)
class FixedPoint:
    """A network in integers, with what its golden model does.

    Attributes
    ----------
    title : str
    wiring, content, vector : str
        Hashes of the network, and of its reference vector as JSON.
    step : float
        h, in units of network time.
    machine : Machine
    fraction : (W,) array of int
        Fraction bits of every word.
    labels : tuple of str
        Of the neurons, in the order of the state vector.
    places : (n, 2) array of int
        Neuron and stage of each, in the arrays of a reference vector.
    inputs, controls : tuples of Port
    error : float
        Largest error of a control over the largest control: where it settles, and long after.
    vectors : mapping of int to (n,) array of int
        States after so many steps; the last is where it settles.
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
    error: float
    vectors: Mapping[int, np.ndarray]

    @property
    def bits(self) -> int:
        """Of a word."""
        return self.machine.bits

    @property
    def steps(self) -> int:
        """After which it is settled."""
        return max(self.vectors)

    def states_after(self, steps: int) -> np.ndarray:
        """What the golden model holds after so many steps: (n,) integers."""
        model = Integers(self.machine)
        model.run(steps)
        return model.states

    def control_error(self, states: np.ndarray, vector: ReferenceVector) -> float:
        """Largest error of a control at integer states (n,), over the largest of a vector's end."""
        neurons = self.machine.neurons[:, 0]
        at = {word: place for place, word in enumerate(neurons.tolist())}
        read = [at[int(port.words[0])] for port in self.controls]
        factor, offset = np.array([port.scale for port in self.controls]).reshape(-1, 2).T
        bits = self.fraction[neurons[read]] + self.machine.guard
        with np.errstate(all="ignore"):
            found = offset + factor * np.ldexp(states[read].astype(float), -bits)
            wanted = offset + factor * vector.end[tuple(self.places[read].T)]
            largest = np.abs(wanted).max(initial=0.0)
            return float(np.abs(found - wanted).max(initial=0.0) / (largest or 1.0))


@checked
def fixed_point(
    network: Network, vector: ReferenceVector, *, bits: Bits = 0, accuracy: PositiveFinite = 1e-3
) -> FixedPoint:
    """A network in integers whose words have as many bits as a wanted accuracy takes.

    Parameters
    ----------
    network : Network
    vector : ReferenceVector
        Of the network; the step and the controls are its.
    bits : int
        Of a word, 4 to 32; 0 is the fewest of `WIDTHS` that are accurate enough.
    accuracy : float
        Largest error of a control over the largest control.

    Returns
    -------
    FixedPoint

    Raises
    ------
    ExportError
        If the vector is no walk that settles, a node does not fit into the words, or they are too
        short for the accuracy; the message says what they reach, and which ones would do.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> found = fixed_point(network, reference_vector(network), bits=16)
    >>> found.error < 1e-3, found.states_after(found.steps).tolist() == (
    ...     found.vectors[found.steps].tolist()
    ... )
    (True, True)
    """
    if 0 < bits < FEWEST:
        raise ExportError(f"bits: expected {FEWEST} to {MOST}, or 0 for a choice, got {bits}")
    if not vector.settles:
        raise ExportError(
            "vector: this walk does not settle, so that nothing says what its integers should come "
            "to; design the network for its inputs first"
        )
    real = program_of(network, vector.step)
    trial = _Trial(network, vector, real, walked(real, max(vector.steps, 1)), accuracy)
    return trial.of_width(bits) if bits else trial.fewest()


@dataclass(frozen=True, eq=False)
class _Trial:
    """What words of several widths reach."""

    network: Network
    vector: ReferenceVector
    program: Program
    ranges: Ranges
    accuracy: float

    def fewest(self) -> FixedPoint:
        """The shortest words that are accurate enough."""
        found = []
        for bits in WIDTHS:
            found.append(self.carried(bits))
            if isinstance(found[-1], FixedPoint) and found[-1].error <= self.accuracy:
                return found[-1]
        if isinstance(found[-1], ExportError):
            raise found[-1]
        best = min((f for f in found if isinstance(f, FixedPoint)), key=lambda f: f.error)
        raise ExportError(
            f"accuracy: no word of up to {MOST} bits brings the controls within {self.accuracy:g} "
            f"of the largest; {best.bits} bits bring them within {best.error:.1e}"
        )

    def of_width(self, bits: int) -> FixedPoint:
        """Words of a width, if they are accurate enough."""
        found = self.carried(bits)
        if isinstance(found, FixedPoint) and found.error <= self.accuracy:
            return found
        wider = (self.carried(more) for more in WIDTHS if more > bits)
        enough = (f for f in wider if isinstance(f, FixedPoint) and f.error <= self.accuracy)
        first = next(enough, None)
        advice = "no width up to 32 is accurate enough"
        if first is not None:
            advice = f"take bits={first.bits} ({first.error:.1e})"
        if isinstance(found, ExportError):
            raise ExportError(f"{found}; {advice}")
        raise ExportError(
            f"bits: words of {bits} bits bring the controls within {found.error:.1e} of the "
            f"largest, wanted is {self.accuracy:g}: {advice}, or allow as much by accuracy="
        )

    def carried(self, bits: int) -> FixedPoint | ExportError:
        """The network in words of a width, or why they cannot carry it."""
        try:
            machine, fraction = quantised(self.program, self.ranges, bits)
        except ExportError as error:
            return error
        machine = machine._replace(period=self.period)
        model = Integers(machine)
        model.run(self.longest)
        model.run(WATCHED * self.period)
        rested = self.record(machine, fraction)
        rested = replace(rested, error=rested.control_error(model.states, self.vector))
        drift = self.of_rows(model.drift)
        found = rested
        for factor in QUIET:
            found = self.settled(rested, np.minimum(factor * drift + 1, 2**bits - 1))
            if found.error <= self.accuracy:
                break
        return found

    def settled(self, rested: FixedPoint, thresholds: np.ndarray) -> FixedPoint:
        """A network with thresholds (n,), and where it settles by them."""
        neurons = np.column_stack([rested.machine.neurons[:, :4], thresholds])
        found = replace(rested, machine=rested.machine._replace(neurons=neurons))
        model = Integers(found.machine)
        steps = model.run(self.longest + WATCHED * self.period, settle=True)
        counts = sorted({*(count for count in EARLY if count < steps), steps})
        return replace(
            found,
            error=max(rested.error, found.control_error(model.states, self.vector)),
            vectors={count: found.states_after(count) for count in counts},
        )

    @property
    def longest(self) -> int:
        """Steps after which the integers rest."""
        return LONGER * self.vector.steps + self.period

    @property
    def period(self) -> int:
        """Steps from one mark to the next: a power of two."""
        steps = max(self.vector.steps // PERIODS, SHORTEST)
        return min(1 << (steps.bit_length() - 1), LONGEST)

    def of_rows(self, drift: np.ndarray) -> np.ndarray:
        """The largest drift (n,) of a neuron at all stages."""
        rows = self.network.places[:, 0]
        largest = np.zeros(len(self.network.cell.neurons), np.int64)
        np.maximum.at(largest, rows, drift)
        return largest[rows]

    def record(self, machine: Machine, fraction: np.ndarray) -> FixedPoint:
        """The record of a machine, before it has walked."""
        network, states = self.network, self.program.states
        read = np.flatnonzero(network.of_population(CONTROLS))
        read = read if len(read) else np.arange(network.size)
        scales = [neuron.scale for neuron in network.cell.neurons]
        return FixedPoint(
            title=network.title,
            wiring=self.vector.wiring,
            content=self.vector.content,
            vector=hashlib.sha256(self.vector.as_json()).hexdigest(),
            step=self.vector.step,
            machine=machine,
            fraction=fraction,
            labels=tuple(network.label(i) for i in range(network.size)),
            places=network.places,
            inputs=tuple(
                Port(name=name, words=words, scale=network.input_scale(name))
                for name, words in self.program.inputs.items()
            ),
            controls=tuple(
                Port(
                    name=network.label(int(i)),
                    words=states[i : i + 1],
                    scale=scales[network.places[i, 0]],
                )
                for i in read
            ),
            error=np.inf,
            vectors={},
        )
