r"""A reference vector: the steps of a network from its start, for the receiver to compare.

Forward Euler with steps of one length h, no neuron past its rails:

.. math:: x_{k+1} = \mathrm{clip}(x_k + h\, M\, d(x_k)) .

Whatever an export computes with, it can take the same steps and must come to the same states. The
residual is the one that runs use, and the walk ends at the first state where it is below the
tolerance.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ann_dc.analysis.spectra import Spectrum, spectrum
from ann_dc.backends.ode import OdeBackend
from ann_dc.errors import FileFormatError
from ann_dc.evaluation.codegen.evaluator import FastEvaluator, fast_evaluator
from ann_dc.network.network import Network
from ann_dc.validation.checked import checked
from ann_dc.validation.values import PositiveFinite
from ann_dc.weights.hashes import content_hash, wiring_hash
from ann_dc.weights.manifest import Table, read_manifest

VECTOR = "reference_vector.json"
"""Name of its file in every export."""
FORMAT = "ann_dc reference vector"
SCHEMA = 1
EARLY = (1, 50)
"""Numbers of steps after which the states are told."""
SHARE = 0.5
"""First length of a step over its stability limit."""
HALVINGS = 6
"""How often the length is halved where the walk does not settle."""
LIMIT = 20_000
"""Most steps of a walk."""
LOST = 1e100
"""Residual of a walk that is lost."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ReferenceVector:
    """A walk, in network units. Arrays (P, N): neurons as in the network's cell, stages.

    Attributes
    ----------
    wiring, content : str
        Hashes of the network that walked.
    inputs : mapping of str to (N,) array
        What the nodes of its inputs hold.
    step : float
        h, in units of network time.
    tolerance : float
        Of the relative KKT residual.
    start : (P, N) array
    early : mapping of int to (P, N) array
        The states after so many steps.
    steps : int
        After which the residual was first below the tolerance; -1 where it never was.
    end : (P, N) array
        The states then.
    residual : float
        The residual then.
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

    @property
    def settles(self) -> bool:
        """Whether the walk came to its end."""
        return self.steps >= 0

    def as_json(self) -> bytes:
        """The vector as JSON; numbers are written so that reading gives the same float64.

        Returns
        -------
        bytes
        """
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
        }
        return (json.dumps(table) + "\n").encode()

    @classmethod
    def from_json(cls, text: bytes) -> ReferenceVector:
        """What `as_json` wrote.

        Parameters
        ----------
        text : bytes

        Raises
        ------
        FileFormatError
            If it is no such vector.
        """
        try:
            table = read_manifest(text.decode("utf-8"), FORMAT, SCHEMA, place=VECTOR)
        except UnicodeDecodeError as error:
            raise FileFormatError(f"{VECTOR}: not UTF-8 text: {error}") from error
        start = _numbers(table, "start", 2)
        early = Table(f"{VECTOR}.early", table.get("early", dict))
        inputs = Table(f"{VECTOR}.inputs", table.get("inputs", dict))
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
        )

    def check(
        self, walk: Callable[[np.ndarray, int], np.ndarray], tolerance: float = 1e-9
    ) -> float:
        """Compare the early states with those of another walker.

        Parameters
        ----------
        walk : function of a (P, N) array and a count
            The states (P, N) after so many steps of the vector's length, with its inputs.
        tolerance : float
            Largest difference, over the largest state or one.

        Returns
        -------
        float
            The largest difference there was.

        Raises
        ------
        FileFormatError
            If it is larger than the tolerance.
        """
        return max(
            check_states(walk(self.start, count), expected, tolerance)
            for count, expected in self.early.items()
        )


def check_states(found: np.ndarray, expected: np.ndarray, tolerance: float) -> float:
    """How far states are from those of a vector.

    Parameters
    ----------
    found, expected : (P, N) array
    tolerance : float
        Largest difference, over the largest state or one.

    Returns
    -------
    float

    Raises
    ------
    FileFormatError
        If it is larger than the tolerance.
    """
    off = float(np.abs(found - expected).max() / max(1.0, np.abs(expected).max()))
    if not off <= tolerance:
        raise FileFormatError(
            f"{VECTOR}: the states differ by {off:.1e} of the largest, {tolerance:g} is allowed; "
            "this is not the network that was exported: export it again"
        )
    return off


@checked
def reference_vector(network: Network, tolerance: PositiveFinite = 1e-6) -> ReferenceVector:
    """Let a network walk from its start until it settles.

    Parameters
    ----------
    network : Network
    tolerance : float
        Of the relative KKT residual.

    Returns
    -------
    ReferenceVector

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
    walker = EulerWalk(network, SHARE * _step_limit(network))
    steps, end, residual = walker.settled(network.start_state, tolerance)
    for _ in range(HALVINGS):
        if steps >= 0:
            break
        walker = EulerWalk(network, walker.step / 2)
        steps, end, residual = walker.settled(network.start_state, tolerance)
    return ReferenceVector(
        wiring=wiring_hash(network),
        content=content_hash(network),
        inputs=dict(network.input_values),
        step=walker.step,
        tolerance=tolerance,
        start=network.unpack(network.start_state),
        early={n: network.unpack(walker.after(network.start_state, n)) for n in EARLY},
        steps=steps,
        end=network.unpack(end),
        residual=residual,
    )


