r"""What a metric demands of its wires, before anyone builds them: how fast, and how accurate.

With every wire W of the metric off by a share, and every node of it behind a lag tau, what the
network calls z = z_0 + M D (`ann_dc.hardware.schematic.metric_wiring`) obeys

.. math:: D' = d(z), \qquad \tau\, v' = W v + (D, c) - v .

No error of W moves an equilibrium, but the way there becomes slower, and from some size on it leads
away. Demanded is what at most doubles the time of the slowest mode, in the linear flow at the
settled point: a lag by itself, and errors by themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.schematic.metric_wiring import MetricWiring, wiring_of
from ann_dc.network.network import Network
from ann_dc.validation.checked import checked
from ann_dc.validation.values import State

WORSE = 2.0
"""How much slower the slowest mode may become."""

LARGEST, SMALLEST = 1.0, 1e-6
"""Lags and errors that are tried."""


@dataclass(frozen=True, kw_only=True)
class MetricDemand:
    """What the wires of a metric may be off by.

    Attributes
    ----------
    kind : str
        Of the metric, in words.
    lag : float
        Largest lag of every node, in the network's fastest time constants; zero where not even
        1e-6 is small enough.
    error : float
        Largest standard deviation of all weights, as a share; zero likewise. Wires there and back
        have errors of their own, except in a grid, where both are one resistor.
    draws : int
        Sets of errors, the worst of which counts.
    """

    kind: str
    lag: float
    error: float
    draws: int

    def __str__(self) -> str:
        lag = f"{self.lag:.1e}" if self.lag else f"less than {SMALLEST:.0e}"
        error = f"{self.error:.2g}" if self.error else f"less than {SMALLEST:.0e}"
        return (
            f"the {self.kind} demands that its nodes follow within {lag} of the fastest time "
            f"constant, and weights within {error} of theirs (rms, worst of {self.draws} draws): "
            "more than either doubles the settling time, or ends in oscillation"
        )


@checked
def metric_demand(network: Network, x: State, *, draws: int = 5) -> MetricDemand | None:
    """The largest lag and the largest errors of a metric's wires that a network can live with.

    Parameters
    ----------
    network : Network
        As designed.
    x : (n,) array
        A settled state.
    draws : int
        Sets of errors.

    Returns
    -------
    MetricDemand or None
        None where the metric is time constants alone.

    Raises
    ------
    NetworkError
        If the settled point does not attract with ideal wires.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.analysis import equilibrium
    >>> from ann_dc.network.preconditioners import Kind
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, kinds=[Kind.PYRAMID]).network
    >>> found = metric_demand(network, equilibrium(network, network.start_state))
    >>> 1e-3 < found.lag < 1, 1e-2 < found.error < 1
    (True, True)
    """
    wiring = wiring_of(network)
    if wiring is None:
        return None
    flow = _LinearFlow(network, x, wiring)
    rng = np.random.default_rng(0)
    parts, part = _resistors(wiring)
    errors = rng.standard_normal((draws, parts))[:, part]
    ideal = np.linalg.eigvals(flow.with_weights(wiring.weights.data))
    if not ideal.real.max() < 0:
        raise NetworkError("metric_demand: the settled point does not attract; see analyse")
    allowed, radius = ideal.real.max() / WORSE, np.abs(ideal).max()

    def endures(error: float) -> bool:
        drawn = (flow.with_weights(wiring.weights.data * (1 + error * e)) for e in errors)
        return all(np.linalg.eigvals(J).real.max() <= allowed for J in drawn)

    def follows(lag: float) -> bool:
        return np.linalg.eigvals(flow.with_lag(lag / radius)).real.max() <= allowed

    return MetricDemand(
        kind=network.metric.kind.value,
        lag=_largest(follows),
        error=_largest(endures),
        draws=draws,
    )


def _resistors(wiring: MetricWiring) -> tuple[int, np.ndarray]:
    """How many parts weights are made of, and which one each is: nodes of a grid share theirs."""
    weights = wiring.weights.tocsr()
    if not wiring.passive:
        return weights.nnz, np.arange(weights.nnz)
    rows = np.repeat(np.arange(weights.shape[0]), np.diff(weights.indptr))
    ends = np.sort(np.column_stack([rows, weights.indices]), axis=1)
    pairs, part = np.unique(ends, axis=0, return_inverse=True)
    return len(pairs), part.ravel()


def _largest(holds: Callable[[float], bool]) -> float:
    """The largest number at which something holds, to a tenth; zero where it never does."""
    if holds(LARGEST):
        return LARGEST
    low, high = SMALLEST, LARGEST
    if not holds(low):
        return 0.0
    while high > 1.1 * low:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


class _LinearFlow:
    """The flow at a settled point, with the nodes of a metric in it."""

    def __init__(self, network: Network, x: np.ndarray, wiring: MetricWiring) -> None:
        self.wiring = wiring
        self.drives = evaluator(network).drive_jacobian(x).toarray()
        rates = network.row.state_rates
        nodes = [wiring.nodes[i] for i in wiring.moved]
        self.moved = np.array([network.state_index[network.neuron_index[n], k] for n, k in nodes])
        self.others = np.setdiff1d(np.arange(network.size), self.moved)
        self.rates = rates[self.others]

    @cached_property
    def _pattern(self) -> sparse.csr_array:
        return sparse.csr_array(self.wiring.weights)

    def with_weights(self, data: np.ndarray) -> np.ndarray:
        """Jacobian (n, n) with other weights of the wires, and no lag: d(z)/ds = M d."""
        pattern = self._pattern
        weights = sparse.csr_array((data, pattern.indices, pattern.indptr), shape=pattern.shape)
        metric = replace(self.wiring, weights=weights).metric
        jacobian = np.empty_like(self.drives)
        jacobian[self.moved] = metric @ self.drives[self.moved]
        jacobian[self.others] = self.rates[:, None] * self.drives[self.others]
        return jacobian

    def with_lag(self, lag: float) -> np.ndarray:
        """Jacobian over the other neurons, the integrators and all further nodes of the metric."""
        wiring, own = self.wiring, self.wiring.own
        nodes = np.setdiff1d(np.arange(len(wiring.nodes)), own)
        others, width = len(self.others), len(self.others) + len(own) + len(nodes)
        state = np.concatenate([own, nodes])  # of the metric
        jacobian = np.zeros((width, width))
        reads = np.concatenate([np.arange(others), others + _places(state, wiring.moved)])
        columns = np.concatenate([self.others, self.moved])
        jacobian[:others, reads] = self.rates[:, None] * self.drives[np.ix_(self.others, columns)]
        middle = others + len(own)
        jacobian[others:middle, reads] = self.drives[np.ix_(self.moved, columns)]
        between = wiring.weights[nodes][:, state].toarray() / lag
        jacobian[middle:, others:] = between
        jacobian[middle:, middle:] -= np.eye(len(nodes)) / lag
        return jacobian


def _places(among: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Where numbers stand in an array that has each once."""
    order = np.argsort(among)
    return order[np.searchsorted(among, wanted, sorter=order)]
