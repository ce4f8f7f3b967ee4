"""The flow of a network for jax, written from its tape: what diffrax integrates in `batch`.

Another array library reads the same ordered list of nodes; jax itself is imported when it is asked
for, because it is an extra of the benches alone.
"""

import numpy as np
import torch

import ann_dc
from ann_dc.backends.layers.preconditioners import PyramidLayer
from ann_dc.backends.layers.tape import TorchTape
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.tape import PRODUCT, SUM


def jax_flow(network: ann_dc.Network):
    """dx/ds of a network as a jax function (x (n,), inputs (I, N)) -> (n,), from its tape.

    The coordinators are their hats and one small matrix between them.
    """
    import jax.numpy as jnp

    tape, wiring, stages = evaluator(network).tape, TorchTape.of(network), network.stages
    functions = {0: jnp.sin, 1: jnp.cos, 2: jnp.tan}
    index = _sources(network)
    places = network.places[:, 0] * stages + network.places[:, 1]
    rates = tape.rates.ravel()[places]
    spread, response = _coordination(network, places)

    def shifted(row, node: int, offset: int, inputs):
        if offset == 0:
            return row
        if offset > 0:
            return jnp.concatenate([row[1:], jnp.zeros(1)])
        left = wiring.left.get(node)
        end = jnp.zeros(1) if left is None else inputs[left, :1]
        return jnp.concatenate([end, row[:-1]])

    def flow(x, inputs):
        state = jnp.concatenate([x, inputs.ravel(), jnp.zeros(1)])[index].reshape(-1, stages)
        rows = [*state, *inputs, jnp.ones(stages)]

        def arriving(first: int, last: int):
            return sum(
                (tape.weights[e] * shifted(rows[wiring.sources[e][0]], *wiring.sources[e], inputs)
                 for e in range(first, last)), jnp.zeros(stages))  # fmt: skip

        for kind, _, a, b in wiring.blocks:
            if kind == SUM:
                rows.append(arriving(a, b))
            else:
                rows.append(rows[a] * rows[b] if kind == PRODUCT else functions[a](rows[b]))
        drives = jnp.concatenate([arriving(*span) for span in wiring.drives])[places]
        return rates * drives + spread @ (response @ (spread.T @ drives))

    return flow


def _sources(network: ann_dc.Network) -> np.ndarray:
    """Where in (x, inputs, 0) the value of every neuron at every stage stands, flat."""
    tape, stages, count = evaluator(network).tape, network.stages, network.size
    index = np.full(len(tape.drives) * stages, -1)
    index[network.places[:, 0] * stages + network.places[:, 1]] = np.arange(count)
    names = list(network.cell.inputs)
    for pin in network.fixed:
        place = network.neuron_index[pin.neuron] * stages + pin.stage
        index[place] = count + names.index(pin.input) * stages + pin.stage
    return index


def _coordination(network: ann_dc.Network, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(S, R) with M = diag(1/tau) + S R S': hats of all chains, and gains of all levels in one."""
    tape = evaluator(network).tape
    pyramid = PyramidLayer(tape, network.stages, dtype=torch.float64)
    points, chains = pyramid.sizes[0], tape.grids.shape[1]
    unit = torch.eye(points * chains, dtype=torch.float64).reshape(points, chains, -1)
    response = pyramid._respond(torch.as_tensor(tape.grids), unit).flatten(0, 1).numpy()
    hats = pyramid._down(torch.eye(2 * network.stages, dtype=torch.float64)).T.numpy()
    spread = np.zeros((len(tape.drives) * network.stages, points, chains))
    chain = pyramid.chain.numpy().reshape(-1, chains)
    for component in range(chains):
        spread[chain[:, component], :, component] = hats
    return spread.reshape(len(spread), -1)[places], response