def _step_limit(network: Network) -> float:
    """The stability limit at the start; where the start repels, the one where the flow settles."""
    limit = _limit_at(network, network.start_state)
    if limit > 0:
        return limit
    settled = OdeBackend(verify=False).run(network).trajectory.final
    return _limit_at(network, settled) or float(1 / network.row.rates.max())


def _limit_at(network: Network, x: np.ndarray) -> float:
    """The stability limit of what moves at a state; zero where nothing does, or it repels."""
    if not fast_evaluator(network).free(x).any():
        return 0.0
    values = spectrum(network, x).eigenvalues
    moving = values[values != 0]
    return Spectrum(eigenvalues=moving).largest_step if len(moving) else 0.0


class EulerWalk:
    """Steps of one length.

    Parameters
    ----------
    network : Network
    step : float
        In units of network time.
    """

    def __init__(self, network: Network, step: float) -> None:
        self.step = step
        self._evaluator: FastEvaluator = fast_evaluator(network)
        limits = np.array([(n.limiter.low, n.limiter.high) for n in network.cell.neurons])
        self._low, self._high = limits[network.places[:, 0]].T

    def after(self, x: np.ndarray, count: int) -> np.ndarray:
        """The state (n,) so many steps after another."""
        with np.errstate(all="ignore"):
            for _ in range(count):
                moved = x + self.step * self._evaluator.rhs(x)
                x = np.clip(moved, self._low, self._high)
        return x

    def settled(self, x: np.ndarray, tolerance: float) -> tuple[int, np.ndarray, float]:
        """(Steps, state, residual) where the residual is first small enough; steps -1: nowhere."""
        residual, count = max(self._evaluator.residuals(x)), 0
        while tolerance <= residual < LOST and count < LIMIT:
            x, count = self.after(x, 1), count + 1
            residual = max(self._evaluator.residuals(x))
        return (count if residual < tolerance else -1), x, float(residual)


def _positive(table: Table, key: str) -> float:
    value = table.get(key, float)
    if not 0 < value < np.inf:
        raise FileFormatError(f"{table.place}.{key}: expected a positive number, got {value!r}")
    return value


def _numbers(table: Table, key: str, rank: int, shape: tuple[int, ...] | None = None) -> np.ndarray:
    """A finite array of a rank, and of a shape where one is given."""
    try:
        values = np.array(table.get(key, list), float)
    except (TypeError, ValueError) as error:
        raise FileFormatError(f"{table.place}.{key}: expected numbers: {error}") from error
    if values.ndim != rank or (shape is not None and values.shape != shape):
        raise FileFormatError(f"{table.place}.{key}: its shape {values.shape} does not fit")
    if not np.isfinite(values).all():
        raise FileFormatError(f"{table.place}.{key}: a value is not finite")
    return values
