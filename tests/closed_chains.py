"""Networks whose stages can be solved by themselves, for the two-level algorithm."""

from functools import cache

import numpy as np
from reference import ipopt

from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import switch
from ann_dc.evaluation.populations import neuron_values
from ann_dc.gain_design.procedure import Design, design
from ann_dc.network.network import COORDINATION, Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.solution.solution import certificate_of
from ann_dc.solver import synthesize
from ann_dc.two_level.levels import TwoLevels
from ann_dc.two_level.upper_gains import UpperGains, UpperMap
from ann_dc.two_level.upper_level import Gradient

NEURON = switch("S14")


CAR = plants.car()


@cache
def closed_chain(problem: OptimalControlProblem) -> Design:
    """Closing B: q_0 is a neuron. The penalty that suits a grid makes the upper level slow."""
    return design(
        synthesize(decompose(problem, NEURON)), preconditioner=PreconditionerKind.MULTILEVEL
    )


@cache
def best(problem: OptimalControlProblem) -> UpperGains:
    found = closed_chain(problem)
    return UpperMap(network=found.network, settled=found.state).best()


def gradient(problem: OptimalControlProblem) -> Gradient:
    gains = best(problem)
    return Gradient(lambda_t=gains.lambda_t, lambda_beta=gains.lambda_beta)


def two_level(problem=CAR, *, upper=None, lower=None) -> TwoLevels:
    upper = upper or gradient(problem)
    return TwoLevels(closed_chain(problem).network, upper=upper, lower=lower)


def near(problem, size: float, seed: int = 0) -> np.ndarray:
    """The solution and a normal deviation."""
    state = closed_chain(problem).state
    return state + size * np.random.default_rng(seed).standard_normal(len(state))


def coordination(network: Network, states: np.ndarray) -> np.ndarray:
    """t and beta of states (..., n)."""
    return states[..., network.of_population(*COORDINATION)]


def assert_ipopts_optimum(problem, network, x) -> None:
    reference = ipopt(problem)
    certificate, values = certificate_of(problem, network, x), neuron_values(network, x)
    assert certificate.certified
    np.testing.assert_allclose(certificate.objective, reference.objective, rtol=1e-6)
    scale = np.abs(reference.q).max()
    np.testing.assert_allclose(values["t"].T, reference.q[:, 1:], atol=1e-5 * scale)
    scale = np.abs(reference.u).max()
    np.testing.assert_allclose(values["u"].T, reference.u, atol=1e-5 * scale)


CONVEX = {"lq": plants.lq(N=4, state_weight=10.0), "least effort": plants.double_integrator(N=4)}
