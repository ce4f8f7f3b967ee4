"""Networks with abs, sigmoid, sign, maximum and minimum settle where NumPy says, also as circuits.

dx/ds = c - x - g(x) / 2 with c = r + g(r) / 2 settles at r, because x + g(x) / 2 rises with x.
"""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings, strategies as st
from simulator import needs_ngspice
from torch_evaluator import TorchEvaluator

import ann_dc
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.errors import AnnDcError, ExportError, NetworkError, ProblemError, SynthesisError
from ann_dc.evaluation.codegen.evaluator import GeneratedEvaluator
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import ReferenceEvaluator
from ann_dc.export.catalogue import FORMATS
from ann_dc.export.drawings import latex_symbols
from ann_dc.export.netlists.verilog_library import function_module
from ann_dc.export.reference.vector import reference_vector
from ann_dc.hardware.parts.generator_curves import Breakpoints
from ann_dc.hardware.parts.levels import BEHAVIOURAL, macro, transistor
from ann_dc.network import Cell, Connection, Function, Network, Neuron, maximum, minimum
from ann_dc.network.functions import CODE, function_block
from ann_dc.optimality.certificate import certify
from ann_dc.optimality.reference_solvers import ipopt_point
from ann_dc.problem.expression import parse_expression
from ann_dc.synthesis.adjoint import gradient
from ann_dc.synthesis.wiring import Wiring

RESTS = np.array([-0.8, -0.25, 0.4, 1.0])
LIMIT = 0.3
VALUES = {
    "abs": np.abs,
    "sigmoid": lambda x: 1 / (1 + np.exp(-x)),
    "sign": np.sign,
    "maximum": lambda x: np.maximum(x, LIMIT),
    "minimum": lambda x: np.minimum(x, LIMIT),
}
SLOPES = {
    "abs": np.sign,
    "sigmoid": lambda x: np.exp(-x) / (1 + np.exp(-x)) ** 2,
    "sign": np.zeros_like,
    "maximum": lambda x: 1.0 * (x > LIMIT),
    "minimum": lambda x: 1.0 * (x < LIMIT),
}
EVALUATORS = (ReferenceEvaluator, InterpretedEvaluator, GeneratedEvaluator, TorchEvaluator)
every_block = pytest.mark.parametrize("name", VALUES)
every_evaluator = pytest.mark.parametrize("kind", EVALUATORS, ids=lambda kind: kind.__name__)


def network_of(name: str, rests: np.ndarray = RESTS) -> Network:
    if name in CODE:
        blocks, wires = (Function(name="g", function=name, x="x"),), ()
    else:
        blocks, wires = {"maximum": maximum, "minimum": minimum}[name]("g", "x", "limit")
    drives = (("c", 1.0), ("x", -1.0), ("g", -0.5))
    return Network(
        cell=Cell(
            neurons=(Neuron(name="x"),),
            inputs=("c", "limit"),
            blocks=blocks,
            connections=(*wires, *(Connection(source=s, target="x", weight=w) for s, w in drives)),
        ),
        stages=len(rests),
        inputs={"c": rests + VALUES[name](rests) / 2, "limit": LIMIT},
        start={"x": 0.1},
    )


@pytest.mark.sampled(5)
@every_evaluator
@every_block
@settings(max_examples=15, deadline=None)
@given(x=st.lists(st.floats(-9, 9), min_size=len(RESTS), max_size=len(RESTS)).map(np.array))
def test_values_and_slopes_are_those_of_numpy(name, kind, x):
    made, c = kind(network_of(name)), network_of(name).inputs["c"]
    np.testing.assert_allclose(made.rhs(x), c - x - VALUES[name](x) / 2, atol=1e-14)
    slopes = np.diag(made.drive_jacobian(x).toarray())
    if np.abs(x - LIMIT).min() > 0:
        np.testing.assert_allclose(slopes, -1 - SLOPES[name](x) / 2, atol=1e-14)


@every_evaluator
@pytest.mark.parametrize("name", ["abs", "sigmoid", "sign"])
def test_zero_large_and_undefined_arguments(name, kind):
    x = np.array([0.0, -0.0, 710.0, -1e6, np.nan])
    made = kind(network_of(name, np.ones(len(x))))
    c = made.rhs(np.zeros(len(x)))[0] + function_block(name).value(0.0) / 2
    values, slopes = 2 * (c - x - made.rhs(x)), np.diag(made.drive_jacobian(x).toarray())
    wanted = {"abs": (0, 0, 710, 1e6), "sigmoid": (0.5, 0.5, 1, 0), "sign": (0, 0, 1, -1)}[name]
    np.testing.assert_allclose(values[:4], wanted, atol=1e-9)
    assert np.isnan(values[4])
    wanted = {"abs": (0, 0, 1, -1), "sigmoid": (0.25, 0.25, 0, 0), "sign": (0, 0, 0, 0)}[name]
    np.testing.assert_allclose(-2 * (slopes[:4] + 1), wanted, atol=1e-14)


