"""The NumPy reference, the compiled kernel and the exact Jacobian say the same."""

import numpy as np
import pytest
from designs import coordinated, near_start, small
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import SUITE

from ann_dc.decomposition.form import PRINTED, SWITCHES
from ann_dc.evaluation.compiled import CompiledEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.cell import Cell, Connection, Function, Limiter, Neuron, Product, Sum, Template
from ann_dc.network.functions import FUNCTIONS
from ann_dc.network.network import Network

TINY = 1e-30
"""A complex step: so small that it leaves the real part alone."""


def complex_step(function, x: np.ndarray) -> np.ndarray:
    """Jacobian (m, n) of a function of batches (..., n) -> (..., m), exact to rounding."""
    return np.imag(function(x + 1j * TINY * np.eye(len(x)))).T / TINY


def assert_close(actual, expected, relative=1e-12) -> None:
    scale = np.abs(expected).max()
    np.testing.assert_allclose(actual, expected, rtol=relative, atol=relative * scale)


@pytest.mark.parametrize("wired", [small, coordinated])
@pytest.mark.parametrize("name", SUITE)
class TestEveryProblem:
    def test_kernel_is_the_reference(self, name, wired):
        network = wired(name)
        kernel = CompiledEvaluator(network)
        for x in near_start(network, 1, count=3):
            assert_close(kernel.rhs(x), evaluator(network).rhs(x))
            assert_close(kernel.drives(x), evaluator(network).drives(x))
            assert_close(
                kernel.drive_jacobian(x).toarray(), evaluator(network).drive_jacobian(x).toarray()
            )

    def test_jacobian_is_the_complex_step(self, name, wired):
        network = wired(name)
        x = near_start(network, 2)
        assert_close(evaluator(network).jacobian(x), complex_step(evaluator(network).rhs, x))

    def test_a_batch_is_its_members(self, name, wired):
        network = wired(name)
        batch = near_start(network, 3, count=4).reshape(2, 2, -1)
        moves = evaluator(network).rhs(batch)
        assert moves.shape == batch.shape
        for place in np.ndindex(2, 2):
            np.testing.assert_allclose(
                moves[place], evaluator(network).rhs(batch[place]), rtol=1e-13
            )


@pytest.mark.parametrize("form", [*SWITCHES.values(), PRINTED], ids=str)
def test_every_form_of_the_car(form):
    network = small("car", form)
    x = near_start(network, 7)
    assert_close(evaluator(network).jacobian(x), complex_step(evaluator(network).rhs, x))
    assert_close(CompiledEvaluator(network).rhs(x), evaluator(network).rhs(x))
    assert_close(
        CompiledEvaluator(network).drive_jacobian(x).toarray(), evaluator(network).jacobian(x)
    )


@pytest.mark.parametrize("name", SUITE)
def test_a_cell_talks_to_its_neighbours_only(name):
    network = small(name)
    jacobian = evaluator(network).jacobian(near_start(network, 4))
    stage = network.places[:, 1]
    assert not jacobian[np.abs(stage[:, None] - stage) > 1].any()
    assert jacobian[np.abs(stage[:, None] - stage) == 1].any()


@pytest.mark.parametrize("name", ["car", "lq_unst", "cart_pole"])
class TestCoordinators:
    def test_flow_is_the_metric_times_the_drives(self, name):
        network = coordinated(name)
        x = near_start(network, 5)
        program, metric = evaluator(network), evaluator(network).metric
        assert_close(evaluator(network).rhs(x), metric @ network.pack(program.drives(x)))
        assert_close(evaluator(network).jacobian(x), metric @ program.drive_jacobian(x).toarray())
        assert_close(CompiledEvaluator(network).metric(x), metric @ x)

    def test_metric_is_symmetric_positive_definite(self, name):
        metric = evaluator(coordinated(name)).metric.toarray()
        assert_close(metric, metric.T, 1e-14)
        assert np.linalg.eigvalsh(metric)[0] > 0


# ---- every function block ----------------------------------------------------------------------


def one_block(function: str, **neuron) -> Network:
    """One neuron that follows g of itself."""
    cell = Cell(
        neurons=(Neuron(name="x", **neuron),),
        blocks=(Function(name="g", function=function, x="x"),),
        connections=(Connection(source="g", target="x"),),
    )
    return Network(cell=cell, stages=1)


@pytest.mark.parametrize("block", FUNCTIONS, ids=lambda block: block.name)
@settings(max_examples=25, deadline=None)
@given(share=st.floats(0.05, 0.95))
def test_function_blocks(block, share):
    low, high = np.clip(block.domain, -2.0, 2.0)
    network, x = one_block(block.name), np.array([low + share * (high - low)])
    if abs(x[0]) < 1e-3:  # the pole of 1/x, the corner of the rectifier
        return
    assert_close(CompiledEvaluator(network).rhs(x), evaluator(network).rhs(x), 1e-14)
    assert_close(evaluator(network).jacobian(x), complex_step(evaluator(network).rhs, x))
    assert_close(
        CompiledEvaluator(network).drive_jacobian(x).toarray(),
        evaluator(network).jacobian(x),
        1e-14,
    )


