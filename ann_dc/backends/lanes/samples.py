"""The samples of a batch as generated code takes them: states, inputs and left, a row a sample."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ann_dc.backends.lanes.group import Samples
from ann_dc.errors import NetworkError
from ann_dc.evaluation.compiled import CompiledEvaluator
from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.generated.plan import Plan
from ann_dc.network.functions import function_block
from ann_dc.network.inputs import input_batch, moved_starts
from ann_dc.network.network import Network


def samples_of(
    network: Network, plan: Plan, inputs: Mapping[str, object], x: np.ndarray | None
) -> tuple[Samples, dict[str, np.ndarray]]:
    """Samples of a network, and all their inputs.

    Parameters
    ----------
    network : Network
    plan : Plan
        Of its wiring.
    inputs : mapping of input name to number, (B,) or (B, N) array
    x : (n,) or (B, n) array, optional
        Where to start, in network units; by default the network's start, moved with its ends.

    Returns
    -------
    samples : Samples
    every : dict of str to (B, N) array

    Raises
    ------
    UnknownNameError, NetworkError
        If an input does not exist, or sizes do not agree.
    """
    every = input_batch(network, inputs)
    starts = moved_starts(network, every) if x is None else _given(network, x)
    sizes = {len(starts), *(len(values) for values in every.values())} - {1}
    if len(sizes) > 1:
        raise NetworkError(
            f"x: sizes of the batch do not agree: {len(starts)} states, inputs of "
            f"{max(sizes - {len(starts)})} samples"
        )
    count = max(sizes, default=1)
    every = {name: np.broadcast_to(v, (count, network.stages)) for name, v in every.items()}
    held = {name: network.input_scale(name).network(values) for name, values in every.items()}
    starts = np.broadcast_to(starts, (count, network.size))
    values = np.repeat(plan.tape.values[None, : plan.one], count, axis=0)
    left = np.repeat(plan.tape.values[None, list(plan.stored), 0], count, axis=0)
    for row, name in enumerate(network.cell.inputs):
        values[:, plan.neurons + row, 1:-1] = held[name]
    for pin in network.pins:
        values[:, network.neuron_index[pin.neuron], pin.stage + 1] = held[pin.input][:, pin.stage]
    for node, source in network.left.items():
        at = network.node_index[node]
        if at < plan.one:
            values[:, at, 0] = held[source][:, 0]
        elif at in plan.stored:
            left[:, plan.stored[at]] = held[source][:, 0]
    neuron, stage = plan.tape.places.T
    values[:, neuron, stage + 1] = starts
    sides = _sides(network, plan, starts, values, left)
    values = np.ascontiguousarray(values.transpose(0, 2, 1))
    samples = Samples(
        states=np.ascontiguousarray(values[..., : plan.neurons]),
        inputs=np.ascontiguousarray(values[..., plan.neurons :]),
        left=left,
        sides=sides,
    )
    return samples, every


def _given(network: Network, x: np.ndarray) -> np.ndarray:
    """(B, n) or (1, n): the start that is given."""
    starts = np.atleast_2d(np.asarray(x, float))
    if starts.ndim != 2 or starts.shape[1] != network.size or not len(starts):
        raise NetworkError(
            f"x: expected state vectors of {network.size} neurons, got an array of shape "
            f"{np.shape(x)}"
        )
    return starts


def _sides(
    network: Network, plan: Plan, starts: np.ndarray, values: np.ndarray, left: np.ndarray
) -> np.ndarray:
    """(B, N, G): on which side of a pole every guarded block begins, by its sample's own inputs."""
    sides = np.zeros((len(starts), network.stages, len(plan.guarded)))
    poles = [network.cell.blocks[step] for step in plan.guarded]
    if not any(function_block(block.function).has_pole for block in poles):  # type: ignore
        return sides
    compiled, stored = CompiledEvaluator(network), list(plan.stored)
    for sample, x in enumerate(starts):
        compiled.work.values[: plan.one] = values[sample]
        compiled.work.values[stored, 0] = left[sample]
        guard = DomainGuard.at(plan.tape, compiled.values(x))
        sides[sample] = guard.signs[list(plan.guarded)].T
    return sides