@pytest.mark.sampled(5)
@every_block
@pytest.mark.parametrize("backend", [OdeBackend(), RecurrentBackend()], ids=["ode", "recurrent"])
def test_runs_settle_at_the_closed_form(backend, name):
    run = backend.run(network_of(name))
    assert run.status.settled
    np.testing.assert_allclose(run.trajectory.final, RESTS, atol=1e-6)


@pytest.mark.sampled(6)
@needs_ngspice
@every_block
@pytest.mark.parametrize("level", [BEHAVIOURAL, macro()], ids=["behavioural", "macro"])
def test_circuits_settle_at_the_closed_form(level, name):
    run = SpiceBackend(level=level).run(network_of(name))
    np.testing.assert_allclose(run.trajectory.final, RESTS, atol=2e-3)


@pytest.mark.parametrize("name", ["abs", "sign"])
def test_transistors_refuse_a_corner_or_jump_by_name(name):
    with pytest.raises(NetworkError, match=rf"\b{name}\b"):
        SpiceBackend(level=transistor()).run(network_of(name))


@needs_ngspice
@pytest.mark.parametrize("name", ["abs", "maximum"])
def test_transistors_with_chords_settle_at_the_closed_form(name):
    run = SpiceBackend(level=replace(transistor(), functions=Breakpoints())).run(network_of(name))
    np.testing.assert_allclose(run.trajectory.final, RESTS, atol=5e-3)


def test_a_problem_with_a_sigmoid_has_the_optimum_of_ipopt():
    """The network needs SymPy's derivatives, the solver those of CasADi."""
    x, a = sp.symbols("x a")
    rate = a - parse_expression("sigmoid(3 * x)", {"x": x}, "dynamics.x")
    assert float(rate.diff(x).subs(x, 0.2)) == pytest.approx(-3 * SLOPES["sigmoid"](0.6))
    problem = ann_dc.OptimalControlProblem(
        name="sigmoid", states=(x,), controls=(a,), dynamics=(rate,), dt=0.1,
        cost=a**2 + x**2 / 10, horizon=4, q_0=(0.5,), q_d=(0.7,),
    )  # fmt: skip
    point = ipopt_point(problem)
    assert certify(problem, *point.kkt).certified
    np.testing.assert_allclose(ann_dc.solve(problem)["a"], point.u[0], rtol=1e-5)


@pytest.mark.parametrize("name", ["abs", "sign"])
def test_a_corner_or_jump_is_refused_by_name_where_slopes_are_needed(name):
    wiring = Wiring(["x"])
    x = wiring.signal("x")
    if name == "abs":
        with pytest.raises(SynthesisError, match=r"'abs'.*'where'"):
            gradient(wiring, wiring.function(name, x), [next(iter(x))[0]])
    with pytest.raises(ProblemError, match=f"calls {name}, which is not smooth"):
        parse_expression(f"{name}(x)", {}, "cost")


def test_formulas_in_other_languages():
    assert latex_symbols.applied("abs", "x") == r"\max(-1 \cdot x, x)"
    with pytest.raises(ExportError, match=r"'sign'.*'where'"):
        latex_symbols.applied("sign", "x")
    u = "min(max(sx * V(x), lo), hi)"
    assert f"(0.5 + (0.5 * tanh(0.5 * {u})))" in function_module("sigmoid")
    assert f"max({u}, -1 * {u})" in function_module("abs")
    assert f"({u} > 0.0 ? 1 : ((-1 * {u}) > 0.0 ? -1 : 0.0 * {u}))" in function_module("sign")


@pytest.mark.sampled(12)
@every_block
@pytest.mark.parametrize("form", FORMATS)
def test_exports_pass_their_own_check_or_refuse_by_name(form, name):
    network = network_of(name)
    block = name if name in CODE else "rectify"
    try:
        files = FORMATS[form].write(network, reference_vector(network))
    except AnnDcError as error:
        assert block in str(error)  # noqa: PT017
    else:
        assert FORMATS[form].check(files)
