r"""Test vector: the steps of a network from its start, for comparison by receivers.

The steps are forward Euler steps of one length h, clipped to the saturation limits:

.. math:: x_{k+1} = \mathrm{clip}(x_k + h\, M\, d(x_k)) .

Every export can take these steps and must reach the same states. The residual is that of all runs.
The iteration ends at the first state with a residual below the tolerance. A vector of a given
duration is that of a network that need not settle, such as an oscillator. Inputs that change over
time have their values at time zero.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from ann_dc.analysis.spectra import Spectrum, spectrum
from ann_dc.backends.ode import OdeBackend
from ann_dc.errors import FileFormatError
from ann_dc.evaluation.codegen.evaluator import FastEvaluator, fast_evaluator
from ann_dc.export.reference.contents import text_of
from ann_dc.network.network import Network
from ann_dc.validation import PositiveFinite, checked
from ann_dc.weights.hashes import content_hash, wiring_hash
from ann_dc.weights.manifest import Table, read_manifest

VECTOR = "reference_vector.json"
"""Name of the vector's file in every export."""
FORMAT = "ann_dc reference vector"
SCHEMA = 1
EARLY = (1, 50)
"""Numbers of steps after which the states are recorded."""
SHARE = 0.5
"""First step length relative to its stability limit."""
HALVINGS = 6
"""Maximum number of step halvings if the iteration does not settle."""
LIMIT = 20_000
"""Maximum number of steps."""
FINE = 0.02
"""Step length of a vector of a given duration, in fastest time constants."""
LOST = 1e100
"""Residual above which the iteration counts as diverged."""

