"""Random small networks with everything that a network may have; most of them settle nowhere."""

from dataclasses import replace

import numpy as np
from random_preconditioners import random_preconditioner

from ann_dc.network.cell import Cell, Connection, Function, Limiter, Neuron, Product, Role, Sum
from ann_dc.network.ends import FixedNeuron, Omitted
from ann_dc.network.functions import FUNCTIONS
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.network.selection import clamped_rows

NEURONS = ("q.a", "t.a", "q.b", "t.b", "u", "mu", "s")
ROLES = (*[Role.PRIMAL] * 5, Role.DUAL, Role.STATE)
SHARED = "e"
INPUTS = ("c", "d")


def random_network(seed: int, kind: PreconditionerKind = PreconditionerKind.DIAGONAL) -> Network:
    """A network with every kind of block, template, end, rail and neuron, by chance."""
    rng = np.random.default_rng(seed)
    stages = int(rng.integers(1, 7))
    blocks, wires = _blocks(rng, stages)
    neurons = [
        Neuron(name=name, tau=_numbers(rng, stages, 0.5, 2.0), role=role, limiter=_limiter(rng))
        for name, role in zip(NEURONS, ROLES)
    ]
    neurons.append(Neuron(name=SHARED, tau=float(rng.uniform(0.5, 2)), shared=True))
    names = (*NEURONS, *INPUTS, "one", *(block.name for block in blocks))
    for target in NEURONS:
        wires += _wires(rng, stages, target, (*names, SHARED), (-1, 0, 0, 0, 1))
        wires.append(Connection(source=target, target=target, weight=-float(rng.uniform(1, 3))))
    wires += _wires(rng, stages, SHARED, NEURONS, (0,))
    cell = Cell(
        neurons=tuple(neurons),
        inputs=INPUTS,
        blocks=tuple(blocks),
        connections=tuple({(w.source, w.target, int(w.template)): w for w in wires}.values()),
        chains=(("q.a", "t.a"), ("q.b", "t.b")),
    )
    network = Network(
        cell=cell,
        stages=stages,
        inputs={name: _numbers(rng, stages, -1, 1) for name in INPUTS},
        fixed=(
            FixedNeuron(neuron="q.a", stage=0, input="c"),
            FixedNeuron(neuron="q.b", stage=0, input="d"),
        ),
        omitted=(Omitted(neuron="mu", stage=stages - 1),),
        left_boundary={"t.a": "c", blocks[0].name: "d"},
        start={name: rng.uniform(-0.5, 0.5, stages) for name in NEURONS} | {SHARED: 0.3},
        title=f"random {seed}",
    )
    return replace(network, preconditioner=random_preconditioner(kind, network.layout, rng))


def free_of_coupled_limits(network: Network) -> Network:
    """Network without the saturation limits of neurons that the preconditioner couples."""
    coupled, neurons = clamped_rows(network), network.cell.neurons
    own = tuple(replace(n, limiter=Limiter()) if k in coupled else n for k, n in enumerate(neurons))
    return replace(network, cell=replace(network.cell, neurons=own))


def far_wired(seed: int) -> Network:
    """The same with sources beyond the neighbours: of those one is fed in front of the row."""
    network = random_network(seed)
    far = [Connection(source="t.a", target="q.b", weight=0.3, template=k) for k in (-2, 2, 9, -9)]
    far += [Connection(source="one", target="q.b", weight=0.1, template=-2)]
    cell = replace(network.cell, connections=(*network.cell.connections, *far))
    return replace(network, cell=cell)


def _blocks(rng, stages: int) -> tuple[list, list[Connection]]:
    """A sum, products, and function blocks on sums that stay near one half."""
    blocks, wires = [Sum(name="first")], []
    wires += _wires(rng, stages, "first", (*NEURONS, *INPUTS), (-1, 0, 1))
    blocks.append(Product(name="product", a="first", b=str(rng.choice(NEURONS))))
    for number, code in enumerate(rng.choice(len(FUNCTIONS), size=3, replace=False)):
        blocks.append(Sum(name=f"argument {number}"))
        target = blocks[-1].name
        wires.append(Connection(source="one", target=target, weight=0.5))
        source = str(rng.choice((*NEURONS, "product", "c")))
        wires.append(Connection(source=source, target=target, weight=0.2))
        blocks.append(Function(name=f"value {number}", function=FUNCTIONS[code].name, x=target))
    return blocks, wires


def _wires(rng, stages: int, target: str, sources, templates) -> list[Connection]:
    return [
        Connection(
            source=str(source),
            target=target,
            weight=_numbers(rng, stages, -0.4, 0.4) if rng.random() < 0.7 else 1.0,
            template=0 if source == SHARED else int(rng.choice(templates)),
        )
        for source in rng.choice(sources, size=min(3, len(sources)), replace=False)
    ]


def _numbers(rng, stages: int, low: float, high: float):
    """One number, or one a stage."""
    return float(rng.uniform(low, high)) if rng.random() < 0.5 else rng.uniform(low, high, stages)


def _limiter(rng) -> Limiter:
    low = -float(rng.uniform(0.2, 1)) if rng.random() < 0.3 else -np.inf
    return Limiter(low=low, high=float(rng.uniform(0.2, 1)) if rng.random() < 0.3 else np.inf)
