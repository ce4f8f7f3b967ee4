"""Samples of a batch in the layout of generated code.

States, inputs and left boundary have one row per sample.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ann_dc.backends.batched.group import Samples
from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.plan import Plan
from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.variant_numbers import Numbers
from ann_dc.network.functions import function_block
from ann_dc.network.inputs import input_batch, moved_starts
from ann_dc.network.network import Network


def samples_of(
    network: Network,
    plan: Plan,
    inputs: Mapping[str, object],
    x: np.ndarray | None,
    numbers: Numbers | None,
) -> tuple[Samples, dict[str, np.ndarray]]:
    """Return the samples of a network and all their inputs (B, N) by name.

    Without an initial guess ``x`` in network units, samples start at the network's start, adapted
    to their boundary conditions. Raises `UnknownNameError` or `NetworkError` if an input does not
    exist or sizes do not agree.
    """
    every = input_batch(network, inputs)
    starts = moved_starts(network, every) if x is None else _given(network, x)
    count = _count(starts, every, numbers)
    every = {name: np.broadcast_to(v, (count, network.stages)) for name, v in every.items()}
    held = {name: network.input_scale(name).network(values) for name, values in every.items()}
    starts = np.broadcast_to(starts, (count, network.size))
    values = plan.tape.values
    left = np.repeat(values[None, list(plan.stored), 0], count, axis=0)
    given = np.repeat(values[None, plan.neurons : plan.one].swapaxes(1, 2), count, axis=0)
    for row, name in enumerate(network.cell.inputs):
        given[:, 1:-1, row] = held[name]
    pins = {
        (network.neuron_index[pin.neuron], pin.stage + 1): held[pin.input][:, pin.stage]
        for pin in network.fixed
    }
    for node, source in network.left_boundary.items():
        at = network.node_index[node]
        if at < plan.neurons:
            pins[at, 0] = held[source][:, 0]
        elif at < plan.one:
            given[:, 0, at - plan.neurons] = held[source][:, 0]
        elif at in plan.stored:
            left[:, plan.stored[at]] = held[source][:, 0]
    places = np.array(list(pins), np.int64).reshape(-1, 2)
    samples = Samples(
        states=np.ascontiguousarray(starts),
        pins=np.stack(list(pins.values()), axis=1) if pins else np.zeros((count, 0)),
        pinned=((places[:, 1] + plan.far - 1) * plan.neurons + places[:, 0]) * plan.axis.lanes,
        inputs=given,
        left=left,
        sides=np.zeros((count, network.stages, len(plan.guarded))),
        weights=np.zeros((0, 0, 0)) if numbers is None else numbers.weights,
        rates=np.zeros((0, 0, 0)) if numbers is None else numbers.rates,
        nominal=plan.tape.rates,
    )
    _enter_sides(network, plan, samples, places)
    return samples, every


def _count(starts: np.ndarray, inputs: Mapping[str, np.ndarray], numbers: Numbers | None) -> int:
    """Return the batch size B given by all arguments."""
    given = max((len(values) for values in inputs.values()), default=1)
    if len({len(starts), given} - {1}) > 1:
        raise NetworkError(
            f"x: sizes of the batch differ: {len(starts)} states, inputs of {given} samples"
        )
    count = max(len(starts), given)
    if numbers is not None and len({count, len(numbers)} - {1}) > 1:
        raise NetworkError(
            f"numbers: sizes of the batch differ: numbers of {len(numbers)} networks, states or "
            f"inputs of {count} samples"
        )
    return count if numbers is None else max(count, len(numbers))


def _given(network: Network, x: np.ndarray) -> np.ndarray:
    """Return the given start as an array (B, n) or (1, n)."""
    starts = np.atleast_2d(np.asarray(x, float))
    if starts.ndim != 2 or starts.shape[1] != network.size or not len(starts):
        raise NetworkError(
            f"x: expected state vectors of {network.size} neurons, got an array of shape "
            f"{np.shape(x)}"
        )
    return starts


def _enter_sides(network: Network, plan: Plan, samples: Samples, places: np.ndarray) -> None:
    """Enter the initial side of every guarded block's pole, by its sample's inputs."""
    poles = [network.cell.blocks[step] for step in plan.guarded]
    if not any(function_block(block.function).has_pole for block in poles):  # type: ignore
        return
    compiled, stored, neurons = InterpretedEvaluator(network), list(plan.stored), plan.neurons
    for sample, x in enumerate(samples.states):
        if len(samples.weights):
            own = samples.weights[sample if len(samples.weights) > 1 else 0]
            compiled.renumber(plan.tape._replace(weights=own))
        values = compiled.work.values
        values[tuple(places.T)] = samples.pins[sample]
        values[neurons : plan.one] = samples.inputs[sample].T
        values[stored, 0] = samples.left[sample]
        guard = DomainGuard.at(plan.tape, compiled.values(x))
        samples.sides[sample] = guard.signs[list(plan.guarded)].T