Precision: TypeAlias = Literal["float64", "float32"]
"""Precision of an export's computations."""
TOLERANCES: dict[Precision, float] = {"float64": 1e-9, "float32": 1e-3}
"""Largest difference of two runs by precision, relative to the largest state or one."""
Walk: TypeAlias = Callable[[np.ndarray, int], np.ndarray]
"""Function that returns the states (P, N) after a number of steps from a start (P, N)."""
ROUNDING: dict[Precision, float] = {"float64": 1e-15, "float32": 1e-7}
"""Perturbation of the start, relative to its values or one."""
MARGIN = 1000.0
MOST = 0.5
"""Largest permitted difference, for any growth of rounding errors."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ReferenceVector:
    """Recorded iteration in network units, with arrays (P, N): neurons of the cell, stages.

    Attributes
    ----------
    wiring, content : str
        Hashes of the network.
    inputs : mapping of str to (N,) array
        Values of the input nodes.
    step : float
        Step length h in network time.
    tolerance : float
        Tolerance of the relative KKT residual.
    early : mapping of int to (P, N) array
        States by number of steps.
    steps : int
        Number of steps after which the residual was first below the tolerance; -1 if it never was.
    end, residual
        States and residual after these steps.
    duration : float or None
        Network time of the runs by which exports are scaled; None for runs until settled.
    """

    wiring: str
    content: str
    inputs: Mapping[str, np.ndarray]
    step: float
    tolerance: float
    start: np.ndarray
    early: Mapping[int, np.ndarray]
    steps: int
    end: np.ndarray
    residual: float
    duration: float | None = None

    @property
    def settles(self) -> bool:
        """True if the iteration settled."""
        return self.steps >= 0

    def as_json(self) -> bytes:
        """Return the vector as JSON; reading gives the identical float64 numbers."""
        table = {
            "format": FORMAT,
            "schema": SCHEMA,
            "rule": "x[k+1] = clip(x[k] + step * move(x[k])), arrays are (neurons, stages)",
            "wiring": self.wiring,
            "content": self.content,
            "step": self.step,
            "tolerance": self.tolerance,
            "inputs": {name: values.tolist() for name, values in self.inputs.items()},
            "start": self.start.tolist(),
            "early": {str(count): values.tolist() for count, values in self.early.items()},
            "steps": self.steps,
            "end": self.end.tolist(),
            "residual": self.residual,
            **({} if self.duration is None else {"duration": self.duration}),
        }
        return (json.dumps(table) + "\n").encode()

    @classmethod
    def from_json(cls, text: bytes) -> ReferenceVector:
        """Parse the output of `as_json`, or raise `FileFormatError`."""
        table = read_manifest(text_of({VECTOR: text}, VECTOR), FORMAT, SCHEMA, place=VECTOR)
        start = _numbers(table, "start", 2)
        early, inputs = table.inner("early"), table.inner("inputs")
        if early.given.keys() != set(map(str, EARLY)):
            counts = " and ".join(map(str, EARLY))
            raise FileFormatError(f"{early.place}: expected the states after {counts} steps alone")
        return cls(
            wiring=table.get("wiring", str),
            content=table.get("content", str),
            inputs={name: _numbers(inputs, name, 1, start.shape[1:]) for name in inputs.given},
            step=_positive(table, "step"),
            tolerance=_positive(table, "tolerance"),
            start=start,
            early={count: _numbers(early, str(count), 2, start.shape) for count in EARLY},
            steps=table.whole("steps", -1, LIMIT),
            end=_numbers(table, "end", 2, start.shape),
            residual=table.get("residual", float),
            duration=_positive(table, "duration") if "duration" in table.given else None,
        )

    def check(
        self, walk: Callable[[np.ndarray, int], np.ndarray], tolerance: float = 1e-9
    ) -> float:
        """Return the largest difference of the early states of another implementation.

        The function ``walk`` returns the states (P, N) after a number of steps of the vector's
        length, with its inputs. The tolerance is relative to the largest state or one. Raises
        `FileFormatError` if the difference exceeds it.
        """
        return max(
            check_states(walk(self.start, count), expected, tolerance)
            for count, expected in self.early.items()
        )


def check_states(found: np.ndarray, expected: np.ndarray, tolerance: float) -> float:
    """Return the largest difference of states (P, N), relative to the largest state or one.

    Raises `FileFormatError` if the difference exceeds the tolerance.
    """
    off = float(np.abs(found - expected).max() / max(1.0, np.abs(expected).max()))
    if not off <= tolerance:
        raise FileFormatError(
            f"{VECTOR}: the states differ by {off:.1e} of the largest, {tolerance:g} is "
            "allowed; the network differs from the exported one: export it again"
        )
    return off


@checked
def reference_vector(
    network: Network,
    tolerance: PositiveFinite = 1e-6,
    duration: PositiveFinite | None = None,
) -> ReferenceVector:
    """Compute the test vector of a network: its iteration from the start to settling.

    The step is half the stability limit, and is halved up to 6 times if the iteration does not
    settle. With a ``duration``, steps are short and not halved.

    Parameters
    ----------
    network : Network
        Network to iterate.
    tolerance : float
        Tolerance of the relative KKT residual. Default 1e-6.
    duration : float, optional
        Network time of the runs by which exports are scaled; by default they last until the network
        settles.

    Returns
    -------
    ReferenceVector
        Recorded iteration; `ReferenceVector.settles` is False if it did not settle.

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> vector = reference_vector(network)
    >>> vector.settles, vector.residual < 1e-6, sorted(vector.early)
    (True, True, [1, 50])
    >>> walker = EulerWalk(network, vector.step)
    >>> vector.check(lambda start, count: network.unpack(walker.after(network.pack(start), count)))
    0.0
    """
    if duration is not None:
        return _of_duration(network, tolerance, duration)
    walker = EulerWalk(network, SHARE * _step_limit(network))
    steps, end, residual = walker.settled(network.start_state, tolerance)
    for _ in range(HALVINGS):
        if steps >= 0:
            break
        walker = EulerWalk(network, walker.step / 2)
        steps, end, residual = walker.settled(network.start_state, tolerance)
    return walker.vector(tolerance, steps, end, residual)


def _of_duration(network: Network, tolerance: float, duration: float) -> ReferenceVector:
    """Return the vector of a network that need not settle, by steps short enough to follow it."""
    rate = fast_evaluator(network).fastest_rate(network.start_state)
    walker = EulerWalk(network, min(FINE / rate, duration / max(EARLY)))
    found = walker.settled(network.start_state, tolerance)
    return replace(walker.vector(tolerance, *found), duration=duration)


def _step_limit(network: Network) -> float:
    """Return the stability limit of the step at the start, or at the end of an unstable start."""
    limit = _limit_at(network, network.start_state)
    if limit > 0:
        return limit
    settled = OdeBackend(verify=False).run(network).trajectory.final
    return _limit_at(network, settled) or float(1 / network.layout.rates.max())


def _limit_at(network: Network, x: np.ndarray) -> float:
    """Return the stability limit of the free neurons; 0 for an unstable state or none free."""
    if not fast_evaluator(network).free(x).any():
        return 0.0
    values = spectrum(network, x).eigenvalues
    moving = values[values != 0]
    return Spectrum(eigenvalues=moving).largest_step if len(moving) else 0.0


class EulerWalk:
    """Forward Euler steps of one length in network time."""

    def __init__(self, network: Network, step: float) -> None:
        self.network, self.step = network, step
        self._evaluator: FastEvaluator = fast_evaluator(network)
        limits = np.array([(n.limiter.low, n.limiter.high) for n in network.cell.neurons])
        self._low, self._high = limits[network.places[:, 0]].T

    def after(self, x: np.ndarray, count: int) -> np.ndarray:
        """Return the state (n,) after a number of steps from another state."""
        with np.errstate(all="ignore"):
            for _ in range(count):
                moved = x + self.step * self._evaluator.rhs(x)
                x = np.clip(moved, self._low, self._high)
        return x

    def settled(self, x: np.ndarray, tolerance: float) -> tuple[int, np.ndarray, float]:
        """Return the number of steps to the tolerance (-1 if never), the state, the residual."""
        residual, count = max(self._evaluator.residuals(x)), 0
        while tolerance <= residual < LOST and count < LIMIT:
            x, count = self.after(x, 1), count + 1
            residual = max(self._evaluator.residuals(x))
        return (count if residual < tolerance else -1), x, float(residual)

    def vector(
        self, tolerance: float, steps: int, end: np.ndarray, residual: float
    ) -> ReferenceVector:
        """Return the test vector of the network by these steps, with its end (n,)."""
        network, start = self.network, self.network.start_state
        return ReferenceVector(
            wiring=wiring_hash(network),
            content=content_hash(network),
            inputs=dict(network.input_values),
            step=self.step,
            tolerance=tolerance,
            start=network.unpack(start),
            early={n: network.unpack(self.after(start, n)) for n in EARLY},
            steps=steps,
            end=network.unpack(end),
            residual=residual,
        )


def _positive(table: Table, key: str) -> float:
    value = table.get(key, float)
    if not 0 < value < np.inf:
        raise FileFormatError(f"{table.place}.{key}: expected a positive number, got {value!r}")
    return value


def _numbers(table: Table, key: str, rank: int, shape: tuple[int, ...] | None = None) -> np.ndarray:
    """Read a finite array of a rank, and of a shape if given."""
    try:
        values = np.array(table.get(key, list), float)
    except (TypeError, ValueError) as error:
        raise FileFormatError(f"{table.place}.{key}: expected numbers: {error}") from error
    if values.ndim != rank or (shape is not None and values.shape != shape):
        raise FileFormatError(f"{table.place}.{key}: its shape {values.shape} does not fit")
    if not np.isfinite(values).all():
        raise FileFormatError(f"{table.place}.{key}: a value is not finite")
    return values


def compare(vector: ReferenceVector, walk: Walk, precision: Precision = "float64") -> float:
    """Apply `ReferenceVector.check` with a tolerance for growing rounding errors.

    Runs with different summation orders amplify rounding if the flow is unstable at the start. The
    growth after the first steps is measured with a second run from a perturbed start: a difference
    may exceed the tolerance of the precision by a thousand times its effect, and at most `MOST`.
    """
    tolerance, first, worst = TOLERANCES[precision], min(vector.early), 0.0
    start = vector.start
    signs = np.where(np.arange(start.size) % 2, 1.0, -1.0).reshape(start.shape)
    moved = start + ROUNDING[precision] * np.maximum(1.0, np.abs(start)) * signs
    for count, expected in vector.early.items():
        states, allowed = walk(start, count), tolerance
        if count > first:
            grown = np.abs(walk(moved, count) - states).max() / max(1.0, np.abs(states).max())
            allowed += min(MARGIN * grown, MOST) if np.isfinite(grown) else 0.0
        worst = max(worst, check_states(states, expected, allowed))
    return worst
