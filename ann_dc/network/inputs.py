"""Batches of a network that differ in their inputs: initial and terminal states.

Inputs are arrays (B, N), one row per sample. If an input is an end of a chain, the initial guess
follows: a straight line from q_0 to q_d remains straight when its ends move.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ann_dc.errors import NetworkError, ProblemError, UnknownNameError
from ann_dc.network.network import Network
from ann_dc.network.waveforms import Waveform


def input_batch(network: Network, inputs: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Return every input of the cell as an array (B, N), from the given inputs.

    A given input is a number, a (B,) array (one value per sample) or a (B, N) array (one per sample
    and stage), all with the same B. B is 1 if only single numbers are given. The network supplies
    the other inputs.

    Raises `UnknownNameError` if the cell lacks an input, and `NetworkError` if the sizes differ.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=3))
    >>> input_batch(network, {"q_0.x": [0.0, 0.5]})["q_0.x"]
    array([[0. , 0. , 0. ],
           [0.5, 0.5, 0.5]])
    """
    arrays = {name: _per_sample(network, name, value) for name, value in inputs.items()}
    sizes = {name: len(array) for name, array in arrays.items() if array.ndim and len(array) != 1}
    if len(set(sizes.values())) > 1:
        given = ", ".join(f"{name} has {size}" for name, size in sizes.items())
        raise NetworkError(f"inputs: sizes of the batch differ: {given} samples")
    count = next(iter(sizes.values()), 1)
    shape = (count, network.stages)
    whole = {
        name: np.broadcast_to(np.asarray(value, float), shape)
        for name, value in network.inputs.items()
    }
    return whole | {name: np.broadcast_to(array, shape) for name, array in arrays.items()}


def waveform_batch(network: Network, inputs: Mapping[str, Any]) -> dict[str, Waveform]:
    """Return all inputs over time of a batch, with values (K, B or 1, N or 1).

    They are those of the network, (K,) or (K, N) and the same for all samples, unless an input is
    given; and the given waveforms, (K,), (K, B) or (K, B, N).

    Examples
    --------
    >>> from ann_dc import Waveform, plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=3))
    >>> ramps = Waveform(times=[0.0, 9.0], values=[[1.0, 2.0], [1.5, 3.0]])
    >>> waveform_batch(network, {"q_d.x": ramps})["q_d.x"].values.shape
    (2, 2, 1)
    """
    found = {
        name: replace(one, values=one.values.reshape(len(one.times), 1, -1))
        for name, one in network.waveforms.items()
        if name not in inputs
    }
    for name, one in inputs.items():
        if isinstance(one, Waveform):
            shape = *one.values.shape, *[1] * (3 - one.values.ndim)
            found[name] = replace(one, values=one.values.reshape(shape))
    return found


def _per_sample(network: Network, name: str, value: Any) -> np.ndarray:
    if name not in network.cell.inputs:
        raise UnknownNameError.of("input", name, network.cell.inputs)
    try:
        array = np.asarray(value, float)
    except (TypeError, ValueError) as error:
        raise NetworkError(f"inputs[{name}]: expected numbers, got {value!r}") from error
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim > 2 or (array.ndim == 2 and array.shape[1] not in (1, network.stages)):
        raise NetworkError(
            f"inputs[{name}]: expected one value per sample, (B,), or one per sample and stage, "
            f"(B, {network.stages}), got an array of shape {np.shape(value)}"
        )
    if array.ndim and len(array) == 0:
        raise NetworkError(f"inputs[{name}]: the batch is empty")
    return array


class _StartMove(NamedTuple):
    """Displacement of the initial guess: ``weight`` (n,) times the change of an input.

    The value of the input is read at ``stage``; weights are in network units on both sides.
    """

    input: str
    stage: int
    weight: np.ndarray


def start_moves(network: Network) -> tuple[_StartMove, ...]:
    """Return the displacements of the initial guess by the ends of the chains.

    If an end of a chain moves, each q and t moves by linear interpolation, so a straight line
    remains straight. A chain with a free terminal end moves as a whole.
    """
    stages = network.stages
    pins = {(pin.neuron, pin.stage): pin.input for pin in network.fixed}
    share = np.arange(stages + 1) / stages
    moves = []
    for q, t in network.cell.chains:
        first, last = pins.get((q, 0), network.left_boundary.get(t)), pins.get((t, stages - 1))
        falling = np.ones(stages + 1) if last is None else 1 - share
        for name, stage, line in ((first, 0, falling), (last, stages - 1, share)):
            if name is not None:
                values = np.zeros(network.live.shape)
                values[network.neuron_index[q]] = line[:-1]
                values[network.neuron_index[t]] = line[1:]
                moves.append(_StartMove(name, stage, network.pack(values)))
    return tuple(moves)


def moved_starts(network: Network, inputs: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return initial state vectors (B, n), with the chains moved with their ends.

    The inputs are arrays (B, N) from `input_batch`.
    """
    count = max((len(values) for values in inputs.values()), default=1)
    states = np.repeat(network.start_state[None], count, axis=0)
    with np.errstate(invalid="ignore"):  # an input that is not finite costs its own sample
        for move in start_moves(network):
            own = network.input_values[move.input][move.stage]
            now = network.input_scale(move.input).network(inputs[move.input][:, move.stage])
            moved = np.flatnonzero(move.weight)
            states[:, moved] += (now - own)[:, None] * move.weight[moved]
    return states


def ranges_of(words: Sequence[str], option: str) -> dict[str, tuple[float, float]]:
    """Return input ranges from texts of the form ``INPUT=LOW:HIGH``.

    Raises `ProblemError`, with the name of the option, if a text is not a range or repeats an
    input.

    Examples
    --------
    >>> ranges_of(["q_d.x=3:7", "q_0.phi=-0.5:0.5"], "over")
    {'q_d.x': (3.0, 7.0), 'q_0.phi': (-0.5, 0.5)}
    """
    ranges: dict[str, tuple[float, float]] = {}
    for word in words:
        name, _, ends = word.partition("=")
        low, _, high = ends.partition(":")
        try:
            found = float(low), float(high)
        except ValueError as error:
            raise ProblemError(
                f"{option}: expected INPUT=LOW:HIGH, for instance q_d.x=3:7, got {word!r}"
            ) from error
        if name.strip() in ranges:
            raise ProblemError(f"{option}: {name.strip()} is specified twice")
        ranges[name.strip()] = found
    return ranges


def drawn_values(
    ranges: Mapping[str, tuple[float, float]], count: int, seed: int, *, independent: bool = False
) -> np.ndarray:
    """Return random input values (count, inputs) within their ranges.

    The values of a seed are equal on all machines. A scrambled Sobol sequence fills the ranges by
    default; with ``independent`` every value is drawn independently.
    """
    low, high = np.transpose(list(ranges.values()))
    if independent:
        points = np.random.default_rng(seed).random((count, len(ranges)))
    else:
        from scipy.stats import qmc  # loads slowly, and few need it

        sequence = qmc.Sobol(len(ranges), rng=seed)
        points = sequence.random_base2(max(count - 1, 0).bit_length())[:count]
    return low + (high - low) * points