def test_function_blocks_are_the_textbook_functions():
    known = {block.name: getattr(np, block.name, None) for block in FUNCTIONS}
    known |= {"reciprocal": lambda x: 1 / x, "rectify": lambda x: np.maximum(x, 0)}
    known |= {"asin": np.arcsin, "acos": np.arccos, "atan": np.arctan}
    for name, function in known.items():
        x = np.array([0.3])
        np.testing.assert_allclose(
            CompiledEvaluator(one_block(name)).rhs(x), function(x), rtol=1e-14
        )


# ---- the template and the limiters -------------------------------------------------------------


def test_sources_in_neighbours_and_ends():
    cell = Cell(
        neurons=(Neuron(name="x", tau=2.0), Neuron(name="y")),
        inputs=("edge",),
        blocks=(Sum(name="s"), Product(name="p", a="s", b="y")),
        connections=(
            Connection(source="x", target="s", template=Template.PREVIOUS, weight=3.0),
            Connection(source="p", target="y"),
            Connection(source="y", target="x", template=Template.NEXT, weight=[1.0, 10.0, 100.0]),
            Connection(source="one", target="x", weight=0.5),
        ),
    )
    network = Network(cell=cell, stages=3, inputs={"edge": 7.0}, left={"x": "edge"})
    x, y = np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0])
    moves = network.unpack(evaluator(network).rhs(network.pack(np.stack([x, y]))))
    np.testing.assert_allclose(moves[0], (np.array([1, 10, 100]) * [5, 6, 0] + 0.5) / 2)
    np.testing.assert_allclose(moves[1], 3 * np.array([7, 1, 2]) * y)


@pytest.mark.parametrize("stages", [1, 2, 5])
def test_a_sum_may_pass_on_what_a_neighbour_hears(stages):
    """s_k = x_{k+1} and x_k' = s_{k+1}: two cells away, as S9 wires it; the row ends in zeros."""
    cell = Cell(
        neurons=(Neuron(name="x"),),
        blocks=(Sum(name="s"),),
        connections=(
            Connection(source="x", target="s", template=Template.NEXT),
            Connection(source="s", target="x", template=Template.NEXT),
        ),
    )
    network, x = Network(cell=cell, stages=stages), np.arange(1.0, stages + 1)
    np.testing.assert_array_equal(evaluator(network).jacobian(x), np.eye(stages, k=2))
    np.testing.assert_array_equal(evaluator(network).rhs(x), np.eye(stages, k=2) @ x)
    np.testing.assert_array_equal(CompiledEvaluator(network).rhs(x), evaluator(network).rhs(x))


@pytest.mark.parametrize("drive", [-1.0, 1.0])
def test_a_rail_stops_what_pushes_outward(drive):
    cell = Cell(
        neurons=(Neuron(name="x", limiter=Limiter(low=-2.0, high=3.0)),),
        inputs=("drive",),
        connections=(Connection(source="drive", target="x"),),
    )
    network = Network(cell=cell, stages=5, inputs={"drive": drive})
    x = np.array([-2.5, -2.0, 0.0, 3.0, 3.5])
    expected = np.where((x <= -2) & (drive < 0) | (x >= 3) & (drive > 0), 0.0, drive)
    np.testing.assert_array_equal(evaluator(network).rhs(x), expected)
    np.testing.assert_array_equal(CompiledEvaluator(network).rhs(x), expected)


def test_a_neuron_at_its_rail_has_no_row():
    network = one_block("exp", limiter=Limiter(high=1.0))
    assert evaluator(network).jacobian([1.0]).tolist() == [[0.0]]
    np.testing.assert_allclose(evaluator(network).jacobian([0.5]), [[np.exp(0.5)]])


def test_one_reader_per_node_value():
    network = small("car")
    x = near_start(network, 6)
    phi = network.unpack(x)[network.neuron_index["q.phi"]]
    np.testing.assert_allclose(evaluator(network).node(x, "cos(phi)"), np.cos(phi), rtol=1e-15)


def test_the_kernel_knows_rails_too():
    network = one_block("exp", limiter=Limiter(high=1.0))
    x = np.array([1.0, 0.5])[: network.size]
    kernel = CompiledEvaluator(network)
    np.testing.assert_array_equal(
        kernel.drive_jacobian(x).toarray(), evaluator(network).drive_jacobian(x).toarray()
    )
