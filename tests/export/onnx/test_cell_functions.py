"""Function blocks in onnxruntime, against those of NumPy."""

import numpy as np
import pytest
from onnx_runs import OnnxNetwork

from ann_dc.network.cell import Cell, Connection, Function, Neuron
from ann_dc.network.functions import FUNCTIONS, function_block
from ann_dc.network.network import Network

SMALL = np.logspace(-12, 0, 49)
BOTH = np.concatenate([-SMALL, SMALL, [-7.0, -3.0, 3.0, 7.0]])
NEAR_ONE = np.concatenate([0.99 * BOTH[:98], SMALL - 1, 1 - SMALL, [0.5]])
ARGUMENTS = {
    "tan": np.concatenate([1.5 * BOTH[:98], [1.5707, -1.5707]]),
    "log": np.concatenate([SMALL, 1 + SMALL, [50.0]]),
    "sqrt": np.concatenate([SMALL, [9.0]]),
    "asin": NEAR_ONE,
    "acos": NEAR_ONE,
    "atan": np.concatenate([BOTH, 1 / BOTH]),
}
"""Where a function is not defined everywhere, or ends are of interest."""
TINY = {"sigmoid": 0.1}
"""Absolute errors in units of rounding errors: a sigmoid is one half, and a half of a tanh."""
ROUNDING = {"float64": 2e-15, "float32": 1e-6}


def of(function: str, arguments: np.ndarray) -> Network:
    """x' = g(argument), with an argument a stage."""
    cell = Cell(
        neurons=(Neuron(name="x"),),
        inputs=("argument",),
        blocks=(Function(name="value", function=function, x="argument"),),
        connections=(Connection(source="value", target="x"),),
    )
    return Network(cell=cell, stages=len(arguments), inputs={"argument": arguments})


@pytest.mark.sampled(24)
@pytest.mark.parametrize("precision", ROUNDING)
@pytest.mark.parametrize("function", [block.name for block in FUNCTIONS])
def test_a_function_is_exact_to_rounding(function, precision):
    arguments = ARGUMENTS.get(function, BOTH).astype(precision).astype(float)
    arguments = arguments[np.abs(arguments) < 1] if function in ("asin", "acos") else arguments
    onnx = OnnxNetwork(of(function, arguments), precision)
    values, residual = onnx.step(np.zeros((1, len(arguments), 1)), 1.0)
    wanted = function_block(function).value(arguments)
    np.testing.assert_allclose(
        values[0, :, 0],
        wanted,
        rtol=ROUNDING[precision],
        atol=TINY.get(function, 1e-300) * ROUNDING[precision],
    )
    assert np.isfinite(residual[0])


LIMITED = [block.name for block in FUNCTIONS if block.is_limited]


@pytest.mark.parametrize("function", LIMITED)
def test_outside_its_domain_the_residual_is_infinite(function):
    low, high = function_block(function).domain
    ends = [end for end in (low, high) if np.isfinite(end)] or [0.0]
    inside = OnnxNetwork(of(function, np.full(2, 0.5)))
    for end in ends:
        beyond = end + 0.01 * np.sign(end - 0.5)
        for argument in (end, beyond) if function != "reciprocal" else (end,):
            given = inside.number([[[0.5], [argument]]])
            assert inside.step(np.zeros((1, 2, 1)), 1.0, given)[1] == np.inf
    assert inside.step(np.zeros((1, 2, 1)), 1.0)[1] < np.inf
