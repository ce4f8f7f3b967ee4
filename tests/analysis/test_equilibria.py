"""Newton's method on the drives: closed forms, and states that are near no equilibrium."""

import numpy as np
import pytest
from designs import coordinated, designed
from hypothesis import given, strategies as st

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.errors import ArgumentValueError, NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.cell import Cell, Connection, Limiter, Neuron, Product
from ann_dc.network.network import Network


def wire(source: str, target: str, weight: float = 1.0) -> Connection:
    return Connection(source=source, target=target, weight=weight)


def pair(wires, **settings) -> Network:
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="y")),
        blocks=(Product(name="p", a="x", b="x"),),
        connections=wires,
    )
    return Network(cell=cell, stages=1, title="a pair", **settings)


def test_a_root_in_closed_form():
    """x' = x^2 - 2 rests at the square root of two, y' = x - y at the same."""
    wires = (wire("p", "x"), wire("one", "x", -2.0), wire("x", "y"), wire("y", "y", -1.0))
    x = equilibrium(pair(wires), np.array([1.0, 0.0]))
    np.testing.assert_allclose(x, [np.sqrt(2.0)] * 2, rtol=1e-14)


def test_where_a_design_has_settled():
    design = designed("car")
    x = equilibrium(design.network, design.state)
    np.testing.assert_allclose(x, design.state, atol=1e-3 * np.abs(x).max())
    assert np.abs(evaluator(design.network).drives(x)).max() < 1e-9 * np.abs(x).max()


def test_coordinators_do_not_move_it():
    network = coordinated("double_integrator")
    x = equilibrium(network, network.start_state)
    assert np.abs(evaluator(network).rhs(x)).max() < 1e-9


def test_a_line_of_equilibria_is_refused():
    """x' = y - x, y' = x - y: every x = y."""
    wires = (wire("x", "x", -1.0), wire("y", "x"), wire("x", "y"), wire("y", "y", -1.0))
    with pytest.raises(NetworkError, match="a pair: Newton's method found no equilibrium"):
        equilibrium(pair(wires), np.array([1.0, 0.0]))


@pytest.mark.parametrize("start", [0.3, 1e6, np.inf])
def test_no_equilibrium_no_answer(start):
    """x' = x^2 + 1 has no root."""
    network = pair((wire("p", "x"), wire("one", "x"), wire("y", "y", -1.0)))
    with pytest.raises(NetworkError, match="use its settled state"):
        equilibrium(network, np.array([start, 0.0]))


def test_no_number_is_no_state():
    network = pair((wire("p", "x"), wire("one", "x"), wire("y", "y", -1.0)))
    with pytest.raises(ArgumentValueError, match="x: expected numbers, none of them nan"):
        equilibrium(network, np.array([np.nan, 0.0]))


@pytest.mark.parametrize("start", [0.5, 0.1, 0.0])
def test_it_lies_beyond_no_rail(start):
    """x' = -0.1 - x with x >= 0, and y' = x - y: at the rail, not at -0.1."""
    cell = Cell(
        neurons=(Neuron(name="x", limiter=Limiter(low=0.0)), Neuron(name="y")),
        connections=(
            wire("x", "x", -1.0), wire("one", "x", -0.1), wire("x", "y"), wire("y", "y", -1.0)
        ),
    )  # fmt: skip
    x = equilibrium(Network(cell=cell, stages=1), np.array([start, 0.2]))
    np.testing.assert_allclose(x, 0.0, atol=1e-12)


@given(seed=st.integers(0, 2**32 - 1))
def test_what_is_found_between_rails_is_the_optimum_of_a_box(seed):
    """x' = b - A x, A symmetric and positive, |x| <= 1/2: min x' A x / 2 - b' x, or a refusal."""
    rng = np.random.default_rng(seed)
    size, limiter = 6, Limiter(low=-0.5, high=0.5)
    root = rng.standard_normal((size, size))
    A, b = root @ root.T + 0.5 * np.eye(size), rng.standard_normal(size)
    names = [f"x{i}" for i in range(size)]
    wires = [wire(s, t, -A[i, j]) for i, t in enumerate(names) for j, s in enumerate(names)]
    wires += [wire("one", t, b[i]) for i, t in enumerate(names)]
    neurons = tuple(Neuron(name=name, limiter=limiter) for name in names)
    network = Network(cell=Cell(neurons=neurons, connections=tuple(wires)), stages=1, title="a box")
    try:
        x = equilibrium(network, np.zeros(size))
    except NetworkError:
        return
    drives = b - A @ x
    assert (np.abs(x) <= 0.5).all()
    free = np.abs(x) < 0.5
    np.testing.assert_allclose(drives[free], 0.0, atol=1e-9)
    assert (drives[~free] * x[~free] >= 0).all()
