"""Networks that several tests export."""

import pytest

import ann_dc
from ann_dc.export.onnx.files import onnx_files
from ann_dc.export.reference.vector import reference_vector
from ann_dc.network.preconditioners.base import PreconditionerKind


@pytest.fixture(scope="session")
def car() -> ann_dc.Network:
    return ann_dc.design(
        ann_dc.plants.car(), preconditioner=PreconditionerKind.COUPLED_MULTILEVEL
    ).network


@pytest.fixture(scope="session")
def vector(car):
    return reference_vector(car)


@pytest.fixture(scope="session")
def files(car, vector):
    return onnx_files(car, vector)
