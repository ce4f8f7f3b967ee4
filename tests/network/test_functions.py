"""A function block in one table: right in every evaluator and export, or refused by name."""

import sys

import numpy as np
import pytest
import sympy as sp
from torch_evaluator import TorchEvaluator

from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.errors import AnnDcError, ExportError, NetworkError, ProblemError, SynthesisError
from ann_dc.evaluation import formulas
from ann_dc.evaluation.codegen.evaluator import GeneratedEvaluator, fast_evaluator
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import ReferenceEvaluator
from ann_dc.export.catalogue import FORMATS
from ann_dc.export.drawings import latex_symbols
from ann_dc.export.netlists import verilog_library
from ann_dc.export.reference.vector import reference_vector
from ann_dc.network.cell import Cell, Connection, Function, Neuron
from ann_dc.network.functions import (
    ARITHMETIC,
    CHOICES,
    ELEMENTARY,
    FUNCTIONS,
    NUMPY,
    OPERATIONS,
    folded,
    function_block,
)
from ann_dc.network.network import Network
from ann_dc.problem import named_functions
from ann_dc.synthesis import adjoint
from ann_dc.synthesis.adjoint import gradient
from ann_dc.synthesis.wiring import Wiring

FunctionBlock = type(FUNCTIONS[0])
SOFTPLUS = FunctionBlock(
    name="softplus",
    formula=lambda lib, x: lib.log(1 + lib.exp(x)),
    slope_formula=lambda lib, x, y: 1 - lib.exp(-y),
)
LOGISTIC = FunctionBlock(
    name="logistic",
    formula=lambda lib, x: 1 / (1 + lib.exp(-x)),
    slope_formula=lambda lib, x, y: y * (1 - y) / 1.0,
)
WAVE = FunctionBlock(
    name="wave",
    formula=lambda lib, x: 2 - lib.arctan(x) * lib.sin(x) + lib.sqrt(x * x + 1) - lib.cosh(x) / 9,
    slope_formula=lambda lib, x, y: (
        x / lib.sqrt(x * x + 1)
        - lib.sin(x) / (1 + x * x)
        - lib.arctan(x) * lib.cos(x)
        - lib.sinh(x) / 9
    ),
)
OPAQUE = FunctionBlock(
    name="opaque",
    formula=lambda lib, x: lib.log1p(lib.exp(x)),
    slope_formula=lambda lib, x, y: 1 - lib.exp(-y),
)
LEAKY = FunctionBlock(
    name="leaky",
    formula=lambda lib, x: lib.where(lib.real(x) > 0, x, 0.1 * x),
    slope_formula=lambda lib, x, y: lib.where(lib.real(x) <= 0, 0.1 * lib.ones_like(x), 1.0),
)
BLOCKS = {block.name: block for block in (SOFTPLUS, LOGISTIC, WAVE, LEAKY, OPAQUE)}
VALUES = {
    "softplus": np.log(1 + np.e),
    "logistic": 1 / (1 + np.exp(-1.0)),
    "wave": 2 - np.pi / 4 * np.sin(1) + np.sqrt(2) - np.cosh(1) / 9,
    "leaky": 1.0,
    "opaque": np.log(1 + np.e),
}
EVALUATORS = (
    ReferenceEvaluator, InterpretedEvaluator, GeneratedEvaluator, fast_evaluator, TorchEvaluator,
)  # fmt: skip
every_block = pytest.mark.parametrize("name", BLOCKS)


@pytest.fixture(autouse=True)
def added(monkeypatch):
    """The function blocks in the table, wherever it was imported."""
    old, new = FUNCTIONS, (*FUNCTIONS, *BLOCKS.values())
    codes = sys.modules[function_block.__module__].CODE
    for code, block in enumerate(new):
        monkeypatch.setitem(codes, block.name, code)
    for module in [*sys.modules.values()]:
        if getattr(module, "FUNCTIONS", None) is old:
            monkeypatch.setattr(module, "FUNCTIONS", new)


def network_of(name: str, stages: int = 2) -> Network:
    """dx/ds = g(1) - g(x), dv/ds = x - v."""
    level = Connection(source="one", target="x", weight=float(VALUES[name]))
    return Network(
        stages=stages,
        cell=Cell(
            neurons=(Neuron(name="x"), Neuron(name="v")),
            blocks=(Function(name="s", function=name, x="x"),),
            connections=(
                *(level, Connection(source="s", target="x", weight=-1.0)),
                *(Connection(source=n, target="v", weight=w) for n, w in (("x", 1.0), ("v", -1.0))),
            ),
        ),
        start={"x": 0.7},
    )


def answer(name: str, function, *arguments):
    """What a function returns; None if it refuses the function block by name."""
    try:
        return function(*arguments)
    except AnnDcError as error:
        assert repr(name) in str(error) or f"function {name}" in str(error), error  # noqa: PT017
        return None


