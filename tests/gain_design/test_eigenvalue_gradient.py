"""Objectives and their gradients: finite differences, closed forms, invariance."""

from dataclasses import replace

import numpy as np
import pytest
from designs import coordinated

from ann_dc.analysis.objectives import SETTLING_TIME, STEPS, TWO_PHASE_STEPS
from ann_dc.analysis.saddle import saddle_of
from ann_dc.analysis.spectra import spectrum
from ann_dc.gain_design.eigenvalue_gradient import DenseFlow, dense_preconditioner
from ann_dc.gain_design.gains import Gains, apply_gains
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Preconditioner, PreconditionerKind
from ann_dc.network.preconditioners.cyclic_reduction import CyclicReduction
from ann_dc.network.preconditioners.multilevel import Multilevel
from ann_dc.network.preconditioners.resistive_grid import ResistiveGrid

OBJECTIVES = pytest.mark.parametrize(
    "objective", [SETTLING_TIME, STEPS, TWO_PHASE_STEPS], ids=["time", "steps", "two-phase"]
)
STEP = 0.05


def coupled(pyramid: Multilevel) -> Multilevel:
    """With another direction of the components at every grid point."""
    rng, C = np.random.default_rng(3), pyramid.chains
    turns = [np.linalg.qr(rng.standard_normal((len(S), C, C)))[0] for S in pyramid.gains]
    turned = (Q @ S @ Q.transpose(0, 2, 1) for Q, S in zip(turns, pyramid.gains))
    return Multilevel(gains=tuple(0.5 * (S + S.transpose(0, 2, 1)) for S in turned))


def between(network: Network, kind: type[ResistiveGrid] | type[CyclicReduction]) -> Preconditioner:
    """A stiffness of no plant: one within, a third of it spread over the neighbours."""
    m, rng = len(network.layout.primal), np.random.default_rng(4)
    own = rng.uniform(-0.3, 0.3, (network.stages, m, m)) / m
    following = rng.uniform(-0.3, 0.3, (network.stages - 1, m, m)) / m
    return kind(own=np.eye(m) + own + own.transpose(0, 2, 1), following=following)


def wired(kind: PreconditionerKind) -> Network:
    """The van der Pol oscillator over four stages with one kind of preconditioner."""
    network = coordinated("van_der_pol")
    assert isinstance(network.preconditioner, Multilevel)
    preconditioner: dict[PreconditionerKind, Preconditioner] = {
        PreconditionerKind.MULTILEVEL: network.preconditioner,
        PreconditionerKind.COUPLED_MULTILEVEL: coupled(network.preconditioner),
        PreconditionerKind.RESISTIVE_GRID: between(network, ResistiveGrid),
        PreconditionerKind.CYCLIC_REDUCTION: between(network, CyclicReduction),
    }
    return (
        replace(network, preconditioner=preconditioner[kind]) if kind in preconditioner else network
    )


def flow_of(network: Network) -> tuple[DenseFlow, np.ndarray]:
    """The flow at the start, and gains drawn at random around 1, with `STEP`."""
    saddle = saddle_of(network, network.start_state)
    preconditioner = dense_preconditioner(network.preconditioner, network.layout, saddle.primal)
    nodes = network.preconditioner.size if isinstance(network.preconditioner, Multilevel) else 0
    count = len(saddle.primal) + 2 * len(saddle.dual) + nodes + 1
    gains = np.exp(0.3 * np.random.default_rng(5).standard_normal(count))
    gains[-1] = STEP
    return DenseFlow(saddle=saddle, preconditioner=preconditioner), gains


@OBJECTIVES
@pytest.mark.parametrize("floor", [1e-4, 10.0], ids=["settles", "below the floor"])
@pytest.mark.parametrize(
    "kind",
    [
        PreconditionerKind.MULTILEVEL,
        PreconditionerKind.COUPLED_MULTILEVEL,
        PreconditionerKind.RESISTIVE_GRID,
        PreconditionerKind.CYCLIC_REDUCTION,
    ],
)
@pytest.mark.sampled
def test_the_gradient_is_that_of_finite_differences(kind, floor, objective):
    flow, gains = flow_of(wired(kind))

    def value(logs):
        return flow.smoothed(gains * np.exp(logs), objective, 8.0, floor).value

    found = flow.smoothed(gains, objective, 8.0, floor).gradient
    steps = 1e-5 * np.eye(len(gains))
    differences = [(value(step) - value(-step)) / 2e-5 for step in steps]
    np.testing.assert_allclose(found, differences, atol=1e-6 * np.abs(found).max())


@pytest.mark.parametrize("kind", list(PreconditionerKind))
def test_the_flow_is_that_of_the_network(kind):
    network = wired(kind) if kind is not PreconditionerKind.DIAGONAL else coordinated("van_der_pol")
    if kind is PreconditionerKind.DIAGONAL:
        network = apply_gains(network, Gains(rho=rho_of(network), rate=network.layout.rates + 1e-9))
    x = network.start_state
    flow, gains = flow_of(network)
    saddle, (neuron, _) = flow.saddle, network.places.T
    z, d = len(saddle.primal), len(saddle.dual)
    gains[:z] = network.layout.state_rates[saddle.primal]
    gains[z : z + d] = network.layout.state_rates[saddle.dual]
    gains[z + d : z + 2 * d] = rho_of(network)[neuron[saddle.dual]]
    gains[z + 2 * d : -1] = 1.0
    expected = np.sort_complex(spectrum(network, x).eigenvalues)
    found = np.sort_complex(np.linalg.eigvals(flow.jacobian(gains, SETTLING_TIME)))
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


def rho_of(network: Network) -> np.ndarray:
    weights = {c.name: c.weight for c in network.cell.connections}
    rho = np.zeros(len(network.cell.neurons))
    for dual in network.cell.duals:
        rho[network.neuron_index[dual.neuron]] = weights[dual.path]
    return rho


def test_two_phase_acts_as_more_penalty():
    """The eigenvalues are those of rho + h / tau_dual, all at once."""
    flow, gains = flow_of(wired(PreconditionerKind.MULTILEVEL))
    _, K, _, _, (h,) = flow.split(gains)
    more, (z, d) = gains.copy(), (len(flow.saddle.primal), len(flow.saddle.dual))
    more[z + d : z + 2 * d] += h * K
    np.testing.assert_array_equal(flow.jacobian(gains, TWO_PHASE_STEPS), flow.jacobian(more, STEPS))
