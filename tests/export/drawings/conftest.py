"""The network that is drawn wherever any will do, and its walk."""

import pytest

import ann_dc
from ann_dc.export.reference.vector import reference_vector
from ann_dc.network.network import Network


@pytest.fixture(scope="session")
def network() -> Network:
    kinds = [ann_dc.PreconditionerKind.DIAGONAL]
    return ann_dc.design(ann_dc.plants.double_integrator(N=5), preconditioner=kinds).network


@pytest.fixture(scope="session")
def vector(network):
    return reference_vector(network)
