"""Networks in onnxruntime, and what NumPy's evaluator makes of the same."""

import numpy as np

from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.reference import evaluator
from ann_dc.export.onnx.files import onnx_files
from ann_dc.export.reference.vector import ReferenceVector
from ann_dc.network.network import Network
from ann_dc.weights.hashes import content_hash, wiring_hash

DIVERGED = 1e9
"""Times the largest state at the start."""


def vector_of(network: Network) -> ReferenceVector:
    """A vector that only says whose it is."""
    start = network.unpack(network.start_state)
    return ReferenceVector(
        wiring=wiring_hash(network), content=content_hash(network), early={}, steps=-1,
        inputs=dict(network.input_values), step=0.1, tolerance=1e-6, start=start, end=start,
        residual=np.inf,
    )  # fmt: skip


def session_of(content: bytes):
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])


class OnnxNetwork:
    """A network in onnxruntime; states are (P, N, B)."""

    def __init__(self, network: Network, precision: str = "float64") -> None:
        files = onnx_files(network, vector_of(network), precision=precision)
        self.network, self.precision = network, precision
        self._step, self._settle = (session_of(files[n]) for n in ("step.onnx", "settle.onnx"))

    def number(self, value) -> np.ndarray:
        return np.array(value, self.precision)

    def inputs(self) -> np.ndarray:
        """Those of the network, (I, N, 1)."""
        values = self.network.input_values
        return self.number([values[name] for name in self.network.cell.inputs])[..., None]

    def _given(self, states, step, inputs) -> dict[str, np.ndarray]:
        given = {"states": self.number(states), "step": self.number(step)}
        if self.network.cell.inputs:
            given["inputs"] = self.inputs() if inputs is None else self.number(inputs)
        return given

    def step(self, states, step: float, inputs=None) -> list[np.ndarray]:
        """(Next states, residual)."""
        return self._step.run(None, self._given(states, step, inputs))

    def settle(self, states, step: float, *, tolerance=1e-6, limit=20_000, inputs=None):
        """(Settled states, residual, steps)."""
        ends = {"tolerance": self.number(tolerance), "limit": np.array(limit)}
        return self._settle.run(None, self._given(states, step, inputs) | ends)


class Walk:
    """The same in NumPy, for one sample from a state vector (n,)."""

    def __init__(self, network: Network, x: np.ndarray, step: float) -> None:
        self.network, self.x, self.step, self.count = network, x, step, 0
        self._flow = evaluator(network)
        limits = np.array([(n.limiter.low, n.limiter.high) for n in network.cell.neurons])
        self._low, self._high = limits[network.places[:, 0]].T
        with np.errstate(all="ignore"):
            self.guard = DomainGuard.at(self._flow.tape, self._flow.values(x)[...])
        self._most = DIVERGED * max(1.0, np.abs(network.unpack(x)).max())

    @property
    def states(self) -> np.ndarray:
        return self.network.unpack(self.x)

    def residual(self) -> float:
        """Infinite outside a domain, and far out."""
        with np.errstate(all="ignore"):
            is_inside = self._flow.outside(self.x, self.guard) == (-1, -1)
            residual = max(self._flow.residuals(self.x))
        return residual if is_inside and np.abs(self.states).max() < self._most else np.inf

    def advance(self) -> None:
        with np.errstate(all="ignore"):
            moved = self.x + self.step * self._flow.rhs(self.x)
        self.x = np.clip(moved, self._low, self._high)
        self.count += 1

    def settle(self, tolerance: float, limit: int) -> float:
        """The residual at the end."""
        while tolerance <= (residual := self.residual()) < np.inf and self.count < limit:
            self.advance()
        return residual
