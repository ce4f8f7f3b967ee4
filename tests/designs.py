"""Networks that several test files use, wired and designed once a session."""

from dataclasses import replace
from functools import cache

import numpy as np
from problems import SUITE
from random_preconditioners import STIFFNESSES, with_stiffness

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import CORRECTED, Form
from ann_dc.gain_design.gain_rule import GainRule, closed_form
from ann_dc.gain_design.gains import apply_gains
from ann_dc.gain_design.procedure import Design, design
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.network.preconditioners.diagonal import Diagonal
from ann_dc.network.preconditioners.multilevel import Multilevel
from ann_dc.solver import synthesize


@cache
def designed(name: str) -> Design:
    """A problem of the suite, designed at its full horizon."""
    return design(synthesize(SUITE[name].problem))


@cache
def small(name: str, form: Form = CORRECTED, rho: float = 0.7) -> Network:
    """A problem of the suite over four stages, with unit time constants."""
    return synthesize(decompose(SUITE[name].problem.with_horizon(4), form), rho=rho)


@cache
def coordinated(name: str) -> Network:
    """The same with time constants and coordinators in closed form."""
    network = small(name)
    linear = Linearisation(network).at(network.start_state)
    return apply_gains(network, closed_form(linear, GainRule()))


@cache
def wired_with(name: str, kind: PreconditionerKind) -> Network:
    """The same with a preconditioner of any kind: from its start, with the time constants that
    belong.
    """
    if kind in STIFFNESSES:
        return with_stiffness(small(name), kind)
    if kind is PreconditionerKind.DIAGONAL:
        return replace(coordinated(name), preconditioner=Diagonal())
    network = small(name)
    linear = Linearisation(network).at(network.start_state)
    return apply_gains(network, closed_form(linear, GainRule(kind=kind)))


def near_start(network: Network, seed: int, count: int | None = None) -> np.ndarray:
    """Random states in the domain of every function block: the start and a hundredth around it.

    A tenth of a scale is already outside for the reactor, whose temperature may stray far.
    """
    shape = network.size if count is None else (count, network.size)
    noise = np.random.default_rng(seed).standard_normal(shape)
    return network.start_state + 0.01 * noise


def slower(network: Network, c: float) -> Network:
    """The same network with every time constant c times as long."""
    neurons = tuple(replace(n, tau=np.asarray(n.tau) * c) for n in network.cell.neurons)
    preconditioner = network.preconditioner
    if isinstance(preconditioner, Multilevel):
        preconditioner = replace(
            preconditioner, gains=tuple(gain / c for gain in preconditioner.gains)
        )
    return replace(
        network, cell=replace(network.cell, neurons=neurons), preconditioner=preconditioner
    )
