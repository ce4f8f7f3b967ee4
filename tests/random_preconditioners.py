"""Metrics of every kind for any row: drawn at random, from a linearisation, and with errors."""

import contextlib
from dataclasses import replace

import numpy as np
from hypothesis import strategies as st
from scipy import sparse

from ann_dc.analysis.saddle import saddle_of
from ann_dc.errors import NetworkError
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import ArrayLayout, Preconditioner, PreconditionerKind
from ann_dc.network.preconditioners.cyclic_reduction import CyclicReduction
from ann_dc.network.preconditioners.diagonal import Diagonal
from ann_dc.network.preconditioners.multilevel import Multilevel
from ann_dc.network.preconditioners.resistive_grid import ResistiveGrid
from ann_dc.network.preconditioners.stiffness import Stiffness

STIFFNESSES = {
    PreconditionerKind.RESISTIVE_GRID: ResistiveGrid,
    PreconditionerKind.CYCLIC_REDUCTION: CyclicReduction,
}


def random_preconditioner(
    kind: PreconditionerKind, row: ArrayLayout, rng: np.random.Generator
) -> Preconditioner:
    """A preconditioner of a kind that fits a row; every number of it is random."""
    if kind is PreconditionerKind.DIAGONAL:
        return Diagonal()
    if kind in STIFFNESSES:
        own, following = random_blocks(rng, row.stages, len(row.primal))
        return STIFFNESSES[kind](own=own, following=following)
    chains, gains = len(row.chains), []
    for level in range(max(int(np.log2(max(2 * row.stages - 1, 2))), 1), 0, -1):
        root = rng.standard_normal((2**level + 1, chains, chains))
        gain = np.eye(chains) + root @ root.transpose(0, 2, 1) / max(chains, 1)
        gains.append(
            gain if kind is PreconditionerKind.COUPLED_MULTILEVEL else gain * np.eye(chains)
        )
    return Multilevel(gains=tuple(gains))


def random_blocks(rng: np.random.Generator, blocks: int, size: int, floor: float = 0.5):
    """Blocks (B, b, b) on and (B - 1, b, b) beside the diagonal of a matrix above ``floor``."""
    own = np.broadcast_to(floor * np.eye(size), (blocks, size, size)).copy()
    following = np.zeros((blocks - 1, size, size))
    for k in range(blocks):
        root = rng.standard_normal((2 * size, 2)) / np.sqrt(size)
        gram = root @ root.T
        own[k] += gram[:size, :size]
        if k + 1 < blocks:
            own[k + 1] += gram[size:, size:]
            following[k] = gram[:size, size:]
    return 0.5 * (own + own.transpose(0, 2, 1)), following


def tridiagonal(own: np.ndarray, following: np.ndarray) -> np.ndarray:
    """The whole matrix (B b, B b) of a row of blocks."""
    blocks, size, _ = own.shape
    whole = np.zeros((blocks, size, blocks, size))
    for k in range(blocks):
        whole[k, :, k] = own[k]
    for k in range(blocks - 1):
        whole[k, :, k + 1], whole[k + 1, :, k] = following[k], following[k].T
    return whole.reshape(blocks * size, -1)


def with_errors(
    preconditioner: Preconditioner, row: ArrayLayout, rng: np.random.Generator, size: float
) -> Preconditioner:
    """The preconditioner with relative errors of every number, up to ``size`` either way, still
    valid.
    """
    off = lambda a: a * rng.uniform(1 - size, 1 + size, a.shape)  # noqa: E731
    for _ in range(100):
        with contextlib.suppress(NetworkError):  # a pyramid that is none
            if isinstance(preconditioner, Stiffness):
                preconditioner_off = replace(
                    preconditioner,
                    own=_mirrored(off(preconditioner.own)),
                    following=off(preconditioner.following),
                )
            elif isinstance(preconditioner, Multilevel):
                gains = tuple(_mirrored(off(gain)) for gain in preconditioner.gains)
                preconditioner_off = replace(preconditioner, gains=gains)
            else:
                preconditioner_off = preconditioner
            if is_valid(preconditioner_off, row):
                return preconditioner_off
    raise AssertionError(f"no valid preconditioner within errors of {size}")


def is_valid(preconditioner: Preconditioner, row: ArrayLayout) -> bool:
    """Whether it fits the row and is positive definite."""
    try:
        preconditioner.check(row)
    except NetworkError:
        return False
    gains = preconditioner.gains if isinstance(preconditioner, Multilevel) else ()
    return all(np.linalg.eigvalsh(gain).min() > -1e-14 for gain in gains)


def _mirrored(blocks: np.ndarray) -> np.ndarray:
    """Symmetric, with what is on and above the diagonal on both sides."""
    upper = np.triu(blocks)
    return upper + np.triu(blocks, 1).transpose(0, 2, 1)


def with_stiffness(network: Network, kind: PreconditionerKind, penalty: float = 4.0) -> Network:
    """A network with the stiffness G = H + penalty A'A + 1 of its start, and its time constants."""
    saddle, row = saddle_of(network, network.start_state), network.layout
    identity = sparse.eye_array(len(saddle.primal))
    G = sparse.coo_array(saddle.H + penalty * saddle.A.T @ saddle.A + identity)
    neuron, stage = network.places[saddle.primal].T
    place, diagonal = np.searchsorted(row.primal, neuron), np.abs(G.diagonal())
    shape = row.stages, len(row.primal), len(row.primal)
    own, following = np.zeros(shape), np.zeros((shape[0] - 1, *shape[1:]))
    own[:] = np.eye(shape[1])
    i, j = G.coords
    values = G.data / np.sqrt(diagonal[i] * diagonal[j])
    within, ahead = stage[i] == stage[j], stage[j] == stage[i] + 1
    own[stage[i[within]], place[i[within]], place[j[within]]] = values[within]
    following[stage[i[ahead]], place[i[ahead]], place[j[ahead]]] = values[ahead]
    tau = np.ones(row.rates.shape)
    tau[neuron, stage] = diagonal
    neurons = tuple(replace(n, tau=t) for n, t in zip(network.cell.neurons, tau))
    preconditioner = STIFFNESSES[kind](own=_mirrored(own), following=following)
    return replace(
        network, cell=replace(network.cell, neurons=neurons), preconditioner=preconditioner
    )


@st.composite
def rows(draw) -> ArrayLayout:
    """Rows of q, u, t, mu and beta neurons with time constants of their own, some not there."""
    stages, chains, controls = (draw(st.integers(1, top)) for top in (9, 2, 2))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    rates = 10 ** rng.uniform(-1, 1, (4 * chains + controls, stages))
    rates[rng.random(rates.shape) < draw(st.sampled_from([0.0, 0.2]))] = 0.0
    q, t = np.arange(chains), chains + controls + np.arange(chains)
    return ArrayLayout(
        rates=rates, primal=np.arange(2 * chains + controls), chains=np.column_stack([q, t])
    )
