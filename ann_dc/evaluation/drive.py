"""Inputs over time as the constant node values that evaluators read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.tape import constant_values
from ann_dc.network.network import Network
from ann_dc.network.waveforms import Waveform
from ann_dc.scale import Scale


class _Driven(NamedTuple):
    """Waveform of an input, and the places in the table of node values that have its value."""

    waveform: Waveform
    scale: Scale
    row: int
    pins: np.ndarray  # neuron and stage (pins, 2) of fixed neurons
    left: list[int]  # nodes whose value left of the first cell it is


class Drive:
    """Time of an evaluator: a function that sets its inputs to those of a network time."""

    def __init__(self, evaluator: InterpretedEvaluator) -> None:
        self.evaluator, network = evaluator, evaluator.network
        self._values = constant_values(network)
        self._driven = [_driven(network, name, one) for name, one in network.waveforms.items()]

    def __call__(self, time: float) -> None:
        """Set the inputs to those of a network time."""
        values = self._values
        for waveform, scale, row, pins, left in self._driven:
            now = np.broadcast_to(scale.network(waveform.at(time)), values.shape[1] - 2)
            values[row, 1:-1] = now
            values[pins[:, 0], pins[:, 1] + 1] = now[pins[:, 1]]
            values[left, 0] = now[0]
        self.evaluator.load(values)


def _driven(network: Network, name: str, waveform: Waveform) -> _Driven:
    nodes = network.node_index
    pins = [(nodes[pin.neuron], pin.stage) for pin in network.fixed if pin.input == name]
    left = [nodes[node] for node, source in network.left_boundary.items() if source == name]
    places = np.array(pins, np.int64).reshape(-1, 2)
    return _Driven(waveform, network.input_scale(name), nodes[name], places, left)


def breakpoints(waveforms: Mapping[str, Waveform], duration: float) -> np.ndarray:
    """Return the network times (K,) between which all inputs are smooth, from 0 to the duration."""
    times = [one.times for one in waveforms.values()]
    inside = np.concatenate([np.empty(0), *times])
    inside = inside[(inside > 0) & (inside < duration)]
    return np.unique(np.concatenate([[0.0], inside, [duration]]))


def values_over_time(network: Network, times: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Return the node values (T, nodes, N) at states (T, n), with the inputs of their times."""
    if not network.waveforms:
        return evaluator(network).values(states)[..., 1:-1]
    drive, found = Drive(InterpretedEvaluator(network)), []
    for time, x in zip(times, states):
        drive(float(time))
        found.append(drive.evaluator.values(x)[:, 1:-1])
    return np.array(found)