@pytest.mark.sampled(22)
@every_block
@pytest.mark.parametrize("kind", EVALUATORS, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("stages", [1, 2, 7])
def test_evaluators_are_right_or_refuse_by_name(stages, kind, name):
    network, block = network_of(name, stages), BLOCKS[name]
    made = answer(name, kind, network)
    if made is None:
        assert kind is InterpretedEvaluator or name == "opaque"
        return
    x = np.linspace(-1.3, 1.9, network.size)
    states = network.unpack(x)[network.cell.neurons.index(network.neuron("x"))]
    drives = network.unpack(made.rhs(x))[network.cell.neurons.index(network.neuron("x"))]
    value = block.value(states)
    np.testing.assert_allclose(drives, VALUES[name] - value, rtol=1e-12, atol=1e-12)
    slopes = np.diag(made.drive_jacobian(x).toarray())
    places = network.unpack(slopes)[network.cell.neurons.index(network.neuron("x"))]
    complex_step = np.imag(block.value(states + 1e-30j)) / 1e-30
    np.testing.assert_allclose(places, -complex_step, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", ["softplus", "logistic"])
@pytest.mark.parametrize("backend", [OdeBackend(), RecurrentBackend()], ids=["ode", "recurrent"])
def test_runs_settle_where_the_formula_says(backend, name):
    run = backend.run(network_of(name))
    assert run.status.settled
    np.testing.assert_allclose(run.trajectory.final, 1.0, atol=1e-6)


@every_block
def test_a_circuit_without_a_cell_is_refused_by_name(name):
    assert answer(name, SpiceBackend().run, network_of(name)) is None


@pytest.mark.sampled(3)
@pytest.mark.parametrize("form", FORMATS)
def test_exports_pass_their_own_check_or_refuse_by_name(form):
    network = network_of("softplus")
    vector = reference_vector(network)
    files = answer("softplus", FORMATS[form].write, network, vector)
    if files is not None:
        assert FORMATS[form].check(files)


def test_a_formula_that_is_no_tree_is_refused_by_name():
    with pytest.raises(NetworkError, match=r"'opaque'.*'log1p'"):
        _ = OPAQUE.trees


def test_an_adjoint_is_wired_from_the_slope():
    wiring = Wiring(["x"])
    x = wiring.signal("x")
    slopes = gradient(wiring, wiring.function("softplus", x), [next(iter(x))[0]])
    (signal,) = slopes.values()
    inner = wiring.functions[next(atom for (*_, atom) in filter(None, signal))]
    assert signal[()] == 1.0
    assert sorted(signal.values()) == [-1.0, 1.0]
    assert inner[0] == "exp"
    assert wiring.sums[inner[1]] == {(wiring.atom(wiring.function("softplus", x)),): -1.0}


def test_an_adjoint_with_a_choice_is_refused_by_name():
    wiring = Wiring(["x"])
    x = wiring.signal("x")
    with pytest.raises(SynthesisError, match=r"'rectify'.*'where'"):
        gradient(wiring, wiring.function("rectify", x), [next(iter(x))[0]])


def test_a_formula_that_computes_with_a_condition_is_refused_by_name():
    step = FunctionBlock(
        name="ramp", formula=lambda lib, x: (x > 0) * x, slope_formula=lambda lib, x, y: 1.0 * x
    )
    with pytest.raises(NetworkError, match="'ramp'"):
        _ = step.trees


LIBRARIES = {
    "loops": (formulas._FORMS, ()),
    "NumPy program": (NUMPY, ()),
    "Verilog-A": (verilog_library.FORMS, ()),
    "LaTeX": (latex_symbols.FORMS, ("where", "at_most", "above")),
    "SymPy": (named_functions._LIBRARY, CHOICES),
    "adjoint": (adjoint._library(Wiring([])), CHOICES),
}
"""Operations of realisations, and those that a realisation refuses by name.

Generated code and ONNX have all: `test_contract` and `test_functions` of ONNX run every block."""


@pytest.mark.parametrize("realisation", LIBRARIES)
def test_a_realisation_has_every_operation_or_refuses_it(realisation):
    library, refused = LIBRARIES[realisation]
    assert set(OPERATIONS) - set(library) == set(refused)
    assert set(library) <= set(OPERATIONS)


@pytest.mark.parametrize("block", FUNCTIONS, ids=lambda block: block.name)
def test_trees_compute_the_formulas(block):
    library = ARITHMETIC | {name: getattr(np, other) for other, name in ELEMENTARY.items()}
    library |= {"maximum": np.maximum, "where": np.where, "at_most": np.less_equal}
    library |= {"above": np.greater}
    x = np.linspace(*np.clip(block.domain, -2.0, 2.0), 8)[1:-1]
    value, slope = block.trees
    y = folded(value, {"x": x}, library)
    np.testing.assert_array_equal(y, block.value(x))
    np.testing.assert_array_equal(folded(slope, {"x": x, "y": y}, library), block.slope(x, y))


def test_a_choice_is_refused_by_name_in_latex_and_in_a_problem():
    with pytest.raises(ExportError, match=r"'leaky'.*'where'"):
        latex_symbols.applied("leaky", "x")
    made = named_functions._class_of(LEAKY)
    with pytest.raises(ProblemError, match=r"'leaky' is not smooth.*'where'"):
        made(sp.Symbol("x")).diff()
