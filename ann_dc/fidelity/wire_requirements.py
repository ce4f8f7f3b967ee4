r"""Wire requirements of a preconditioner: bandwidth and matching.

Let every wire W of the preconditioner have a relative error, and every node a lag tau. The variable
z = z_0 + M D of the network (`ann_dc.hardware.schematic.preconditioner_wiring`) then satisfies

.. math:: D' = d(z), \qquad \tau\, v' = W v + (D, c) - v .

An error of W does not shift an equilibrium. It slows down the flow and, from some size on,
destabilises the equilibrium. The requirement is that the time of the slowest mode at most doubles,
in the linear flow at the settled point. The lag and the errors are evaluated separately.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.schematic.preconditioner_wiring import PreconditionerWiring, wiring_of
from ann_dc.network.network import Network
from ann_dc.validation import State

WORSE = 2.0
"""Allowed factor on the time of the slowest mode."""

LARGEST, SMALLEST = 1.0, 1e-6
"""Range of lags and errors that are tested."""


@dataclass(frozen=True, kw_only=True)
class PreconditionerDemand:
    """Requirements for the wires of a preconditioner.

    Attributes
    ----------
    kind : str
        Name of the preconditioner kind.
    lag : float
        Largest lag of every node, in the network's fastest time constants; zero if 1e-6 is not
        small enough.
    error : float
        Largest relative standard deviation of all weights; zero as for the lag. Forward and
        backward wires have independent errors, except in a resistive grid, whose wire pairs are one
        resistor. The worst of ``draws`` error sets counts.
    """

    kind: str
    lag: float
    error: float
    draws: int

    def __str__(self) -> str:
        lag = f"{self.lag:.1e}" if self.lag else f"less than {SMALLEST:.0e}"
        error = f"{self.error:.2g}" if self.error else f"less than {SMALLEST:.0e}"
        return (
            f"the {self.kind} requires that its nodes follow within {lag} of the fastest time "
            f"constant, and weights within {error} of their values (rms, worst of {self.draws} "
            "draws); larger values double the settling time or cause oscillation"
        )


def preconditioner_demand(
    network: Network, x: State, *, draws: int = 5
) -> PreconditionerDemand | None:
    """Compute the largest lag and the largest errors of preconditioner wires.

    `x` (n,) is a settled state; `draws` is the number of error sets. The result is None for a
    diagonal preconditioner. Raises `NetworkError` if the settled point is unstable with ideal
    wires.
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
        raise NetworkError(
            "preconditioner_demand: the settled point is unstable; see ann_dc.diagnose"
        )
    allowed, radius = ideal.real.max() / WORSE, np.abs(ideal).max()

    def decays(jacobian: np.ndarray) -> bool:
        return np.linalg.eigvals(jacobian).real.max() <= allowed

    def endures(error: float) -> bool:
        return all(decays(flow.with_weights(wiring.weights.data * (1 + error * e))) for e in errors)

    def follows(lag: float) -> bool:
        return decays(flow.with_lag(lag / radius))

    return PreconditionerDemand(
        kind=network.preconditioner.kind.value,
        lag=_largest(follows),
        error=_largest(endures),
        draws=draws,
    )


def _resistors(wiring: PreconditionerWiring) -> tuple[int, np.ndarray]:
    """Return the number of parts and the part of each weight; grid nodes use one part."""
    weights = wiring.weights.tocsr()
    if not wiring.passive:
        return weights.nnz, np.arange(weights.nnz)
    rows = np.repeat(np.arange(weights.shape[0]), np.diff(weights.indptr))
    ends = np.sort(np.column_stack([rows, weights.indices]), axis=1)
    pairs, part = np.unique(ends, axis=0, return_inverse=True)
    return len(pairs), part.ravel()


def _largest(holds: Callable[[float], bool]) -> float:
    """Return the largest number that satisfies a condition, to a tenth; zero if none."""
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
    """Linear flow at a settled point, including the nodes of a preconditioner."""

    def __init__(self, network: Network, x: np.ndarray, wiring: PreconditionerWiring) -> None:
        self.wiring = wiring
        self.drives = evaluator(network).drive_jacobian(x).toarray()
        rates = network.layout.state_rates
        nodes = [wiring.nodes[i] for i in wiring.moved]
        self.moved = np.array([network.state_index[network.neuron_index[n], k] for n, k in nodes])
        self.others = np.setdiff1d(np.arange(network.size), self.moved)
        self.rates = rates[self.others]

    def with_weights(self, data: np.ndarray) -> np.ndarray:
        """Return the Jacobian (n, n) with other wire weights and no lag: d(z)/ds = M d."""
        pattern = self.wiring.weights.tocsr()
        weights = sparse.csr_array((data, pattern.indices, pattern.indptr), shape=pattern.shape)
        preconditioner = replace(self.wiring, weights=weights).preconditioner
        jacobian = np.empty_like(self.drives)
        jacobian[self.moved] = preconditioner @ self.drives[self.moved]
        jacobian[self.others] = self.rates[:, None] * self.drives[self.others]
        return jacobian

    def with_lag(self, lag: float) -> np.ndarray:
        """Return the Jacobian over other neurons, integrators and preconditioner nodes."""
        wiring, own = self.wiring, self.wiring.own
        nodes = np.setdiff1d(np.arange(len(wiring.nodes)), own)
        others, width = len(self.others), len(self.others) + len(own) + len(nodes)
        state = np.concatenate([own, nodes])  # of the preconditioner
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
    """Return the positions of numbers in an array of unique values."""
    order = np.argsort(among)
    return order[np.searchsorted(among, wanted, sorter=order)]
