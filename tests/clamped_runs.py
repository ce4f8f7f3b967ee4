"""Networks whose coupled neurons have rails, states at them, and runs that change who is held."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from designs import small, wired_with

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.cell import Limiter
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind

COUPLED = (
    PreconditionerKind.MULTILEVEL,
    PreconditionerKind.COUPLED_MULTILEVEL,
    PreconditionerKind.RESISTIVE_GRID,
    PreconditionerKind.CYCLIC_REDUCTION,
)

OF_RUNS = tuple(
    pytest.param(kind, marks=() if kind is PreconditionerKind.RESISTIVE_GRID else pytest.mark.slow)
    for kind in COUPLED
)
"""The same for tests of whole runs, which take seconds; `make slow` runs three of them."""


def with_limits(network: Network, size: float, *populations: str) -> Network:
    """The network with rails at -size and size for some populations; all where none is named."""
    rails = Limiter(low=-size, high=size)
    chosen = lambda n: not populations or n.population in populations  # noqa: E731
    neurons = tuple(replace(n, limiter=rails) if chosen(n) else n for n in network.cell.neurons)
    return replace(network, cell=replace(network.cell, neurons=neurons))


def unrailed(network: Network) -> Network:
    """The network without rails: its drives are never cut."""
    return with_limits(network, np.inf)


def rails_of(network: Network) -> tuple[np.ndarray, np.ndarray]:
    """Low and high (n,) of the state vector."""
    limits = np.array([(n.limiter.low, n.limiter.high) for n in network.cell.neurons])
    return tuple(limits[network.places[:, 0]].T)


def at_limits(network: Network, seed: int) -> np.ndarray:
    """A random state, about half of whose neurons stand at their rails."""
    low, high = rails_of(network)
    size = np.where(np.isfinite(high), high, 0.3)
    return np.random.default_rng(seed).uniform(-2 * size, 2 * size).clip(low, high)


@cache
def resting_at_rails(name: str, population: str) -> tuple[float, np.ndarray]:
    """Rails a little below where a population settles, and where the network rests then."""
    plain = small(name)
    free = equilibrium(plain, plain.start_state)
    own = [n.population == population for n in plain.cell.neurons]
    size = 0.95 * float(np.abs(free[np.array(own)[plain.places[:, 0]]]).max())
    return size, equilibrium(with_limits(plain, size, population), free)


@cache
def run_with_changes(preconditioner: PreconditionerKind) -> tuple[Network, np.ndarray, int]:
    """Euler steps of the NumPy evaluator, pushed now and then; how often its held set changes."""
    network = with_limits(wired_with("car", preconditioner), 0.35, "u", "q")
    low, high = rails_of(network)
    own, rng = evaluator(network), np.random.default_rng(4)
    x, states, changes, before = network.start_state.clip(low, high), [], 0, None
    step = 0.2 / own.fastest_rate(x)
    for number in range(600):
        if number % 30 == 0:  # somebody pushes it
            x = (x + 0.5 * rng.standard_normal(len(x))).clip(low, high)
        states.append(x)
        derivatives = own.rhs(x)
        held = ((x <= low) | (x >= high)) & (derivatives == 0)
        changes += before is not None and not np.array_equal(held, before)
        before = held
        x = (x + step * derivatives).clip(low, high)
    return network, np.array(states), changes
