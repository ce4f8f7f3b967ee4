"""Networks of which netlists are written, each designed once."""

import pytest

import ann_dc
from ann_dc.export.reference.vector import ReferenceVector, reference_vector
from ann_dc.network.network import Network


def designed(problem: ann_dc.OptimalControlProblem) -> tuple[Network, ReferenceVector]:
    network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    return network, reference_vector(network)


@pytest.fixture(scope="session")
def car() -> tuple[Network, ReferenceVector]:
    return designed(ann_dc.plants.car())


@pytest.fixture(scope="session")
def small() -> tuple[Network, ReferenceVector]:
    return designed(ann_dc.plants.double_integrator(N=3))
