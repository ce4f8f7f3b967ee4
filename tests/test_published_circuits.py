"""Circuits that others have published for inequalities, wired by hand."""

import numpy as np
import pytest
from simulator import needs_ngspice

import ann_dc
from ann_dc.backends.status import Outcome
from ann_dc.hardware.parts.levels import macro
from ann_dc.network.cell import ONE, Cell, Connection, Function, Limiter, Neuron, Sum
from ann_dc.network.network import Network


def wires(target: str, **weights: float) -> list[Connection]:
    """What arrives at a neuron or a sum, by its source; ``one`` is a bias."""
    names = {"one": ONE}
    return [Connection(source=names.get(s, s), target=target, weight=w) for s, w in weights.items()]


def programming_circuit(conductance: float) -> Network:
    """Kennedy and Chua's: a capacitor a variable, a current g max(0, f) a constraint.

    It minimises 2 x^2 + x y + y^2 - 12 x - 10 y where f = x + y - 4 is not positive.

    References
    ----------
    .. [1] M. P. Kennedy, L. O. Chua, Neural networks for nonlinear programming, IEEE Transactions
       on Circuits and Systems 35, 1988.
    """
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="y")),
        blocks=(Sum(name="f"), Function(name="i", function="rectify", x="f")),
        connections=(
            *wires("x", x=-4.0, y=-1.0, one=12.0, i=-conductance),
            *wires("y", x=-1.0, y=-2.0, one=10.0, i=-conductance),
            *wires("f", x=1.0, y=1.0, one=-4.0),
        ),
    )
    return Network(cell=cell, stages=1)


def closed_form(conductance: float) -> np.ndarray:
    """Where the gradient and the currents balance."""
    H, a = np.array([[4.0, 1.0], [1.0, 2.0]]), np.ones(2)
    right = np.array([12.0, 10.0]) + 4.0 * conductance * a
    return np.linalg.solve(H + conductance * np.outer(a, a), right)


@pytest.mark.parametrize("conductance", [1.0, 10.0, 100.0])
def test_a_programming_circuit_settles_where_its_currents_balance(conductance):
    run = ann_dc.OdeBackend().run(programming_circuit(conductance))
    assert run.status.settled
    np.testing.assert_allclose(run.trajectory.final, closed_form(conductance), rtol=1e-6)


def test_a_large_conductance_comes_near_the_constrained_optimum():
    np.testing.assert_allclose(closed_form(1e6), [1.5, 2.5], atol=1e-5)


@needs_ngspice
def test_the_programming_circuit_in_ngspice():
    run = ann_dc.SpiceBackend(level=macro(a0=1e6)).run(programming_circuit(100.0))
    np.testing.assert_allclose(run.trajectory.final, closed_form(100.0), rtol=3e-4)


BITS = 4


def converter() -> Network:
    """Tank and Hopfield's: sigmoids V of what is charged, which find the bits of an input.

    References
    ----------
    .. [1] D. W. Tank, J. J. Hopfield, Simple 'neural' optimization networks, IEEE Transactions on
       Circuits and Systems 33, 1986.
    """
    blocks, connections = [], []
    for i in range(BITS):
        names = f"steep.{i}", f"tanh.{i}", f"V.{i}"
        blocks += [
            Sum(name=names[0]), Function(name=names[1], function="tanh", x=names[0]),
            Sum(name=names[2]),
        ]  # fmt: skip
        connections += wires(names[0], **{f"u.{i}": 50.0})
        connections += wires(names[2], **{names[1]: 0.5}, one=0.5)
        others = {f"V.{j}": -(2.0 ** (i + j)) for j in range(BITS) if j != i}
        bias = -(2.0 ** (2 * i - 1))
        connections += wires(f"u.{i}", **{f"u.{i}": -1.0}, **others, one=bias, x=2.0**i)
    cell = Cell(
        neurons=tuple(Neuron(name=f"u.{i}") for i in range(BITS)),
        inputs=("x",),
        blocks=tuple(blocks),
        connections=tuple(connections),
    )
    return Network(cell=cell, stages=1, inputs={"x": 0.0})


@pytest.mark.slow
def test_a_converter_that_is_reset_finds_all_codes():
    network = converter()
    codes = np.arange(2.0**BITS)
    batch = ann_dc.OdeBackend().run_batch(network, {"x": codes}, x=np.zeros(BITS))
    assert batch.outcomes == (Outcome.SETTLED,) * len(codes)
    np.testing.assert_array_equal((batch.states > 0) @ 2.0 ** np.arange(BITS), codes)


def test_a_converter_that_is_not_reset_may_find_another_code():
    """Its energy has local minima."""
    rng = np.random.default_rng(0)
    starts = rng.normal(size=(64, BITS))
    batch = ann_dc.OdeBackend().run_batch(converter(), {"x": np.full(64, 7.0)}, x=starts)
    found = (batch.states[batch.settled] > 0) @ 2.0 ** np.arange(BITS)
    assert {7.0} < set(found.tolist())


def linear_program(penalty: float = 1.0) -> Network:
    """min -x - 2 y where x + y <= 4, x + 3 y <= 6, x >= 0 and y >= 0: rails, and diode neurons.

    A row's neuron integrates k (m - mu) with m = max(0, mu + w g), which everybody reads.

    References
    ----------
    .. [1] S. Vichik, F. Borrelli, Solving linear and quadratic programs with an analog circuit,
       Computers and Chemical Engineering 70, 2014.
    """
    rows = {"a": (1.0, 1.0, -4.0), "b": (1.0, 3.0, -6.0)}
    blocks, connections = [], []
    for row, (of_x, of_y, constant) in rows.items():
        blocks += [
            Sum(name=f"s.{row}"),
            Function(name=f"m.{row}", function="rectify", x=f"s.{row}"),
        ]
        at = {"x": penalty * of_x, "y": penalty * of_y, "one": penalty * constant}
        connections += wires(f"s.{row}", **{f"mu.{row}": 1.0}, **at)
        connections += wires(f"mu.{row}", **{f"m.{row}": 1.0, f"mu.{row}": -1.0})
    connections += wires("x", one=1.0, **{"m.a": -1.0, "m.b": -1.0})
    connections += wires("y", one=2.0, **{"m.a": -1.0, "m.b": -3.0})
    positive = Limiter(low=0.0)
    cell = Cell(
        neurons=(
            Neuron(name="x", limiter=positive), Neuron(name="y", limiter=positive),
            Neuron(name="mu.a"), Neuron(name="mu.b"),
        ),
        blocks=tuple(blocks),
        connections=tuple(connections),
    )  # fmt: skip
    return Network(cell=cell, stages=1)


@pytest.mark.parametrize("penalty", [0.3, 1.0, 3.0])
def test_a_linear_program_and_its_duals(penalty):
    network = linear_program(penalty)
    starts = np.random.default_rng(0).uniform(0, 3, (20, network.size))
    for x in starts:
        run = ann_dc.OdeBackend().run(network.with_start(x))
        assert run.status.settled
        np.testing.assert_allclose(run.trajectory.final, [3.0, 1.0, 0.5, 0.5], atol=1e-6)
