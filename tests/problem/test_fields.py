"""Names that mean something elsewhere too: refused only where they could not be told apart."""

import re

import numpy as np
import pytest
import sympy as sp

import ann_dc
from ann_dc import plotting
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.decomposition.latex import as_latex
from ann_dc.errors import ProblemError
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.toml_file import load_problem

KINDS = [ann_dc.PreconditionerKind.DIAGONAL]


def named(state="x", control="a", given="w") -> OptimalControlProblem:
    x, a, w = sp.symbols([state, control, given])
    return OptimalControlProblem(
        states=(x,), controls=(a,), inputs={w: 0.1}, dynamics=(a + w - sp.sin(x),), dt=0.1,
        cost=a**2 + w * x**2 / 9, horizon=4, q_0=(0.2,), q_d=(1,),
    )  # fmt: skip


FILE = """
states = ["{0}"]
controls = ["{1}"]
dt = 0.1
horizon = 4
q_0 = [0.2]
q_d = [1]
cost = "{1}**2 + {2}*{0}**2/9"
dynamics = {{{0} = "{1} + {2} - sin({0})"}}
inputs = {{{2} = 0.1}}
"""

NAMES = [
    ("mu", "beta", "k"), ("beta", "t", "N"), ("t", "mu", "E"), ("k", "q", "mu"), ("u", "q", "t"),
    ("N", "E", "I"), ("q_0", "one", "oo"), ("one", "q_d", "self"), ("m", "c", "b"),
    ("numpy", "x0", "zoo"),
]  # fmt: skip


@pytest.fixture(scope="module")
def plain():
    return ann_dc.solve(named(), preconditioner=KINDS)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("names", NAMES, ids=" ".join)
def test_a_name_that_can_be_told_apart_goes_all_the_way(names, plain, tmp_path):
    state, control, given = names
    problem = named(*names)
    solution = ann_dc.solve(problem, preconditioner=KINDS)
    np.testing.assert_allclose(solution[state], plain["x"], rtol=1e-9)
    np.testing.assert_allclose(solution[control], plain["a"], rtol=1e-9)
    for population in ("q", "t", "mu", "beta"):
        mine, theirs = solution[f"{population}.{state}"], plain[f"{population}.x"]
        np.testing.assert_allclose(mine, theirs, rtol=1e-6, atol=1e-9)
        np.testing.assert_array_equal(solution.populations[population][:, 0], mine)
    assert problem.with_inputs(**{given: 0.3}).inputs[sp.Symbol(given)][0] == 0.3
    assert str(solution.equations)
    assert as_latex(solution.equations)

    file = tmp_path / "problem.toml"
    file.write_text(FILE.format(*names), encoding="utf-8")
    assert load_problem(file).f == problem.f
    ann_dc.save(solution.network, tmp_path / "network.npz")
    loaded = ann_dc.load(tmp_path / "network.npz")
    np.testing.assert_array_equal(loaded.start_state, solution.network.start_state)
    backend = SpiceBackend()
    circuit, probe = backend.prepare(solution.network)
    assert backend.deck(circuit, probe, {}).parts == backend.deck(*plain_circuit(plain), {}).parts


def plain_circuit(plain):
    return SpiceBackend().prepare(plain.network)


def test_figures_take_such_names():
    solution = ann_dc.solve(named("mu", "t", "k"), preconditioner=KINDS)
    pictures = (plotting.trajectory, plotting.controls, plotting.settling)
    axes = [axes for picture in pictures for axes in picture(solution).axes]
    words = [one.get_ylabel() for one in axes]
    words += [word for one in axes for word in one.get_legend_handles_labels()[1]]
    assert any("mu" in word for word in words)


@pytest.mark.parametrize(
    ("names", "reason"),
    [
        ({"state": "sin"}, "formulas in text form use it for a function"),
        ({"control": "pi"}, "formulas in text form use it for a function or a number"),
        ({"state": "nan"}, "tables and files use it for a number"),
        ({"given": "one"}, "the node of constants has this name"),
        ({"given": "q_d"}, "with_inputs and --set use it"),
        ({"state": "a__b"}, "netlists write the stage behind a double '_'"),
    ],
)
def test_a_name_that_cannot_is_refused_with_the_reason(names, reason):
    with pytest.raises(ProblemError, match=re.escape(reason)):
        named(**names)
