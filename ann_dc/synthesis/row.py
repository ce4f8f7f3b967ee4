"""Cell array of a problem: N equal cells, with the boundaries as data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ann_dc.decomposition.equations import StageEquations
from ann_dc.network.cell import Cell
from ann_dc.network.ends import FixedNeuron, Omitted
from ann_dc.network.network import Network
from ann_dc.problem.initial_guess import InitialGuess
from ann_dc.problem.scales import Scales
from ann_dc.scale import Scale
from ann_dc.synthesis.inequalities import absent_diodes


def row_of(cell: Cell, equations: StageEquations, scales: Scales) -> Network:
    """Return the network of N cells and its boundary data.

    The cell is wired for the equations in the given scales.
    """
    problem, last = equations.problem, equations.problem.horizon - 1
    closing = equations.form.start_is_neuron
    states = [str(s) for s in problem.states]
    given = [s for s, fixed in zip(states, problem.fixed_start) if fixed]
    pins = (
        [] if closing else [FixedNeuron(neuron=f"q.{s}", stage=0, input=f"q_0.{s}") for s in given]
    )
    pins += [
        FixedNeuron(neuron=f"t.{s}", stage=last, input=f"q_d.{s}")
        for s, fixed in zip(states, fixed_targets(equations))
        if fixed
    ]
    values: dict[str, Any] = {f"q_0.{s}": value for s, value in zip(states, problem.q_0)}
    values |= {f"q_d.{s}": value for s, value in zip(states, problem.q_d or ())}
    values = {name: value for name, value in values.items() if name in cell.inputs}
    values |= {str(s): value for s, value in problem.inputs.items()}
    return Network(
        cell=cell,
        stages=problem.horizon,
        inputs=values,
        input_scales=_input_scales(problem, scales, values),
        fixed=tuple(pins),
        omitted=tuple(Omitted(neuron=name, stage=k) for name, k in _absent(equations)),
        left_boundary={f"t.{s}": f"q_0.{s}" for s in given} if closing else {},
        title=problem.name,
    )


def _input_scales(problem, scales: Scales, inputs: Mapping[str, Any]) -> dict[str, Scale]:
    """Return input scales: chain scales for ends, the largest value for other inputs."""
    known = {
        f"{end}.{s}": scale
        for end in ("q_0", "q_d")
        for s, scale in zip(problem.states, scales.states)
    }
    known |= {str(s): input_scale(values) for s, values in problem.inputs.items()}
    return {name: known[name] for name in inputs}


def fixed_targets(equations: StageEquations) -> tuple[bool, ...]:
    """Return True for each state component whose last target is fixed at q_d."""
    problem = equations.problem
    return (False,) * problem.n if equations.form.terminal_free else problem.fixed


def _absent(equations: StageEquations) -> list[tuple[str, int]]:
    """Return the neurons (name, stage) that are omitted at the boundaries."""
    problem, form, last = equations.problem, equations.form, equations.problem.horizon - 1
    absent = [  # what a given q_0 does not need, and a free one is not tied by
        (f"beta.{s}", 0)
        for s, fixed in zip(problem.states, problem.fixed_start)
        if not (fixed and form.start_is_neuron)
    ]
    absent += absent_diodes(equations)
    if form.printed_ranges:  # (16), (17): u and mu from k = 1, beta up to N - 2
        absent += [(f"u.{s}", 0) for s in problem.controls]
        absent += [(f"mu.{s}", 0) for s in problem.states]
        absent += [(f"beta.{s}", last) for s in problem.states if last > 0]
    return absent


def input_scale(values: float | Sequence[float]) -> Scale:
    """Return the scale of a further input: its largest value over the stages."""
    return Scale(float(np.abs(np.asarray(values)).max()) or 1.0)


def start_values(
    network: Network, initial_guess: InitialGuess, measured: Sequence[float] = ()
) -> np.ndarray:
    """Return the state vector (n,) of a network, in its units, from an initial guess.

    Multipliers that the guess does not give are zero; controls beyond their limits are clipped.
    Objectives have equal coefficients, and the level is that of the largest. ``measured`` are the p
    objectives at the initial guess.
    """
    values = np.zeros(network.live.shape)
    groups = {
        "q": initial_guess.q[:, :-1],
        "t": initial_guess.q[:, 1:],
        "u": initial_guess.u,
        "mu": initial_guess.mu,
        "beta": initial_guess.beta,
    }
    position: dict[str, int] = {}
    for row, neuron in enumerate(network.cell.neurons):
        index = position.get(neuron.population, 0)
        position[neuron.population] = index + 1
        group, limiter = groups.get(neuron.population), neuron.limiter
        if group is not None:
            given = neuron.scale.network(group[index])
            values[row] = np.clip(given, limiter.low, limiter.high)
    for objective, value in zip(network.cell.objectives, measured):
        known = (objective.at_rest(1.0 / len(measured)), value, max(measured))
        for name, given in zip(objective.neurons, known):
            values[network.neuron_index[name]] = network.neuron(name).scale.network(given)
    return network.pack(values)
