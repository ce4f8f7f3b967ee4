"""Verilog-A: modules are well formed, and their equations, integrated, settle to the optimum.

No compiler of Verilog-A is at hand. The modules are elaborated here instead, by the rules of the
language: every contribution becomes an equation of a node, every ``idt`` a state.
"""

import csv
import io
import re

import numpy as np
import pytest
from netlist_problems import CASES, PROBLEMS
from scipy.integrate import solve_ivp
from verilog_modules import modules_of

import ann_dc
from ann_dc.errors import ExportError
from ann_dc.export.netlists.verilog_a import verilog_a_files
from ann_dc.export.reference.vector import reference_vector

KINDS = [ann_dc.PreconditionerKind.DIAGONAL]
FUNCTIONS = {"ln": np.log, "max": max, "min": min} | {
    name: getattr(np, name) for name in ("sin", "cos", "tan", "exp", "sqrt", "tanh", "sinh", "cosh")
} | {"atan": np.arctan, "asin": np.arcsin, "acos": np.arccos}  # fmt: skip


class Circuit:
    """A module with all that is in it, as equations: V of driven nodes, I into virtual grounds."""

    def __init__(self, text: str) -> None:
        self.modules = modules_of(text)
        self.driven: dict[str, str] = {"rst": "0.0"}
        self.currents: dict[str, list[str]] = {}
        self.rates: list[str] = []
        self._open("network", {}, {}, "")

    def _open(self, name: str, nets: dict[str, str], given: dict[str, float], path: str) -> None:
        module = self.modules[name]
        values = {n: float(text) for n, text in module.parameters.items()} | given
        where = {node: nets.get(node, path + node) for node in module.nodes}
        where |= dict.fromkeys(module.grounds, "0")
        for access, names, expression in module.contributions:
            ends = [where[module.branches.get(n, n)] for n in names]
            equation = self._equation(expression, where, module.branches, values)
            if access == "I":
                self.currents.setdefault(ends[1], []).append(equation)
            else:
                assert ends[0] not in self.driven, f"{ends[0]} is driven twice"
                self.driven[ends[0]] = equation
        for instance in module.instances:
            inner = self.modules[instance.module]
            ports = dict(zip(inner.ports, (where[net] for net in instance.nets)))
            own = {n: eval(e, {"__builtins__": {}}, values) for n, e in instance.given.items()}
            self._open(instance.module, ports, own, f"{path}{instance.name}.")

    def _equation(self, text, where, branches, values) -> str:
        """An expression of Python with numbers for parameters, V[...] and I(...) for accesses."""
        text = re.sub(r"\s+", " ", text)
        text = re.sub(r"\bV\((\w+), (\w+)\)", r"(V(\1) - V(\2))", text)
        text = re.sub(r"\bV\((\w+)\)", lambda m: f"V['{where[branches.get(m[1], m[1])]}']", text)
        text = re.sub(r"\bI\((\w+)\)", lambda m: f"I['{where[branches[m[1]]]}']", text)
        for name in sorted(values, key=len, reverse=True):
            text = re.sub(rf"(?<![\w'.\]]){name}(?![\w'(])", repr(float(values[name])), text)
        return self._states(text)

    def _states(self, text: str) -> str:
        """The state of an ``idt``, whose rate is what it integrates."""
        place = text.find("idt(")
        if place < 0:
            return _conditional(text)
        depth, ends = 0, []
        for at in range(place + 3, len(text)):
            depth += {"(": 1, ")": -1}.get(text[at], 0)
            if (depth == 1 and text[at] == ",") or depth == 0:
                ends.append(at)
            if depth == 0:
                break
        self.rates.append(_conditional(text[place + 4 : ends[0]]))
        state = f"S[{len(self.rates) - 1}]"
        return text[:place] + state + text[ends[-1] + 1 :]

    def settled(self, seconds: float, nodes: list[str]) -> np.ndarray:
        """Volts of nodes after so many seconds, from the state in which ``idt`` starts."""
        driven = {node: compile(text, node, "eval") for node, text in self.driven.items()}
        drawn = {n: compile(" + ".join(each), n, "eval") for n, each in self.currents.items()}
        rates = [compile(text, "idt", "eval") for text in self.rates]

        def of(state):
            """What is known at a state, worked out where it is asked for."""
            known = {**FUNCTIONS, "__builtins__": {}, "S": state}
            known["V"] = Lazy(driven, known, {"0": 0.0})
            known["I"] = Lazy(drawn, known, {})
            return known

        def rate(_, state):
            known = of(state)
            return np.array([eval(code, known) for code in rates])

        start, first = np.zeros(len(rates)), 1e-6 * seconds
        run = solve_ivp(rate, (0, seconds), start, rtol=1e-6, atol=1e-19, first_step=first)
        end = of(run.y[:, -1])["V"]
        return np.array([end[node] for node in nodes])


class Lazy(dict):
    """Values by node, from compiled equations."""

    def __init__(self, codes, known, given) -> None:
        super().__init__(given)
        self.codes, self.known = codes, known

    def __missing__(self, node):
        self[node] = eval(self.codes[node], self.known)
        return self[node]


def _conditional(text: str) -> str:
    """``a ? b : c`` and ``&&``, ``||`` in Python's words."""
    text = text.replace("&&", " and ").replace("||", " or ")
    found = re.fullmatch(r"(.*)\?(.*):(.*)", text)
    return f"(({found[2]}) if ({found[1]}) else ({found[3]}))" if found else text


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", [*CASES, pytest.param("car", marks=pytest.mark.slow)])
def test_the_equations_settle_to_the_optimum(name):
    problem = ann_dc.plants.car() if name == "car" else PROBLEMS[name]()
    network = ann_dc.design(problem, preconditioner=KINDS).network
    files = verilog_a_files(network, reference_vector(network))
    seconds = float(re.search(rb"wait until (\S+) s", files["README.md"])[1])
    rows = [*csv.DictReader(io.StringIO(files["expected_controls.csv"].decode()))]
    volts = Circuit(files["network.va"].decode()).settled(seconds, [row["node"] for row in rows])
    expected = np.array([float(row["volts"]) for row in rows])
    np.testing.assert_allclose(volts, expected, atol=1e-5 * np.abs(expected).max())


def test_a_cell_is_a_module_and_the_row_is_one_of_cells(car):
    files = verilog_a_files(*car)
    modules = modules_of(files["network.va"].decode())
    assert [each.module for each in modules["network"].instances] == [
        "cell_0", *["cell_1"] * 7, "cell_2"
    ]  # fmt: skip
    assert {"integ", "pi_cell", "inv", "mul4q", "func_sin", "func_cos", "func_tan"} < set(modules)
    assert "sum" not in modules
    inside = [each.module for each in modules["cell_1"].instances]
    assert (inside.count("pi_cell"), inside.count("integ"), inside.count("mul4q")) == (8, 10, 10)
    assert (len(modules), len(modules["network"].instances)) == (11, 9)


def test_what_cannot_be_built_is_refused():
    grid = ann_dc.design(
        ann_dc.plants.double_integrator(N=5),
        preconditioner=ann_dc.PreconditionerKind.RESISTIVE_GRID,
    ).network
    with pytest.raises(ExportError, match="behavioural circuits cannot build a resistive grid"):
        verilog_a_files(grid, reference_vector(grid))


def test_that_nothing_has_run_it_is_said(small):
    said = verilog_a_files(*small)["README.md"].decode()
    assert "No simulator has run this file" in said
    assert "drops every instance" in said
