"""The NumPy evaluator: batches, complex states, the preconditioner as a matrix."""

import numpy as np
import pytest
from designs import coordinated, near_start, small
from problems import SUITE

from ann_dc.evaluation.reference import evaluator, tape_with_penalty

TINY = 1e-30


def assert_close(actual, expected, relative=1e-12) -> None:
    scale = np.abs(expected).max()
    np.testing.assert_allclose(actual, expected, rtol=relative, atol=relative * scale)


@pytest.mark.parametrize("wired", [small, coordinated])
@pytest.mark.parametrize("name", SUITE)
class TestEveryProblem:
    def test_jacobian_is_the_complex_step(self, name, wired):
        network = wired(name)
        x = near_start(network, 2)
        stepped = evaluator(network).rhs(x + 1j * TINY * np.eye(len(x)))
        assert_close(evaluator(network).jacobian(x), np.imag(stepped).T / TINY)

    def test_a_batch_is_its_members(self, name, wired):
        network = wired(name)
        batch = near_start(network, 3, count=4).reshape(2, 2, -1)
        derivatives = evaluator(network).rhs(batch)
        assert derivatives.shape == batch.shape
        for place in np.ndindex(2, 2):
            np.testing.assert_allclose(
                derivatives[place], evaluator(network).rhs(batch[place]), rtol=1e-13
            )


@pytest.mark.parametrize("name", ["car", "lq_unst", "cart_pole"])
class TestCoordinators:
    def test_flow_is_the_preconditioner_times_the_drives(self, name):
        network = coordinated(name)
        x = near_start(network, 5)
        reference, preconditioner = evaluator(network), evaluator(network).preconditioner
        assert_close(reference.rhs(x), preconditioner @ network.pack(reference.drives(x)))
        assert_close(reference.jacobian(x), preconditioner @ reference.drive_jacobian(x).toarray())

    def test_preconditioner_is_symmetric_positive_definite(self, name):
        preconditioner = evaluator(coordinated(name)).preconditioner.toarray()
        assert_close(preconditioner, preconditioner.T, 1e-14)
        assert np.linalg.eigvalsh(preconditioner)[0] > 0


def test_a_network_keeps_its_evaluator():
    network = small("car")
    assert evaluator(network) is evaluator(network)


def test_one_reader_per_node_value():
    network = small("car")
    x = near_start(network, 6)
    cosine = next(b for b in network.cell.blocks if getattr(b, "function", "") == "cos")
    phi = network.neuron("q.phi").scale.user(network.unpack(x)[network.neuron_index["q.phi"]])
    np.testing.assert_allclose(evaluator(network).node(x, cosine.name), np.cos(phi), rtol=1e-14)


def test_another_penalty_is_another_weight():
    network = small("car", rho=0.7)
    edges = evaluator(network).edges
    tape = tape_with_penalty(network, 0.25)
    for dual in network.cell.duals:
        assert (evaluator(network).tape.weights[edges[dual.path]] == 0.7).all()
        assert (tape.weights[edges[dual.path]] == 0.25).all()
