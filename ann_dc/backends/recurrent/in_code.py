"""Recurrent runs in generated code: the steps of the layers without tensors.

One or many runs are supported, with every order and step rule, on the CPU and without acceleration.
Everything else, and gradients, require the layers.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import numpy as np

from ann_dc.analysis.spectra import stability_limit
from ann_dc.backends.batch import BatchRun
from ann_dc.backends.lane_batch import Thread, attempts_of, run_lanes
from ann_dc.backends.lanes import orders
from ann_dc.backends.lanes.group import Group
from ann_dc.backends.lanes.recurrence import Looks, Recurrence, StepLengths, recur_lanes
from ann_dc.backends.lanes.recurrence_code import ROWS
from ann_dc.backends.recurrent.rules.orders import SIMULTANEOUS, STAGE_BY_STAGE, TWO_PHASE, Order
from ann_dc.backends.recurrent.rules.steps import StepRule, above_limit
from ann_dc.backends.settling import GROWTH, HEADWAY, Settling, window_of
from ann_dc.backends.status import OVERFLOW
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.evaluation.codegen.lanes import Lanes
from ann_dc.evaluation.codegen.plan import refusal
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.variant_numbers import Numbers
from ann_dc.network.network import Network
from ann_dc.progress import Progress

ORDERS = {
    SIMULTANEOUS: orders.SIMULTANEOUS,
    TWO_PHASE: orders.TWO_PHASE,
    STAGE_BY_STAGE: orders.STAGE_BY_STAGE,
}


def is_possible(network: Network) -> bool:
    """Return True if code is generated for the wiring of a network."""
    return refusal(evaluator(network).tape) is None


def looks_of(order: Order, settling: Settling, limit: int, check: int) -> Looks:
    """Return check times, every ``check`` steps, and end conditions of a sample."""
    return Looks(
        order=ORDERS[order],
        check=check,
        limit=limit,
        tolerance=settling.tolerance,
        settled=settling.tolerance * settling.confirm,
        overflow=OVERFLOW,
        window=window_of(limit),
        headway=HEADWAY,
        growth=GROWTH,
    )


def run_batch(
    network: Network,
    inputs: Mapping[str, object],
    x: np.ndarray | None,
    looks: Looks,
    step: StepRule,
    *,
    numbers: Numbers | None,
    curves: int,
    progress: Progress,
) -> BatchRun:
    """Run a batch as `RecurrentBackend.run_batch` does, if it `is_possible`."""
    lengths, attempts = step_lengths(network, step), attempts_of(network)

    def begin(lanes: Lanes) -> Thread:
        group = Group.of(lanes, 2, ROWS)
        recurrence = Recurrence.of(lanes, group, lengths, looks)
        return Thread(
            group,
            lambda samples, found, queue: recur_lanes(
                group, recurrence, samples, found, queue, attempts
            ),
        )

    return run_lanes(
        network,
        inputs,
        x,
        begin,
        numbers=numbers,
        curves=curves,
        threads=None,
        progress=progress,
    )


def step_lengths(network: Network, step: StepRule) -> StepLengths:
    """Return the numbers of a step rule for a network.

    Warns (`UserWarning`) if a fixed step exceeds the stability limit at the network's start.
    """
    lengths = step.lengths(dual_limit(network))
    if lengths.is_fixed:
        limit = stability_limit(network, network.start_state)
        if 0 < limit < lengths.longest:
            warnings.warn(above_limit(lengths.longest, limit, network), stacklevel=4)
    return lengths


def dual_limit(network: Network) -> float:
    """Return `layers.steps.dual_limit` for the numbers of a network."""
    edges, tape = evaluator(network).edges, evaluator(network).tape
    fastest = 2.0 / fast_evaluator(network).fastest_rate(network.start_state)
    limits = [fastest]
    for dual in network.cell.duals:
        row = network.neuron_index[dual.neuron]
        live = network.live[row]
        if dual.path in edges and live.any():
            rho, rate = tape.weights[edges[dual.path], live], tape.rates[row, live]
            limits.append(float((rho / rate)[rho > 0].min(initial=fastest)))
    return min(limits)
