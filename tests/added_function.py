"""Errors of every realisation of the function block ``softplus``, as JSON; see `values`.

The package on the path has the block; see `tests/network/test_functions_added.py`.
"""

import json
import pickle
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import sympy as sp
from onnx_runs import OnnxNetwork
from torch_evaluator import TorchEvaluator

import ann_dc
from ann_dc.analysis.equilibria import equilibrium
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.errors import AnnDcError
from ann_dc.evaluation.codegen.evaluator import GeneratedEvaluator
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import ReferenceEvaluator
from ann_dc.export.catalogue import FORMATS
from ann_dc.export.readme import readme
from ann_dc.export.reference.vector import reference_vector
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.states import emulated_state
from ann_dc.hardware.parts.levels import macro, transistor
from ann_dc.network.cell import Cell, Connection, Function, Neuron
from ann_dc.network.network import Network
from ann_dc.optimality.certificate import certify
from ann_dc.optimality.reference_solvers import ipopt_point
from ann_dc.problem.expression import parse_expression
from ann_dc.problem.serialisation import expression_of, lines_of
from ann_dc.weights.hashes import content_hash
from ann_dc.weights.network_file import load

X, A = sp.symbols("x a")
SOFTPLUS = parse_expression("softplus(x)", {"x": X}, "dynamics.x")
POINTS = np.linspace(-1.5, 1.9, 7)
VALUES = np.log(1 + np.exp(POINTS))
SLOPES = 1 / (1 + np.exp(-POINTS))
PROBLEM = ann_dc.OptimalControlProblem(
    name="softplus", states=(X,), controls=(A,), dynamics=(A - SOFTPLUS,), dt=0.1,
    cost=A**2 + X**2 / 10, horizon=4, q_0=(0.5,), q_d=(0.7,),
)  # fmt: skip
DIAGONAL = [ann_dc.PreconditionerKind.DIAGONAL]
NETWORK = ann_dc.design(PROBLEM, preconditioner=DIAGONAL).network
BLOCK = Network(
    cell=Cell(
        neurons=(Neuron(name="x"),),
        inputs=("c",),
        blocks=(Function(name="s", function="softplus", x="x"),),
        connections=(
            Connection(source="s", target="x", weight=-1.0),
            Connection(source="c", target="x", weight=1.0),
        ),
    ),
    stages=len(POINTS),
    inputs={"c": VALUES},
    start={"x": 0.5},
)
"""dx/ds = c - softplus(x)."""


def error(found, wanted) -> float:
    return float(np.abs(np.asarray(found, float) - wanted).max() / np.abs(wanted).max())


def of_evaluator(kind) -> float:
    made = kind(BLOCK)
    slopes = np.diag(made.drive_jacobian(POINTS).toarray())
    return max(error(VALUES - made.rhs(POINTS), VALUES), error(-slopes, SLOPES))


def of_onnx(precision: str) -> float:
    states = POINTS[None, :, None]
    after, _ = OnnxNetwork(BLOCK, precision).step(states, 1.0)
    return error(VALUES - (after - states)[0, :, 0], VALUES)


def of_parser() -> float:
    (line,) = lines_of(2 * SOFTPLUS)
    assert expression_of([line], {"x": X}, "cost") == 2 * SOFTPLUS
    assert pickle.loads(pickle.dumps(SOFTPLUS)) == SOFTPLUS
    slope = SOFTPLUS.diff(X)
    values = [float(SOFTPLUS.subs(X, x)) for x in POINTS]
    return max(error(values, VALUES), error([float(slope.subs(X, x)) for x in POINTS], SLOPES))


def of_problem() -> float:
    q, u = POINTS[None, :], np.zeros((1, len(POINTS)))
    functions = PROBLEM.functions
    found = functions.derivatives(q, u, np.zeros_like(q))
    rolled = functions.rollout(POINTS[:1], np.zeros((1, 1)))[0, 1]
    return max(
        error(found.map[0], POINTS - 0.1 * VALUES),
        error(found.jacobian[0, 0], 1 - 0.1 * SLOPES),
        error(rolled, POINTS[0] - 0.1 * VALUES[0]),
    )


def of_casadi() -> float:
    """The optimum of IPOPT, whose derivatives CasADi computes, with its certificate."""
    point = ipopt_point(PROBLEM)
    assert certify(PROBLEM, *point.kkt).certified
    return error(ann_dc.solve(PROBLEM)["a"], point.u[0])


def of_weights() -> float:
    vector = reference_vector(NETWORK)
    files = FORMATS["weights"].write(NETWORK, vector)
    program = readme("weights", FORMATS["weights"], NETWORK, vector, files).decode()
    with tempfile.TemporaryDirectory() as folder:
        for name, content in files.items():
            (Path(folder) / name).write_bytes(content)
        again = load(Path(folder) / "network.safetensors")
        assert content_hash(again) == content_hash(NETWORK)
        code = re.search(r"```python\n(.*?)```", program, re.DOTALL)[1]
        command = [sys.executable, "-I", "-c", code, folder]
        run = subprocess.run(command, capture_output=True, text=True, check=True)
    return max(float(line.split()[1]) for line in run.stdout.splitlines())


def of_circuit(**given) -> float:
    return SpiceBackend(**given).run(NETWORK).control_error


def of_emulation() -> float:
    circuit, probe = SpiceBackend().prepare(NETWORK)
    emulation = emulate(circuit, macro())
    x = equilibrium(emulation.network, emulated_state(emulation, probe.final))
    rows = [i for i, n in enumerate(NETWORK.cell.neurons) if n.name.startswith("u.")]
    return error(emulation.controls(x), NETWORK.unpack(probe.final)[rows])


def of_text(form: str, words: str) -> float:
    files = FORMATS[form].write(NETWORK, reference_vector(NETWORK))
    assert any(words in content.decode() for content in files.values())
    return 0.0


def of_format(form: str) -> float:
    options = {"decades": 3.0} if form == "conductances" else {}
    FORMATS[form].check(FORMATS[form].write(NETWORK, reference_vector(NETWORK), **options))
    return 0.0


CASES = {
    "parser": of_parser,
    "problem": of_problem,
    "reference": lambda: of_evaluator(ReferenceEvaluator),
    "interpreted": lambda: of_evaluator(InterpretedEvaluator),
    "generated": lambda: of_evaluator(GeneratedEvaluator),
    "torch": lambda: of_evaluator(TorchEvaluator),
    "onnx float64": lambda: of_onnx("float64"),
    "onnx float32": lambda: of_onnx("float32"),
    "casadi": of_casadi,
    "weights": of_weights,
    "latex": lambda: of_text("latex", r"\log(1 + \exp("),
    "verilog_a": lambda: of_text("verilog_a", "ln(1 + exp(min(max(sx * V(x), lo), hi)))"),
    "ideal circuit": of_circuit,
    "macro circuit": lambda: of_circuit(level=macro()),
    "transistor circuit": lambda: of_circuit(level=transistor()),
    "emulation": of_emulation,
    **{f"export {form}": (lambda form=form: of_format(form)) for form in FORMATS},
}


def values() -> dict[str, float | str]:
    """Return the largest relative error of every realisation, or the message of its refusal."""
    found: dict[str, float | str] = {}
    for name, case in CASES.items():
        try:
            found[name] = case()
        except AnnDcError as refusal:
            found[name] = str(refusal)
    return found


if __name__ == "__main__":
    print(json.dumps(values()))
