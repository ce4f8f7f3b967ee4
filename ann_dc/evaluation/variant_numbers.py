"""Weights and rates of many networks of one wiring: sample-specific batch numbers.

All other data are those of one network: cell, ends, inputs, saturation limits and preconditioner. A
pyramid uses the same gains for all samples. A grid or tree uses the same S in M = T^{1/2} S^{-1}
T^{1/2}, with a separate T for every sample.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Annotated, Any

import numpy as np

from ann_dc.errors import NetworkError, such_as
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.network import Network
from ann_dc.validation import NotEmpty, Own, checked

NUMBERS = {"weight", "tau"}
"""Fields in which connections and neurons of one wiring may differ."""
WORDS = {"title", "ranges", "cell"}
"""Fields of a network that do not affect the wiring or are compared separately."""
ELSEWHERE = {
    "inputs": "; pass them to run_batch as inputs",
    "start": "; pass them to run_batch as x",
}
"""Remedies for fields that differ."""


def require_one_wiring(first: Network, other: Network, number: int) -> None:
    """Raise `NetworkError` if networks differ in more than weights and tau.

    The message contains the given number of the network and names the difference.
    """
    for a, b in ((first, other), (first.cell, other.cell)):
        for field in (f.name for f in fields(a) if f.name not in WORDS):
            own, its = getattr(a, field), getattr(b, field)
            if not _is_same(own, its):
                raise NetworkError(
                    f"networks: number {number} has other {field.replace('_', ' ')} than the first"
                    f"{_where(own, its)}{ELSEWHERE.get(field, '')}"
                )


def _is_same(own: Any, its: Any) -> bool:
    """Return True if two values are equal except for the fields `NUMBERS`."""
    if own is its:
        return True
    if type(own) is not type(its):
        return False
    if isinstance(own, Mapping):
        return own.keys() == its.keys() and all(_is_same(own[key], its[key]) for key in own)
    if isinstance(own, (tuple, list)):
        return len(own) == len(its) and all(map(_is_same, own, its))
    if is_dataclass(own):
        names = [f.name for f in fields(own) if f.name not in NUMBERS]
        return all(_is_same(getattr(own, name), getattr(its, name)) for name in names)
    return bool(np.array_equal(own, its))


def _where(own: Any, its: Any) -> str:
    """Return the name of the first item that differs, for the message."""
    if isinstance(own, Mapping):
        keys = [key for key in own if key not in its or not _is_same(own[key], its[key])]
        keys += [key for key in its if key not in own]
        return f": {keys[0]}"
    if not isinstance(own, tuple):
        return ""
    if len(own) != len(its):
        return f": {len(its)} for {len(own)}"
    differing = next(a for a, b in zip(own, its) if not _is_same(a, b))
    name = getattr(differing, "name", "")
    return f": {name}" if name else ""


@such_as("numbers_of(networks)")
@dataclass(frozen=True, kw_only=True, eq=False)
class Numbers:
    """Numbers of B networks with E connections and P neurons in each of N cells.

    Raises `NetworkError` if the shapes do not agree or a number is not finite.

    Attributes
    ----------
    weights : (B, E, N) array
        Connection weights in the order of ``evaluator(network).edges``.
    rates : (B, P, N) array
        1 / tau; zero for pinned and absent neurons.

    Examples
    --------
    >>> from ann_dc import nonidealities, plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=3))
    >>> numbers = numbers_of([network, nonidealities.mismatch(network, 0.01, seed=1)])
    >>> len(numbers), numbers.rates.shape[1:] == network.live.shape
    (2, True)
    """

    weights: np.ndarray
    rates: np.ndarray

    def __post_init__(self) -> None:
        for field in ("weights", "rates"):
            given = np.ascontiguousarray(getattr(self, field), float)
            if given.ndim != 3 or not len(given):
                raise NetworkError(
                    f"{field}: expected an array (B, rows, N), got one of shape {given.shape}"
                )
            if not np.isfinite(given).all():
                raise NetworkError(f"{field}: a number is not finite")
            given.setflags(write=False)
            object.__setattr__(self, field, given)
        apart = [shape[::2] for shape in (self.weights.shape, self.rates.shape)]
        if apart[0] != apart[1]:
            raise NetworkError(
                f"weights, rates: samples and stages differ: {apart[0]} and {apart[1]}"
            )

    def __len__(self) -> int:
        return len(self.weights)

    def __getitem__(self, samples: slice | np.ndarray) -> Numbers:
        return Numbers(weights=self.weights[samples], rates=self.rates[samples])

    def check(self, network: Network) -> None:
        """Raise `NetworkError` if the numbers do not fit a network."""
        tape = evaluator(network).tape
        for field, own in (("weights", tape.weights), ("rates", tape.rates)):
            given = getattr(self, field).shape[1:]
            if given != own.shape:
                raise NetworkError(
                    f"numbers: {field} of a network with another wiring: {given} per sample, "
                    f"expected {own.shape}"
                )
        if not np.array_equal(self.rates > 0, np.broadcast_to(tape.rates > 0, self.rates.shape)):
            raise NetworkError(
                "numbers: expected positive rates for neurons of the network and zero elsewhere"
            )

    def network_of(self, network: Network, sample: int) -> Network:
        """Return a network with the numbers of one sample.

        The numbers must fit the network. The result equals the original network of the sample to
        rounding.
        """
        edges, cell = evaluator(network).edges, network.cell
        weights, rates = self.weights[sample], self.rates[sample]
        connections = tuple(replace(c, weight=weights[edges[c.name]]) for c in cell.connections)
        neurons = []
        for neuron, rate in zip(cell.neurons, rates):
            tau = np.broadcast_to(np.asarray(neuron.tau, float), rate.shape).copy()
            np.divide(1.0, rate, out=tau, where=rate > 0)
            neurons.append(replace(neuron, tau=tau))
        cell = replace(cell, connections=connections, neurons=tuple(neurons))
        return replace(network, cell=cell)


@checked
def numbers_of(networks: Annotated[Sequence[Network], NotEmpty(), Own()]) -> Numbers:
    """Return the numbers of networks of one wiring, for ``run_batch``.

    The first network runs the batch. The networks may differ in weights and time constants only.
    Raises `NetworkError` if the sequence is empty, or if a network differs from the first in
    anything else; the message names the difference.

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> drawn = [ann_dc.nonidealities.mismatch(network, 0.01, seed=seed) for seed in range(4)]
    >>> batch = ann_dc.OdeBackend().run_batch(network, {}, numbers=numbers_of(drawn))
    >>> batch.settled.tolist()
    [True, True, True, True]
    """
    if not len(networks):
        raise NetworkError("networks: expected one network or more, got none")
    first = networks[0]
    for number, network in enumerate(networks):
        require_one_wiring(first, network, number)
    edges = evaluator(first).edges
    order = np.array([edges[c.name] for c in first.cell.connections], np.int64)
    weights = np.zeros((len(networks), len(edges), first.stages))
    rates = np.zeros((len(networks), *first.live.shape))
    for sample, network in enumerate(networks):
        for row, connection in zip(order, network.cell.connections):
            weights[sample, row] = connection.weight
        rates[sample] = network.layout.rates
    return Numbers(weights=weights, rates=rates)
