"""Choice of the word width for a wanted accuracy, measured on the golden model.

The jitter of words and net inputs at the equilibrium sets the thresholds of the settling test, as
loose as the controls at settling allow. A width is acceptable if the nominal inputs settle with the
wanted accuracy, no input of the sample or of a held-out sample settles at wrong or unconfirmed
controls, and almost as many inputs settle as in float64.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, TypeAlias

import numpy as np

from ann_dc.errors import ExportError
from ann_dc.export.fixed_point.formats import quantised
from ann_dc.export.fixed_point.golden import (
    FEWEST,
    MOST,
    WRONG,
    FixedPoint,
    Measured,
    Port,
)
from ann_dc.export.fixed_point.machine import SMALL, STILL, Machine, Settled, first_cut_off
from ann_dc.export.fixed_point.sampling import Sample, confirmed, covered, held_out, learnt
from ann_dc.export.reference.vector import EARLY, ReferenceVector
from ann_dc.lowering.program import FUNCTION, UPDATE
from ann_dc.network.network import Network
from ann_dc.validation import PositiveFinite, Range, checked

WIDTHS = (8, 12, 16, 20, 24, 28, 32)
"""Widths that are tested if none is given."""
QUIET = (2, 1)
"""Thresholds of the settling test relative to the jitter at the equilibrium, in order of trial; the
first sufficiently accurate value is used.
"""
SAFE = 0.25
"""Largest settling error of an input of the sample, relative to the error of a wrong answer."""
FINEST = 20
"""Thresholds are at least one last bit of a number with this many bits, or of the words."""
LONGER = 2
"""Integer steps until convergence, relative to the steps of the slowest run."""
PATIENCE = 4
"""Step limit relative to the settling steps of the slowest input of the sample."""
PERIODS = 8
"""Periods of the settling test within the steps of the slowest run."""
SHORTEST, LONGEST = 8, 1024
"""Shortest and longest period in steps."""
WATCHED = 4
"""Number of periods for which converged words are observed."""
ENDLESS = ("onnx", "torch_program", "verilog_a", "pack", "analog_computer")
"""Formats of networks that do not settle: steps in floating point, and circuits."""
CONTROLS = "u"
"""Population of the controls."""

Bits: TypeAlias = Annotated[int, Range(words=f"0 or {FEWEST} to {MOST} bits", low=0, high=MOST)]


@checked
def fixed_point(
    network: Network,
    vector: ReferenceVector,
    *,
    bits: Bits = 0,
    accuracy: PositiveFinite = 1e-3,
    over: str = "",
) -> FixedPoint:
    """Choose the integers of a network, with the bits that an accuracy needs.

    Parameters
    ----------
    network : Network
        Network to convert.
    vector : ReferenceVector
        Test vector of the network, which provides the reference controls.
    bits : int
        Bits of a number, 4 to 32. The default 0 selects the smallest sufficient width of `WIDTHS`.
    accuracy : float
        Largest error of a control relative to the largest control, with the nominal inputs of the
        network. Default 1e-3. Ten times this error is a wrong answer; a sample of the ranges must
        not have any.
    over : str
        Ranges of inputs for which words are chosen, ``q_d.x=3:7,q_d.y=3:7``. By default these are
        the ranges of the design, or only the nominal inputs if the design has no ranges.

    Returns
    -------
    FixedPoint
        Integers of the network, with measured accuracy.

    Raises
    ------
    ExportError
        If the run of the vector does not settle, or the preconditioner couples neurons that have
        saturation limits. Also raised if a node does not fit into the words or the words are too
        short for the accuracy. The message gives the accuracy reached and a sufficient width.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> found = fixed_point(network, reference_vector(network), bits=16, over="q_d.x=0.5:2")
    >>> found.error < 1e-3, found.measured.right, found.measured.wrong
    (True, 256, 0)
    """
    if 0 < bits < FEWEST:
        raise ExportError(f"bits: expected {FEWEST} to {MOST}, or 0 for a choice, got {bits}")
    ranges = covered(network, over)
    sample = learnt(network, vector, ranges) if vector.settles else None
    if sample is None or not sample.settled[0]:
        raise _unsettled(vector)
    trial = _Trial(network, vector, ranges, sample, accuracy)
    return trial.of_width(bits) if bits else trial.fewest()


def _unsettled(vector: ReferenceVector) -> ExportError:
    """Return the error for a network without a settled state."""
    if vector.duration is None:
        return ExportError(
            "network: expected a network that settles within the steps of its test vector; "
            "words are chosen for the accuracy of the settled state. Design the network for "
            "its inputs, or use weights or onnx"
        )
    return ExportError(
        f"duration: expected a network that settles, got a run of {vector.duration:g} that does "
        "not end at an equilibrium; words are chosen for the accuracy of the settled state. "
        f"Use {', '.join(ENDLESS)}"
    )


@dataclass(frozen=True, eq=False)
class _Trial:
    """Trials of several word widths for one network."""

    network: Network
    vector: ReferenceVector
    ranges: dict[str, tuple[float, float]]
    sample: Sample
    accuracy: float

    @cached_property
    def unseen(self) -> Sample:
        """Trajectories for held-out inputs."""
        return held_out(self.network, self.vector, self.ranges, self.sample.step)

    def good(self, found: FixedPoint | ExportError) -> bool:
        """Return True if words are accurate enough and enough inputs settle correctly."""
        if isinstance(found, ExportError):
            return False
        return found.error <= self.accuracy and not found.measured.failed

    def fewest(self) -> FixedPoint:
        """Return the shortest acceptable words."""
        found = []
        for bits in WIDTHS:
            found.append(self.carried(bits))
            if self.good(found[-1]):
                return found[-1]
        if isinstance(found[-1], ExportError):
            raise found[-1]
        best = min((f for f in found if isinstance(f, FixedPoint)), key=lambda f: f.error)
        field = "accuracy" if best.error > self.accuracy else "over"
        raise ExportError(
            f"{field}: no word of up to {MOST} bits is sufficient: {best.bits} bits "
            f"{self.reached(best)}; {self.remedy(best)}"
        )

    def of_width(self, bits: int) -> FixedPoint:
        """Return words of the given width, if they are acceptable."""
        found = self.carried(bits)
        if isinstance(found, FixedPoint) and self.good(found):
            return found
        wider = (self.carried(more) for more in WIDTHS if more > bits)
        first = next((f for f in wider if isinstance(f, FixedPoint) and self.good(f)), None)
        advice = f"no width up to {MOST} is sufficient"
        if first is not None:
            advice = f"use bits={first.bits} ({first.error:.1e})"
        if isinstance(found, ExportError):
            raise ExportError(f"{found}; {advice}")
        raise ExportError(
            f"bits: words of {bits} bits {self.reached(found)}: {advice}; or {self.remedy(found)}"
        )

    def reached(self, found: FixedPoint) -> str:
        """Return the accuracy of words as a clause, with the unacceptable counts."""
        text = f"reach a control error of {found.error:.1e} of the largest"
        text += f" (wanted {self.accuracy:g})"
        if found.error == np.inf:
            text = "do not settle with the inputs of the network"
        if self.ranges and found.measured.failed:
            link = ", and" if found.error > self.accuracy else ", but"
            text += f"{link} in the ranges {found.measured} (expected {found.measured.failed})"
        return text

    def remedy(self, found: FixedPoint) -> str:
        """Return a remedy that makes words of the same width acceptable."""
        if self.ranges and found.measured.failed:
            return "narrow the ranges of over=, or design the network for them first (--range)"
        if found.error == np.inf:
            return "design the network for its inputs again"
        return "raise accuracy="

    def carried(self, bits: int) -> FixedPoint | ExportError:
        """Return the network in words of a width, or the reason that they are too short."""
        try:
            machine, fraction = quantised(self.sample.program, self.sample.ranges, bits)
        except ExportError as error:
            return error
        found = self.record(machine._replace(period=self.period), fraction)
        model = found.model(self.sample.loaded)
        model.run(self.longest)
        model.run(WATCHED * self.period)
        if model.saturated[0]:
            return ExportError(
                f"bits: words of {bits} bits cannot represent the states of the reference "
                f"vector: {self.cut_off(found)}; use an initial guess closer to the solution, "
                "or design the network again"
            )
        found = replace(found, error=found.control_error(model.states, self.vector))
        whole = self.sample.settled & ~model.saturated
        jitter = [self.of_rows(part[:, whole].max(1)) for part in (model.drift, model.drive)]
        tried = found
        for factor in QUIET:
            tried = self.settled(found, factor, *jitter)
            if self.good(tried):
                break
        if not self.good(tried):
            return tried
        measured = Measured()
        if self.ranges:
            _, measured = self.judged(tried, self.unseen, tried.limit, WRONG * self.accuracy)
        return replace(tried, measured=measured)

    def cut_off(self, found: FixedPoint) -> str:
        """Return the first number that does not fit its word, with the range of the word."""
        machine, program = found.machine, self.sample.program
        operation = first_cut_off(machine, self.longest + WATCHED * self.period)
        if operation is None:
            return "a number is truncated"
        kind, target, table, argument = operation[:4]
        word, ends = target, np.array([-1, 1]) << (machine.bits - 1)
        if kind == FUNCTION:
            word, ends = argument, machine.tables[table, :2]
        elif kind == UPDATE:
            word = program.states[target]
        low, high = np.ldexp(ends.astype(float), -found.fraction[word])
        name = program.names[program.rows[word]]
        return f"{name} leaves {low:g} .. {high:g} network units"

    def judged(
        self, found: FixedPoint, sample: Sample, limit: int, allowed: float
    ) -> tuple[Settled, Measured]:
        """Settle the inputs of a sample in integers, and count correct answers."""
        run = found.model(sample.loaded).settle(limit)
        answers = found.values(run.states)
        sample = confirmed(self.network, self.vector, sample, run.settled, answers)
        return run, found.judged(run, sample, allowed)

    def settled(
        self, found: FixedPoint, factor: int, drift: np.ndarray, drive: np.ndarray
    ) -> FixedPoint:
        """Return a network with thresholds (n,), and its settling results on the sample."""
        machine = found.machine
        least = factor << max(machine.guard, machine.wide - FINEST) >> 2
        neurons = machine.neurons.copy()
        for column, jitter in ((STILL, drift), (SMALL, drive)):
            allowed = np.maximum(factor * jitter, least) + 1
            neurons[:, column] = np.minimum(allowed, 2 ** (machine.wide - 1) - 1)
        found = replace(found, machine=machine._replace(neurons=neurons))
        limit, allowed = self.longest + WATCHED * self.period, SAFE * WRONG * self.accuracy
        run, measured = self.judged(found, self.sample, limit, allowed)
        error = found.control_error(run.states[:, 0], self.vector) if run.settled[0] else np.inf
        steps = int(run.steps[0])
        counts = sorted({*(count for count in EARLY if count < steps), steps})
        return replace(
            found,
            error=max(found.error, error),
            measured=measured,
            limit=PATIENCE * int(run.steps[run.settled].max(initial=steps)),
            vectors={count: found.states_after(count) for count in counts},
        )

    @property
    def slowest(self) -> int:
        """Steps of the slowest run of the sample."""
        return int(self.sample.steps.max())

    @property
    def longest(self) -> int:
        """Steps after which the integers have converged."""
        return LONGER * self.slowest + self.period

    @property
    def period(self) -> int:
        """Steps between marks: a power of two."""
        steps = max(self.slowest // PERIODS, SHORTEST)
        return min(1 << (steps.bit_length() - 1), LONGEST)

    def of_rows(self, jitter: np.ndarray) -> np.ndarray:
        """Return the largest jitter (n,) of a neuron over all stages."""
        rows = self.network.places[:, 0]
        largest = np.zeros(len(self.network.cell.neurons), np.int64)
        np.maximum.at(largest, rows, jitter)
        return largest[rows]

    def _reached(self, port: Port) -> float:
        """Return the largest magnitude of a control in network units on the sampled runs."""
        low, high = (ends[port.words] for ends in self.sample.ranges)
        return float(np.maximum(np.abs(low), np.abs(high)).max())

    def record(self, machine: Machine, fraction: np.ndarray) -> FixedPoint:
        """Return the record of a machine before its execution."""
        network, program = self.network, self.sample.program
        read = np.flatnonzero(network.of_population(CONTROLS))
        read = read if len(read) else np.arange(network.size)
        scales = [neuron.scale for neuron in network.cell.neurons]
        controls = tuple(
            Port(
                name=network.label(int(i)),
                words=program.states[i : i + 1],
                scale=scales[network.places[i, 0]],
            )
            for i in read
        )
        return FixedPoint(
            title=network.title,
            wiring=self.vector.wiring,
            content=self.vector.content,
            vector=hashlib.sha256(self.vector.as_json()).hexdigest(),
            step=self.sample.step,
            machine=machine,
            fraction=fraction,
            labels=tuple(network.label(i) for i in range(network.size)),
            places=network.places,
            inputs=tuple(
                Port(name=name, words=words, scale=network.input_scale(name))
                for name, words in program.inputs.items()
            ),
            controls=controls,
            ranges=self.ranges,
            measured=Measured(),
            accuracy=self.accuracy,
            error=np.inf,
            reach=max(abs(port.scale.factor) * self._reached(port) for port in controls),
            limit=0,
            vectors={},
        )
